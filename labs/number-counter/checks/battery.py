"""Checks of the battery's times, by the LED that it switches."""

from dataclasses import dataclass

from grader.own_checks import (
    AnyStep,
    Context,
    EarlierCheckId,
    Finding,
    Process,
    Topic,
    failed,
    graded,
    not_reached,
    ramp,
    unexplained,
)

#: Error of a time that the battery may have beside the delays of the machine, in s.
SLACK_S = 0.3


@dataclass
class Parameters:
    topic: Topic
    process: Process
    #: Number of the LED, from 1.
    led: int
    #: Time in s from the battery's start to the LED's first light, or from that to dark again.
    time_s: float


@dataclass
class GoesOn:
    topic: Topic
    process: Process
    #: Number of the LED, from 1.
    led: int
    #: The battery's node is in the graph at the end of this step.
    up: AnyStep
    #: Time in s for full credit, and time without any.
    within_s: float
    none_from_s: float
    #: Checks that charge a panel without messages, and one that is late with them.
    panel: list[EarlierCheckId]
    late_panel: EarlierCheckId


@dataclass
class Change:
    """A change of the LED: after one message at `after_s`, by the next one at `seen_s`."""

    after_s: float
    seen_s: float


def goes_on(context: Context, p: GoesOn) -> Finding:
    """The LED goes on when the battery is empty for the first time; a late battery earns a part."""
    expected = f"LED {p.led} on within {p.within_s:g} s"
    up = context.step(p.up)
    if up is None:
        return not_reached("The battery's node did not come up.", expected=expected)
    where = (context.location(p.topic),)
    states = context.messages(p.topic).numbers("states")
    if all(each is None for each in states):
        reason = "No message with the states of the LEDs was recorded."
        return context.charge(failed(expected, "no states", reason, where=where), None, p.panel)
    changes = _changes(context, p)
    if not changes:
        reason = f"LED {p.led} did not go on in the {context.duration_s - up.ended_s:.1f} s that the battery ran."
        finding = unexplained(failed(expected, "it stays off", reason, where=where))
    else:
        finding = _lit(context, p, up.ended_s, changes[0].seen_s)
    return context.charge(finding, None, [p.late_panel])


def _lit(context: Context, p: GoesOn, up_s: float, lit_s: float) -> Finding:
    """Judge the time from the battery's start to the LED's first light; shorter delays of the machine are in its limit."""
    late_s = lit_s - up_s
    delay_s = max(0.0, context.longest_delay_s(up_s, lit_s) - SLACK_S)
    share = ramp(late_s, p.within_s, p.none_from_s)
    best = ramp(late_s - delay_s, p.within_s, p.none_from_s)
    reason = f"LED {p.led} went on {late_s:.1f} s after the battery's node came up; {p.within_s:g} s are allowed."
    where = (context.location(p.topic),)
    expected = f"LED {p.led} on within {p.within_s:g} s"
    return graded(share, expected, f"on after {late_s:.1f} s", reason, where=where, best=best)


def waits(context: Context, p: Parameters) -> Finding:
    """The LED is dark until the battery is empty; the battery starts later than its program."""
    run = context.process(p.process)
    if run is None:
        return not_reached("The battery did not run.")
    changes = _changes(context, p)
    expected = f"dark for {p.time_s:g} s"
    if not changes:
        return not_reached(f"LED {p.led} was not seen to go on.")
    dark_s = changes[0].seen_s - run.started_s
    measured = f"on {dark_s:.1f} s after the start of the program"
    reason = (
        f"LED {p.led} goes on {dark_s:.1f} s after the start of the battery's program, "
        f"and the battery is full for {p.time_s:g} s."
    )
    return graded(float(dark_s > p.time_s - SLACK_S), expected, measured, reason)


def stays(context: Context, p: Parameters) -> Finding:
    """The LED is on while the battery is empty; the panel's messages bound the time from both sides."""
    changes = _changes(context, p)
    expected = f"on for {p.time_s:g} s"
    if not changes:
        return not_reached(f"LED {p.led} was not seen to go on.")
    on = changes[0]
    seen = context.messages(p.topic).received_s
    if len(changes) < 2:
        lit_s = float(seen[-1]) - on.seen_s
        if lit_s < p.time_s + SLACK_S:
            return not_reached(f"LED {p.led} went on so late that the session ended {lit_s:.1f} s afterwards.")
        reason = f"LED {p.led} was still on {lit_s:.1f} s after it went on, and the battery is empty for {p.time_s:g} s."
        return failed(expected, "it stays on", reason)
    off = changes[1]
    delay_s = context.longest_delay_s(on.after_s, off.seen_s)
    least_s = off.after_s - on.seen_s - delay_s - SLACK_S
    most_s = off.seen_s - on.after_s + delay_s + SLACK_S
    lit_s = off.seen_s - on.seen_s
    measured = f"on for {lit_s:.1f} s"
    reason = f"LED {p.led} was on for {lit_s:.1f} s, and the battery is empty for {p.time_s:g} s."
    return graded(float(least_s <= p.time_s <= most_s), expected, measured, reason)


def _changes(context: Context, p: Parameters | GoesOn) -> list[Change]:
    """Return the changes of the LED, which is dark before the first message."""
    messages = context.messages(p.topic)
    changes = []
    is_on = False
    before_s = 0.0
    for time_s, states in zip(messages.received_s, messages.numbers("states"), strict=True):
        if states is None:
            continue
        if len(states) < p.led:
            continue
        if bool(states[p.led - 1]) != is_on:
            is_on = not is_on
            changes.append(Change(before_s, float(time_s)))
        before_s = float(time_s)
    return changes

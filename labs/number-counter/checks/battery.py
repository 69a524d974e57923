"""Checks of the battery's times, by the LED that it switches."""

from dataclasses import dataclass

from grader.own_checks import Context, Finding, Process, Topic, failed, graded, not_reached

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
class Change:
    """A change of the LED: after one message at `after_s`, by the next one at `seen_s`."""

    after_s: float
    seen_s: float


def waits(context: Context, p: Parameters) -> Finding:
    """The LED is dark until the battery is empty, some seconds after the start of its program."""
    run = context.process(p.process)
    changes = _changes(context, p)
    expected = f"dark for {p.time_s:g} s"
    if not (run and changes):
        return not_reached(f"LED {p.led} never went on.")
    dark_s = changes[0].seen_s - run.started_s
    measured = f"on {dark_s:.1f} s after the start of the program"
    seen = f"LED {p.led} goes on {dark_s:.1f} s after the start of the battery's program"
    reason = f"{seen}, and the battery is full for {p.time_s:g} s."
    return graded(float(dark_s > p.time_s - SLACK_S), expected, measured, reason)


def stays(context: Context, p: Parameters) -> Finding:
    """The LED is on while the battery is empty; the panel's messages bound the time from both sides."""
    changes = _changes(context, p)
    expected = f"on for {p.time_s:g} s"
    if not changes:
        return not_reached(f"LED {p.led} never went on.")
    on = changes[0]
    seen = context.messages(p.topic).received_s
    if len(changes) < 2:
        lit_s = float(seen[-1]) - on.seen_s
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


def _changes(context: Context, p: Parameters) -> list[Change]:
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

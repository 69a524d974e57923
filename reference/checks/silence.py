"""Check of a topic that falls silent after a step."""

from __future__ import annotations

from pydantic import BaseModel, Field

from grader.own_checks import (
    AnyStep,
    Context,
    Finding,
    Topic,
    apart,
    check,
    cpu_delay_doubt,
    graded,
    not_reached,
    ramp,
)


class StopsPublishing(BaseModel):
    """A topic falls silent after a step, and stays so."""

    topic: Topic
    step: AnyStep = Field(description="Label of the step that ends it.")
    within_s: float = Field(gt=0, description="Time after the step in which it may still publish.")
    none_from_s: float | None = Field(
        None, gt=0, description="Later messages leave no credit; else none are allowed."
    )
    until: AnyStep | None = Field(
        None, description="Label of the step before which it counts; else the end."
    )


@check(commands=("ros2 topic echo {topic}",))
def stops_publishing(context: Context, p: StopsPublishing) -> Finding:
    """Judge the last message after the step."""
    expected = f"nothing on {p.topic} later than {p.within_s:g} s after '{p.step}'"
    step = context.step(p.step)
    if step is None:
        reason = f"Not tested, because the step '{p.step}' was not reached."
        return not_reached(reason, expected=expected)
    sent_s = context.messages(p.topic).sent_s
    if not (sent_s <= step.ended_s).any():
        reason = f"Not tested, because nothing was published before '{p.step}'."
        return not_reached(reason, expected=expected)
    sent_s = sent_s[sent_s <= _until_s(context, p)]
    last_s = float(sent_s.max(initial=step.ended_s))
    late_s = last_s - step.ended_s
    delay_s = context.longest_delay_s(step.ended_s, last_s)
    count = int((sent_s > step.ended_s + p.within_s).sum())
    shown = apart(late_s, p.within_s, places=2)
    return graded(
        _share(p, late_s),
        expected,
        f"last message {shown} s after the step",
        f"{count} messages came later, the last one {shown} s after the step.",
        where=(context.location(p.topic, span_s=(step.ended_s, last_s)),),
        best=_share(p, late_s - delay_s),
        doubt=cpu_delay_doubt(delay_s, late_s),
        levels=_LEVELS,
    )


#: Credit levels of the time after which a topic falls silent.
_LEVELS = 10


def _until_s(context: Context, p: StopsPublishing) -> float:
    """Return the end of the time that counts, in s since the session's start."""
    until = context.step(p.until) if p.until is not None else None
    return until.started_s if until is not None else context.duration_s


def _share(p: StopsPublishing, late_s: float) -> float:
    """Return the credit of a last message so long after the step."""
    return ramp(late_s, p.within_s, p.none_from_s or p.within_s)

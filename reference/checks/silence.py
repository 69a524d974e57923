"""Check of a topic that falls silent after a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
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
    is_earlier = sent_s <= step.ended_s
    if not is_earlier.any():
        reason = f"Not tested, because nothing was published before '{p.step}'."
        return not_reached(reason, expected=expected)
    counted_s = sent_s[sent_s <= _until_s(context, p)]
    return _judge_last(context, p, expected, step.ended_s, counted_s)


def _judge_last(
    context: Context,
    p: StopsPublishing,
    expected: str,
    ended_s: float,
    sent_s: NDArray[np.float64],
) -> Finding:
    """Judge the time of the last message after the end of the step."""
    last_s = float(sent_s.max(initial=ended_s))
    late_s = last_s - ended_s
    is_late = sent_s > ended_s + p.within_s
    shown = apart(late_s, p.within_s, places=2)
    measured = f"last message {shown} s after the step"
    reason = f"{is_late.sum()} messages came later, the last one {shown} s after the step."
    share = _share(p, late_s)
    delay_s = context.longest_delay_s(ended_s, last_s)
    best = _share(p, late_s - delay_s)
    doubt = cpu_delay_doubt(delay_s, late_s)
    where = context.location(p.topic, span_s=(ended_s, last_s))
    return graded(
        share,
        expected,
        measured,
        reason,
        where=(where,),
        best=best,
        doubt=doubt,
        levels=_LEVELS,
    )


#: Credit levels of the time after which a topic falls silent.
_LEVELS = 10


def _until_s(context: Context, p: StopsPublishing) -> float:
    """Return the end of the time that counts, in s since the session's start."""
    until = None
    if p.until is not None:
        until = context.step(p.until)
    if until is None:
        return context.duration_s
    return until.started_s


def _share(p: StopsPublishing, late_s: float) -> float:
    """Return the credit of a last message so long after the step."""
    none_from_s = p.within_s
    if p.none_from_s is not None:
        none_from_s = p.none_from_s
    return ramp(late_s, p.within_s, none_from_s)

"""A check of the drive commands of the launched talker."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from grader.own_checks import (
    Context,
    EarlierCheckId,
    Finding,
    Part,
    PlanLabel,
    Topic,
    Window,
    failed,
    of_parts,
)

_FIELDS = {"drive.speed": ("speed", "v"), "drive.steering_angle": ("steering angle", "d")}


@dataclass
class Parameters:
    topic: Topic
    window: Window
    silence_charged_by: EarlierCheckId
    plan: PlanLabel = "plan"


def drives(context: Context, p: Parameters) -> Finding:
    """Both numbers are other than zero: the launch file has set the parameters."""
    expected = "a speed and a steering angle other than zero"
    messages = context.messages(p.topic, window=p.window)
    if not len(messages):
        reason = "The launched nodes sent no drive command."
        return context.charge(failed(expected, "no messages", reason), None, [p.silence_charged_by])
    left_out = _left_out(context, p.plan)
    parts = []
    for field, (name, parameter) in _FIELDS.items():
        if parameter in left_out:
            # Its argument is not declared, which costs points where the file is loaded.
            parts.append(Part(1.0, f"{parameter} left out"))
            continue
        numbers = [each for each in messages.numbers(field) if each is not None]
        parts.append(_is_set(numbers, name, parameter))
    where = (context.location(p.topic),)
    return of_parts(expected, parts, where=where)


def _left_out(context: Context, plan: str) -> set[str]:
    """Return the parameters that a repaired launch file gives no process, because their argument is not declared."""
    step = context.step(plan)
    if step is None:
        return set()
    left_out = step.found.left_out
    names = set()
    if left_out:
        for each in left_out.values():
            names.update(each)
    return names


def _is_set(numbers: list[Any], name: str, parameter: str) -> Part:
    if not np.any(numbers):
        reason = f"The {name} is 0 in all messages: the launch file gives the talker no {parameter} other than 0."
        return Part(0.0, f"{name} 0", reason)
    return Part(1.0, f"{name} {float(np.median(numbers)):g}")

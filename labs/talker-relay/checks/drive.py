"""A check of the drive commands of the launched talker."""

from dataclasses import dataclass

import numpy as np

from grader.own_checks import (
    Context,
    EarlierCheckId,
    Finding,
    Part,
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


def drives(context: Context, p: Parameters) -> Finding:
    """Both numbers are other than zero: the launch file has set the parameters."""
    expected = "a speed and a steering angle other than zero"
    messages = context.messages(p.topic, window=p.window)
    if not len(messages):
        reason = "No drive command came while both nodes ran."
        return context.charge(failed(expected, "no messages", reason), None, [p.silence_charged_by])
    parts = []
    for field, (name, parameter) in _FIELDS.items():
        numbers = [each for each in messages.numbers(field) if each is not None]
        parts.append(_is_set(numbers, name, parameter))
    where = (context.location(p.topic),)
    return of_parts(expected, parts, where=where)


def _is_set(numbers, name, parameter):
    if not np.any(numbers):
        reason = f"The {name} is 0 in all messages: the launch file gives the talker no {parameter} other than 0."
        return Part(0.0, f"{name} 0", reason)
    return Part(1.0, f"{name} {float(np.median(numbers)):g}")

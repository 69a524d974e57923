"""Finds how well students' code can be confined on this machine, and refuses to grade with less than is required."""

from __future__ import annotations

from pathlib import Path

from confine import probing
from confine.isolation import Isolation, Level
from grader.errors import IsolationError
from grader.live.sandbox.installation import wheels_of
from grader.live.sandbox.room import StudentRoom, made_room


def probe_isolation(interpreter: Path) -> Isolation:
    """Find the strongest confinement of students' programs that works here."""
    return probing.probe_isolation(interpreter, _room_of)


def _room_of(scratch: Path, interpreter: Path) -> StudentRoom:
    return made_room(scratch, wheels_of(interpreter))


def require(isolation: Isolation, least: Level) -> None:
    """Raise `IsolationError`, with the one thing that would fix it, unless the confinement is good enough."""
    if isolation.level.at_least(least):
        return
    remedy = isolation.remedy
    if least is Level.REDUCED:
        remedy += " If you trust this code, add --trust-code."
    raise IsolationError(
        f"students' code can be confined here at the level '{isolation.level.value}' only, "
        f"and '{least.value}' is required",
        remedy=f"{remedy} `grade doctor` shows more.",
    )

"""What the first process of a session's sandbox needs to know."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grader.live.isolation import Isolation
from grader.live.ros_launch import NativeLaunch
from grader.recording.session import SessionRecord


@dataclass(frozen=True)
class PlannedStep:
    """A step with its parameters as plain data, and the words in which it is shown while it runs."""

    kind: str
    parameters: dict[str, Any]
    label: str | None
    words: str


@dataclass(frozen=True)
class SessionPlan:
    """All that the process of a session needs to know.

    Attributes
    ----------
    record : SessionRecord
        With what is known before the session.
    folder, scratch : Path
        The recording's folder, and one of the session's own that the caller removes.
    executables, sources : dict
        Artifact -> wrapper relative to `staged`, and -> source relative to `staged`/src.
    reference : dict
        Reference node -> {"file": absolute path, "node": fully qualified name}.
    expected : list of str
        Names of topics, services and nodes that the rubric uses.
    """

    record: SessionRecord
    steps: list[PlannedStep]
    folder: Path
    scratch: Path
    staged: Path
    executables: dict[str, str]
    sources: dict[str, str]
    reference: dict[str, dict[str, str]]
    expected: list[str]
    isolation: Isolation
    interpreter: Path
    slot: int
    domain_id: int
    timeout_s: float
    native: NativeLaunch | None = None

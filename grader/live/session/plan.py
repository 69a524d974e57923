"""The plan of a session, for the first process of its sandbox."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from confine.isolation import Isolation
from grader.lab.steps.base import Step
from grader.live.sandbox.environment import NativeLaunch
from grader.live.sandbox.installation import Installation
from grader.live.session.program import StudentProgram
from grader.recording.session import SessionRecord, StepRun


@dataclass(frozen=True)
class SessionPlan:
    """Everything that the process of a session needs.

    The `record` holds facts from before the session, `steps` its steps, each with its entry for the record; the caller
    removes `scratch`. For each artifact there are the program below `staged`, and the source's path relative to
    `staged`/src; for each reference node the absolute path of its "file" and its full name as "node".
    `expected` are the names of topics, services and nodes that the rubric uses. In the folder `interfaces` are the
    prefixes of packages that were built. `crash_library` names the frames of a compiled program that crashes.
    """

    record: SessionRecord
    steps: list[tuple[StepRun, Step]]
    folder: Path
    scratch: Path
    staged: Path
    programs: dict[str, StudentProgram]
    sources: dict[str, str]
    reference: dict[str, dict[str, str]]
    expected: list[str]
    isolation: Isolation
    installation: Installation
    slot: int
    domain_id: int
    timeout_s: float
    native: NativeLaunch | None = None
    interfaces: Path | None = None
    crash_library: Path | None = None

"""What the first process of a session's sandbox needs to know."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from confine.isolation import Isolation
from grader.lab.steps.base import Step
from grader.live.sandbox.environment import NativeLaunch
from grader.recording.session import SessionRecord, StepRun


@dataclass(frozen=True)
class SessionPlan:
    """All that the process of a session needs to know.

    The `record` holds what is known before, `steps` what is to be run, each with its entry for the record; the caller
    removes `scratch`. For each artifact there are the wrapper's path relative to `staged`, and the source's
    relative to `staged`/src; for each reference node the absolute path of its "file" and its full name as "node".
    `expected` are the names of topics, services and nodes that the rubric uses. In the folder `interfaces` lie the
    prefixes of packages that were built.
    """

    record: SessionRecord
    steps: list[tuple[StepRun, Step]]
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
    interfaces: Path | None = None

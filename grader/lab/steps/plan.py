"""The step `plan`.

The session does it: `grader.live.session.steps.plan`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import Step, StepResult
from launch_plan.plan import Problem


@dataclass
class Repair:
    """A mistake in a launch file, and how a copy was changed so that the evaluation went on."""

    kind: str
    message: str
    file: str | None = None
    line: int | None = None
    remedy: str = ""
    repair: str = ""


def repair_of(problem: Problem, done: str = "") -> Repair:
    """Return a problem with its repair, or without one."""
    return Repair(
        problem.kind, problem.message, problem.file, problem.line, problem.remedy, repair=done
    )


@dataclass
class PlanResult(StepResult):
    """The plan, in the format of `grader.recording.launch_plan`, and the repaired mistakes."""

    plan: dict[str, Any] | None = None
    mended: list[Repair] | None = None
    #: Parameters left to the nodes, because they depend on an argument without a known value: names by process.
    left_out: dict[str, list[str]] | None = None
    artifact: str | None = None

    @property
    def repairs(self) -> list[Repair]:
        """The repaired mistakes; empty if there is no plan."""
        if self.mended is None:
            return []
        return list(self.mended)

    def note(self) -> str:
        """Write the problem of the launch file as the plan has it."""
        return str((self.plan or {}).get("problem") or "")


class PlanStep(Step):
    """Evaluate a launch file with arguments, without starting what it describes."""

    kind = "plan"
    result = PlanResult
    words = "evaluating {launch}"
    command = "ros2 launch {launch}"

    launch: ref.Artifact
    arguments: dict[str, str] = Field(default_factory=dict)
    assume: dict[str, str] = Field(
        default_factory=dict,
        description="Values for arguments that the file uses without declaring them.",
    )
    timeout_s: float = Field(10.0, gt=0, le=60)

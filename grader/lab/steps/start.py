"""The step `start`.

The session does it: `grader.live.session.steps.start`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from pydantic import Field, model_validator

from grader.lab import references as ref
from grader.lab.lab_code import Settings
from grader.lab.steps.base import Step, StepResult
from grader.lab.yaml_with_lines import mistakes_at


@dataclass
class StartResult(StepResult):
    """True for a process that was started anew, or the started processes of a launch plan."""

    started: bool | None = None
    processes: list[str] | None = None
    #: Omitted prefixes of command lines, by process of a launch plan.
    without_prefix: dict[str, str] | None = None
    artifact: str | None = None

    def note(self) -> str:
        """Name the processes of a launch plan."""
        if self.started is False:
            return "it was running"
        return ", ".join(self.processes or ())


class StartStep(Step):
    """Start a student's artifact, the processes of a launch plan, or a reference node."""

    kind = "start"
    result = StartResult
    words = "starting {target}"
    exactly_one = ("student", "launch", "reference")
    example: ClassVar = {"student": "talker"}

    student: ref.Artifact | None = None
    launch: ref.Artifact | None = None
    reference: ref.ReferenceNode | None = None
    name: str | None = Field(
        None, description="Name of the process; the artifact's by default (student only)."
    )
    parameters: dict[str, Any] = Field(
        default_factory=dict, description="ROS parameters (student only)."
    )
    remappings: dict[str, str] = Field(
        default_factory=dict, description="Name remappings (student only)."
    )
    composed: dict[str, str] = Field(
        default_factory=dict,
        description="Name remappings besides, where the artifact's file holds others too.",
    )
    if_ended: bool = Field(False, description="Start it again only if it has ended.")
    with_: Settings = Field(
        default_factory=dict, alias="with", description="Settings (reference only)."
    )

    @model_validator(mode="after")
    def _is_of_use(self) -> StartStep:
        owners = dict.fromkeys(
            ("name", "parameters", "remappings", "composed", "if_ended"), "student"
        )
        owners["with_"] = "reference"
        mistakes = []
        for key in self.model_fields_set & owners.keys():
            owner = owners[key]
            if getattr(self, owner) is None:
                name = key.rstrip("_")
                mistakes.append(((name,), f"only a {owner} takes it"))
        if mistakes:
            raise mistakes_at(mistakes)
        return self

"""The step `set_parameters`.

The director does it: `grader.live.ros_node.steps.set_parameters`.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import Step, StepResult
from grader.lab.steps.words import fields


@dataclass
class SetParametersResult(StepResult):
    """The reasons of refusals by parameter; for invalid values also the values before and after."""

    node: str | None = None
    refused: dict[str, str | None] | None = None
    #: Rubric's name of a parameter -> the student's, where that is misspelt.
    names: dict[str, str | None] | None = None
    before: dict[str, Any] | None = None
    after: dict[str, Any] | None = None

    @property
    def reasons(self) -> dict[str, str | None]:
        """The reasons for refusals; empty if there was no answer."""
        return {} if self.refused is None else self.refused

    def note(self) -> str:
        """Write the reasons of refusals."""
        if self.refused:
            return f"refused: {fields(self.refused)}"
        return ""


class SetParametersStep(Step):
    """Set parameters of a student's node through its parameter services."""

    kind = "set_parameters"
    result = SetParametersResult
    words = "setting parameters of {node}"

    node: ref.RosName
    values: dict[str, Any]
    refusal_expected: bool = Field(
        False,
        description="The values are invalid; what the node has is kept from before and after, and restored.",
    )
    timeout_s: float = Field(5.0, gt=0, le=60)

    def commands(self) -> Sequence[str]:
        """Return a command for each of the values."""
        commands = []
        for name, value in self.values.items():
            word = json.dumps(value)
            if isinstance(value, str):
                word = shlex.quote(value)
            text = f"{name} {word}".replace("{", "{{").replace("}", "}}")
            commands.append("ros2 param set {node} " + text)
        return commands

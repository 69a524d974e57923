"""The step `get_parameters`.

The director does it: `grader.live.ros_node.steps.get_parameters`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import Field

from grader.lab import references as ref
from grader.lab.steps.base import Step, StepResult
from grader.lab.steps.words import fields


@dataclass
class ParameterValue:
    """The value of a parameter, and the name of its type, e.g. "double"."""

    type: str = ""
    value: Any = None


@dataclass
class GetParametersResult(StepResult):
    """The node, the names of its parameters, and the values of those that were asked for and exist."""

    node: str | None = None
    declared: list[Any] | None = None
    values: dict[str, ParameterValue] | None = None

    def declares(self, name: str) -> bool:
        """Return whether the node is known to declare a parameter."""
        return self.declared is not None and name in self.declared

    @property
    def read(self) -> dict[str, ParameterValue]:
        """The values; empty if there was no answer."""
        return {} if self.values is None else self.values

    def note(self) -> str:
        """Write the values."""
        return fields({name: held.value for name, held in self.read.items()})


class GetParametersStep(Step):
    """Read parameters of a student's node through its parameter services."""

    kind = "get_parameters"
    result = GetParametersResult
    words = "reading parameters of {node}"
    command = "ros2 param dump {node}"

    node: ref.RosName
    names: tuple[ref.GivenName, ...]
    timeout_s: float = Field(5.0, gt=0, le=60)

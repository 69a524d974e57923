"""The parts that all steps share: their parameters and words, and their results as a session's record keeps them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self, cast

from pydantic import ConfigDict

from grader.lab.references import Parameters
from grader.recording.record import from_plain
from grader.recording.session import StepRun

#: Metadata of a field of a result that is left out of the record while it has its default.
ABSENT = {"absent": True}


@dataclass
class StepResult:
    """Base of the results of steps, with all fields optional because a step may end early.

    A session's record keeps it as JSON without the fields that are None: `StepRun.result`, for example
    `{"topic": "/chatter", "matched": true}`.
    """

    #: Reason why the step could not be done.
    problem: str | None = None

    def note(self) -> str:
        """Describe the result in a few words for the report; empty if the outcome says it all."""
        return ""

    @classmethod
    def of(cls, run: StepRun) -> Self:
        """Read the result of a recorded step; keys that an older grader wrote are passed over."""
        return cls.of_plain(run.result)

    @classmethod
    def of_plain(cls, plain: dict[str, Any]) -> Self:
        """Read a result from JSON."""
        known = {each.name for each in dataclasses.fields(cls)}
        kept = {key: value for key, value in plain.items() if key in known}
        return from_plain(cls, kept)

    def to_plain(self) -> dict[str, Any]:
        """Return the result as the record keeps it."""
        plain: dict[str, Any] = _plain(self)
        return {key: value for key, value in plain.items() if value is not None}


def _plain(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if not dataclasses.is_dataclass(value):
        return value
    plain = {}
    for each in dataclasses.fields(value):
        held = getattr(value, each.name)
        if each.metadata != ABSENT or held != each.default:
            plain[each.name] = _plain(held)
    return plain


@dataclass(frozen=True)
class Answer:
    """The outcome of a step, see `StepRun.outcome`, and its result."""

    outcome: str
    result: StepResult = field(default_factory=StepResult)


class Step(Parameters):
    """Base of the steps: the parameters that a rubric gives, and the words for them."""

    #: Messages keep infinite numbers and not-a-numbers, as sensors send them.
    model_config = ConfigDict(ser_json_inf_nan="constants")

    #: Key of the step in a rubric, e.g. "wait_for".
    kind: ClassVar[str]
    #: Description for the progress display and the report. Of `exactly_one`, `{key}` and `{target}` stand for the
    #: name of the given key and its value.
    words: ClassVar[str]
    #: Command that does the same in a terminal, with names of parameters, e.g. "ros2 param dump {node}"; empty if
    #: there is none.
    command: ClassVar[str] = ""
    #: Type of the result.
    result: ClassVar[type[StepResult]] = StepResult

    @classmethod
    def given(cls, run: StepRun) -> Self:
        """Return the parameters of a recorded step.

        A parameter that an older grader did not have gets its default, or None if it is required now.
        """
        required = {name for name, info in cls.model_fields.items() if info.is_required()}
        given = {**dict.fromkeys(required), **run.parameters}
        return cast(Self, cls.model_construct(**given))

    def describe(self) -> str:
        """Describe the step in a few words."""
        key = ""
        for each in self.exactly_one:
            if getattr(self, each) is not None:
                key = each
                break
        target = getattr(self, key, "")
        return self.words.format(key=key.replace("_", " "), target=target, **vars(self))

    def commands(self) -> Sequence[str]:
        """Return the commands that do the same in a terminal, as templates with names of its parameters."""
        return [self.command] if self.command else []

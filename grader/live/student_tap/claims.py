"""Reads the tap's notes from a student's process with care: any code in that process can write to its pipe."""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    StrictBool,
    StrictFloat,
    StrictInt,
)

from grader.recording.session import Claim
from ros_bag.qos import Qos

_MOST_CLAIMS = 2000
_LONGEST_TEXT = 500
_LARGEST_INTEGER = 2**63 - 1

_Text = Annotated[str, AfterValidator(lambda text: text[:_LONGEST_TEXT])]
_Number = Annotated[int, Field(ge=0, le=10**7)]
_Integer = Annotated[StrictInt, Field(ge=-_LARGEST_INTEGER, le=_LARGEST_INTEGER)]


class _Policies(BaseModel):
    model_config = ConfigDict(strict=True)

    reliability: _Text = ""
    durability: _Text = ""
    history: _Text = ""
    depth: _Number = 0


class _Note(BaseModel):
    model_config = ConfigDict(strict=True)

    kind: _Text
    name: _Text
    node: _Text
    file: _Text
    line: _Number
    type: _Text = ""
    qos: _Policies | None = None
    value: StrictBool | _Integer | StrictFloat | _Text | None = None


def claims_in(text: str, process: str, above: str) -> list[Claim]:
    """Read the lines of the tap in a process, and drop `above` from paths; a line that is not a note is skipped."""
    found = []
    for line in text.split("\n")[:_MOST_CLAIMS]:
        with suppress(ValueError):
            note = _Note.model_validate_json(line)
            qos = None
            if note.qos:
                qos = Qos(**note.qos.model_dump(exclude_unset=True))
            file = note.file.removeprefix(above)
            plain = note.model_dump(exclude={"qos", "file"})
            found.append(Claim(process, file=file, qos=qos, **plain))
    return found

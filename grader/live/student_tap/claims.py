"""What the tap in a student's process notes, taken with care: any code in that process can write to its pipe."""

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

from grader.recording.session import Claim, Qos

_MOST_CLAIMS = 2000
_LONGEST_TEXT, _LARGEST_INTEGER = 500, 2**63 - 1

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
    """Read the lines that the tap in a process wrote, and drop `above` from paths; what is no note is passed over."""
    found = []
    for line in text.split("\n")[:_MOST_CLAIMS]:
        with suppress(ValueError):
            note = _Note.model_validate_json(line)
            policies = Qos(**note.qos.model_dump(exclude_unset=True)) if note.qos else None
            plain = note.model_dump(exclude={"qos", "file"})
            found.append(Claim(process, file=note.file.removeprefix(above), qos=policies, **plain))
    return found

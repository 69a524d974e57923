"""The launch files in `cases/`, each with expected parts of its plan; the README there has the format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from grader import yaml_text

FOLDER = Path(__file__).parent / "cases"
HEADER = (FOLDER / "header.txt").read_text(encoding="utf-8")
FOOTER = "\n    ])\n"


@dataclass(frozen=True)
class Case:
    """A launch file and expected parts of its plan."""

    name: str
    text: str
    expect: Mapping[str, Any]
    arguments: Mapping[str, str]
    files: Mapping[str, str]
    filename: str
    is_compared: bool


class _Read(BaseModel):
    """Refuses keys that the format does not have."""

    model_config = ConfigDict(extra="forbid", strict=True)


class _Entities(_Read):
    """Entities of a Python launch file."""

    entities: str

    def in_header(self, before: str = "") -> str:
        """Return the whole launch file."""
        return before + HEADER + self.entities + FOOTER


class _CaseFile(_Read):
    """The contents of a case's file."""

    case: str
    not_compared: Literal["later patch", "own answer"] | None = None
    filename: str = "x_launch.py"
    before: str = ""
    text: str | None = None
    entities: str | None = None
    arguments: dict[str, str] = {}
    files: dict[str, str | _Entities] = {}
    expect: dict[str, Any]


def read_case(path: Path) -> Case:
    """Read a case from its file."""
    plain = yaml_text.load(path.read_text(encoding="utf-8"))
    given = _CaseFile.model_validate(plain)
    assert (given.text is None) != (given.entities is None), f"{path}: text or entities"
    expect = given.expect
    text = given.text or ""
    if given.entities is not None:
        text = _Entities(entities=given.entities).in_header(given.before)
        expect = _from_first_line(expect, (given.before + HEADER).count("\n"))
    files: dict[str, str] = {}
    for name, file in given.files.items():
        if isinstance(file, _Entities):
            file = file.in_header()
        files[name] = file
    is_compared = given.not_compared is None
    return Case(given.case, text, expect, given.arguments, files, given.filename, is_compared)


def _from_first_line(expect: Mapping[str, Any], lines_above: int) -> dict[str, Any]:
    """Count the expected line numbers of entities from the first line of the whole file."""
    counted = dict(expect)
    for path, value in expect.items():
        if path.endswith(".line") and value is not None:
            counted[path] = value + lines_above
    return counted


CASES = [read_case(path) for path in sorted(FOLDER.rglob("*.yaml"))]

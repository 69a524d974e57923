"""`overrides.yaml`: what people decide about single submissions, each with reason, name and date.

It lies beside the results, so that no regrade can lose it. All its mistakes are reported at once, by line.
"""

from __future__ import annotations

import hashlib
import unicodedata
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import date, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from grader.lab.policy import Moment, TimeSpan, parse_time
from grader.lab.rubric import Rubric
from grader.lab.yaml_with_lines import (
    Loc,
    Mistakes,
    Strict,
    meant,
    mistakes_at,
    parse_yaml,
    read_text,
)

OVERRIDES_FILE = "overrides.yaml"
#: Stands for all submissions.
EVERYONE = "*"

_WHAT = "the file of overrides"
_CHANGES = ("set", "add", "excused", "bonus", "extension", "due", "submitted", "reviewed", "appeal")
_OF_A_PART = ("set", "add", "excused", "appeal")
#: What needs no reason: it changes nothing.
_WITHOUT_REASON = {"reviewed", "appeal", "comment"}


def _points(value: Any) -> Any:
    try:
        points = Decimal(str(value))
    except InvalidOperation:
        points = Decimal("NaN")
    if not points.is_finite() or abs(points) > 1_000_000:
        raise ValueError("a number of points is expected")
    if points != round(points, 2):
        raise ValueError("points have at most two decimals")
    return points


def _names(value: Any) -> Any:
    listed = value if isinstance(value, (list, tuple)) else [value]
    if listed and all(isinstance(n, (str, int)) and not isinstance(n, bool) for n in listed):
        # As names of submissions are, however an editor composes letters with their marks.
        return tuple(unicodedata.normalize("NFC", str(name)) for name in listed)
    raise ValueError(
        f"the name of a submission, a list of names, or '{EVERYONE}' for all is expected; "
        "in quotes if it reads like something else, as 1.10 or no does"
    )


def _words(value: Any) -> Any:
    if isinstance(value, str) and value.strip():
        return " ".join(value.split())
    raise ValueError("a text is expected")


def _date(value: Any) -> Any:
    found = value
    if isinstance(value, str):
        try:
            found = date.fromisoformat(value.strip())
        except ValueError:
            found = parse_time(value)
    if not isinstance(found, date):
        raise ValueError("a date is expected, such as 2026-11-21, with its time where you like")
    return found.isoformat(timespec="minutes") if isinstance(found, datetime) else found.isoformat()


Points = Annotated[Decimal, BeforeValidator(_points)]
Words = Annotated[str, BeforeValidator(_words)]


class Override(Strict):
    """One decision about one submission or several."""

    submission: Annotated[tuple[str, ...], BeforeValidator(_names)]
    check: str | None = None
    criterion: str | None = None
    #: Points of a check or a criterion: these, or so many more (or fewer).
    set_: Points | None = Field(None, alias="set")
    add: Points | None = None
    #: A check or a criterion loses nothing.
    excused: Literal[True] | None = None
    #: Points beyond the rubric's.
    bonus: Annotated[Points, Field(gt=0)] | None = None
    #: How much later it is due.
    extension: TimeSpan | None = None
    #: When it is due, and when it was handed in, in place of what is known.
    due: Moment | None = None
    submitted: Moment | None = None
    #: A person has looked at a part or at the whole, and it stays as it is; a comment alone says so too.
    reviewed: Literal[True] | None = None
    #: What a student asks to be looked at again.
    appeal: Words | None = None
    #: What the student is told there.
    comment: Words | None = None
    reason: Words = ""
    who: Words
    when: Annotated[str, BeforeValidator(_date)]

    @property
    def change(self) -> str:
        """What it does, by its key."""
        given = self.model_dump(by_alias=True, include=self.model_fields_set)
        return next((name for name in _CHANGES if name in given), "reviewed")

    @model_validator(mode="after")
    def _changes_one_thing(self) -> Override:
        given = self.model_dump(by_alias=True, include=self.model_fields_set)
        if empty := [key for key, value in given.items() if value is None]:
            raise mistakes_at(((key,), "a value is missing") for key in empty)
        changes = [name for name in _CHANGES if name in given] or ["reviewed"] * (
            "comment" in given
        )
        parts = len({"check", "criterion"} & given.keys())
        if len(changes) != 1:
            raise ValueError(f"exactly one of {', '.join(_CHANGES)} is needed")
        if changes[0] in _OF_A_PART and parts != 1:
            raise ValueError(f"{changes[0]} needs either a check or a criterion")
        if changes[0] not in (*_OF_A_PART, "reviewed") and parts:
            raise ValueError(
                f"{changes[0]} is of the whole submission, not of a check or a criterion"
            )
        return self


@dataclass(frozen=True)
class Overrides:
    """All entries of one file, in its order."""

    entries: tuple[Override, ...] = ()
    #: The line of each entry.
    lines: tuple[int, ...] = ()
    name: str = ""
    #: Hash of the file's text; empty if there is no file.
    sha256: str = ""

    def of(self, submission: str) -> tuple[Override, ...]:
        """Return the entries about a submission."""
        return tuple(
            entry
            for entry in self.entries
            if not {submission, EVERYONE}.isdisjoint(entry.submission)
        )

    def remarks(self, submissions: Iterable[str], *, times_matter: bool) -> list[str]:
        """Say which entries do nothing: they name no submission, or move a time where the rubric has no lateness."""
        known, unknown, idle = sorted(submissions), [], []
        for entry, line in zip(self.entries, self.lines, strict=True):
            location = f"{self.name}:{line}"
            names = [name for name in entry.submission if name != EVERYONE and name not in known]
            unknown += [
                f"{location}: there is no submission {name!r}{meant(name, known)}" for name in names
            ]
            moved = any(time is not None for time in (entry.extension, entry.due, entry.submitted))
            if moved and not times_matter:
                idle.append(
                    f"{location}: the rubric does not say what lateness costs, so a time changes nothing"
                )
        return unknown + idle


def load_overrides(path: Path, rubric: Rubric) -> Overrides:
    """Read and validate a file of overrides.

    Raises RubricError with every mistake, each with file and line; also where it does not fit the rubric.
    """
    return parse_overrides(path, read_text(path, _WHAT, "Check --overrides."), rubric)


def parse_overrides(path: Path, text: str, rubric: Rubric) -> Overrides:
    """Validate what stands in a file of overrides, or is to stand there; raises as `load_overrides`."""
    sha256 = hashlib.sha256(text.encode()).hexdigest()
    if not any(line.partition("#")[0].strip() for line in text.splitlines()):
        return Overrides(name=path.name, sha256=sha256)
    plain, mistakes = parse_yaml(path, text, _WHAT)
    for key in plain:
        if key != "overrides":
            mistakes.add((key,), "unknown key; the only key is overrides")
    listed = plain.get("overrides") if plain.get("overrides") is not None else []
    if not isinstance(listed, list):
        mistakes.add(("overrides",), "a list of entries is expected")
        listed = []
    entries: list[Override] = []
    for number, raw in enumerate(listed):
        loc: Loc = ("overrides", number)
        if isinstance(raw, Mapping):
            _check_part(raw, loc, rubric, mistakes)
            if "reason" not in raw and (raw.keys() - _WITHOUT_REASON) & {*_CHANGES}:
                mistakes.add((*loc, "reason"), "this key is missing")
        try:
            entry = Override.model_validate(raw)
        except ValidationError as error:
            mistakes.add_validation(loc, error)
            continue
        if entry in entries:
            mistakes.add(loc, "the same entry stands here twice")
        entries.append(entry)
    mistakes.raise_any("`grade regrade --help` shows what entries look like.")
    lines = tuple(mistakes.line_of(("overrides", n)) for n in range(len(entries)))
    return Overrides(tuple(entries), lines, path.name, sha256)


def _check_part(raw: Mapping[str, Any], loc: Loc, rubric: Rubric, mistakes: Mistakes) -> None:
    """Note a check or criterion that the rubric does not have, or points that it cannot have."""
    checks = [check for criterion in rubric.criteria for check in criterion.checks]
    beside = {
        id_
        for criterion in rubric.bonus
        for id_ in (criterion.id, *(check.id for check in criterion.checks))
    }
    for kind, parts in (("check", checks), ("criterion", rubric.criteria)):
        possible = {part.id: part.points for part in parts}
        identity = raw.get(kind)
        if not isinstance(identity, str):
            continue
        if identity in beside:
            mistakes.add(
                (*loc, kind), f"{identity!r} is beside the points; the key bonus adds to these"
            )
            continue
        if identity not in possible:
            part_of = next(
                (c.id for c in rubric.checks() if kind == "check" and identity in c.replaces), None
            )
            now = f"; it is part of {part_of!r} now" if part_of else meant(identity, list(possible))
            mistakes.add((*loc, kind), f"the rubric has no {kind} {identity!r}{now}")
            continue
        with suppress(ValueError):
            if "set" in raw and not 0 <= _points(raw["set"]) <= possible[identity]:
                mistakes.add(
                    (*loc, "set"),
                    f"{identity} has from 0 to {possible[identity]} points; bonus gives more",
                )


def moment_of(submitted_at: str | None) -> datetime | None:
    """Return a recorded time of submission, or None if it is not known or has no offset from UTC."""
    found = parse_time(submitted_at) if submitted_at else None
    return found if found is not None and found.utcoffset() is not None else None

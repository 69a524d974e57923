"""`overrides.yaml`: decisions of people about submissions, each with reason, name and date.

The file is next to the results, so that no regrade can lose it. All its mistakes are reported at once, by line.
"""

from __future__ import annotations

import hashlib
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from grader.lab.policy import Moment, TimeSpan, parse_time
from grader.lab.rubric import Rubric
from grader.lab.similar_words import meant
from grader.lab.yaml_with_lines import Loc, Mistakes, Strict, mistakes_at, parse_yaml, read_text

#: A name for all submissions.
EVERYONE = "*"

_WHAT = "the file of overrides"
_CHANGES = ("set", "add", "excused", "bonus", "extension", "due", "submitted", "reviewed", "appeal")
_OF_A_PART = ("set", "add", "excused", "appeal")
_OF_TIME = ("extension", "due", "submitted")
#: Keys without an effect on points, which need no reason.
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
    listed = value
    if not isinstance(value, (list, tuple)):
        listed = [value]
    if listed and all(map(_is_name, listed)):
        # Editors compose letters with their marks in several ways; names of submissions are in NFC.
        return tuple(unicodedata.normalize("NFC", str(name)) for name in listed)
    raise ValueError(
        f"the name of a submission, a list of names, or '{EVERYONE}' for all is expected; "
        "in quotes if it reads like something else, as 1.10 or no does"
    )


def _is_name(value: Any) -> bool:
    """Tell whether a value can be a name; YAML reads a name such as 4711 as a number."""
    return isinstance(value, (str, int)) and not isinstance(value, bool)


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
    if isinstance(found, datetime):
        return found.isoformat(timespec="minutes")
    return found.isoformat()


Points = Annotated[Decimal, BeforeValidator(_points)]
Words = Annotated[str, BeforeValidator(_words)]


class Override(Strict):
    """One decision about one submission or several."""

    submission: Annotated[tuple[str, ...], BeforeValidator(_names)]
    check: str | None = None
    criterion: str | None = None
    #: New points of a check or a criterion.
    set_: Points | None = Field(None, alias="set")
    #: Points added to a check or a criterion; negative to subtract.
    add: Points | None = None
    #: True if a check or a criterion loses nothing.
    excused: Literal[True] | None = None
    #: Points beyond the rubric's.
    bonus: Annotated[Points, Field(gt=0)] | None = None
    #: Additional time until the deadline.
    extension: TimeSpan | None = None
    #: Deadline of this submission.
    due: Moment | None = None
    #: Time of submission, instead of the known one.
    submitted: Moment | None = None
    #: True if a person has reviewed a part or the whole without a change; a comment alone means the same.
    reviewed: Literal[True] | None = None
    #: Request of a student for a review.
    appeal: Words | None = None
    #: Comment for the student.
    comment: Words | None = None
    reason: Words = ""
    who: Words
    when: Annotated[str, BeforeValidator(_date)]

    @property
    def change(self) -> str:
        """The key of the change."""
        given = self.model_dump(by_alias=True, include=self.model_fields_set)
        for name in _CHANGES:
            if name in given:
                return name
        return "reviewed"

    @model_validator(mode="after")
    def _changes_one_thing(self) -> Override:
        given = self.model_dump(by_alias=True, include=self.model_fields_set)
        empty = [key for key, value in given.items() if value is None]
        if empty:
            raise mistakes_at(((key,), "a value is missing") for key in empty)
        changes = [name for name in _CHANGES if name in given]
        if not changes and "comment" in given:
            changes.append("reviewed")
        if len(changes) != 1:
            raise ValueError(f"exactly one of {', '.join(_CHANGES)} is needed")
        change = changes[0]
        parts = len({"check", "criterion"} & given.keys())
        if change in _OF_A_PART and parts != 1:
            raise ValueError(f"{change} needs either a check or a criterion")
        if parts and change not in (*_OF_A_PART, "reviewed"):
            raise ValueError(f"{change} is of the whole submission, not of a check or a criterion")
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
        found = []
        for entry in self.entries:
            if submission in entry.submission or EVERYONE in entry.submission:
                found.append(entry)
        return tuple(found)

    def remarks(self, submissions: Iterable[str], *, times_matter: bool) -> list[str]:
        """Report entries without an effect: for unknown submissions, or about times if the rubric has no lateness."""
        known = sorted(submissions)
        unknown = []
        idle = []
        for entry, line in zip(self.entries, self.lines, strict=True):
            location = f"{self.name}:{line}"
            for name in entry.submission:
                if name != EVERYONE and name not in known:
                    near = meant(name, known)
                    unknown.append(f"{location}: there is no submission {name!r}{near}")
            if entry.change in _OF_TIME and not times_matter:
                idle.append(
                    f"{location}: the rubric does not say what lateness costs, so a time changes nothing"
                )
        return unknown + idle


def load_overrides(path: Path, rubric: Rubric) -> Overrides:
    """Read and validate a file of overrides.

    Raises RubricError with every mistake, each with file and line; a mismatch with the rubric is a mistake too.
    """
    return parse_overrides(path, read_text(path, _WHAT, "Check --overrides."), rubric)


def is_blank(text: str) -> bool:
    """Tell whether a text of YAML has nothing but comments."""
    for line in text.splitlines():
        if line.partition("#")[0].strip():
            return False
    return True


def parse_overrides(path: Path, text: str, rubric: Rubric) -> Overrides:
    """Validate the text of a file of overrides; raises as `load_overrides`."""
    sha256 = hashlib.sha256(text.encode()).hexdigest()
    if is_blank(text):
        return Overrides(name=path.name, sha256=sha256)
    plain, mistakes = parse_yaml(path, text, _WHAT)
    for key in plain:
        if key != "overrides":
            mistakes.add((key,), "unknown key; the only key is overrides")
    listed = plain.get("overrides")
    if listed is None:
        listed = []
    if not isinstance(listed, list):
        mistakes.add(("overrides",), "a list of entries is expected")
        listed = []
    entries: list[Override] = []
    for number, raw in enumerate(listed):
        loc: Loc = ("overrides", number)
        if isinstance(raw, Mapping):
            _check_part(raw, loc, rubric, mistakes)
            _require_reason(raw, loc, mistakes)
        try:
            entry = Override.model_validate(raw)
        except ValidationError as error:
            mistakes.add_validation(loc, error)
            continue
        if entry in entries:
            mistakes.add(loc, "the same entry stands here twice")
        entries.append(entry)
    mistakes.raise_any("`grade regrade --help` shows what entries look like.")
    lines = [mistakes.line_of(("overrides", number)) for number in range(len(entries))]
    return Overrides(tuple(entries), tuple(lines), path.name, sha256)


def _require_reason(raw: Mapping[str, Any], loc: Loc, mistakes: Mistakes) -> None:
    """Add a mistake if a change of points has no reason."""
    changing = (raw.keys() - _WITHOUT_REASON) & set(_CHANGES)
    if changing and "reason" not in raw:
        mistakes.add((*loc, "reason"), "this key is missing")


def _check_part(raw: Mapping[str, Any], loc: Loc, rubric: Rubric, mistakes: Mistakes) -> None:
    """Add mistakes for an unknown check or criterion, and for impossible points."""
    possible: dict[str, dict[str, Decimal]] = {"check": {}, "criterion": {}}
    for criterion in rubric.criteria:
        possible["criterion"][criterion.id] = criterion.points
        for check in criterion.checks:
            possible["check"][check.id] = check.points
    bonus_ids = _bonus_ids(rubric)
    for kind, points in possible.items():
        identity = raw.get(kind)
        if not isinstance(identity, str):
            continue
        place = (*loc, kind)
        if identity in bonus_ids:
            mistakes.add(place, f"{identity!r} is beside the points; the key bonus adds to these")
        elif identity not in points:
            hint = _replacing(identity, kind, rubric) or meant(identity, list(points))
            mistakes.add(place, f"the rubric has no {kind} {identity!r}{hint}")
        elif "set" in raw and not _is_possible(raw["set"], points[identity]):
            given = raw["set"]
            most = points[identity]
            mistakes.add(
                (*loc, "set"),
                f"{identity} has from 0 to {most} points, not {given}; bonus gives more",
            )


def _bonus_ids(rubric: Rubric) -> set[str]:
    """Return the ids of the criteria and checks of the bonus."""
    found: set[str] = set()
    for criterion in rubric.bonus:
        found.add(criterion.id)
        found.update(check.id for check in criterion.checks)
    return found


def _replacing(identity: str, kind: str, rubric: Rubric) -> str:
    """Return the check that replaces another one, as the end of a sentence; empty if there is none."""
    for check in rubric.checks():
        if kind == "check" and identity in check.replaces:
            return f"; it is part of {check.id!r} now"
    return ""


def _is_possible(value: Any, most: Decimal) -> bool:
    """Return whether points are within those of a part; the validation reports a value that is not a number."""
    try:
        return bool(0 <= _points(value) <= most)
    except ValueError:
        return True


def moment_of(submitted_at: str | None) -> datetime | None:
    """Return a recorded time of submission, or None if it is unknown or has no offset from UTC."""
    found = parse_time(submitted_at) if submitted_at else None
    if found is None or found.utcoffset() is None:
        return None
    return found

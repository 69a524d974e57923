"""Gradescope: `submission_123/`, and who and when in `submission_metadata.yml`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import yaml

from grader.batch.lms.system import Delivered, System
from grader.policy import parse_time

_FILE = "submission_metadata.yml"
_KEY = re.compile(r"(?P<key>[^\s:#-][^:]*):\s*")
_PART = re.compile(r" {2}(?P<key>:\w+):(?: (?P<value>.*))?")
_FACT = re.compile(r"(?: {2}(?P<new>- )| {4}):(?P<key>name|sid|email): (?P<value>.+)")


class Gradescope(System):
    """Downloads of Gradescope."""

    name = "Gradescope"
    own = frozenset({_FILE})

    def match(self, entries: Mapping[str, bool]) -> dict[str, Delivered]:
        """Take each folder beside the system's file for a submission."""
        if entries.get(_FILE, True):
            return {}
        return {name: Delivered(name, name) for name, is_folder in entries.items() if is_folder}

    def entries(
        self, known: Mapping[str, Delivered], read: Callable[[Sequence[str]], Mapping[str, str]]
    ) -> Mapping[str, Delivered]:
        """Add who handed in what, and when."""
        written = _read_metadata(read([_FILE]).get(_FILE, ""))
        return {entry: _by(written.get(entry), one) for entry, one in known.items()}


@dataclass
class _Submitted:
    people: list[dict[str, str]] = field(default_factory=list)
    at: datetime | None = None


def _by(submitted: _Submitted | None, known: Delivered) -> Delivered:
    """Name those who handed something in together after all of them, with the number of the submission."""
    if submitted is None:
        return known
    ids = [person.get("sid") or person.get("email", "") for person in submitted.people]
    names = [person.get("name") or one for person, one in zip(submitted.people, ids, strict=True)]
    if len(names) > 1:
        known = replace(known, student=", ".join([*names, known.student]), student_id="")
    elif names:
        known = replace(known, student=names[0], student_id=ids[0])
    return replace(known, attempt_at=submitted.at)


def _read_metadata(text: str) -> dict[str, _Submitted]:
    """Read who handed in which folder, and when.

    It is read by its lines, as Gradescope always writes it: with all test results of a class it has megabytes, of
    which most are written by students, and which a reader of YAML would take minutes for.
    """
    found: dict[str, _Submitted] = {}
    folder, part = _Submitted(), ""
    for line in text.splitlines():
        if key := _KEY.fullmatch(line):
            folder = found[key["key"]] = _Submitted()
            part = ""
        elif key := _PART.fullmatch(line):
            part = key["key"]
            if part == ":created_at":
                folder.at = _moment(key["value"] or "")
        elif part == ":submitters" and (fact := _FACT.fullmatch(line)):
            if fact["new"] or not folder.people:
                folder.people.append({})
            folder.people[-1][fact["key"]] = _scalar(fact["value"])
    return found


def _scalar(text: str) -> str:
    text = text.strip()
    if text[:1] in ("'", '"'):
        try:
            return str(yaml.safe_load(text))
        except yaml.YAMLError:
            return text
    return text


def _moment(text: str) -> datetime | None:
    time = parse_time(re.sub(r"(\.\d{6})\d+", r"\1", _scalar(text)))
    return time if time is not None and time.utcoffset() is not None else None

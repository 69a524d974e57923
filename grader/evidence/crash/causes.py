"""Causes of exceptions and of lines of output: the first row of `causes.yaml` that fits, in words for a student."""

from __future__ import annotations

import difflib
import functools
import re
import sys
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from grader.evidence.crash.tracebacks import Raised
from grader.evidence.known_packages import ros_packages

#: Characters of a message that are searched.
_READ = 2000
_INTERFACE_ENDING = re.compile(r"_(?:msgs|srvs|interfaces|actions)$")
_SUGGESTED = re.compile(r"Did you mean:? '([^']{1,80})'\?")
#: Likeness, from 0 to 1, from which one name is a misspelt other: that of "sdt" and "std".
_ALIKE = 0.6
#: Likeness from which a name is suggested for another.
_NEAR = 0.75
#: Characters of a name that are compared.
_NAME_START = 80


@dataclass(frozen=True)
class Diagnosis:
    """The cause of a failure of a process."""

    #: A slug, such as "read-only-property", stable for fixtures and statistics.
    kind: str
    #: The problem, in a sentence for a student.
    problem: str
    #: The fix, in a sentence.
    remedy: str
    #: File and line of the submission's innermost frame.
    file: str | None = None
    line: int | None = None
    #: Type as Python printed it; empty if there was no exception.
    exception_type: str = ""
    #: Name in question: a module, a topic, a parameter, an attribute.
    subject: str = ""


@dataclass(frozen=True)
class _Row:
    kind: str
    problem: str
    remedy: str
    subject: str = ""
    type: str = ""
    text: str = ""
    message: str = ""
    passes: str = ""
    near: Sequence[str] | None = None

    def fits(self, raised: Raised) -> Diagnosis | None:
        """Return the cause of an exception, None if the row does not fit."""
        if self.type and not re.fullmatch(self.type, raised.name):
            return None
        if self.passes:
            frames = "\n".join(f"{frame.path} {frame.function}" for frame in raised.frames)
            if not re.search(self.passes, frames):
                return None
        text = raised.message.split("\n", 1)[0]
        if self.message:
            match = re.search(self.message, raised.message[:_READ])
        else:
            match = re.search(self.text, text[:_READ])
        if match is None:
            return None
        return self.cause([match[0], *match.groups("")], raised.name, text)

    def cause(self, values: Sequence[str], exception: str = "", text: str = "") -> Diagnosis:
        """Return the cause with the matched values in its texts."""

        def filled(words: str) -> str:
            return words.format(*values, type=exception, text=text)

        problem = filled(self.problem)
        subject = filled(self.subject)
        if self.near is not None:
            suggested = _SUGGESTED.search(text[:_READ])
            near = suggested[1] if suggested else _near(subject, self.near)
            if near:
                problem += f" Did you mean {near}?"
        return Diagnosis(filled(self.kind), problem, filled(self.remedy), subject=subject)


@functools.cache
def table() -> dict[str, Any]:
    """Return the contents of `causes.yaml`."""
    text = (Path(__file__).parent / "causes.yaml").read_text(encoding="utf-8")
    sections: dict[str, Any] = yaml.load(text, yaml.CSafeLoader)
    return sections


@functools.cache
def _rows(section: str) -> tuple[_Row, ...]:
    return tuple(_Row(**row) for row in table()[section])


def cause_of(raised: Raised, root_files: Collection[str]) -> Diagnosis:
    """Return the cause of an exception.

    Parameters
    ----------
    raised
        The exception.
    root_files
        Files of the submission, relative to its root.
    """
    missing = re.search(r"No module named '?([\w.]{1,200})'?", raised.message[:_READ])
    if missing is not None and raised.name in ("ModuleNotFoundError", "ImportError"):
        return _missing_module(missing[1], root_files)
    for row in _rows("exceptions"):
        cause = row.fits(raised)
        if cause is not None:
            return cause
    raise LookupError("the last row of causes.yaml fits every exception")


def cause_of_line(line: str) -> Diagnosis | None:
    """Return the cause of a line of output without an exception, None if it reports no failure."""
    for row in _rows("lines"):
        match = re.search(row.text, line[:_READ])
        if match is not None:
            return row.cause([match[0], *match.groups("")])
    return None


def _missing_module(module: str, root_files: Iterable[str]) -> Diagnosis:
    """Return the cause of a failed import."""
    root = module.split(".")[0]
    last = module.rsplit(".", 1)[-1]
    stems: set[str] = set()
    folders: set[str] = set()
    for file in root_files:
        path = Path(file)
        folders.update(path.parts[:-1])
        if path.suffix == ".py":
            stems.add(path.stem)
    near = _meant(module, root)
    if module == "rclpy":
        return _import_cause("ros-not-sourced", module, near)
    if root in stems or root in folders or last in stems:
        return _import_cause("missing-sibling", module, near)
    if near is not None:
        return _import_cause("misspelt-module", module, near)
    if _INTERFACE_ENDING.search(root) or root in ros_packages():
        return _import_cause("missing-interface", module, near)
    near = _near(root, stems | sys.stdlib_module_names)
    cause = _import_cause("missing-module", module, near)
    if near is None:
        return cause
    hint = f" If {near} is meant, correct the name."
    return replace(cause, remedy=cause.remedy + hint)


def _import_cause(kind: str, module: str, near: str | None) -> Diagnosis:
    root = module.split(".")[0]
    for row in _rows("modules"):
        if row.kind == kind:
            return row.cause([module, module, root, near or ""])
    raise LookupError(f"causes.yaml has no {kind}")


def _near(name: str, known: Collection[str]) -> str | None:
    """Return the known name most like another, None if none is, or if it is the same."""
    folded = {each.casefold(): each for each in sorted(known)}
    start = name[:_NAME_START].casefold()
    close = difflib.get_close_matches(start, list(folded), n=1, cutoff=_NEAR)
    if not close:
        return None
    near = folded[close[0]]
    return near if near != name else None


def _meant(module: str, root: str) -> str | None:
    """Return the module that was meant by a misspelt name; the name of an existing package means itself."""
    known_modules = table()["known_modules"].split()
    for near in (_near(module, known_modules), _near(root, ros_packages())):
        if near is None:
            continue
        other = near.split(".")[0]
        is_meant = other == root if root in ros_packages() else _alike(root, other)
        if is_meant:
            return near
    return None


def _alike(name: str, other: str) -> bool:
    """Return whether two names of packages are alike without a common ending."""
    bare = _INTERFACE_ENDING.sub("", name)
    bare_other = _INTERFACE_ENDING.sub("", other)
    return difflib.SequenceMatcher(None, bare, bare_other).ratio() >= _ALIKE

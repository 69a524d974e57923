"""What is behind an exception or a line of output: the first row of `causes.yaml` that fits, in words for a student."""

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

#: Characters of a message that patterns are looked for in.
_READ = 2000
_INTERFACE_ENDING = re.compile(r"_(?:msgs|srvs|interfaces|actions)$")
_SUGGESTED = re.compile(r"Did you mean:? '([^']{1,80})'\?")
#: How alike two names have to be, from 0 to 1, for one to be a slip in the other: "sdt" and "std" are just so.
_ALIKE = 0.6


@dataclass(frozen=True)
class Diagnosis:
    """What went wrong in a process."""

    #: A slug, e.g. "read-only-property", stable for fixtures and statistics.
    kind: str
    #: What happened, for a student.
    problem: str
    #: How to fix it.
    remedy: str
    #: The deepest line of the submission on the way to the exception.
    file: str | None = None
    line: int | None = None
    #: As Python printed it; empty where no exception did it.
    exception_type: str = ""
    #: The name that it is about: a module, a topic, a parameter, an attribute.
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
        """Give the cause of an exception, None if it is another."""
        text = raised.message.split("\n", 1)[0]
        if self.type and not re.fullmatch(self.type, raised.name):
            return None
        if self.passes:
            frames = "\n".join(f"{frame.path} {frame.function}" for frame in raised.frames)
            if not re.search(self.passes, frames):
                return None
        pattern, searched = (self.message, raised.message) if self.message else (self.text, text)
        match = re.search(pattern, searched[:_READ])
        return (
            self.cause([match[0], *match.groups("")], raised.name, text)
            if match is not None
            else None
        )

    def cause(self, values: Sequence[str], exception: str = "", text: str = "") -> Diagnosis:
        """Put what was found into the words."""
        kind, problem, remedy, subject = (
            words.format(*values, type=exception, text=text)
            for words in (self.kind, self.problem, self.remedy, self.subject)
        )
        if self.near is not None:
            own = _SUGGESTED.search(text[:_READ])
            near = own[1] if own else _near(subject, self.near)
            problem += f" Did you mean {near}?" if near else ""
        return Diagnosis(kind, problem, remedy, subject=subject)


@functools.cache
def table() -> dict[str, Any]:
    """Return what stands in `causes.yaml`."""
    text = (Path(__file__).parent / "causes.yaml").read_text(encoding="utf-8")
    sections: dict[str, Any] = yaml.load(text, yaml.CSafeLoader)
    return sections


@functools.cache
def _rows(section: str) -> tuple[_Row, ...]:
    return tuple(_Row(**row) for row in table()[section])


def cause_of(raised: Raised, root_files: Collection[str]) -> Diagnosis:
    """Return what is behind an exception; `root_files` are the submission's, relative to its root."""
    missing = re.search(r"No module named '?([\w.]{1,200})'?", raised.message[:_READ])
    if missing is not None and raised.name in ("ModuleNotFoundError", "ImportError"):
        return _missing_module(missing[1], root_files)
    return next(cause for row in _rows("exceptions") if (cause := row.fits(raised)) is not None)


def cause_of_line(line: str) -> Diagnosis | None:
    """Return what a line of output says of trouble without an exception."""
    found = ((row, re.search(row.text, line[:_READ])) for row in _rows("lines"))
    return next(
        (row.cause([match[0], *match.groups("")]) for row, match in found if match is not None),
        None,
    )


def _missing_module(module: str, root_files: Iterable[str]) -> Diagnosis:
    root = module.split(".")[0]
    paths = [Path(file) for file in root_files]
    stems = {path.stem for path in paths if path.suffix == ".py"}
    folders = {part for path in paths for part in path.parts[:-1]}
    near = _meant(module, root)
    if module == "rclpy":
        kind = "ros-not-sourced"
    elif root in stems | folders or module.rsplit(".", 1)[-1] in stems:
        kind = "missing-sibling"
    elif near is not None:
        kind = "misspelt-module"
    elif _INTERFACE_ENDING.search(root) or root in ros_packages():
        kind = "missing-interface"
    else:
        kind, near = "missing-module", _near(root, stems | sys.stdlib_module_names)
    cause = next(row for row in _rows("modules") if row.kind == kind).cause(
        [module, module, root, near or ""]
    )
    hint = f" If {near} is meant, correct the name." if near and kind == "missing-module" else ""
    return replace(cause, remedy=cause.remedy + hint)


def _near(name: str, known: Collection[str]) -> str | None:
    folded = {k.casefold(): k for k in sorted(known)}
    close = difflib.get_close_matches(name[:80].casefold(), list(folded), n=1, cutoff=0.75)
    return folded[close[0]] if close and folded[close[0]] != name else None


def _meant(module: str, root: str) -> str | None:
    """Return the module that was meant by a misspelt name; a package that there is means itself."""
    for near in (_near(module, table()["known_modules"].split()), _near(root, ros_packages())):
        other = near.split(".")[0] if near is not None else ""
        if other and (other == root if root in ros_packages() else _alike(root, other)):
            return near
    return None


def _alike(name: str, other: str) -> bool:
    """Whether two names of packages are alike beside the ending that many have."""
    bare, bare_other = (_INTERFACE_ENDING.sub("", each) for each in (name, other))
    return difflib.SequenceMatcher(None, bare, bare_other).ratio() >= _ALIKE

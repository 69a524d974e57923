"""Files of a student that a report shows whole, with marks at the lines of the proof."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from grader.result import CheckResult, Result

#: Characters of all files in one report.
MOST_CHARACTERS = 60_000
#: Characters of a line; the rest is cut.
_LONGEST_LINE = 300


@dataclass(frozen=True)
class FileLine:
    """A line of a file, numbered from 1, and the checks that refer to it."""

    number: int
    text: str
    checks: tuple[CheckResult, ...]


def _is_marked(line: FileLine) -> bool:
    return bool(line.checks)


@dataclass(frozen=True)
class WholeFile:
    """A file in a report; `id` is its id in the page."""

    id: str
    path: str
    lines: tuple[FileLine, ...]

    @property
    def marked(self) -> int:
        """Number of marked lines."""
        return len(list(filter(_is_marked, self.lines)))

    def anchor_of(self, line: int) -> str:
        """Return the id of a marked line."""
        return f"{self.id}-{line}"


def lines_of(text: str) -> list[str]:
    """Split a file as Python counts its lines."""
    return re.split(r"\r\n|\r|\n", text)


def whole_files_of(result: Result, texts: Mapping[str, str]) -> dict[str, WholeFile]:
    """Return the files with lines of proof, by path; files of lost points come first, while their sizes allow."""
    marks: dict[str, dict[int, list[CheckResult]]] = {}
    for file, line, check in _proof(result):
        checks = marks.setdefault(file, {}).setdefault(line, [])
        if check not in checks:
            checks.append(check)
    found: dict[str, WholeFile] = {}
    left = MOST_CHARACTERS
    for path, by_line in marks.items():
        text = texts.get(path, "")
        if 0 < len(text) <= left:
            left -= len(text)
            found[path] = WholeFile(f"file-{len(found)}", path, tuple(_lines(text, by_line)))
    return found


def _proof(result: Result) -> Iterator[tuple[str, int, CheckResult]]:
    """Yield file, line and check of each location in a file; checks that lost points come first."""
    for check in sorted(result.every_check, key=lambda check: not check.lost):
        for where in check.where:
            if where.file is None or where.line is None:
                continue
            yield where.file, where.line, check


def _lines(text: str, checks: Mapping[int, Iterable[CheckResult]]) -> Iterator[FileLine]:
    """Yield the lines of a file with the checks of each, without the empty end after the last line."""
    lines = lines_of(text)
    if not lines[-1]:
        lines.pop()
    for number, line in enumerate(lines, 1):
        shown = line.replace("\t", "    ")
        if len(shown) > _LONGEST_LINE:
            shown = shown[: _LONGEST_LINE - 1] + "…"
        yield FileLine(number, shown, tuple(checks.get(number, ())))

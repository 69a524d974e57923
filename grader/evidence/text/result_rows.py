"""What a program's printed results say of each of several things: how many, and how late.

Students print them in lines, tables, blocks of lines or JSON, in any language and with other units than asked.
What is read here are claims: checks compare them with what was recorded.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import yaml

from grader.evidence.text.printed import NUMBER, with_short_runs
from grader.recording.session import OutputLine

_LOG_PREFIX = re.compile(r"^\[[A-Z]+\] \[[\d.]+\] \[[^\]]{1,200}\]: ")
_UNITS_S = {
    "ns": 1e-9,
    "us": 1e-6,
    "µs": 1e-6,
    "μs": 1e-6,
    "ms": 1e-3,
    "msec": 1e-3,
    "s": 1.0,
    "sec": 1.0,
}
_UNIT = r"(?:ns|us|µs|μs|msec|ms|sec|s)(?![A-Za-z])"
_LONG_UNITS = (
    ("milli", 1e-3),
    ("micro", 1e-6),
    ("nano", 1e-9),
    ("second", 1.0),
    ("segundo", 1.0),
    ("sekunde", 1.0),
)
#: What a label says -> the words for it, as regular expressions. The first counts that fits: of what is counted, only
#: what came.
_KINDS: dict[str, re.Pattern[str]] = {
    kind: re.compile("|".join(words), re.IGNORECASE)
    for kind, words in yaml.load(
        Path(__file__).with_name("lexicon.yaml").read_bytes(), yaml.CSafeLoader
    ).items()
}
_MEASURED = re.compile(
    rf"(?<![A-Za-z_\d.])({NUMBER})(?![\d.])\s*({_UNIT}|(?:milli|micro|nano|second)[a-z]*)?"
)
_UNIT_IN_BRACKETS = re.compile(rf"[(\[]\s*({_UNIT})\s*[)\]]")
_CELL_BORDER = r"[|│┃║,;\t]"
_BORDER = re.compile(r"[|│┃║,;\t\n(){}\[\]，；、。]")
_LETTER = re.compile(r"[^\W\d_]")
#: Lines and numbers that are read behind a name.
_MOST_LINES_OF_A_BLOCK, _MOST_FIELDS = 12, 100

#: Digits in groups of three, as 1,001.5 or 1.001,5, and a decimal comma, as 0,49.
_GROUPED_BY_COMMAS = re.compile(r"(?<![\d.,])[1-9]\d{0,2}(?:,\d{3})+(?=\.\d|(?![\d,]))")
_GROUPED_BY_DOTS = re.compile(r"(?<![\d.,])[1-9]\d{0,2}(?:\.\d{3})+(?=,\d|(?![\d.]))")
_DECIMAL_COMMA = re.compile(r"(?<![\d.,])(\d+),(\d+)(?![\d,]|\.\d)")
#: Who writes a thousand as 1000 means one by 1,000; dates and times do not tell.
_UNGROUPED = re.compile(r"(?<![\d.,:/-])\d{4,6}(?!\d|[.,:/-]\d)")
#: A comma that parts values: behind a word or a bracket, or with more than two values in a row.
_COMMAS_PART = re.compile(
    r"[^\W\d],\d|[\"'\])}],|[\[({][^\[\](){}]*\d,\d|\d,\d+(?:\.\d+)?,\d+\.|,\d+\.\d+,"
)

#: Characters of a line that are read.
LINE_LIMIT = 1000

#: Lines with a name that are read, from the first and from the last on, and how far above a row its header may be.
_FIRST_LINES, _LAST_LINES, _HEADER_ABOVE = 20, 40, 60


@dataclass(frozen=True)
class ResultRow:
    """What is said of one thing."""

    #: When it was read.
    t_ns: int
    #: How many messages.
    count: int
    #: Their latency; None where none is given.
    mean_s: float | None
    max_s: float | None
    #: By how much the mean may have been cut when it was printed: 0.4 ms may stand there as 0.
    rounding_s: float = field(default=0.0, compare=False)


#: What is printed more coarsely than in ms says nothing.
_COARSEST_S = 1e-3


def rounding_of(number: str, unit_s: float) -> float:
    """Return by how much a number may have been cut when it was printed, in s; whole ones may have been cut off."""
    places = len(number.lower().partition("e")[0].partition(".")[2])
    return min(_COARSEST_S, (0.5 if places else 1.0) * 10.0**-places * unit_s)


def result_row(
    output: Sequence[OutputLine], name: str, others: Sequence[str], *, loosely: bool = False
) -> ResultRow | None:
    """Return what a program's output says of a thing, by its name, see `lines_naming`.

    The `others` are names of the things that are also told of: a block of lines ends at one of them.
    """
    lines = [_LOG_PREFIX.sub("", line.text[:LINE_LIMIT]) for line in output]
    found = []
    for start in lines_naming(lines, name, loosely=loosely):
        line = plain_numbers(lines[start])
        name_at = _spelt(name, loosely=False).search(line)
        spelt = functools.partial(_spelt, loosely=name_at is None)
        name_at = name_at or spelt(name).search(line)
        behind = line[name_at.end() :] if name_at is not None else ""
        below = map(plain_numbers, lines[start + 1 : start + _MOST_LINES_OF_A_BLOCK])
        above = map(plain_numbers, reversed(lines[max(0, start - _HEADER_ABOVE) : start]))
        fields = (
            _from_table(line, above),
            _from_block(below, behind, [spelt(n) for n in (name, *others)]),
        )
        found.append([_row_of(output[start].t_ns, each) for each in fields])
    rows = [row for kind in zip(*found, strict=True) for row in kind if row is not None]
    return next((row for row in rows if row.mean_s is not None), rows[0] if rows else None)


@functools.lru_cache(maxsize=8192)  # Each line is read for each thing.
def plain_numbers(line: str) -> str:
    """Return a line with its numbers as a program would read them: ``1,001`` and ``0,49`` as ``1001`` and ``0.49``.

    In a line whose commas part values nothing is changed.
    """
    line = with_short_runs(line)
    if not re.search(r"\d[.,]\d", line) or _COMMAS_PART.search(line):
        return line
    fractions = [match[0] for match in _DECIMAL_COMMA.finditer(_GROUPED_BY_DOTS.sub("1", line))]
    ungrouped = _UNGROUPED.search(line) is not None
    if any(ungrouped or not _GROUPED_BY_COMMAS.fullmatch(number) for number in fractions):
        line = _GROUPED_BY_DOTS.sub(lambda match: match[0].replace(".", ""), line)
        return _DECIMAL_COMMA.sub(r"\1.\2", line)
    return _GROUPED_BY_COMMAS.sub(lambda match: match[0].replace(",", ""), line)


def lines_naming(lines: Sequence[str], name: str, *, loosely: bool = False) -> list[int]:
    """Return the places of the lines about a thing: the first and the last of them, where there are too many.

    Its name stands there as a word of its own; loosely, it may be spelt otherwise, as ``Best Effort`` for
    ``best_effort``, and where lines begin with it, those alone count.
    """
    begins = (
        re.split(r"[\W_]+", name)[0].casefold() if loosely else name
    )  # It is found much sooner than a pattern.
    near = (
        (n, line)
        for n, line in enumerate(lines)
        if begins in (line.casefold() if loosely else line)
    )
    places = [
        (n, match) for n, line in near if (match := _spelt(name, loosely).search(line)) is not None
    ]
    first = [
        n for n, match in places if loosely and not re.search(r"[^\W_]", lines[n][: match.start()])
    ]
    about = first or [n for n, _ in places]
    return (
        about
        if len(about) <= _FIRST_LINES + _LAST_LINES
        else [*about[:_FIRST_LINES], *about[-_LAST_LINES:]]
    )


@functools.lru_cache(maxsize=64)
def _spelt(name: str, loosely: bool) -> re.Pattern[str]:
    """Return what finds a name as a word of its own, at most behind ``test_``; loosely, in any spelling."""
    if not loosely:
        return re.compile(rf"(?<![A-Za-z0-9_])(?:test_)?{re.escape(name)}(?![A-Za-z0-9_])")
    parts = r"[\s_-]?".join(map(re.escape, re.split(r"[\W_]+", name)))
    return re.compile(rf"(?<![^\W_])(?:test_)?{parts}(?![^\W_])", re.IGNORECASE)


# -- numbers and what they are ---------------------------------------------------------------------


class _Field(NamedTuple):
    """A number as it was printed, with what stands at it: "max", "mean", "received", "messages", "latency" or nothing.

    `unit_s` is the unit that it or its label names, milliseconds where neither does.
    """

    number: str
    kind: str = ""
    unit_s: float = 1e-3
    has_unit: bool = False
    has_label: bool = True

    @classmethod
    def of(cls, label: str, measured: re.Match[str]) -> _Field:
        own_s = _unit_of(measured[2] or "")
        unit_s = own_s or _unit_of(label) or 1e-3
        return cls(
            measured[1],
            _kind_of(label),
            unit_s,
            own_s is not None,
            _LETTER.search(label) is not None,
        )

    @property
    def is_count(self) -> bool:
        return not self.has_unit and float(self.number).is_integer()


def _kind_of(label: str) -> str:
    return next((kind for kind, pattern in _KINDS.items() if pattern.search(label)), "")


def _unit_of(text: str) -> float | None:
    match = re.search(rf"(?<![A-Za-zµμ])({_UNIT})", text.replace("_", " ").lower())
    named = _UNITS_S[match[1]] if match is not None else None
    return named or next((value for start, value in _LONG_UNITS if start in text.lower()), None)


def _row_of(t_ns: int, fields: Sequence[_Field]) -> ResultRow | None:
    """Return what fields say together; None where they do not say how many."""
    said: dict[str, _Field] = {}
    for each in fields:
        if each.is_count or each.kind not in ("received", "messages"):
            said.setdefault(each.kind, each)
    bare = fields[0] if fields and not fields[0].has_label and fields[0].is_count else None
    count = said.get("received") or said.get("messages") or bare
    if count is None:
        return None
    mean, most = said.get("mean"), said.get("max")
    if len(fields) > 2 and not any(each.has_label or each.kind for each in fields):
        mean, most = fields[1:3]  # As in a table without a header.
    elif mean is None and most is None:
        mean = said.get("latency")
    mean_s, max_s = (
        float(each.number) * each.unit_s if each is not None else None for each in (mean, most)
    )
    rounding_s = rounding_of(mean.number, mean.unit_s) if mean is not None else 0.0
    return ResultRow(t_ns, int(float(count.number)), mean_s, max_s, rounding_s)


# -- tables ----------------------------------------------------------------------------------------


def _from_table(row: str, above: Iterable[str]) -> list[_Field]:
    """Read a row of a table by its header, one of the lines above it."""
    cells = _cells(row)
    titles = next((each for line in above if _is_header(each := _cells(line), len(cells))), None)
    if titles is not None:
        measured = (
            (title, _MEASURED.match(cell.lstrip("'\" ")))
            for title, cell in zip(titles, cells, strict=True)
        )
        return [
            _Field.of(title, match)
            for title, match in itertools.islice(measured, 1, None)
            if match is not None
        ]
    return []


def _cells(line: str) -> list[str]:
    border = rf"\s*{_CELL_BORDER}\s*" if re.search(_CELL_BORDER, line) else r"\s{2,}"
    return [cell for cell in re.split(border, line.strip().strip("|│┃║")) if cell.strip()]


def _is_header(titles: Sequence[str], width: int) -> bool:
    if len(titles) != width or width < 3 or any(re.search(r"\d\.\d", title) for title in titles):
        return False
    kinds = set(map(_kind_of, titles[1:]))
    return {"mean", "max"} <= kinds and not kinds.isdisjoint(("received", "messages"))


# -- lines and blocks ------------------------------------------------------------------------------


def _from_block(
    lines: Iterable[str], behind: str, others: Sequence[re.Pattern[str]]
) -> list[_Field]:
    """Read what stands behind the name, and in the lines up to the next name: labelled numbers with their units."""
    own = itertools.takewhile(lambda line: not any(other.search(line) for other in others), lines)
    first = _labelled(behind)
    # What one line tells wholly, the next need not; a block goes on where it does not.
    row = _row_of(0, first)
    return (
        first
        if row is not None and row.mean_s is not None
        else _labelled("\n".join([behind, *own]))
    )


def _labelled(text: str) -> list[_Field]:
    """Return the numbers of a text with their labels: what stands before each, or behind it where nothing does."""
    fields: list[_Field] = []
    for part in _BORDER.split(_UNIT_IN_BRACKETS.sub(r" \1 ", text)):
        found = list(itertools.islice(_MEASURED.finditer(part), _MOST_FIELDS))
        ends = [0, *(match.end() for match in found)]
        between = [part[end : match.start()] for end, match in zip(ends, found, strict=False)]
        behind = [*between[1:], part[ends[-1] :]]
        follow = found and not _LETTER.search(between[0]) and _LETTER.search(behind[-1])
        for label, match in zip(behind if follow else between, found, strict=True):
            fields.append(_Field.of(label, match))
        if len(fields) > _MOST_FIELDS:
            break
    return fields

"""Printed results of a program about each of several things: number of messages and latency.

Students print results in lines, tables, blocks of lines or JSON, in any language, and with other units than asked. The
numbers are claims: checks compare them with the recording.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import yaml

from grader.evidence.text.printed import NUMBER, with_short_runs
from grader.lab.patterns import compiled, search
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


def _kinds() -> dict[str, re.Pattern[str]]:
    lexicon = Path(__file__).with_name("lexicon.yaml").read_bytes()
    kinds = {}
    for kind, words in yaml.load(lexicon, yaml.CSafeLoader).items():
        kinds[kind] = re.compile("|".join(words), re.IGNORECASE)
    return kinds


#: Words of a label for each kind of number. The first kind that fits counts: of several counts, the received messages.
_KINDS = _kinds()
_MEASURED = re.compile(
    rf"(?<![A-Za-z_\d.])({NUMBER})(?![\d.])\s*({_UNIT}|(?:milli|micro|nano|second)[a-z]*)?"
)
_UNIT_IN_BRACKETS = re.compile(rf"[(\[]\s*({_UNIT})\s*[)\]]")
_CELL_BORDER = r"[|│┃║,;\t]"
_BORDER = re.compile(r"[|│┃║,;\t\n(){}\[\]，；、。]")
_LETTER = re.compile(r"[^\W\d_]")

#: Digits in groups of three, as 1,001.5 or 1.001,5, and a decimal comma, as 0,49.
_GROUPED_BY_COMMAS = re.compile(r"(?<![\d.,])[1-9]\d{0,2}(?:,\d{3})+(?=\.\d|(?![\d,]))")
_GROUPED_BY_DOTS = re.compile(r"(?<![\d.,])[1-9]\d{0,2}(?:\.\d{3})+(?=,\d|(?![\d.]))")
_DECIMAL_COMMA = re.compile(r"(?<![\d.,])(\d+),(\d+)(?![\d,]|\.\d)")
#: A thousand written as 1000, so that 1,000 beside it means one; dates and times do not tell.
_UNGROUPED = re.compile(r"(?<![\d.,:/-])\d{4,6}(?!\d|[.,:/-]\d)")
#: A comma between values: after a word or a bracket, or with more than two values in a row.
_COMMAS_PART = re.compile(
    r"[^\W\d],\d|[\"'\])}],|[\[({][^\[\](){}]*\d,\d|\d,\d+(?:\.\d+)?,\d+\.|,\d+\.\d+,"
)

#: Characters of a line that are read.
LINE_LIMIT = 1000
#: Lines after a name that are read.
_MOST_LINES_OF_A_BLOCK = 12
#: Numbers after a name that are read.
_MOST_FIELDS = 100
#: First and last lines with a name that are read.
_FIRST_LINES = 20
_LAST_LINES = 40
#: Largest distance of a header above its row, in lines.
_HEADER_ABOVE = 60
#: Cells of the smallest table: a name, a mean and a maximum.
_LEAST_CELLS = 3
#: Names of the groups in a pattern of a line.
_GROUPS = {"count", "mean_ms", "max_ms"}
#: Largest rounding of a printed time, in s.
_COARSEST_S = 1e-3


@dataclass(frozen=True)
class ResultRow:
    """The printed results of one thing."""

    #: Time at which the row was read.
    t_ns: int
    #: Number of messages.
    count: int
    #: Latency of the messages; None if it was not printed.
    mean_s: float | None
    max_s: float | None
    #: Largest amount that printing can have cut off the mean: 0.4 ms may be printed as 0.
    rounding_s: float = field(default=0.0, compare=False)


def rounding_of(number: str, unit_s: float) -> float:
    """Return the largest amount that printing can have cut off a number, in s; digits of whole numbers may be cut off.

    For example `rounding_of("0.49", 1e-3)` is 5e-6, and `rounding_of("3", 1e-6)` is 1e-6.
    """
    mantissa = number.lower().partition("e")[0]
    places = len(mantissa.partition(".")[2])
    share = 0.5 if places else 1.0
    return min(_COARSEST_S, share * 10.0**-places * unit_s)


def result_rows(
    output: Sequence[OutputLine], names: Sequence[str], pattern: str
) -> dict[str, ResultRow | None]:
    """Return the results that a program printed for each of several things; None for a thing without any.

    Parameters
    ----------
    output
        Lines of the program.
    names
        Names of the things.
    pattern
        Regular expression of a line, with the groups count, mean_ms and max_ms; other readable forms count if no line
        fits.

    Raises
    ------
    ValueError
        If the pattern has no such groups.
    """
    if not _GROUPS.issubset(compiled(pattern).groupindex):
        raise ValueError("the groups count, mean_ms and max_ms are needed")
    return {name: _printed_row(output, name, names, pattern) for name in names}


def _printed_row(
    output: Sequence[OutputLine], name: str, names: Sequence[str], pattern: str
) -> ResultRow | None:
    """Return the results of a thing, by the pattern or in another form; a name spelt otherwise is tried last."""
    others = [other for other in names if other != name]
    for loosely in (False, True):
        found = _by_pattern(output, name, pattern, loosely=loosely)
        if found is None:
            found = result_row(output, name, others, loosely=loosely)
        if found is not None:
            return found
    return None


def _by_pattern(
    output: Sequence[OutputLine], name: str, pattern: str, *, loosely: bool
) -> ResultRow | None:
    """Return the numbers of the first line that names a thing and matches the pattern."""
    lines = [line.text[:LINE_LIMIT] for line in output]
    for place in lines_naming(lines, name, loosely=loosely):
        match = search(pattern, plain_numbers(lines[place]))
        if match:
            mean_s = float(match["mean_ms"]) / 1e3
            longest_s = float(match["max_ms"]) / 1e3
            rounding_s = rounding_of(match["mean_ms"], 1e-3)
            printed_ns = output[place].t_ns
            return ResultRow(printed_ns, int(match["count"]), mean_s, longest_s, rounding_s)
    return None


def result_row(
    output: Sequence[OutputLine], name: str, others: Sequence[str], *, loosely: bool = False
) -> ResultRow | None:
    """Return the results that a program printed for a thing; the first row with a mean if there is one.

    Parameters
    ----------
    output
        Lines of the program.
    name
        Name of the thing.
    others
        Names of the other things; a block of lines ends at one of them.
    loosely
        Whether the name may be spelt differently, see `lines_naming`.
    """
    lines = [_LOG_PREFIX.sub("", line.text[:LINE_LIMIT]) for line in output]
    names = [name, *others]
    from_tables = []
    from_blocks = []
    for start in lines_naming(lines, name, loosely=loosely):
        t_ns = output[start].t_ns
        from_tables.append(_row_of(t_ns, _from_table(lines, start)))
        from_blocks.append(_row_of(t_ns, _from_block(lines, start, names)))
    rows = [row for row in from_tables + from_blocks if row is not None]
    for row in rows:
        if row.mean_s is not None:
            return row
    return rows[0] if rows else None


# Each line is read for each thing.
@functools.lru_cache(maxsize=8192)
def plain_numbers(line: str) -> str:
    """Return a line with its numbers as a program reads them: ``1,001`` and ``0,49`` become ``1001`` and ``0.49``.

    A line with commas between values stays the same.
    """
    line = with_short_runs(line)
    if not re.search(r"\d[.,]\d", line) or _COMMAS_PART.search(line):
        return line
    if not _has_decimal_commas(line):
        return _GROUPED_BY_COMMAS.sub(lambda match: match[0].replace(",", ""), line)
    line = _GROUPED_BY_DOTS.sub(lambda match: match[0].replace(".", ""), line)
    return _DECIMAL_COMMA.sub(r"\1.\2", line)


def _has_decimal_commas(line: str) -> bool:
    """Return whether a comma in a line is decimal, because its digits are not groups or other digits are not grouped."""
    is_ungrouped = _UNGROUPED.search(line) is not None
    for number in _DECIMAL_COMMA.finditer(_GROUPED_BY_DOTS.sub("1", line)):
        if is_ungrouped or not _GROUPED_BY_COMMAS.fullmatch(number[0]):
            return True
    return False


def lines_naming(lines: Sequence[str], name: str, *, loosely: bool = False) -> list[int]:
    """Return the indices of the lines about a thing: the first and the last, if there are too many.

    Parameters
    ----------
    lines
        The lines.
    name
        Name of the thing, which must be in a line as a word of its own.
    loosely
        Whether the name may be spelt differently, as ``Best Effort`` for ``best_effort``. If lines begin with such a
        name, only these count.
    """
    about = []
    first = []
    for number, match in _matches(lines, name, loosely):
        about.append(number)
        if loosely and not re.search(r"[^\W_]", lines[number][: match.start()]):
            first.append(number)
    about = first or about
    if len(about) <= _FIRST_LINES + _LAST_LINES:
        return about
    return about[:_FIRST_LINES] + about[-_LAST_LINES:]


def _matches(lines: Sequence[str], name: str, loosely: bool) -> Iterator[tuple[int, re.Match[str]]]:
    """Yield each line with a name, by its index, and the position of the name."""
    pattern = _spelt(name, loosely)
    # Finding a part of the name is much faster than matching the pattern.
    begins = re.split(r"[\W_]+", name)[0].casefold() if loosely else name
    for number, line in enumerate(lines):
        searched = line.casefold() if loosely else line
        match = pattern.search(line) if begins in searched else None
        if match is not None:
            yield number, match


@functools.lru_cache(maxsize=64)
def _spelt(name: str, loosely: bool) -> re.Pattern[str]:
    """Return a pattern of a name as a word of its own, optionally after ``test_``; loosely, in any spelling."""
    if not loosely:
        return re.compile(rf"(?<![A-Za-z0-9_])(?:test_)?{re.escape(name)}(?![A-Za-z0-9_])")
    parts = r"[\s_-]?".join(map(re.escape, re.split(r"[\W_]+", name)))
    return re.compile(rf"(?<![^\W_])(?:test_)?{parts}(?![^\W_])", re.IGNORECASE)


# -- numbers and their kinds ---------------------------------------------------------------------


class _Field(NamedTuple):
    """A printed number with its label."""

    number: str
    #: "max", "mean", "received", "messages", "latency", or empty.
    kind: str = ""
    #: The unit of the number or of its label; milliseconds if neither has a unit.
    unit_s: float = 1e-3
    has_unit: bool = False
    has_label: bool = True

    @classmethod
    def of(cls, label: str, measured: re.Match[str]) -> _Field:
        own_s = _unit_of(measured[2] or "")
        unit_s = own_s or _unit_of(label) or 1e-3
        has_label = _LETTER.search(label) is not None
        return cls(measured[1], _kind_of(label), unit_s, own_s is not None, has_label)

    @property
    def is_count(self) -> bool:
        return not self.has_unit and float(self.number).is_integer()

    @property
    def seconds(self) -> float:
        return float(self.number) * self.unit_s


def _kind_of(label: str) -> str:
    for kind, pattern in _KINDS.items():
        if pattern.search(label):
            return kind
    return ""


def _unit_of(text: str) -> float | None:
    text = text.lower()
    match = re.search(rf"(?<![A-Za-zµμ])({_UNIT})", text.replace("_", " "))
    if match is not None:
        return _UNITS_S[match[1]]
    for start, unit_s in _LONG_UNITS:
        if start in text:
            return unit_s
    return None


def _row_of(t_ns: int, fields: Sequence[_Field]) -> ResultRow | None:
    """Return the row that fields make together; None if there is no count."""
    by_kind: dict[str, _Field] = {}
    for each in fields:
        if each.is_count or each.kind not in ("received", "messages"):
            by_kind.setdefault(each.kind, each)
    count = by_kind.get("received") or by_kind.get("messages")
    if count is None and fields:
        first = fields[0]
        count = first if first.is_count and not first.has_label else None
    if count is None:
        return None
    mean, most = _latency_of(fields, by_kind)
    mean_s = max_s = None
    rounding_s = 0.0
    if mean is not None:
        mean_s = mean.seconds
        rounding_s = rounding_of(mean.number, mean.unit_s)
    if most is not None:
        max_s = most.seconds
    return ResultRow(t_ns, int(float(count.number)), mean_s, max_s, rounding_s)


def _latency_of(
    fields: Sequence[_Field], by_kind: dict[str, _Field]
) -> tuple[_Field | None, _Field | None]:
    """Return the fields of the mean and of the maximum."""
    is_bare = not any(each.has_label or each.kind for each in fields)
    if is_bare and len(fields) > 2:
        # A row of a table without a header: count, mean, maximum.
        return fields[1], fields[2]
    mean = by_kind.get("mean")
    most = by_kind.get("max")
    if mean is None and most is None:
        mean = by_kind.get("latency")
    return mean, most


# -- tables ----------------------------------------------------------------------------------------


def _from_table(lines: Sequence[str], start: int) -> list[_Field]:
    """Read a row of a table by its header, one of the lines above it."""
    cells = _cells(plain_numbers(lines[start]))
    above = reversed(lines[max(0, start - _HEADER_ABOVE) : start])
    titles = _header(map(plain_numbers, above), len(cells))
    fields = []
    # The first cell holds the name.
    for title, cell in zip(titles[1:], cells[1:], strict=False):
        match = _MEASURED.match(cell.lstrip("'\" "))
        if match is not None:
            fields.append(_Field.of(title, match))
    return fields


def _header(lines: Iterable[str], width: int) -> list[str]:
    """Return the titles of the first line that is a header of so many cells; empty if there is no such line."""
    for line in lines:
        titles = _cells(line)
        if len(titles) == width and _is_header(titles):
            return titles
    return []


def _cells(line: str) -> list[str]:
    border = r"\s{2,}"
    if re.search(_CELL_BORDER, line):
        border = _CELL_BORDER
    cells = map(str.strip, re.split(border, line.strip().strip("|│┃║")))
    return list(filter(None, cells))


def _is_header(titles: Sequence[str]) -> bool:
    if len(titles) < _LEAST_CELLS or any(re.search(r"\d\.\d", title) for title in titles):
        return False
    kinds = set(map(_kind_of, titles[1:]))
    return {"mean", "max"} <= kinds and not kinds.isdisjoint(("received", "messages"))


# -- lines and blocks ------------------------------------------------------------------------------


def _from_block(lines: Sequence[str], start: int, names: Sequence[str]) -> list[_Field]:
    """Read the labelled numbers after a name, the first of some, and in the lines up to the next name."""
    line = plain_numbers(lines[start])
    name_at = _spelt(names[0], loosely=False).search(line)
    loosely = name_at is None
    if loosely:
        name_at = _spelt(names[0], loosely=True).search(line)
    behind = line[name_at.end() :] if name_at is not None else ""
    first = _labelled(behind)
    row = _row_of(0, first)
    if row is not None and row.mean_s is not None:
        # The line is complete, and the next lines can be about something else.
        return first
    patterns = [_spelt(name, loosely) for name in names]
    block = [behind]
    for below in lines[start + 1 : start + _MOST_LINES_OF_A_BLOCK]:
        below = plain_numbers(below)
        if any(pattern.search(below) for pattern in patterns):
            break
        block.append(below)
    return _labelled("\n".join(block))


def _labelled(text: str) -> list[_Field]:
    """Return the numbers of a text with their labels, before each number or, if there are none, after it."""
    fields: list[_Field] = []
    for part in _BORDER.split(_UNIT_IN_BRACKETS.sub(r" \1 ", text)):
        found = list(itertools.islice(_MEASURED.finditer(part), _MOST_FIELDS))
        if found:
            for label, match in zip(_labels(part, found), found, strict=True):
                fields.append(_Field.of(label, match))
        if len(fields) > _MOST_FIELDS:
            break
    return fields


def _labels(part: str, found: Sequence[re.Match[str]]) -> list[str]:
    """Return the text before each number; the text after each if only that has letters at the ends."""
    before = []
    end = 0
    for match in found:
        before.append(part[end : match.start()])
        end = match.end()
    behind = [*before[1:], part[end:]]
    if _LETTER.search(before[0]) or not _LETTER.search(behind[-1]):
        return before
    return behind

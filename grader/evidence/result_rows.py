"""What a program's printed results say of each of several things: how many, and how late.

Students print them in lines, tables, blocks of lines or JSON, in any language and with other units than asked.
What is read here are claims: checks compare them with what was recorded.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from grader.evidence.lexicon import one_of
from grader.evidence.printed import NUMBER, with_short_runs
from grader.recording.session import OutputLine

_LOG_PREFIX = re.compile(r"^\[[A-Z]+\] \[[\d.]+\] \[[^\]]{1,200}\]: ")
_UNITS_S = {"ns": 1e-9, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ms": 1e-3, "msec": 1e-3, "s": 1.0, "sec": 1.0}
_UNIT = r"(?:ns|us|µs|μs|msec|ms|sec|s)(?![A-Za-z])"
_LONG_UNITS = (("milli", 1e-3), ("micro", 1e-6), ("nano", 1e-9), ("second", 1.0), ("segundo", 1.0), ("sekunde", 1.0))
_MEAN, _MOST, _MESSAGES = map(one_of, ("mean", "largest", "messages"))
_LATENCY, _RECEIVED = (rf"{one_of(name)}[a-zé]{{0,20}}" for name in ("latency", "received"))
_NOT_RECEIVED = re.compile(one_of("not_received"), re.IGNORECASE)
_CELL_BORDER = r"[|│┃║,;\t]"
_MOST_LINES_OF_A_BLOCK = 12

#: Digits in groups of three, as 1,001.5 or 1.001,5, and a decimal comma, as 0,49.
_GROUPED_BY_COMMAS = re.compile(r"(?<![\d.,])[1-9]\d{0,2}(?:,\d{3})+(?=\.\d|(?![\d,]))")
_GROUPED_BY_DOTS = re.compile(r"(?<![\d.,])[1-9]\d{0,2}(?:\.\d{3})+(?=,\d|(?![\d.]))")
_DECIMAL_COMMA = re.compile(r"(?<![\d.,])(\d+),(\d+)(?![\d,]|\.\d)")
#: Who writes a thousand as 1000 means one by 1,000; dates and times do not tell.
_UNGROUPED = re.compile(r"(?<![\d.,:/-])\d{4,6}(?!\d|[.,:/-]\d)")
#: A comma that parts values: behind a word or a bracket, or with more than two values in a row.
_COMMAS_PART = re.compile(r"[^\W\d],\d|[\"'\])}],|[\[({][^\[\](){}]*\d,\d|\d,\d+(?:\.\d+)?,\d+\.|,\d+\.\d+,")

LINE_LIMIT = 1000
"""Characters of a line that are read."""

#: Lines with a name that are read, from the first and from the last on, and how far above a row its header may be.
_FIRST_LINES, _LAST_LINES, _HEADER_ABOVE = 20, 40, 60


@dataclass(frozen=True)
class ResultRow:
    """What is said of one thing.

    Attributes
    ----------
    t_ns : int
        When it was read.
    count : int
        How many messages.
    mean_s, max_s : float or None
        Their latency; None where none is given.
    rounding_s : float
        By how much the mean may have been cut when it was printed: 0.4 ms may stand there as 0.
    """

    t_ns: int
    count: int
    mean_s: float | None
    max_s: float | None
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
    """Return what a program's output says of a thing.

    Parameters
    ----------
    name : str
        How the thing is called; it stands in its line as a word of its own.
    others : sequence of str
        Names of the things that are also told of: a block of lines ends at one of them.
    loosely : bool
        Whether the name may be spelt otherwise, as ``Best Effort`` for ``best_effort``.
    """
    lines = [plain_numbers(_LOG_PREFIX.sub("", line.text[:LINE_LIMIT])) for line in output]
    starts = lines_naming(lines, name, loosely=loosely)
    found = [
        _row_of(output[start].t_ns, *row)
        for read in (_from_table, _from_block)
        for start in starts
        if (row := read(lines, start, name, others)) is not None
    ]
    return next((row for row in found if row.mean_s is not None), found[0] if found else None)


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

    Parameters
    ----------
    loosely : bool
        In any spelling, as ``Best Effort`` for ``best_effort``; where lines begin with it, those alone.
    """
    about = [n for n, line in enumerate(lines) if not loosely and names(line, name)]
    if loosely:
        places = [(n, match) for n, line in enumerate(lines) if (match := _spelt(name).search(line)) is not None]
        first = [n for n, match in places if not re.search(r"[^\W_]", lines[n][: match.start()])]
        about = first or [n for n, _ in places]
    return about if len(about) <= _FIRST_LINES + _LAST_LINES else [*about[:_FIRST_LINES], *about[-_LAST_LINES:]]


def names(line: str, name: str) -> bool:
    """Whether a line is about a thing: its name stands in it as a word of its own, at most behind ``test_``."""
    return re.search(rf"(?<![A-Za-z0-9_]){re.escape(name)}(?![A-Za-z0-9_])", line.replace("test_", "")) is not None


@functools.lru_cache(maxsize=64)
def _spelt(name: str) -> re.Pattern[str]:
    """Return what finds a name in any spelling: in capitals, apart, with hyphens."""
    parts = r"[\s_-]?".join(map(re.escape, re.split(r"[\W_]+", name)))
    return re.compile(rf"(?<![^\W_])(?:test_)?{parts}(?![^\W_])", re.IGNORECASE)


def _behind(line: str, name: str) -> str:
    """Return what stands behind a name in a line, however it is spelt."""
    if names(line, name):
        return line.replace("test_", "").partition(name)[2]
    match = _spelt(name).search(line)
    return line[match.end() :] if match is not None else ""


class _Time(NamedTuple):
    value: float
    rounding: float


_Row = tuple[int, _Time | None, _Time | None]


def _row_of(t_ns: int, count: int, mean: _Time | None, most: _Time | None) -> ResultRow:
    largest_s = most.value if most is not None else None
    return (
        ResultRow(t_ns, count, None, largest_s) if mean is None else ResultRow(t_ns, count, mean[0], largest_s, mean[1])
    )


def _time_of(number: str, unit_s: float) -> _Time:
    return _Time(float(number) * unit_s, rounding_of(number, unit_s))


# -- tables ----------------------------------------------------------------------------------------


def _from_table(lines: Sequence[str], start: int, name: str, others: Sequence[str]) -> _Row | None:
    """Read a row of a table by its header; without one, count, mean and maximum stand in this order."""
    cells = _cells(lines[start])
    above = reversed(lines[max(0, start - _HEADER_ABOVE) : start])
    header = next((found for line in above if (found := _header(line, len(cells)))), None)
    if header is not None:
        count, mean, largest = (_cell(cells, header, kind) for kind in ("count", "mean", "max"))
        if count is None or not count.value.is_integer():
            return None
        return int(count.value), mean, largest
    behind = _behind(lines[start], name)
    numbers = [c for c in re.split(rf"[\s:\"'`*]+|\s*{_CELL_BORDER}\s*", behind) if c]
    if len(numbers) < 3 or not all(re.fullmatch(rf"{NUMBER}%?|%|-", c) for c in numbers):
        return None
    if not numbers[0].isdecimal() or not all(re.fullmatch(NUMBER, c) for c in numbers[1:3]):
        return None
    return int(numbers[0]), _time_of(numbers[1], 1e-3), _time_of(numbers[2], 1e-3)


def _cells(line: str) -> list[str]:
    border = rf"\s*{_CELL_BORDER}\s*" if re.search(_CELL_BORDER, line) else r"\s{2,}"
    return [cell for cell in re.split(border, line.strip().strip("|│┃║")) if cell.strip()]


def _header(line: str, width: int) -> dict[str, tuple[int, float]] | None:
    """Return what stands in which column, counted from the right, and its unit in s; None if this is no header."""
    titles = _cells(line)
    if len(titles) != width or width < 3 or re.search(r"\d\.\d", line):
        return None
    found: dict[str, tuple[int, float]] = {}
    for place, title in enumerate(titles, -width):
        unit_s = _unit_of(title)
        if re.search(_MOST, title, re.IGNORECASE):
            found.setdefault("max", (place, unit_s))
        elif re.search(_MEAN, title, re.IGNORECASE):
            found.setdefault("mean", (place, unit_s))
        elif place > -width and not _NOT_RECEIVED.search(title) and "count" not in found:
            counts = re.search(rf"{_RECEIVED}|{_MESSAGES}|^\W{{0,9}}[nN#]\W{{0,9}}$", title, re.IGNORECASE)
            found.update({"count": (place, 1.0)} if counts else {})
    return found if {"mean", "max", "count"} <= set(found) else None


def _cell(cells: Sequence[str], header: dict[str, tuple[int, float]], kind: str) -> _Time | None:
    place, unit_s = header[kind]
    match = re.match(rf"\W{{0,3}}?({NUMBER})\s*({_UNIT})?", cells[place]) if len(cells) >= -place else None
    if match is None:
        return None
    return _time_of(match[1], _UNITS_S[match[2].lower()] if match[2] and kind != "count" else unit_s)


def _unit_of(text: str) -> float:
    """Return the unit that a title or a label names, in s; milliseconds where it names none."""
    match = re.search(rf"(?<![A-Za-zµμ])({_UNIT})", text.replace("_", " "))
    if match is not None:
        return _UNITS_S[match[1]]
    return next((value for word, value in _LONG_UNITS if word in text.lower()), 1e-3)


# -- lines and blocks ------------------------------------------------------------------------------


def _from_block(lines: Sequence[str], start: int, name: str, others: Sequence[str]) -> _Row | None:
    """Read what stands behind the name, up to the next name: labelled numbers with their units."""
    first = _behind(lines[start], name)
    block = [first]
    spelt_so = names(lines[start], name)
    for line in lines[start + 1 : start + _MOST_LINES_OF_A_BLOCK]:
        if any(names(line, other) if spelt_so else _spelt(other).search(line) for other in (name, *others)):
            break
        block.append(line)
    # What one line tells wholly, the next need not; a block goes on where it does not.
    for text in (first, "\n".join(block)):
        count = _count(text)
        read = _time_before if _labels_follow(text) else _time
        mean_s, max_s = read(text, _MEAN), read(text, _MOST)
        mean_s = _time(text, _LATENCY) if mean_s is None and max_s is None else mean_s
        if count is not None and (mean_s is not None or text is not first or len(block) == 1):
            return count, mean_s, max_s
    return None


def _count(text: str) -> int | None:
    behind = r"[^\d\n]{0,20}?"
    for pattern in (
        rf"{_RECEIVED}{behind}(\d+)(?!\.?\d)(?!\s*{_UNIT})",
        rf"(?<!\d)(\d+)\s*{_MESSAGES}",
        rf"(?<![A-Za-z]){_MESSAGES}{behind}(\d+)(?!\.?\d)(?!\s*{_UNIT})",
        rf"^\W{{0,5}}(\d+)(?![\d.]|\s*{_UNIT})",
        r"(?<!\w)n\s?[=:]\s?(\d+)(?!\.?\d)",
    ):
        if (match := re.search(pattern, text, re.IGNORECASE)) is not None:
            return int(match[1])
    return None


def _time(text: str, label: str) -> _Time | None:
    """Return the time behind a label, in s."""
    between = r"((?:[^\d\n+-]|-(?=[A-Za-z ])){0,40}?)"
    behind = rf"\s{{0,9}}({_UNIT})?(\s{{0,9}}(?:milli|micro|nano|second))?"
    pattern = rf"(?<![A-Za-z]){label}{between}({NUMBER}){behind}"
    match = re.search(pattern, text, re.IGNORECASE)
    if match is None:
        return None
    unit_s = _UNITS_S[match[3].lower()] if match[3] else _unit_of(f"{match[4] or ''} {match[1]}")
    return _time_of(match[2], unit_s)


_BEFORE_LABEL = (
    rf"({NUMBER})\s{{0,9}}({_UNIT})?(\s{{0,9}}(?:milli|micro|nano|second)[a-z]*)?[\s(]{{0,2}}(?:on )?(?<![A-Za-z])"
)


def _labels_follow(text: str) -> bool:
    """Whether labels stand behind their numbers, as in ``0.49 ms avg, 2.15 ms max``."""
    labels = [match for label in (_MEAN, _MOST) if (match := re.search(rf"(?<![A-Za-z]){label}", text, re.IGNORECASE))]
    if not labels or re.match(rf"\w*[\s:=]*{NUMBER}", text[max(match.end() for match in labels) :]):
        return False
    return all(re.search(_BEFORE_LABEL + "$", text[: match.start()], re.IGNORECASE) for match in labels)


def _time_before(text: str, label: str) -> _Time | None:
    """Return the time directly before a label, in s."""
    match = re.search(_BEFORE_LABEL + label, text, re.IGNORECASE)
    if match is None:
        return None
    unit_s = _UNITS_S[match[2].lower()] if match[2] else _unit_of(match[3] or "")
    return _time_of(match[1], unit_s)

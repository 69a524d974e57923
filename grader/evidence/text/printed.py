"""Numbers that a process printed or logged. They are claims: checks compare them with the recording."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from grader.evidence.recorded import Recorded
from grader.evidence.text.output import is_whole, read_output
from grader.lab.patterns import has_time_left, search
from grader.recording.session import OutputLine, ProcessRun

#: A decimal number. A match neither starts after a digit nor can end in two ways; a search therefore looks at each
#: character once, even if the text after the number does not fit.
NUMBER = r"[+-]?(?:(?<!\d)\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"{NUMBER}|[+-]?\b(?:nan|inf)\b", re.IGNORECASE)
_LONG_RUN = re.compile(r"(\d{40})\d+|([^\S\n]{20})[^\S\n]+|([.=_*~+#-]{100})[.=_*~+#-]+")
_WRAPPING = re.compile(r"np\.float\d*\(|array\(|dtype=\w+|[()]")
#: Text that may be between or after numbers.
_ONLY_NUMBERS = re.compile(r"(?:[\s,;|│┃║'\"\[\]{}]|\b(?:rad|deg|m|mm|s|ms)\b|°)*")
#: A letter of any script.
_LETTER = r"[^\W\d_]"
#: The name of an element, with its number, before its value.
_ELEMENT_NAME = re.compile(rf"['\"]?{_LETTER}{{0,10}}[ _]?\d{{1,2}}['\"]?\s?[:=]\s?", re.IGNORECASE)
#: A unit after a label, as in ``Mean (rad): 0.1`` or ``Mean [rad]: [0.1]``.
_LABEL_UNIT = r"(?: ?[(\[][A-Za-z°]{1,9}[)\]])?"
#: The label at the start of a line.
_LINE_LABEL = re.compile(r"([^:=\[]*)[:=\[]")
_CELLS = re.compile(r"\s{2,}|\s*[|,;\t│┃║]\s*")
_NARROW_CELLS = re.compile(r"[\s|,;│┃║]+")
#: Bars of an absolute value in a title, as in ``mean |e|``; they are not borders.
_MAGNITUDE = re.compile(
    r"(?<=[^\s|]) ?\|(?:e|d|x|q|err|errors?|diff|delta|fehler|erreur|Δ\w?)\|(?=\s|$)", re.IGNORECASE
)
_ELEMENT = re.compile(
    rf"\W{{0,9}}(?:[^\n]{{0,30}}?[:=：\s]\s{{0,9}})?({_NUMBER.pattern})\s?(?:rad|deg|°)?\W{{0,3}}$",
    re.IGNORECASE,
)

#: Characters of a line that a pattern is searched in.
_LINE_LIMIT = 2000
#: Characters of a vector, and of a line of other forms, that are read.
_MAX_VECTOR_TEXT = 4000
#: Characters of a vector in brackets that are read.
_MAX_BRACKETED = 100_000
#: Last occurrences of a label that are read for a vector.
_LAST_LABELS = 200
#: Last lines, and characters of them, that are read for other forms; no program prints more statistics.
_LAST_LINES = 500
_LAST_CHARACTERS = 50_000
#: Lines below a label that are read.
_MOST_ELEMENTS = 64
#: Largest half unit of the last place of a number that counts as rounded.
_COARSEST = 0.005
#: A time after every output, in ns.
_NEVER_NS = 2**63
#: Largest number of remembered searches.
_MOST_FOUND = 256
#: Process and pattern -> the numbers that the pattern found in its output.
_found: dict[tuple[ProcessRun, str], tuple[Report, ...]] = {}


@functools.lru_cache(maxsize=4096)
def with_short_runs(text: str) -> str:
    """Return a text with its numbers, blanks and rules cut to the length that people print.

    Searching the result takes a time linear in its length.
    """
    return _LONG_RUN.sub(r"\1\2\3", text)


@dataclass(frozen=True)
class Report:
    """A number that a process reported, and the time at which the grader read it."""

    t_ns: int
    value: float
    #: Half a unit of the last printed place; 0 if that is coarser than the second place.
    rounding: float = 0.0
    #: Text before the number, as far as the pattern reads it.
    lead_in: str = ""


def reports(recorded: Recorded, artifact: str, patterns: Sequence[str]) -> list[Report]:
    """Return the numbers that a pattern finds in the lines of an artifact's output, until it was interrupted.

    If the output has none, the node's log on /rosout is read. The first pattern with a number counts.
    """
    for pattern in patterns:
        found = _reports(recorded, artifact, pattern)
        if found:
            return found
    return []


@functools.lru_cache(maxsize=16)
def _reports(recorded: Recorded, artifact: str, pattern: str) -> list[Report]:
    return _printed(recorded, artifact, pattern) or _logged(recorded, pattern)


def _printed(recorded: Recorded, artifact: str, pattern: str) -> list[Report]:
    found: list[Report] = []
    for process in recorded.processes_of(artifact):
        found += _of_process(process, pattern)
    return found


def reports_of(process: ProcessRun, patterns: Sequence[str]) -> list[Report]:
    """Return the numbers that a pattern finds in the output of one process, as `reports` does."""
    for pattern in patterns:
        found = _of_process(process, pattern)
        if found:
            return list(found)
    return []


def _of_process(process: ProcessRun, pattern: str) -> tuple[Report, ...]:
    """Return the numbers that a pattern finds in the output of a process; several checks seek the same ones."""
    known = _found.get((process, pattern))
    if known is not None:
        return known
    found = tuple(_sought(process, pattern))
    # A check with more time left may find more.
    if has_time_left():
        if len(_found) >= _MOST_FOUND:
            _found.clear()
        _found[process, pattern] = found
    return found


def _sought(process: ProcessRun, pattern: str) -> Iterator[Report]:
    """Yield the numbers that a pattern finds in the output of a process."""
    until_ns = process.interrupted_ns or process.exited_ns or _NEVER_NS
    for line in _read(process):
        if line.t_ns >= until_ns:
            continue
        report = _report(pattern, line.t_ns, line.text)
        if report is not None:
            yield report


# Several checks seek other numbers in the same output.
@functools.lru_cache(maxsize=64)
def _read(process: ProcessRun) -> list[OutputLine]:
    return read_output(process.output)


def _logged(recorded: Recorded, pattern: str) -> list[Report]:
    found = []
    log = recorded.bag.stream("/rosout", "rcl_interfaces/msg/Log")
    lines = []
    for t_ns, text in zip(log.received_ns.tolist(), log.field("msg"), strict=True):
        for part in text.split("\n"):
            lines.append(OutputLine(t_ns, "stdout", part))
    for line in read_output(lines):
        report = _report(pattern, line.t_ns, line.text)
        if report is not None:
            found.append(report)
    return found


def _report(pattern: str, t_ns: int, text: str) -> Report | None:
    text = text[:_LINE_LIMIT]
    match = search(pattern, text)
    if match is None or match.lastindex is None:
        return None
    start, end = match.span(match.lastindex)
    if not is_whole(text, start, end):
        return None
    number = text[start:end]
    lead_in = text[match.start() : start]
    try:
        return Report(t_ns, float(number), _rounding([number]), lead_in.rstrip())
    except ValueError:
        return None


@dataclass(frozen=True)
class PrintedVector:
    """Numbers that were printed for a label."""

    values: tuple[float, ...]
    #: Half a unit of the last printed place; 0 if that is coarser than the second place.
    rounding: float = 0.0
    #: "vector" (after the label), "table" (a column of one) or "lines" (a number in each of several).
    form: str = "vector"


def printed_vector(
    output: Sequence[OutputLine],
    labels: Sequence[str],
    after_ns: int | None = None,
    unless: str | None = None,
) -> PrintedVector | None:
    """Return the last vector printed after a label, as ``Mean: [0.1 0.2]``, on one line or several.

    Parameters
    ----------
    output
        Lines of a process.
    labels
        Labels in any case; the first one with numbers counts.
    after_ns
        Time after which other forms count too: numbers without brackets as in ``Mean: 0.1, 0.2``, a table with the
        label above a column or before a row, or lines as ``mean = 0.1`` for one element each.
    unless
        Regular expression of text, from the start of the line to the numbers, that tells of another quantity.
    """
    lines = read_output(output)
    short = _with_short_lines(lines)
    return _vector_in(short, labels, after_ns, unless)


def vector_printed_by(
    process: ProcessRun, labels: Sequence[str], unless: str | None = None
) -> PrintedVector | None:
    """Return the last vector that a process printed after a label, as `printed_vector` does.

    Other forms count after its interruption.
    """
    lines = _short_lines_of(process)
    return _vector_in(lines, labels, process.interrupted_ns, unless)


@functools.lru_cache(maxsize=64)
def _short_lines_of(process: ProcessRun) -> list[OutputLine]:
    return _with_short_lines(_read(process))


def _with_short_lines(lines: Sequence[OutputLine]) -> list[OutputLine]:
    found = []
    for line in lines:
        text = with_short_runs(line.text)
        found.append(OutputLine(line.t_ns, line.stream, text))
    return found


def _vector_in(
    lines: Sequence[OutputLine], labels: Sequence[str], after_ns: int | None, unless: str | None
) -> PrintedVector | None:
    """Return the last vector after a label in an output as `read_output` returns it, see `printed_vector`."""
    there = "\n".join(line.text for line in lines).lower()
    for label in labels:
        if label.lower() not in there:
            continue
        found = _labelled(lines, re.escape(label), after_ns, unless)
        if found is not None:
            return found
    return None


def _labelled(
    output: Sequence[OutputLine], label: str, after_ns: int | None, other: str | None
) -> PrintedVector | None:
    for stream in ("stdout", "stderr"):
        text = "\n".join(line.text for line in output if line.stream == stream)
        found = _bracketed(text, label, other)
        if found:
            return _numbers_of(found, "vector")
    if after_ns is None:
        return None
    lines = _last_lines(output, after_ns)
    for at, line in enumerate(lines):
        own_label = _LINE_LABEL.match(line)
        if own_label is not None and _tells(other, own_label[1]):
            lines[at] = ""
    return _unbracketed(lines, label)


def _bracketed(text: str, label: str, other: str | None) -> list[str]:
    """Return the numbers of the last vector in brackets after a label."""
    head = (
        rf"\b{label}\w*\b[^\[\n]{{0,60}}(?:\[[A-Za-z°]{{1,9}}\][^\[\n]{{0,20}})?"
        r"(?:\n[ \t]*(?:np\.)?(?:array\()?)?\["
    )
    heads = list(re.finditer(head, text, re.IGNORECASE))
    for match in reversed(heads[-_LAST_LABELS:]):
        end = match.end()
        line_start = text.rfind("\n", 0, match.start()) + 1
        begin = max(line_start, match.start() - _MAX_VECTOR_TEXT)
        if _tells(other, text[begin:end]):
            continue
        inside, closed, _ = text[end : end + _MAX_BRACKETED].partition("]")
        numbers = _only_numbers(inside) if closed else []
        if numbers:
            return numbers
    return []


def _last_lines(output: Sequence[OutputLine], after_ns: int) -> list[str]:
    """Return the last lines printed after a time, as far as they are read."""
    found: list[str] = []
    characters = 0
    for line in reversed(output):
        if line.t_ns < after_ns:
            continue
        text = line.text[:_MAX_VECTOR_TEXT].rstrip()
        characters += len(text)
        if len(found) == _LAST_LINES or characters > _LAST_CHARACTERS:
            break
        found.append(text)
    found.reverse()
    return found


def _unbracketed(lines: Sequence[str], label: str) -> PrintedVector | None:
    """Return numbers for a label in one of the other forms; a single number after the label is the last choice."""
    behind = _last_behind(lines, label)
    if len(behind) > 1:
        return _numbers_of(behind, "vector")
    for read, form in ((_column, "table"), (_each, "lines"), (_listed, "lines")):
        numbers = read(lines, label)
        if len(numbers) > 1:
            return _numbers_of(numbers, form)
    if behind:
        return _numbers_of(behind, "vector")
    return None


def _tells(other: str | None, text: str) -> bool:
    """Return whether a text tells of another quantity."""
    return other is not None and search(other, text, ignore_case=True) is not None


def _numbers_of(texts: Sequence[str], form: str) -> PrintedVector:
    return PrintedVector(tuple(map(float, texts)), _rounding(texts), form)


def _rounding(texts: Sequence[str]) -> float:
    """Return half a unit of the last place of the longest number, because numpy leaves out trailing zeros."""
    places = 0
    for text in texts:
        if "e" in text.lower():
            return 0.0
        places = max(places, len(text.partition(".")[2]))
    rounding = 10.0**-places / 2
    if not texts or rounding > _COARSEST:
        return 0.0
    return rounding


def _last_behind(lines: Sequence[str], label: str) -> list[str]:
    """Return the numbers after a label of one or two words, in the last line with some.

    Each number may have the name of its element, as in ``mean: joint1=0.1, joint2=0.2``.
    """
    words = rf"(?:^|[\W_]){label}{_LETTER}*(?:[ _-]?(?:{_LETTER}|\|){{1,20}})?{_LABEL_UNIT}"
    pattern = re.compile(rf"{words}(?:\s{{0,9}}[:=：|│┃║]|\s)(.*)", re.IGNORECASE)
    for line in reversed(lines):
        match = pattern.search(line)
        if match is None:
            continue
        numbers = _only_numbers(_ELEMENT_NAME.sub(" ", match[1]))
        if numbers:
            return numbers
    return []


def _only_numbers(text: str) -> list[str]:
    """Return the numbers of a text without other contents; empty if it has some."""
    if text.count("[") > text.count("]"):
        # The vector goes on in the next lines.
        return []
    text = _WRAPPING.sub(" ", text)
    if _ONLY_NUMBERS.fullmatch(_NUMBER.sub(" ", text)) is None:
        return []
    return _NUMBER.findall(text)


def _cells(line: str, *, apart: bool) -> list[str]:
    """Return the cells of a line of a table: separated by two spaces or by lines if apart, else by each space."""
    line = _MAGNITUDE.sub("", line)
    cells = _CELLS.split(line.strip()) if apart else _NARROW_CELLS.split(line)
    return list(filter(None, cells))


def _column(lines: Sequence[str], label: str) -> list[str]:
    """Return the numbers of the last table below a cell that begins with a label."""
    title = re.compile(rf"{label}(?![a-z])", re.IGNORECASE)
    found: list[str] = []
    for at, line in enumerate(lines):
        for apart in (True, False):
            place = _title_place(_cells(line, apart=apart), title)
            column = _below(lines[at + 1 :], place, apart=apart) if place else []
            if len(column) > 1:
                found = column
                break
    return found


def _title_place(cells: Sequence[str], title: re.Pattern[str]) -> int:
    """Return the position of a title in the header of a table, counted from the right as -1; 0 if it has none."""
    if len(cells) < 2 or any(map(_NUMBER.fullmatch, cells)):
        return 0
    places = [number for number, cell in enumerate(cells) if title.match(cell)]
    if len(places) != 1:
        return 0
    return places[0] - len(cells)


def _below(lines: Sequence[str], place: int, *, apart: bool) -> list[str]:
    """Return the numbers at a position, counted from the right, of the lines of a table."""
    numbers: list[str] = []
    for line in lines:
        if not re.search(r"[^\W_]", line):
            is_rule = re.search(r"[-=─━═]", line) is not None
            if numbers and not is_rule:
                break
            continue
        cells = _cells(line, apart=apart)
        if len(cells) < -place or not _NUMBER.fullmatch(cells[place]):
            break
        numbers.append(cells[place])
    return numbers


def _each(lines: Sequence[str], label: str) -> list[str]:
    """Return the number after a label in each line, as in ``joint 3: mean = 0.1 rad, max = 0.2 rad``."""
    words = rf"(?:^|[\W_]){label}{_LETTER}*(?:[ _-]{_LETTER}{{1,20}})?{_LABEL_UNIT}"
    number = rf"(?:\s{{0,9}}[:=：]\s{{0,9}}|\s{{1,9}})({_NUMBER.pattern})(?![\w.])"
    pattern = re.compile(words + number, re.IGNORECASE)
    return [match[1] for match in map(pattern.search, lines) if match is not None]


def _listed(lines: Sequence[str], label: str) -> list[str]:
    """Return the numbers below the last line that holds a label alone, one after a name in each line."""
    title = rf"(?:^|[\W_]){label}(?:{_LETTER}|[ ()_|°-]){{0,60}}[:：]?\s*$"
    pattern = re.compile(title, re.IGNORECASE)
    found: list[str] = []
    for at, line in enumerate(lines):
        if pattern.search(line):
            numbers = _elements(lines[at + 1 : at + 1 + _MOST_ELEMENTS])
            if len(numbers) > 1:
                found = numbers
    return found


def _elements(lines: Sequence[str]) -> list[str]:
    """Return the number at the end of each line, up to the first line without one."""
    numbers = []
    for line in lines:
        match = _ELEMENT.match(line)
        # A whole number is more likely a count of something else.
        if match is None or match[1].isdecimal():
            break
        numbers.append(match[1])
    return numbers

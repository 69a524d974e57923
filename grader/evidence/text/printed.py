"""Numbers that a process printed or logged. They are claims: checks compare them with what was recorded."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

from grader.evidence.crash.tracebacks import without_colours
from grader.evidence.recorded import Recorded
from grader.lab.patterns import search
from grader.recording.session import OutputLine

#: A decimal number. Behind a digit it does not begin anew, and it ends in one way only: who looks for it is done after
#: one look at each character, also where what must follow is not there.
NUMBER = r"[+-]?(?:(?<!\d)\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"{NUMBER}|[+-]?\b(?:nan|inf)\b", re.IGNORECASE)
_LONG_RUN = re.compile(r"(\d{40})\d+|([^\S\n]{20})[^\S\n]+|([.=_*~+#-]{100})[.=_*~+#-]+")


@functools.lru_cache(maxsize=4096)
def with_short_runs(text: str) -> str:
    """Return a text whose numbers, blanks and rules have the length that people print, at most.

    So what is looked for in it is found, or not, in a time that grows with its length and not with the square of it.
    """
    return _LONG_RUN.sub(r"\1\2\3", text)


_WRAPPING = re.compile(r"np\.float\d*\(|array\(|dtype=\w+|[()]")
#: What may stand between numbers and behind them.
_ONLY_NUMBERS = re.compile(r"(?:[\s,;|│┃║'\"\[\]{}]|\b(?:rad|deg|m|mm|s|ms)\b|°)*")

#: A letter of any script, and an element's name with its number before its value.
_LETTER = r"[^\W\d_]"
_ELEMENT_NAME = re.compile(rf"['\"]?{_LETTER}{{0,10}}[ _]?\d{{1,2}}['\"]?\s?[:=]\s?", re.IGNORECASE)

#: A unit behind a label, as in ``Mean (rad): 0.1`` or ``Mean [rad]: [0.1]``.
_LABEL_UNIT = r"(?: ?[(\[][A-Za-z°]{1,9}[)\]])?"

_MAX_VECTOR_TEXT = 4000
#: Labels from the last on behind which a vector is sought, and lines from the last on that are read for other forms.
_LAST_LABELS, _LAST_LINES = 200, 500
#: Nobody prints more statistics than this.
_LAST_CHARACTERS = 50_000


@dataclass(frozen=True)
class Report:
    """A number that a process reported, and when the grader read it."""

    t_ns: int
    value: float
    #: Half a unit of the last place that was printed, 0 where that is coarser than the second.
    rounding: float = 0.0
    #: What stands before the number, as far as the pattern reads it.
    lead_in: str = ""


def reports(recorded: Recorded, artifact: str, patterns: Sequence[str]) -> list[Report]:
    """Return the number that a pattern finds in each line of an artifact's output, until it was interrupted.

    Where it shows none, the node's log on /rosout is read instead. The first of the patterns counts that finds any.
    """
    return next(
        (found for pattern in patterns if (found := _reports(recorded, artifact, pattern))), []
    )


@functools.lru_cache(maxsize=16)
def _reports(recorded: Recorded, artifact: str, pattern: str) -> list[Report]:
    found: list[Report] = []
    for process in recorded.processes_of(artifact):
        until_ns = process.interrupted_ns or process.exited_ns or 2**63
        found += [
            r
            for line in process.output
            if line.t_ns < until_ns and (r := _report(pattern, line.t_ns, line.text))
        ]
    if found:
        return found
    log = recorded.bag.stream("/rosout", "rcl_interfaces/msg/Log")
    texts = log.field("msg")
    return [
        r
        for t_ns, text in zip(log.received_ns.tolist(), texts, strict=True)
        if text and (r := _report(pattern, t_ns, text))
    ]


def _report(pattern: str, t_ns: int, text: str) -> Report | None:
    text = without_colours(text[:2000])
    match = search(pattern, text)
    if match is None or match.lastindex is None:
        return None
    try:
        value, lead_in = (
            match[match.lastindex],
            text[match.start() : match.start(match.lastindex)].rstrip(),
        )
        return Report(t_ns, float(value), _rounding([value]), lead_in)
    except ValueError:
        return None


@dataclass(frozen=True)
class PrintedVector:
    """Numbers that were printed for a label."""

    values: tuple[float, ...]
    #: Half a unit of the last place that was printed, 0 where that is coarser than the second.
    rounding: float = 0.0
    #: "vector" (behind the label), "table" (a column of one) or "lines" (a number in each of several).
    form: str = "vector"


def printed_vector(
    output: Sequence[OutputLine],
    labels: Sequence[str],
    after_ns: int | None = None,
    unless: str | None = None,
) -> PrintedVector | None:
    """Return the last vector printed behind a label, as ``Mean: [0.1 0.2]``; it may run over several lines.

    Of several labels, matched in any case, the first counts that has numbers. In what was printed after a time other
    forms count too: numbers without brackets as in ``Mean: 0.1, 0.2``, a table with the label over a column or before a
    row, or lines that say ``mean = 0.1`` of one element each. Where the regular expression `unless` is found between
    the beginning of the line and the numbers, they are of something else.
    """
    output = [
        OutputLine(line.t_ns, line.stream, with_short_runs(without_colours(line.text)))
        for line in output
    ]
    there = "\n".join(line.text for line in output).lower()
    found = (
        _labelled(output, re.escape(label), after_ns, unless)
        for label in labels
        if label.lower() in there
    )
    return next((vector for vector in found if vector is not None), None)


def _labelled(
    output: Sequence[OutputLine], label: str, after_ns: int | None, other: str | None
) -> PrintedVector | None:
    head = (
        rf"\b{label}\w*\b[^\[\n]{{0,60}}(?:\[[A-Za-z°]{{1,9}}\][^\[\n]{{0,20}})?"
        r"(?:\n[ \t]*(?:np\.)?(?:array\()?)?\["
    )
    for stream in ("stdout", "stderr"):
        text = "\n".join(line.text for line in output if line.stream == stream)
        heads = list(re.finditer(head, text, re.IGNORECASE))[-_LAST_LABELS:]
        begins = [
            max(text.rfind("\n", 0, head.start()) + 1, head.start() - _MAX_VECTOR_TEXT)
            for head in heads
        ]
        own = [
            h.end()
            for h, begin in zip(heads, begins, strict=True)
            if not _tells(other, text[begin : h.end()])
        ]
        vectors = (_vector(text[end : end + _MAX_VECTOR_TEXT]) for end in reversed(own))
        if found := next(filter(None, vectors), None):
            return _numbers_of(found, "vector")
    if after_ns is None:
        return None
    last = [line.text[:_MAX_VECTOR_TEXT].rstrip() for line in output if line.t_ns >= after_ns][
        -_LAST_LINES:
    ]
    room = itertools.accumulate(len(line) for line in reversed(last))
    lines = last[-sum(size <= _LAST_CHARACTERS for size in room) or len(last) :]
    lines = [
        "" if (own_label := _LINE_LABEL.match(line)) and _tells(other, own_label[1]) else line
        for line in lines
    ]
    behind = next((numbers for line in reversed(lines) if (numbers := _behind(line, label))), [])
    if len(behind) > 1:
        return _numbers_of(behind, "vector")
    for read, form in ((_column, "table"), (_each, "lines"), (_listed, "lines")):
        if len(numbers := read(lines, label)) > 1:
            return _numbers_of(numbers, form)
    return _numbers_of(behind, "vector") if behind else None


#: The label with which a line begins.
_LINE_LABEL = re.compile(r"([^:=\[]*)[:=\[]")


def _tells(other: str | None, text: str) -> bool:
    """Whether a text tells that the numbers behind it are of something else."""
    return other is not None and search(other, text, ignore_case=True) is not None


def _numbers_of(texts: Sequence[str], form: str) -> PrintedVector:
    return PrintedVector(tuple(map(float, texts)), _rounding(texts), form)


#: Numbers that are printed more coarsely are not taken for rounded ones.
_COARSEST = 0.005


def _rounding(texts: Sequence[str]) -> float:
    """Return half a unit of the last place of any of the numbers, since numpy leaves out trailing zeros."""
    places = [len(text.partition(".")[2]) for text in texts if "e" not in text.lower()]
    unit = 10.0 ** -max(places) if places and len(places) == len(texts) else 0.0
    return unit / 2 if unit and unit / 2 <= _COARSEST else 0.0


def _behind(line: str, label: str) -> list[str]:
    """Return the numbers that stand behind a label of one or two words, each by its element's name or not."""
    words = rf"(?:^|[\W_]){label}{_LETTER}*(?:[ _-]?(?:{_LETTER}|\|){{1,20}})?{_LABEL_UNIT}"
    match = re.search(rf"{words}(?:\s{{0,9}}[:=：|│┃║]|\s)(.*)", line, re.IGNORECASE)
    return _only_numbers(_ELEMENT_NAME.sub(" ", match[1])) if match is not None else []


def _only_numbers(text: str) -> list[str]:
    """Return the numbers of a text that has nothing else in it."""
    text = _WRAPPING.sub(" ", text)
    return _NUMBER.findall(text) if _ONLY_NUMBERS.fullmatch(_NUMBER.sub(" ", text)) else []


_CELLS = re.compile(r"\s{2,}|\s*[|,;\t│┃║]\s*")


#: Bars of an absolute value in a title, as in ``mean |e|``, are no borders.
_MAGNITUDE = re.compile(
    r"(?<=[^\s|]) ?\|(?:e|d|x|q|err|errors?|diff|delta|fehler|erreur|Δ\w?)\|(?=\s|$)", re.IGNORECASE
)


def _cells(line: str, *, apart: bool) -> list[str]:
    """Return the cells of a line of a table: apart by two spaces or by lines, else by each space."""
    line = _MAGNITUDE.sub("", line)
    return [
        cell
        for cell in (_CELLS.split(line.strip()) if apart else re.split(r"[\s|,;│┃║]+", line))
        if cell
    ]


def _column(lines: Sequence[str], label: str) -> list[str]:
    """Return the numbers of the last table below a cell that begins with a label."""
    found: list[str] = []
    for at, line in enumerate(lines):
        for apart in (True, False):
            cells = _cells(line, apart=apart)
            titled = [
                n
                for n, cell in enumerate(cells)
                if re.match(rf"{label}(?![a-z])", cell, re.IGNORECASE)
            ]
            if (
                len(titled) == 1
                and len(cells) > 1
                and not any(_NUMBER.fullmatch(cell) for cell in cells)
            ):
                column = _below(lines[at + 1 :], titled[0] - len(cells), apart=apart)
                if len(column) > 1:
                    found = column
                    break
    return found


def _below(lines: Sequence[str], place: int, *, apart: bool) -> list[str]:
    """Return the numbers at a place, counted from the right, of the lines of a table."""
    numbers: list[str] = []
    for line in lines:
        if not re.search(r"[^\W_]", line):
            if numbers and not re.search(r"[-=─━═]", line):
                break
            continue  # a rule of dashes
        cells = _cells(line, apart=apart)
        if len(cells) < -place or not _NUMBER.fullmatch(cells[place]):
            break
        numbers.append(cells[place])
    return numbers


def _each(lines: Sequence[str], label: str) -> list[str]:
    """Return the number behind a label in each line that has one, as in ``joint 3: mean = 0.1 rad, max = 0.2 rad``."""
    words = rf"(?:^|[\W_]){label}{_LETTER}*(?:[ _-]{_LETTER}{{1,20}})?{_LABEL_UNIT}"
    head = rf"{words}(?:\s{{0,9}}[:=：]\s{{0,9}}|\s{{1,9}})({_NUMBER.pattern})(?![\w.])"
    return [
        match[1] for line in lines if (match := re.search(head, line, re.IGNORECASE)) is not None
    ]


_ELEMENT = re.compile(
    rf"\W{{0,9}}(?:[^\n]{{0,30}}?[:=：\s]\s{{0,9}})?({_NUMBER.pattern})\s?(?:rad|deg|°)?\W{{0,3}}$",
    re.IGNORECASE,
)


def _listed(lines: Sequence[str], label: str) -> list[str]:
    """Return the numbers of the lines below the last one that is a label alone, one number behind a name in each."""
    title = rf"(?:^|[\W_]){label}(?:{_LETTER}|[ ()_|°-]){{0,60}}[:：]?\s*$"
    found: list[str] = []
    for at, line in enumerate(lines):
        if not re.search(title, line, re.IGNORECASE):
            continue
        below = (_ELEMENT.match(each) for each in lines[at + 1 : at + 1 + _MOST_ELEMENTS])
        # A whole number is rather a count of something.
        numbers = [match[1] if match and not match[1].isdecimal() else "" for match in below]
        numbers = list(itertools.takewhile(bool, numbers))
        found = numbers if len(numbers) > 1 else found
    return found


#: Lines below a label that are read.
_MOST_ELEMENTS = 64


def _vector(text: str) -> list[str]:
    inside, closed, _ = text.partition("]")
    return _only_numbers(inside) if closed else []

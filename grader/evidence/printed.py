"""Numbers that a process printed or logged. They are claims: checks compare them with what was recorded."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from grader.evidence.recorded import Recorded
from grader.recording.session import OutputLine

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?\b(?:nan|inf)\b", re.IGNORECASE)
_WRAPPING = re.compile(r"np\.float\d*\(|array\(|dtype=\w+|[()]")
_ONLY_NUMBERS = re.compile(r"(?:[\s,;|'\"\[\]]|\b(?:rad|deg|m|mm|s|ms)\b|°)*")
"""What may stand between numbers and behind them."""

#: A unit behind a label, as in ``Mean (rad): 0.1`` or ``Mean [rad]: [0.1]``.
_LABEL_UNIT = r"(?: ?[(\[][A-Za-z°]{1,9}[)\]])?"

_MAX_VECTOR_TEXT = 4000
#: Labels from the last on behind which a vector is sought, and lines from the last on that are read for other forms.
_LAST_LABELS, _LAST_LINES = 200, 500


@dataclass(frozen=True)
class Report:
    """A number that a process reported, and when the grader read it."""

    t_ns: int
    value: float
    rounding: float = 0.0
    """Half a unit of the last place that was printed, 0 where that is coarser than the second."""
    lead_in: str = ""
    """What stands before the number, as far as the pattern reads it."""


def reports(recorded: Recorded, artifact: str, pattern: str) -> list[Report]:
    """Return the first group of a pattern in each line of an artifact's output, until it was interrupted.

    Where standard output and error show none, the node's log on /rosout is read instead.
    """
    expression = re.compile(pattern)
    found: list[Report] = []
    for process in recorded.processes_of(artifact):
        until_ns = process.interrupted_ns or process.exited_ns or 2**63
        found += [
            r for line in process.output if line.t_ns < until_ns and (r := _report(expression, line.t_ns, line.text))
        ]
    if found:
        return found
    log = recorded.bag.stream("/rosout", "rcl_interfaces/msg/Log")
    texts = log.field("msg")
    return [
        r
        for t_ns, text in zip(log.received_ns.tolist(), texts, strict=True)
        if text and (r := _report(expression, t_ns, text))
    ]


def _report(expression: re.Pattern[str], t_ns: int, text: str) -> Report | None:
    match = expression.search(text[:2000])
    if match is None:
        return None
    try:
        value, lead_in = match.group(1), text[match.start() : match.start(1)].rstrip()
        return Report(t_ns, float(value), _rounding([value]), lead_in)
    except (ValueError, IndexError):
        return None


@dataclass(frozen=True)
class PrintedVector:
    """Numbers that were printed for a label.

    Attributes
    ----------
    rounding : float
        Half a unit of the last place that was printed, 0 where that is coarser than the second.
    form : str
        "vector" (behind the label), "table" (a column or a row of one) or "lines" (a number in each of several).
    """

    values: tuple[float, ...]
    rounding: float = 0.0
    form: str = "vector"


def printed_vector(output: Sequence[OutputLine], label: str, after_ns: int | None = None) -> PrintedVector | None:
    """Return the last vector printed behind a label, as ``Mean: [0.1 0.2]``; it may run over several lines.

    Parameters
    ----------
    label : str
        A word, matched in any case.
    after_ns : int, optional
        In what was printed from then on other forms count too: numbers without brackets as in ``Mean: 0.1, 0.2``,
        a table with the label over a column or before a row, or lines that say ``mean = 0.1`` of one element each.
    """
    head = (
        rf"\b{re.escape(label)}\w*\b[^\[\n]{{0,60}}(?:\[[A-Za-z°]{{1,9}}\][^\[\n]{{0,20}})?"
        r"(?:\n[ \t]*(?:np\.)?(?:array\()?)?\["
    )
    for stream in ("stdout", "stderr"):
        text = "\n".join(line.text for line in output if line.stream == stream)
        ends = [match.end() for match in re.finditer(head, text, re.IGNORECASE)][-_LAST_LABELS:]
        vectors = (_vector(text[end : end + _MAX_VECTOR_TEXT]) for end in reversed(ends))
        if (found := next((vector for vector in vectors if vector is not None), None)) is not None:
            return _numbers_of(found, "vector")
    if after_ns is None:
        return None
    last = [line for line in output if line.t_ns >= after_ns][-_LAST_LINES:]
    lines = [line.text[:_MAX_VECTOR_TEXT].rstrip() for line in last]
    bare = [numbers for line in lines if (numbers := _bare(line, label))]
    if bare and len(bare[-1]) > 1:
        return _numbers_of(bare[-1], "vector")
    for numbers, form in (
        (_column(lines, label), "table"),
        (_row(lines, label), "table"),
        (_each(lines, label), "lines"),
    ):
        if len(numbers) > 1:
            return _numbers_of(numbers, form)
    return _numbers_of(bare[-1], "vector") if bare else None


def _numbers_of(texts: Sequence[str], form: str) -> PrintedVector:
    return PrintedVector(tuple(map(float, texts)), _rounding(texts), form)


#: Numbers that are printed more coarsely are not taken for rounded ones.
_COARSEST = 0.005


def _rounding(texts: Sequence[str]) -> float:
    """Return half a unit of the last place of any of the numbers, since numpy leaves out trailing zeros."""
    places = [len(text.partition(".")[2]) for text in texts if "e" not in text.lower()]
    unit = 10.0 ** -max(places) if places and len(places) == len(texts) else 0.0
    return unit / 2 if unit and unit / 2 <= _COARSEST else 0.0


def _bare(line: str, label: str) -> list[str]:
    """Return the numbers that stand behind a label of one or two words, if nothing else does."""
    head = rf"(?:^|[\W_]){re.escape(label)}[A-Za-z]*(?:[ _-]?[A-Za-z|]{{1,20}})?{_LABEL_UNIT}[^\S\n]*[:=]([^:=]*)$"
    match = re.search(head, line, re.IGNORECASE)
    if match is None or not _ONLY_NUMBERS.fullmatch(_NUMBER.sub(" ", _WRAPPING.sub(" ", match[1]))):
        return []
    return _NUMBER.findall(match[1])


_CELLS = re.compile(r"\s{2,}|\s*[|,;\t│┃║]\s*")


#: Bars of an absolute value in a title, as in ``mean |e|``, are no borders.
_MAGNITUDE = re.compile(
    r"(?<=[^\s|]) ?\|(?:e|d|x|q|err|errors?|diff|delta|fehler|erreur|Δ\w?)\|(?=\s|$)", re.IGNORECASE
)


def _cells(line: str, *, apart: bool) -> list[str]:
    """Return the cells of a line of a table: apart by two spaces or by lines, else by each space."""
    line = _MAGNITUDE.sub("", line)
    return [cell for cell in (_CELLS.split(line.strip()) if apart else re.split(r"[\s|,;│┃║]+", line)) if cell]


def _column(lines: Sequence[str], label: str) -> list[str]:
    """Return the numbers of the last table below a cell that begins with a label."""
    found: list[str] = []
    for at, line in enumerate(lines):
        for apart in (True, False):
            cells = _cells(line, apart=apart)
            titled = [
                n for n, cell in enumerate(cells) if re.match(rf"{re.escape(label)}(?![a-z])", cell, re.IGNORECASE)
            ]
            if len(titled) == 1 and len(cells) > 1 and not any(_NUMBER.fullmatch(cell) for cell in cells):
                column = _below(lines[at + 1 :], titled[0] - len(cells), apart=apart)
                found = column if len(column) > 1 else found
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


def _row(lines: Sequence[str], label: str) -> list[str]:
    """Return the numbers of the last line that begins with a label and holds nothing else."""
    rows = [cells for line in lines if len(cells := _cells(line, apart=False)) > 2]
    titled = [cells[1:] for cells in rows if re.match(rf"{re.escape(label)}(?![a-z])", cells[0], re.IGNORECASE)]
    return next((row for row in reversed(titled) if all(_NUMBER.fullmatch(cell) for cell in row)), [])


def _each(lines: Sequence[str], label: str) -> list[str]:
    """Return the number behind a label in each line that has one, as in ``joint 3: mean = 0.1 rad, max = 0.2 rad``."""
    words = rf"(?:^|[\W_]){re.escape(label)}[A-Za-z]*(?:[ _-][A-Za-z]{{1,20}})?{_LABEL_UNIT}"
    head = rf"{words}\s{{0,9}}[:=]\s{{0,9}}({_NUMBER.pattern})(?![\w.])"
    return [match[1] for line in lines if (match := re.search(head, line, re.IGNORECASE)) is not None]


def _vector(text: str) -> list[str] | None:
    inside, closed, _ = text.partition("]")
    inside = _WRAPPING.sub(" ", inside) if closed else ""
    if not _NUMBER.search(inside) or not _ONLY_NUMBERS.fullmatch(_NUMBER.sub(" ", inside)):
        return None
    return _NUMBER.findall(inside)


def text_of(output: Sequence[OutputLine]) -> str:
    """Return the text of output lines."""
    return "\n".join(line.text for line in output)

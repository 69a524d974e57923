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

_MAX_VECTOR_TEXT = 4000


@dataclass(frozen=True)
class Report:
    """A number that a process reported, and when the grader read it."""

    t_ns: int
    value: float


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
        return Report(t_ns, float(match.group(1)))
    except (ValueError, IndexError):
        return None


def labelled_vector(output: Sequence[OutputLine], label: str, after_ns: int | None = None) -> list[float] | None:
    """Return the last vector printed behind a label, as ``Mean: [0.1 0.2]``; it may run over several lines.

    Parameters
    ----------
    label : str
        A word, matched in any case.
    after_ns : int, optional
        In what was printed from then on, numbers without brackets count too, as in ``Mean: 0.1, 0.2``.
    """
    head = rf"\b{re.escape(label)}\w*\b[^\[\n]{{0,60}}(?:\n[ \t]*(?:np\.)?(?:array\()?)?\["
    for stream in ("stdout", "stderr"):
        text = "\n".join(line.text for line in output if line.stream == stream)
        vectors = [_vector(text[m.end() : m.end() + _MAX_VECTOR_TEXT]) for m in re.finditer(head, text, re.IGNORECASE)]
        found = [vector for vector in vectors if vector is not None]
        if found:
            return found[-1]
    bare = [v for line in output if after_ns is not None and line.t_ns >= after_ns and (v := _bare(line.text, label))]
    return bare[-1] if bare else None


def _bare(line: str, label: str) -> list[float]:
    """Return the numbers that stand behind a label of one or two words, if nothing else does."""
    head = rf"(?:^|[\W_]){re.escape(label)}[A-Za-z]*(?:[ _-]?[A-Za-z|]{{1,20}})?[^\S\n]*[:=]([^:=]*)$"
    match = re.search(head, line[:_MAX_VECTOR_TEXT].rstrip(), re.IGNORECASE)
    if match is None or not _ONLY_NUMBERS.fullmatch(_NUMBER.sub(" ", _WRAPPING.sub(" ", match[1]))):
        return []
    return [float(n) for n in _NUMBER.findall(match[1])]


def _vector(text: str) -> list[float] | None:
    inside, closed, _ = text.partition("]")
    inside = _WRAPPING.sub(" ", inside)
    if not closed or not _NUMBER.search(inside) or not _ONLY_NUMBERS.fullmatch(_NUMBER.sub(" ", inside)):
        return None
    return [float(n) for n in _NUMBER.findall(inside)]


def text_of(output: Sequence[OutputLine]) -> str:
    """Return the text of output lines."""
    return "\n".join(line.text for line in output)

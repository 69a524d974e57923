"""Numbers that a process printed or logged. They are claims: checks compare them with what was recorded."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from grader.evidence.recorded import Recorded
from grader.recording.session import OutputLine

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?\b(?:nan|inf)\b", re.IGNORECASE)
_WRAPPING = re.compile(r"np\.float\d*\(|array\(|dtype=\w+|[()]")
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


def labelled_vector(output: Sequence[OutputLine], label: str) -> list[float] | None:
    """Return the last vector printed behind a label, as ``Mean: [0.1 0.2]``; it may run over several lines.

    Parameters
    ----------
    label : str
        A word, matched in any case.
    """
    found: list[float] | None = None
    for stream in ("stdout", "stderr"):
        text = "\n".join(line.text for line in output if line.stream == stream)
        for match in re.finditer(rf"\b{re.escape(label)}\w*\b[^\[\n]{{0,60}}\n?[^\[\n]{{0,60}}\[", text, re.IGNORECASE):
            vector = _vector(text[match.end() : match.end() + _MAX_VECTOR_TEXT])
            found = vector if vector is not None else found
        if found is not None:
            return found
    return found


def _vector(text: str) -> list[float] | None:
    inside, closed, _ = text.partition("]")
    if not closed:
        return None
    return [float(n) for n in _NUMBER.findall(_WRAPPING.sub(" ", inside))]


def text_of(output: Sequence[OutputLine]) -> str:
    """Return the text of output lines."""
    return "\n".join(line.text for line in output)

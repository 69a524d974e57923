r"""Output of a process as a person reads it: the one reader for numbers that a program printed.

| printed | read |
|---|---|
| `[INFO] [1695.25] [arm]: RMS: 0.1234` | `RMS: 0.1234` |
| `[arm-2] RMS: 0.1234` | `RMS: 0.1234` |
| `\rRMS: 0.1\rRMS: 0.2` | two lines, `RMS: 0.1` and `RMS: 0.2` |
| `RMS:\x07 \x1b[32m0.1234\x1b[0m` | `RMS: 0.1234` |
| `RMS: 0,1234` | `RMS: 0.1234` |
| `RMS: 1,25`, in an output with such a line | `RMS: 1.25` |
| `counts: [1,2]`, `1,234 messages`, `0.1,0.2` | the same |
| `Traceback ...`, `  File ...`, `    print(f"RMS: {rms:.4f}")`, `ValueError: RMS 4` | nothing |
| `took 12.5 s`, pattern `took (\d+)` | no number, because `12` is a part of `12.5` |
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from grader.evidence.crash.tracebacks import without_colours
from grader.recording.session import OutputLine

#: A prefix of `ros2 launch`, and one of a ROS logger.
_PREFIX = re.compile(
    r"(?:\[[\w.-]{1,100}-\d{1,4}\] ?)?(?:\[[A-Z]{4,5}\] \[\d{1,20}\.\d{1,10}\] \[[^\]\s]{1,300}\]:? ?)?"
)
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")
_TRACEBACK = re.compile(r"\s*(?:\+ Exception Group )?Traceback \(most recent call last\):\s*$")
_MESSAGE = re.compile(r"[^\s|+]")
_FRAME = re.compile(r"[ |]{0,40}File \"[^\"]{1,2000}\", line \d{1,9}")
#: A number that may have a decimal comma; a list such as `1,2,3` has none, nor has `[1,2]`.
_COMMA = re.compile(r"(?<![\w.,])([+-]?\d+),(\d+)(?![\w.]|,\d)")
_PAIR = re.compile(r"[(\[]([+-]?\d+),(\d+)[)\]]")
#: A number that only a decimal comma explains.
_FRACTION = re.compile(r"(?<![\w.,])[+-]?0,\d+(?![\w.]|,\d)")
_POINT = re.compile(r"\d\.\d")
#: First characters of a number's surroundings that would make the number a part of another one.
_LONGER = re.compile(r"[.,]?\d|[eE][+-]?\d|\.\w")


def plain_output(output: Sequence[OutputLine]) -> list[OutputLine]:
    """Return the lines of an output as a terminal shows them, without colours and control characters."""
    lines: list[OutputLine] = []
    for line in output:
        text = without_colours(line.text)
        if _CONTROL.search(text) is None:
            lines.append(line if text == line.text else replace(line, text=text))
            continue
        for part in text.split("\r"):
            lines.append(replace(line, text=_CONTROL.sub("", part)))
    return lines


def read_output(output: Sequence[OutputLine]) -> list[OutputLine]:
    """Return the lines for the search of numbers: without tracebacks and prefixes, with decimal points."""
    lines: list[OutputLine] = []
    for line in _without_tracebacks(plain_output(output)):
        if line.text.startswith("["):
            text = _PREFIX.sub("", line.text, count=1)
            line = OutputLine(line.t_ns, line.stream, text)
        lines.append(line)
    if not _has_decimal_commas(lines):
        return lines
    return [OutputLine(line.t_ns, line.stream, _with_points(line.text)) for line in lines]


def _has_decimal_commas(lines: Sequence[OutputLine]) -> bool:
    """Tell whether a line has a number that only a decimal comma explains."""
    for line in lines:
        if "," not in line.text:
            continue
        if _FRACTION.search(_PAIR.sub("", line.text)):
            return True
    return False


def _with_points(text: str) -> str:
    """Return a line with points in place of decimal commas; a line with a point has no decimal comma."""
    if _POINT.search(text):
        return text
    if _PAIR.search(text):
        return text
    return _COMMA.sub(r"\1.\2", text)


def _without_tracebacks(lines: Sequence[OutputLine]) -> Iterator[OutputLine]:
    """Yield the lines that are no part of a traceback; other output may stand between the lines of one."""
    inside = {"stdout": False, "stderr": False}
    for line in lines:
        text = line.text
        is_frame = _FRAME.match(text) is not None
        if is_frame or _TRACEBACK.match(text):
            inside[line.stream] = True
        elif not inside[line.stream] or text.startswith("["):
            yield line
        elif _MESSAGE.match(text):
            # The exception with its message ends the traceback.
            inside[line.stream] = False


def is_whole(text: str, start: int, end: int) -> bool:
    """Tell whether a number in a text is a whole one, unlike `0` of `0,1234` or `4` of `:.4f`."""
    before = text[max(0, start - 2) : start]
    # Several points lead to a number, as in `RMS ... 0.1`.
    if re.search(r"\d[.,]?$|(?:^|[^.])\.$", before):
        return False
    has_point = re.search(r"[.eE]", text[start:end]) is not None
    following = _LONGER.match(text, end)
    if following is None:
        return True
    # A comma behind a fraction separates two numbers.
    return has_point and text[end] == ","

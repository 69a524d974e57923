"""Python tracebacks read out of a process's output lines.

Other output may stand between their lines, as a process writes to two streams and logs from several threads.
All styles from Python 3.10 to 3.14 are read, with chained exceptions and exception groups.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field

from grader.recording.session import OutputLine

LINE_LIMIT = 4000
"""Characters of a line that are read."""

HEAD_LINES = 2_000
TAIL_LINES = 20_000
"""Lines from the end of an output that are read, besides the first `HEAD_LINES`."""

TRACEBACK_LIMIT = 200
"""Tracebacks of one process that are kept, the last ones."""

FRAME_LIMIT = 200
"""Frames of one traceback that are looked at, the deepest ones."""

_MESSAGE_LINES = 12
_ANSI = re.compile(r"\x1b\[[0-9;]{0,20}[A-Za-z]")
_LAUNCH_PREFIX = re.compile(r"^\[[\w.-]{1,100}-\d{1,4}\] ?")
_LOG = re.compile(r"^\[(?:DEBUG|INFO|WARN|ERROR|FATAL)\] ?\[")
_HEADER = re.compile(r"^\s*(?:\+ Exception Group )?Traceback \(most recent call last\):\s*$")
_GROUP_MARGIN = re.compile(r"^ *\| ?")
_GROUP_RULE = re.compile(r"^ *\+(?:-\+)?-{4,}(?: (?:\d+|\.\.\.) -{4,})?\s*$")
_FRAME = re.compile(r'^ {0,12}File "([^"]{1,2000})", line (\d{1,9})(?:, in (.{1,200}))?$')
_FINAL = re.compile(r"^([A-Za-z_][\w.]{0,200})(?:: (.*))?$")
_SYNTAX = frozenset(["SyntaxError", "IndentationError", "TabError"])
_CAUSE = "The above exception was the direct cause of the following exception:"
_DURING = "During handling of the above exception, another exception occurred:"
_LIBRARY_FOLDERS = re.compile(r"^(?:site-packages|dist-packages|python3(?:\.\d+)?)$")


@dataclass(frozen=True)
class Frame:
    """A line of code on the way to an exception."""

    path: str
    line: int
    function: str | None


@dataclass(frozen=True)
class Raised:
    """One exception as its traceback tells it.

    Attributes
    ----------
    type : str
        With its module where Python prints it.
    message : str
        All its lines.
    frames : tuple of Frame
        Outermost first.
    linked : bool
        Whether it came of the one before it ("direct cause" or "during handling").
    ignored : bool
        Whether Python went on regardless ("Exception ignored in").
    t_ns : int
        When the line with the type was read.
    """

    type: str
    message: str
    frames: tuple[Frame, ...]
    linked: bool = False
    ignored: bool = False
    t_ns: int = 0

    @property
    def name(self) -> str:
        """The type without its module."""
        return self.type.rsplit(".", 1)[-1]


@dataclass
class _Reading:
    """A traceback while it is read."""

    headed: bool = False
    linked: bool = False
    ignored: bool = False
    t_ns: int = 0
    frames: list[Frame] = field(default_factory=list)
    type: str = ""
    message: list[str] = field(default_factory=list)


def without_colours(text: str) -> str:
    """Return a text without the sequences by which terminals are told of colours."""
    return _ANSI.sub("", text) if "\x1b" in text else text


def plain_lines(output: Sequence[OutputLine], stream: str | None = None) -> list[tuple[int, str]]:
    """Times and texts of one stream's lines, or of all, without colours and the prefixes of a launch."""
    lines = []
    kept = output if len(output) <= HEAD_LINES + TAIL_LINES else [*output[:HEAD_LINES], *output[-TAIL_LINES:]]
    for line in kept:
        if stream is None or line.stream == stream:
            text = without_colours(line.text[:LINE_LIMIT]).rstrip("\r\n")
            lines.append((line.t_ns, _LAUNCH_PREFIX.sub("", text)))
    return lines


def tracebacks(output: Sequence[OutputLine]) -> list[Raised]:
    """The exceptions of a process in their order; from standard output only where standard error has none."""
    found = list(_read(plain_lines(output, "stderr")))
    return (found or list(_read(plain_lines(output, "stdout"))))[-TRACEBACK_LIMIT:]


def chains(raised: Sequence[Raised]) -> list[list[Raised]]:
    """Exceptions that came of each other together, the first cause first."""
    linked: list[list[Raised]] = []
    for exception in raised:
        if exception.linked and linked:
            linked[-1].append(exception)
        else:
            linked.append([exception])
    return linked


def student_frame(frames: Sequence[Frame], root_files: Collection[str]) -> tuple[str, int] | None:
    """File and line of the deepest of `frames` that lies in the submission.

    Parameters
    ----------
    frames : sequence of Frame
        Outermost first; their paths may be those in a sandbox.
    root_files : collection of str
        The submission's files, relative to its root.
    """
    by_name: dict[str, list[str]] = {}
    for file in root_files:
        by_name.setdefault(file.rsplit("/", 1)[-1], []).append(file)
    meant: dict[str, str | None] = {}
    for frame in reversed(frames[-FRAME_LIMIT:]):
        if frame.path not in meant:
            meant[frame.path] = student_file(frame.path, by_name.get(frame.path.rsplit("/", 1)[-1], ()))
        if (found := meant[frame.path]) is not None:
            return found, frame.line
    return None


def student_file(path: str, root_files: Collection[str]) -> str | None:
    """The file of the submission that `path` means, judged by the longest common end; None if none does."""
    parts = path.split("/")
    best: tuple[int, int, str] | None = None
    for file in root_files:
        own = file.split("/")
        if own[-1] != parts[-1]:
            continue
        common = 0
        while common < min(len(own), len(parts)) and own[-1 - common] == parts[-1 - common]:
            common += 1
        if common < 2 and _in_library(parts):
            continue
        rank = (common, -len(own), file)
        if best is None or rank > best:
            best = rank
    return None if best is None else best[2]


def _in_library(parts: Sequence[str]) -> bool:
    """Whether a path leads into what is installed for an interpreter."""
    return any(_LIBRARY_FOLDERS.match(part) for part in parts[:-1])


def _read(lines: Sequence[tuple[int, str]]) -> Iterator[Raised]:
    current: _Reading | None = None
    linked = ignored = False
    for t_ns, raw in lines:
        if _LOG.match(raw):
            continue
        line = _GROUP_MARGIN.sub("", raw)
        starts = _HEADER.match(line) is not None or line.startswith(("Exception ignored in", _CAUSE, _DURING))
        if current is not None and (starts or _GROUP_RULE.match(raw) or _is_over(current, line)):
            if current.type:
                yield _finished(current)
                current = None
            elif starts:
                current = None
        if line.startswith((_CAUSE, _DURING)):
            linked = True
        elif line.startswith("Exception ignored in"):
            ignored = True
        elif _HEADER.match(line):
            current, linked, ignored = _Reading(True, linked, ignored), False, False
        elif not _GROUP_RULE.match(raw):
            current = _taken(current, line, t_ns)
    if current is not None and current.type:
        yield _finished(current)


def _is_over(current: _Reading, line: str) -> bool:
    """Whether the exception's message has ended."""
    if not current.type:
        return False
    return not line.strip() or len(current.message) >= _MESSAGE_LINES or _FRAME.match(line) is not None


def _taken(current: _Reading | None, line: str, t_ns: int) -> _Reading | None:
    """Take in a line that may belong to a traceback; the traceback being read after it."""
    frame = _FRAME.match(line)
    if frame is not None:
        current = current or _Reading()
        current.frames.append(Frame(frame[1], int(frame[2]), frame[3]))
        return current
    final = _FINAL.match(line)
    if current is None:
        if final is None or final[1] not in _SYNTAX or not final[2]:
            return None
        return _Reading(type=final[1], message=[final[2]], t_ns=t_ns)
    if current.type:
        current.message.append(line)
    elif final is not None:
        if not current.headed and final[1] not in _SYNTAX:
            return None
        current.type, current.message, current.t_ns = final[1], [final[2] or ""], t_ns
    return current


def _finished(current: _Reading) -> Raised:
    message = "\n".join(current.message).strip()
    return Raised(current.type, message, tuple(current.frames), current.linked, current.ignored, current.t_ns)

"""Python tracebacks in a process's output lines.

Other output can come between their lines. All styles from Python 3.10 to 3.14 are read, with chains and groups.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from grader.recording.session import OutputLine

#: Characters of a line that are read.
LINE_LIMIT = 4000
#: First lines of an output that are read.
HEAD_LINES = 2_000
#: Last lines of an output that are read.
TAIL_LINES = 20_000
#: Last tracebacks of a process that are kept.
TRACEBACK_LIMIT = 200
#: Innermost frames of a traceback that are examined.
FRAME_LIMIT = 200
#: Lines of the longest message.
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
_IGNORED = "Exception ignored in"
_LIBRARY_FOLDERS = re.compile(r"^(?:site-packages|dist-packages|python3(?:\.\d+)?)$")


@dataclass(frozen=True)
class Frame:
    """A line of code that led to an exception."""

    path: str
    line: int
    function: str | None


@dataclass
class Raised:
    """One exception, read from its traceback."""

    #: Type, with its module if Python prints it.
    type: str = ""
    #: All lines of the message.
    message: str = ""
    #: Outermost first.
    frames: list[Frame] = field(default_factory=list)
    #: True if the previous exception caused this one ("direct cause" or "during handling").
    linked: bool = False
    #: True if Python continued ("Exception ignored in").
    ignored: bool = False
    #: Time at which the line with the type was read.
    t_ns: int = 0
    #: True if "Traceback (most recent call last)" is above it.
    headed: bool = False

    @property
    def name(self) -> str:
        """The type without its module."""
        return self.type.rsplit(".", 1)[-1]


def without_colours(text: str) -> str:
    """Return a text without the colour sequences of terminals."""
    if "\x1b" not in text:
        return text
    return _ANSI.sub("", text)


def plain_lines(output: Sequence[OutputLine]) -> list[OutputLine]:
    """Return the first and last lines of an output, without colours and the prefixes of a launch."""
    kept = list(output)
    if len(kept) > HEAD_LINES + TAIL_LINES:
        del kept[HEAD_LINES:-TAIL_LINES]
    lines = []
    for line in kept:
        text = without_colours(line.text[:LINE_LIMIT]).rstrip("\r\n")
        lines.append(OutputLine(line.t_ns, line.stream, _LAUNCH_PREFIX.sub("", text)))
    return lines


def tracebacks(output: Sequence[OutputLine]) -> list[Raised]:
    """Return the exceptions of a process in their order; from standard output if standard error has none."""
    lines = plain_lines(output)
    for stream in ("stderr", "stdout"):
        found = list(_read(line for line in lines if line.stream == stream))
        if found:
            return found[-TRACEBACK_LIMIT:]
    return []


def chains(raised: Sequence[Raised]) -> list[list[Raised]]:
    """Return lists of exceptions that caused each other, the first cause first."""
    linked: list[list[Raised]] = []
    for exception in raised:
        if exception.linked and linked:
            linked[-1].append(exception)
        else:
            linked.append([exception])
    return linked


def student_frame(frames: Sequence[Frame], root_files: Collection[str]) -> tuple[str, int] | None:
    """Return file and line of the innermost of some frames, outermost first, that is in the submission."""
    meant: dict[str, str | None] = {}
    for frame in reversed(frames[-FRAME_LIMIT:]):
        if frame.path not in meant:
            meant[frame.path] = student_file(frame.path, root_files)
        found = meant[frame.path]
        if found is not None:
            return found, frame.line
    return None


def student_file(path: str, root_files: Collection[str]) -> str | None:
    """Return the file of the submission with the longest common end with a path; None if there is none."""
    parts = path.split("/")
    is_installed = any(map(_LIBRARY_FOLDERS.match, parts[:-1]))
    # An installed file is the student's only if its folder is too.
    least = 2 if is_installed else 1
    best = (0, 0, "")
    for file in root_files:
        if file.endswith(parts[-1]):
            own = file.split("/")
            best = max(best, (_common_end(own, parts), -len(own), file))
    if best[0] < least:
        return None
    return best[2]


def _common_end(some: Sequence[str], others: Sequence[str]) -> int:
    """Return the number of equal last parts of two paths."""
    count = 0
    for part, other in zip(reversed(some), reversed(others), strict=False):
        if part != other:
            break
        count += 1
    return count


def _read(lines: Iterable[OutputLine]) -> Iterator[Raised]:
    """Yield the exceptions of some lines."""
    reader = _Reader()
    for line in lines:
        if not _LOG.match(line.text):
            yield from reader.read(line)
    yield from reader.finished()


class _Reader:
    """Reads lines, and keeps the exception that is being read."""

    def __init__(self) -> None:
        self._current: Raised | None = None
        #: True if the next exception is caused by the previous one.
        self._linked = False
        #: True if Python ignored the next exception.
        self._ignored = False

    def finished(self) -> Iterator[Raised]:
        """Yield the exception being read, if its type is known."""
        if self._current is not None and self._current.type:
            yield self._current

    def read(self, raw: OutputLine) -> Iterator[Raised]:
        """Read a line, and yield the exception that it ends."""
        line = _GROUP_MARGIN.sub("", raw.text)
        is_rule = _GROUP_RULE.match(raw.text) is not None
        is_header = _HEADER.match(line) is not None
        is_link = line.startswith((_CAUSE, _DURING))
        is_ignored = line.startswith(_IGNORED)
        starts = is_header or is_link or is_ignored
        if starts or is_rule or self._is_over(line):
            ended = list(self.finished())
            yield from ended
            if starts or ended:
                self._current = None
        if is_header:
            self._current = Raised(linked=self._linked, ignored=self._ignored, headed=True)
            self._linked = False
            self._ignored = False
        elif starts:
            self._linked = self._linked or is_link
            self._ignored = is_ignored
        elif not is_rule:
            self._take(line, raw.t_ns)

    def _is_over(self, line: str) -> bool:
        """Return whether a line ends the message of the current exception."""
        if self._current is None or not self._current.type:
            return False
        is_full = self._current.message.count("\n") + 1 >= _MESSAGE_LINES
        return is_full or not line.strip() or _FRAME.match(line) is not None

    def _take(self, line: str, t_ns: int) -> None:
        """Add a line that can belong to the current exception, or drop the exception."""
        frame = _FRAME.match(line)
        if frame is not None:
            current = self._current or Raised()
            current.frames.append(Frame(frame[1], int(frame[2]), frame[3]))
            self._current = current
            return
        if self._current is not None and self._current.type:
            self._current.message += f"\n{line}".rstrip()
            return
        final = _FINAL.match(line)
        if final is not None:
            self._end(final, t_ns)

    def _end(self, final: re.Match[str], t_ns: int) -> None:
        """Take type and message of the current exception from its last line, or drop the exception."""
        current = self._current
        message = final[2] or ""
        is_headed = current is not None and current.headed
        is_syntax = final[1] in _SYNTAX
        if not is_headed and not is_syntax:
            self._current = None
            return
        if current is None:
            # A syntax error in a file has no traceback, but a message.
            if not message:
                return
            current = Raised()
        current.type = final[1]
        current.message = message.strip()
        current.t_ns = t_ns
        self._current = current

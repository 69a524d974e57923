"""Python tracebacks read out of a process's output lines.

Other output may stand between their lines. All styles from Python 3.10 to 3.14 are read, with chains and groups.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from grader.recording.session import OutputLine

#: Characters of a line that are read.
LINE_LIMIT = 4000
#: Lines from the start and from the end of an output that are read.
HEAD_LINES, TAIL_LINES = 2_000, 20_000
#: Tracebacks of one process that are kept, the last ones.
TRACEBACK_LIMIT = 200
#: Frames of one traceback that are looked at, the deepest ones.
FRAME_LIMIT = 200

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


@dataclass
class Raised:
    """One exception as its traceback tells it."""

    #: With its module where Python prints it.
    type: str = ""
    #: All its lines.
    message: str = ""
    #: Outermost first.
    frames: list[Frame] = field(default_factory=list)
    #: Whether it came of the one before it ("direct cause" or "during handling").
    linked: bool = False
    #: Whether Python went on regardless ("Exception ignored in").
    ignored: bool = False
    #: When the line with the type was read.
    t_ns: int = 0
    #: Whether "Traceback (most recent call last)" stands above it.
    headed: bool = False

    @property
    def name(self) -> str:
        """The type without its module."""
        return self.type.rsplit(".", 1)[-1]


def without_colours(text: str) -> str:
    """Return a text without the sequences by which terminals are told of colours."""
    return _ANSI.sub("", text) if "\x1b" in text else text


def plain_lines(output: Sequence[OutputLine]) -> list[OutputLine]:
    """Lines without colours and the prefixes of a launch."""
    kept = (
        output
        if len(output) <= HEAD_LINES + TAIL_LINES
        else [*output[:HEAD_LINES], *output[-TAIL_LINES:]]
    )
    texts = (without_colours(line.text[:LINE_LIMIT]).rstrip("\r\n") for line in kept)
    stripped = (_LAUNCH_PREFIX.sub("", text) for text in texts)
    return [
        OutputLine(line.t_ns, line.stream, text) for line, text in zip(kept, stripped, strict=True)
    ]


def tracebacks(output: Sequence[OutputLine]) -> list[Raised]:
    """The exceptions of a process in their order; from standard output only where standard error has none."""
    lines = plain_lines(output)
    found = (
        [*_read(line for line in lines if line.stream == stream)] for stream in ("stderr", "stdout")
    )
    return next(filter(None, found), [])[-TRACEBACK_LIMIT:]


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
    """File and line of the deepest of `frames`, outermost first, that lies in the submission."""
    meant: dict[str, str | None] = {}
    for frame in reversed(frames[-FRAME_LIMIT:]):
        if frame.path not in meant:
            meant[frame.path] = student_file(frame.path, root_files)
        if (found := meant[frame.path]) is not None:
            return found, frame.line
    return None


def student_file(path: str, root_files: Collection[str]) -> str | None:
    """The file of the submission that `path` means, judged by the longest common end; None if none does."""
    parts = path.split("/")[::-1]
    # What is installed for an interpreter is the student's only with a folder of theirs.
    least = 2 if any(_LIBRARY_FOLDERS.match(part) for part in parts[1:]) else 1
    namesakes = [file.split("/")[::-1] for file in root_files if file.endswith(parts[0])]
    ends = (
        itertools.takewhile(lambda pair: pair[0] == pair[1], zip(own, parts, strict=False))
        for own in namesakes
    )
    ranked = [
        (len(list(end)), -len(own), "/".join(own[::-1]))
        for end, own in zip(ends, namesakes, strict=True)
    ]
    best = max(ranked, default=(0, 0, ""))
    return best[2] if best[0] >= least else None


def _read(lines: Iterable[OutputLine]) -> Iterator[Raised]:
    current: Raised | None = None
    linked = ignored = False
    for raw in lines:
        if _LOG.match(raw.text):
            continue
        line = _GROUP_MARGIN.sub("", raw.text)
        is_rule, is_header = (
            _GROUP_RULE.match(raw.text) is not None,
            _HEADER.match(line) is not None,
        )
        starts = is_header or line.startswith(("Exception ignored in", _CAUSE, _DURING))
        if current is not None and (starts or is_rule or _is_over(current, line)):
            if current.type:
                yield current
            current = None if current.type or starts else current
        if is_header:
            current, linked, ignored = (
                Raised(linked=linked, ignored=ignored, headed=True),
                False,
                False,
            )
        elif starts:
            linked, ignored = (
                linked or line.startswith((_CAUSE, _DURING)),
                line.startswith("Exception ignored in"),
            )
        elif not is_rule:
            current = _taken(current, line, raw.t_ns)
    if current is not None and current.type:
        yield current


def _is_over(current: Raised, line: str) -> bool:
    """Whether the exception's message has ended."""
    if not current.type:
        return False
    return (
        not line.strip()
        or current.message.count("\n") + 1 >= _MESSAGE_LINES
        or _FRAME.match(line) is not None
    )


def _taken(current: Raised | None, line: str, t_ns: int) -> Raised | None:
    """Take in a line that may belong to a traceback; the traceback being read after it."""
    frame, final = _FRAME.match(line), _FINAL.match(line)
    if frame is not None:
        current = current or Raised()
        current.frames.append(Frame(frame[1], int(frame[2]), frame[3]))
    elif current is not None and current.type:
        current.message += f"\n{line}".rstrip()
    elif final is not None and (final[1] in _SYNTAX or (current is not None and current.headed)):
        if current is None and not final[2]:
            return None
        current = current or Raised()
        current.type, current.message, current.t_ns = final[1], (final[2] or "").strip(), t_ns
    elif final is not None:
        return None
    return current

"""Asks programs for the stacks of their threads, and reads the tap's answer with care.

The answer is text of `faulthandler`, for example:

    Thread 0x00007f8 (most recent call first):
      File "/workspace/src/node.py", line 12 in on_request
      File "/venv/rclpy/executors.py", line 310 in spin

Any code in the process can write to its pipe; the reader therefore bounds all that it keeps.
"""

from __future__ import annotations

import os
import re
import signal
from contextlib import suppress

from confine.machine import read_bytes_of
from grader.recording.session import StackFrame

#: Signals that the tap answers with the stacks of all threads, and of the main thread alone.
ALL_THREADS, MAIN_THREAD = signal.SIGRTMAX - 4, signal.SIGRTMAX - 5

_THREAD = re.compile(r"^(?:(?:Current thread|Thread) 0x|Stack \(most recent call first\))")
_FRAME = re.compile(r'^  File "([^"]{1,520})", line (\d{1,7}) in (.{1,520})$')
#: A character that `faulthandler` writes by its number, as `\xfc` or `\u0142`.
_ESCAPED = re.compile(r"\\(?:x([0-9a-f]{2})|u([0-9a-f]{4})|U([0-9a-f]{8}))")
_CAUGHT = re.compile(rb"^SigCgt:\s*([0-9a-f]+)", re.MULTILINE)
_MOST_THREADS, _MOST_FRAMES = 16, 60
_LONGEST_NAME = 300


def ask(pid: int, number: int) -> None:
    """Ask a process for stacks; a process without the tap's handler is left alone, because the signal would end it."""
    with suppress(OSError):
        caught = _CAUGHT.search(read_bytes_of(f"/proc/{pid}/status"))
        if caught is None:
            return
        has_handler = int(caught[1], 16) >> (number - 1) & 1
        if has_handler:
            os.kill(pid, number)


def threads_in(text: str, above: str) -> list[list[StackFrame]]:
    """Read the stacks in the tap's text, the innermost frame first, and drop `above` from paths."""
    threads: list[list[StackFrame]] = []
    for line in text.split("\n"):
        if _THREAD.match(line):
            threads.append([])
        frame = _FRAME.match(line)
        if frame is None:
            continue
        if threads:
            _add_frame(threads[-1], frame, above)
    kept = threads[:_MOST_THREADS]
    return list(filter(None, kept))


def _add_frame(frames: list[StackFrame], frame: re.Match[str], above: str) -> None:
    """Append a frame to the stack of a thread, up to the limit."""
    if len(frames) >= _MOST_FRAMES:
        return
    file = _unescaped(frame[1]).removeprefix(above)
    line = int(frame[2])
    function = _unescaped(frame[3])
    frames.append(StackFrame(file[:_LONGEST_NAME], line, function[:_LONGEST_NAME]))


def _unescaped(text: str) -> str:
    return _ESCAPED.sub(_character, text)


def _character(escaped: re.Match[str]) -> str:
    digits = "".join(escaped.groups(""))
    number = int(digits, 16)
    if number > 0x10FFFF:
        return "?"
    is_surrogate = 0xD800 <= number <= 0xDFFF
    if is_surrogate:
        return "?"
    return chr(number)

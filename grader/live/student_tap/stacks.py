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
        if caught is not None and int(caught[1], 16) >> (number - 1) & 1:
            os.kill(pid, number)


def threads_in(text: str, above: str) -> list[list[StackFrame]]:
    """Read the stacks in the tap's text, the innermost frame first, and drop `above` from paths."""
    threads: list[list[StackFrame]] = []
    for line in text.split("\n"):
        if _THREAD.match(line):
            threads.append([])
        frame = _FRAME.match(line)
        if frame is None or not threads or len(threads[-1]) >= _MOST_FRAMES:
            continue
        file = _unescaped(frame[1]).removeprefix(above)[:_LONGEST_NAME]
        threads[-1].append(StackFrame(file, int(frame[2]), _unescaped(frame[3])[:_LONGEST_NAME]))
    return [frames for frames in threads[:_MOST_THREADS] if frames]


def _unescaped(text: str) -> str:
    return _ESCAPED.sub(_character, text)


def _character(escaped: re.Match[str]) -> str:
    number = int(escaped[1] or escaped[2] or escaped[3], 16)
    is_character = number <= 0x10FFFF and not 0xD800 <= number <= 0xDFFF
    return chr(number) if is_character else "?"

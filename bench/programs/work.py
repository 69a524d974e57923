"""Work of a busy receiver."""

import sys
import threading
import time

PERIOD_S, _BUSY_S = 0.2, 0.1


def work() -> None:
    """Compute for a tenth of a second."""
    end_s = time.monotonic() + _BUSY_S
    while time.monotonic() < end_s:
        pass


def end_of_input() -> threading.Event:
    """Return an event that is set at the end of standard input, which tells a program to end."""
    ended = threading.Event()

    def read() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=read, daemon=True).start()
    return ended


def until_told(busy: bool) -> None:
    """Return at the end of standard input; a busy program calls `work` every fifth of a second until then."""
    ended = end_of_input()
    while not ended.wait(PERIOD_S - _BUSY_S if busy else PERIOD_S):
        if busy:
            work()

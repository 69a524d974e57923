"""Other work that a busy receiver has to do."""

import sys
import threading
import time

PERIOD_S, _BUSY_S = 0.2, 0.1


def work() -> None:
    """Compute for a tenth of a second."""
    end_s = time.monotonic() + _BUSY_S
    while time.monotonic() < end_s:
        pass


def until_told(busy: bool) -> None:
    """Return when standard input ends; every fifth of a second `work` meanwhile, if `busy`."""
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.wait(PERIOD_S - _BUSY_S if busy else PERIOD_S):
        if busy:
            work()

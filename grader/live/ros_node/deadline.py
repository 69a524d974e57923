"""Deadlines that only run while the grader looks: a stall of the grader must not make others late."""

from __future__ import annotations

import time
from collections.abc import Callable

#: Time in s between two looks that counts as a stall of the grader, which looks every few hundredths of a second.
_STALL_S = 0.25
#: Most stalled time in s that is left out.
_MOST_LEFT_OUT_S = 10.0


class Deadline:
    """A time limit; the time `stall_s` without looks does not count."""

    def __init__(self, timeout_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._looked_s = clock()
        #: Time left at the last look, in s; not more than 0 if the deadline has passed.
        self.left_s = timeout_s
        self.stall_s = 0.0

    def passed(self) -> bool:
        """Look whether the time is over."""
        now_s = self._clock()
        since_s, self._looked_s = now_s - self._looked_s, now_s
        if since_s > _STALL_S and self.stall_s + since_s <= _MOST_LEFT_OUT_S:
            self.stall_s += since_s
        else:
            self.left_s -= since_s
        return self.left_s <= 0

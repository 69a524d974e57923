"""Deadlines that only run while somebody looks: who stalls for a while must not take others for late."""

from __future__ import annotations

import time
from collections.abc import Callable

#: Who waits looks every few hundredths of a second; where so much lies between two looks, it stalled itself.
_STALL_S = 0.25
#: So much of a stall is left out of account, and no more.
_MOST_LEFT_OUT_S = 10.0


class Deadline:
    """A time that something may take; `stall_s` is for how long nobody looked, which does not count."""

    def __init__(self, timeout_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._left_s, self._looked_s = timeout_s, clock()
        self.stall_s = 0.0

    def passed(self) -> bool:
        """Look whether the time is over."""
        now_s = self._clock()
        since_s, self._looked_s = now_s - self._looked_s, now_s
        if since_s > _STALL_S and self.stall_s + since_s <= _MOST_LEFT_OUT_S:
            self.stall_s += since_s
        else:
            self._left_s -= since_s
        return self._left_s <= 0

"""Slots for sandboxes on this machine, shared by all gradings on it."""

from __future__ import annotations

import asyncio
import math
import os
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress

from confine.isolation import Isolation
from confine.machine import cpu_quota, idle_s
from grader.live.session.scheduler import SESSIONS_PER_CORE, sessions_at_a_time

_POLL_S = 0.1
#: A sandbox more is admitted where the cores had nothing to do for this share of such a time: on two cores as much as
#: the usual session takes. With twice the share a fifth of the cores' time was left over. To ask for what the very
#: session took before kept the short, busy ones waiting, and all others behind them.
ROOM_SHARE, ROOM_S = 0.1, 0.3
#: Largest number of slots; a request for all of them runs alone.
MOST_SLOTS = 32
#: Slots for each core, spare ones included. A usual session needs 0.15 to 0.18 of a core: with four slots for
#: each of two cores, these were busy 68 % of the time, and 90 % with six.
SLOTS_PER_CORE = 6


class Machine:
    """A number of slots for sandboxes, found by all gradings through its name.

    A slot is held by binding the abstract socket with its name. The kernel frees the slots of a killed process, and
    nothing is left behind. All requests pass a `turnstile`, so that later sandboxes do not starve a request for many
    slots. Spare slots are given while the machine's cores are mostly idle.
    """

    def __init__(
        self,
        slots: int,
        name: str = "grade",
        *,
        spare: int = 0,
        idle_s: Callable[[], float] = idle_s,
    ) -> None:
        self.slots = min(slots, MOST_SLOTS)
        self.spare = min(spare, MOST_SLOTS - self.slots)
        self._name = name
        self._idle_s = idle_s

    @classmethod
    def of(cls, isolation: Isolation, jobs: int | None = None) -> Machine:
        """Return this machine's slots: the wanted number, or as many as one grading uses, and spare ones by cores.

        Sandboxes that share a network could send messages to each other; they get a single slot. A quota of CPU time
        leaves cores idle that may not be used; there are no spare slots then.
        """
        slots = sessions_at_a_time(isolation)
        if not isolation.namespaces:
            return cls(slots)
        if jobs is not None:
            return cls(jobs)
        quota = cpu_quota()
        if quota is not None:
            return cls(min(slots, max(1, math.floor(SESSIONS_PER_CORE * quota))))
        cores = len(os.sched_getaffinity(0))
        return cls(slots, spare=SLOTS_PER_CORE * cores - slots)

    def submissions(self, sessions: int) -> int:
        """Return how many submissions, of some sessions each, usually keep all slots in use.

        While a submission is read, waits for its last session, or is judged, it uses fewer slots than it has sessions.
        """
        slots = self.slots + self.spare
        twice = math.ceil(2 * slots / max(1, sessions))
        return min(slots, 1 + twice)

    def is_asked(self) -> bool:
        """Return whether a request waits for slots; between two requests it is False for a moment."""
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as turnstile:
                turnstile.bind(self._address("turnstile"))
        except OSError:
            return True
        return False

    def _address(self, name: str) -> str:
        return f"\0{self._name}-{name}"

    async def take(self, parts: int | None = None) -> Callable[[], None]:
        """Wait for a slot, or for all slots of one of some parts; returns the context that frees them.

        Of n parts, each has every n-th slot: a single part has all slots, and with as many parts as `slots`, a part
        excludes spare slots.
        """
        with await self._bind([["turnstile"]]):
            count = parts or self.slots + self.spare
            step = MOST_SLOTS if parts is None else parts
            names = []
            for first in range(1, count + 1):
                numbers = range(first, MOST_SLOTS + 1, step)
                names.append([f"slot-{number}" for number in numbers])
            at_once = self.slots
            if parts is not None:
                at_once = len(names)
            held = await self._bind(names[:at_once], names[at_once:])
            return held.close

    async def _bind(
        self, groups: Sequence[Sequence[str]], spare: Sequence[Sequence[str]] = ()
    ) -> ExitStack:
        """Wait until a group of names is free, or a spare one while cores are idle, and hold the group."""
        looked_s, idle_s = time.monotonic(), self._idle_s() if spare else 0.0
        while True:
            has_room, past_s = False, time.monotonic() - looked_s
            if spare and past_s > ROOM_S:
                now_s = self._idle_s()
                has_room = now_s - idle_s > ROOM_SHARE * past_s
                looked_s, idle_s = time.monotonic(), now_s
            for names in (*groups, *(spare if has_room else ())):
                with suppress(OSError), ExitStack() as held:
                    for name in names:
                        holder = held.enter_context(
                            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
                        )
                        holder.bind(self._address(name))
                    return held.pop_all()
            await asyncio.sleep(_POLL_S)

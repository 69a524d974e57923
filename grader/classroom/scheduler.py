"""Slots for sandboxes on this machine, shared by all gradings that run on it at a time."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack

from grader.live.sandbox.isolation import Isolation
from grader.live.sandbox.machine import idle_s
from grader.live.session.runner import sessions_at_a_time

_POLL_S = 0.1
#: For so long it is looked what the cores have to do before a sandbox more is admitted; a tenth of them is left idle,
#: since what is timed needs a core at once.
_LOOK_S, _LEFT_IDLE = 1.0, 0.1
#: What a session takes of a core where that is not known.
USUAL_SHARE = 0.4
#: The most slots there are; what runs alone holds all of them.
MOST_SLOTS = 16


class Machine:
    """A number of slots for sandboxes, or all of them for one; by the name, gradings find each other.

    Whoever holds the abstract socket of a slot's name holds the slot, so the kernel frees what a killed process
    held, and nothing is left behind. Everyone comes through a `turnstile`, so that sandboxes which come later do not
    keep one that waits for all slots from them. Some are `spare`: given where the machine's `cores` have as much to
    spare as what comes will take.
    """

    def __init__(
        self,
        slots: int,
        name: str = "grade",
        *,
        spare: int = 0,
        cores: int = 1,
        idle_s: Callable[[], float] = idle_s,
    ) -> None:
        self.slots = min(slots, MOST_SLOTS)
        self.spare = min(spare, MOST_SLOTS - self.slots)
        self._cores = cores
        self._name = name
        self._idle_s = idle_s

    @classmethod
    def of(cls, isolation: Isolation, jobs: int | None = None) -> Machine:
        """Return this machine's slots: so many as are wanted, or as its cores allow, and as many more if they are idle.

        Where sandboxes share a network, one could speak in another's, so that there is one slot.
        """
        slots = sessions_at_a_time(isolation)
        if jobs is not None and isolation.namespaces:
            return cls(jobs)
        return cls(slots, spare=slots if isolation.namespaces else 0, cores=len(os.sched_getaffinity(0)))

    async def take(self, share: float = USUAL_SHARE, *, alone: bool = False) -> Callable[[], None]:
        """Wait for a slot for what takes a share of a core, or for all slots; returns what gives them back."""
        with await self._bind(["turnstile"]), ExitStack() as held:
            if alone:
                for number in range(1, MOST_SLOTS + 1):
                    held.enter_context(await self._bind([f"slot-{number}"]))
            else:
                names = [f"slot-{number}" for number in range(1, self.slots + self.spare + 1)]
                held.enter_context(await self._bind(names[: self.slots], names[self.slots :], share))
            return held.pop_all().close

    async def _bind(self, names: Sequence[str], spare: Sequence[str] = (), share: float = 0.0) -> socket.socket:
        """Wait until a name is free, or a spare one and so much of a core is idle; returns its holder."""
        looked_s, idle_s = time.monotonic(), self._idle_s()
        while True:
            has_room, past_s = False, time.monotonic() - looked_s
            if past_s > _LOOK_S:
                idle_share = (self._idle_s() - idle_s) / past_s
                has_room = self._cores * (idle_share - _LEFT_IDLE) > share
                looked_s, idle_s = time.monotonic(), self._idle_s()
            for name in (*names, *(spare if has_room else ())):
                holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
                try:
                    holder.bind(f"\0{self._name}-{name}")
                except OSError:
                    holder.close()
                else:
                    return holder
            await asyncio.sleep(_POLL_S)

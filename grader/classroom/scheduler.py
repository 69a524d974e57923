"""Slots for sandboxes on this machine, shared by all gradings that run on it at a time."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Iterable

from grader.live.sandbox.isolation import Isolation
from grader.live.session.runner import sessions_at_a_time

_POLL_S = 0.1
#: The most slots there are; what runs alone holds all of them.
MOST_SLOTS = 16


class Machine:
    """A number of slots for sandboxes, or all of them for one.

    Parameters
    ----------
    places : int
        Sandboxes at a time.
    name : str
        Under which gradings find each other.

    Notes
    -----
    Whoever holds the abstract socket of a slot's name holds the slot, so the kernel frees what a killed process
    held, and nothing is left behind. Everyone comes through a `turnstile`, so that sandboxes which come later do not
    keep one that waits for all slots from them.
    """

    def __init__(self, slots: int, name: str = "grade") -> None:
        self.slots = min(slots, MOST_SLOTS)
        self._name = name

    @classmethod
    def of(cls, isolation: Isolation, jobs: int | None = None) -> Machine:
        """Return this machine's slots: so many as are wanted, or as its cores allow.

        Where sandboxes share a network, one could speak in another's, so that there is one slot.
        """
        return cls(jobs if jobs is not None and isolation.namespaces else sessions_at_a_time(isolation))

    async def take(self, *, alone: bool = False) -> Callable[[], None]:
        """Wait for a slot, or for all; returns what gives them back."""
        held: list[socket.socket] = []
        turnstile = await self._bind(["turnstile"])
        try:
            if alone:
                for number in range(1, MOST_SLOTS + 1):
                    held.append(await self._bind([f"slot-{number}"]))
            else:
                held.append(await self._bind([f"slot-{number}" for number in range(1, self.slots + 1)]))
        except BaseException:
            _close(held)
            raise
        finally:
            turnstile.close()
        return lambda: _close(held)

    async def _bind(self, names: Iterable[str]) -> socket.socket:
        """Wait until one of some names is free; returns what holds it."""
        wanted = list(names)
        while True:
            for name in wanted:
                holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
                try:
                    holder.bind(f"\0{self._name}-{name}")
                except OSError:
                    holder.close()
                else:
                    return holder
            await asyncio.sleep(_POLL_S)


def _close(held: Iterable[socket.socket]) -> None:
    for holder in held:
        holder.close()

"""Places for cells on this machine, shared by all gradings that run on it at a time."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Iterable

from grader.live.sandbox.isolation import Isolation
from grader.live.session.runner import cells_at_a_time

_POLL_S = 0.1
#: The most places there are; what runs alone holds all of them.
MOST_PLACES = 16


class Machine:
    """A number of places for cells, or all of them for one.

    Parameters
    ----------
    places : int
        Cells at a time.
    name : str
        Under which gradings find each other.

    Notes
    -----
    Whoever holds the abstract socket of a place's name holds the place, so the kernel frees what a killed process
    held, and nothing is left behind. Everyone comes through a `turnstile`, so that cells which come later do not
    keep one that waits for all places from them.
    """

    def __init__(self, places: int, name: str = "grade") -> None:
        self.places = min(places, MOST_PLACES)
        self._name = name

    @classmethod
    def of(cls, isolation: Isolation, jobs: int | None = None) -> Machine:
        """Return this machine's places: so many as are wanted, or as its cores allow.

        Where cells share a network, one could speak in another's, so that there is one place.
        """
        return cls(jobs if jobs is not None and isolation.namespaces else cells_at_a_time(isolation))

    async def take(self, *, alone: bool = False) -> Callable[[], None]:
        """Wait for a place, or for all; returns what gives them back."""
        held: list[socket.socket] = []
        turnstile = await self._bind(["turnstile"])
        try:
            if alone:
                for number in range(1, MOST_PLACES + 1):
                    held.append(await self._bind([f"place-{number}"]))
            else:
                held.append(await self._bind([f"place-{number}" for number in range(1, self.places + 1)]))
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

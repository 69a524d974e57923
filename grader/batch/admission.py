"""Who may use the machine next: the places of one grading of many submissions."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum

from grader.batch.machine import Machine
from grader.live.cells import cells_at_a_time
from grader.live.isolation import Isolation

#: As soon as so many wait to be alone, the others make room for them.
_MOST_WAITING_ALONE = 3


class Use(IntEnum):
    """What a place is for; the lower goes first, since what ends a submission frees most."""

    WORK = 0
    CELL = 1
    START = 2


class Place:
    """A place that was granted."""

    def __init__(self, on_release: Callable[[], None]) -> None:
        self._on_release: Callable[[], None] | None = on_release

    def release(self) -> None:
        """Give the place back; once is enough, more does nothing."""
        if self._on_release is not None:
            on_release, self._on_release = self._on_release, None
            on_release()


@dataclass(order=True)
class _Waiting:
    """Who waits; sorted by use, then submission, then who came first."""

    use: Use
    submission: int
    number: int
    alone: bool = field(compare=False)
    granted: asyncio.Future[None] = field(compare=False)


class Admission:
    """Grants places, so that no core idles while any submission has something to run.

    A session that must be alone waits until nothing else is left to do, or until some such have gathered:
    emptying the machine for each by itself would leave cores idle every time.

    Parameters
    ----------
    places : int
        How many cells, or pieces of work in their stead, may run at a time.
    machine : Machine, optional
        Shared with other gradings; without it, the places are on other machines.
    """

    def __init__(self, places: int, machine: Machine | None = None) -> None:
        self._places = places
        self._machine = machine
        self._waiting: list[_Waiting] = []
        self._taken = 0
        self._emptying = False
        self._alone = False
        self._asked = 0

    @classmethod
    def on_this_machine(cls, isolation: Isolation, jobs: int | None = None) -> Admission:
        """Make the admission of one grading here.

        Parameters
        ----------
        jobs : int or None
            How many cells this grading wants at a time; by default as many as the machine takes. Where cells share
            a network, one could speak in another's, so that it stays at one.
        """
        most = cells_at_a_time(isolation)
        places = jobs if jobs is not None and isolation.namespaces else most
        return cls(places, Machine(max(most, places)))

    @property
    def places(self) -> int:
        """How many cells may run at a time."""
        return self._places

    def resize(self, places: int) -> None:
        """Take note of how many places there are."""
        self._places = places
        self._grant()

    async def take(self, use: Use, submission: int, *, alone: bool = False) -> Place:
        """Wait for a place.

        Parameters
        ----------
        submission : int
            Its number in the queue; earlier ones go first.
        """
        self._asked += 1
        waiting = _Waiting(use, submission, self._asked, alone, asyncio.get_running_loop().create_future())
        self._waiting.append(waiting)
        self._grant()
        try:
            await waiting.granted
            place = Place(lambda: self._release(alone))
        except asyncio.CancelledError:
            if waiting in self._waiting:
                self._waiting.remove(waiting)
                self._grant()
            elif waiting.granted.done() and not waiting.granted.cancelled():
                self._release(alone)
            raise
        if self._machine is None:
            return place
        try:
            give_back = await self._machine.take(alone=alone)
        except BaseException:
            place.release()
            raise

        def release() -> None:
            give_back()
            place.release()

        return Place(release)

    def _release(self, alone: bool) -> None:
        self._taken -= 1
        self._alone = self._alone and not alone
        self._grant()

    def _grant(self) -> None:
        while (chosen := self._next()) is not None:
            self._waiting.remove(chosen)
            self._taken += 1
            self._alone = chosen.alone
            chosen.granted.set_result(None)

    def _next(self) -> _Waiting | None:
        still = [w for w in self._waiting if not w.granted.done()]  # and not given up
        ordinary = [w for w in still if not w.alone]
        alone = [w for w in still if w.alone]
        self._emptying = bool(alone) and (self._emptying or len(alone) >= _MOST_WAITING_ALONE)
        if self._alone or self._taken >= self._places:
            return None
        if ordinary and not self._emptying:
            return min(ordinary)
        return min(alone) if alone and self._taken == 0 else None

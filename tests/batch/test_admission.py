"""Who goes next: what ends a submission first, earlier ones first, and one that must be alone with nobody else."""

from __future__ import annotations

import asyncio
import sys
import uuid

import pytest

from grader.batch.admission import Admission, Place, Use
from grader.batch.machine import Machine
from grader.live.isolation import Form, Isolation, Level

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="abstract sockets are Linux's own")


class Queue:
    """An admission, and the order in which it let people in."""

    def __init__(self, places: int) -> None:
        self.admission = Admission(places, Machine(places, f"grade-test-{uuid.uuid4().hex}"))
        self.admitted: list[str] = []
        self.places: dict[str, Place] = {}
        self.tasks: dict[str, asyncio.Task[None]] = {}

    async def comes(self, name: str, use: Use, submission: int, *, alone: bool = False) -> None:
        """Let someone queue."""

        async def wait() -> None:
            self.places[name] = await self.admission.take(use, submission, alone=alone)
            self.admitted.append(name)

        self.tasks[name] = asyncio.ensure_future(wait())
        await settle()

    async def leaves(self, name: str) -> None:
        """Let someone who was admitted leave."""
        self.places.pop(name).release()
        await settle()


async def settle() -> None:
    """Let everything happen that can happen without waiting for time to pass."""
    for _ in range(20):
        await asyncio.sleep(0)


def test_what_ends_a_submission_goes_first() -> None:
    """Work goes before sessions, sessions before new submissions, and earlier submissions before later ones."""

    async def scenario() -> list[str]:
        queue = Queue(1)
        await queue.comes("holder", Use.CELL, 0)
        await queue.comes("start 3", Use.START, 3)
        await queue.comes("start 2", Use.START, 2)
        await queue.comes("cell of 1, second", Use.CELL, 1)
        await queue.comes("cell of 0", Use.CELL, 0)
        await queue.comes("work of 1", Use.WORK, 1)
        for _ in range(6):
            await queue.leaves(queue.admitted[-1])
        return queue.admitted

    assert asyncio.run(scenario()) == [
        "holder", "work of 1", "cell of 0", "cell of 1, second", "start 2", "start 3",
    ]  # fmt: skip


def test_sessions_of_a_submission_keep_their_order() -> None:
    """Of one submission, the session that is asked for first, which is the longest, runs first."""

    async def scenario() -> list[str]:
        queue = Queue(1)
        for name in ("longest", "middle", "shortest"):
            await queue.comes(name, Use.CELL, 0)
        for _ in range(3):
            await queue.leaves(queue.admitted[-1])
        return queue.admitted

    assert asyncio.run(scenario()) == ["longest", "middle", "shortest"]


def test_no_place_idles_while_anyone_has_something_to_run() -> None:
    """At the tail of one submission the places go to the next."""

    async def scenario() -> list[str]:
        queue = Queue(2)
        await queue.comes("last of 0", Use.CELL, 0)
        await queue.comes("start 1", Use.START, 1)
        await queue.leaves("start 1")
        await queue.comes("first of 1", Use.CELL, 1)
        return queue.admitted

    assert asyncio.run(scenario()) == ["last of 0", "start 1", "first of 1"]


def test_one_alone_waits_until_nothing_else_is_left() -> None:
    """A session that must be alone is put off while there is other work, and runs with nobody beside it."""

    async def scenario() -> None:
        queue = Queue(2)
        await queue.comes("a", Use.CELL, 0)
        await queue.comes("alone", Use.CELL, 0, alone=True)
        await queue.comes("b", Use.START, 1)
        assert queue.admitted == ["a", "b"]
        await queue.leaves("b")
        assert queue.admitted == ["a", "b"]
        await queue.leaves("a")
        assert queue.admitted == ["a", "b", "alone"]
        await queue.comes("c", Use.WORK, 0)
        assert queue.admitted == ["a", "b", "alone"]
        await queue.leaves("alone")
        assert queue.admitted == ["a", "b", "alone", "c"]

    asyncio.run(scenario())


def test_several_that_must_be_alone_get_the_machine_together() -> None:
    """With three that must be alone, the others make room once, and they run one after another."""

    async def scenario() -> list[str]:
        queue = Queue(2)
        await queue.comes("a", Use.CELL, 0)
        for number in range(3):
            await queue.comes(f"alone {number}", Use.CELL, number, alone=True)
        await queue.comes("b", Use.CELL, 3)
        assert queue.admitted == ["a"]
        for _ in range(4):
            await queue.leaves(queue.admitted[-1])
        return queue.admitted

    assert asyncio.run(scenario()) == ["a", "alone 0", "alone 1", "alone 2", "b"]


def test_whoever_gives_up_takes_no_place() -> None:
    """One that is cancelled, before or in the very moment in which it is let in, leaves the place to others."""

    async def scenario() -> list[str]:
        queue = Queue(1)
        await queue.comes("a", Use.CELL, 0)
        await queue.comes("gives up", Use.CELL, 1)
        await queue.comes("b", Use.CELL, 2)
        queue.tasks["gives up"].cancel()
        await queue.leaves("a")
        await queue.comes("gives up late", Use.CELL, 3)
        queue.places.pop("b").release()  # lets it in, but it does not know yet
        queue.tasks["gives up late"].cancel()
        await settle()
        await queue.comes("c", Use.CELL, 4)
        return queue.admitted

    assert asyncio.run(scenario()) == ["a", "b", "c"]


def test_giving_back_twice_does_nothing() -> None:
    """A place that was given back twice is free once."""

    async def scenario() -> list[str]:
        queue = Queue(1)
        await queue.comes("a", Use.CELL, 0)
        place = queue.places["a"]
        place.release()
        place.release()
        await queue.comes("b", Use.CELL, 1)
        await queue.comes("c", Use.CELL, 2)
        return queue.admitted

    assert asyncio.run(scenario()) == ["a", "b"]


def test_cells_that_share_a_network_run_one_at_a_time() -> None:
    """Whatever was asked for, a submission is not given the chance to speak in another's network."""
    assert Admission.on_this_machine(Isolation(Level.REDUCED), 4).places == 1
    assert Admission.on_this_machine(Isolation(Level.NO_CGROUP, Form.USER), 4).places == 4

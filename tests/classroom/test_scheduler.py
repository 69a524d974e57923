"""Places for sandboxes: as many as there are, all of them for one, and none lost with a killed holder."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from confine.isolation import Isolation, Level
from confine.namespaces import Form
from grader.classroom.scheduler import MOST_SLOTS, ROOM_S, ROOM_SHARE, Machine

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="abstract sockets are Linux's own")

#: Takes a place (or all, if told to), says so, and holds it until it is killed.
_HOLDER = """
import asyncio, sys, time
from grader.classroom.scheduler import Machine
give_back = asyncio.run(Machine(2, sys.argv[1]).take(1 if sys.argv[2] == "alone" else None))
print("holds", flush=True)
time.sleep(600)
"""


def machine(slots: int) -> Machine:
    """Make places that no other test knows."""
    return Machine(slots, f"grade-test-{uuid.uuid4().hex}")


async def waits(
    taking: Coroutine[Any, Any, Callable[[], None]],
) -> asyncio.Task[Callable[[], None]]:
    """Start to take a place, give that five chances, and check that it has to wait."""
    task = asyncio.ensure_future(taking)
    await asyncio.sleep(0.5)
    assert not task.done()
    return task


def test_as_many_as_there_are_places() -> None:
    """One more than there are places waits until a place is given back."""

    async def scenario() -> None:
        slots = machine(2)
        first, second = await slots.take(), await slots.take()
        third = await waits(slots.take())
        second()
        give_back = await third
        give_back()
        first()

    asyncio.run(scenario())


@pytest.mark.parametrize(("share", "more"), [(0.8, 2), (ROOM_SHARE / 2, 0)])
def test_idle_cores_take_more_one_after_another(share: float, more: int) -> None:
    """Beyond its slots a machine takes one sandbox after another while its cores have little to do, up to a number."""

    async def scenario() -> None:
        slots = Machine(
            1, f"grade-test-{uuid.uuid4().hex}", spare=2, idle_s=lambda: share * time.monotonic()
        )
        held = [await slots.take()]
        for _ in range(more):
            began_s = time.monotonic()
            held.append(await slots.take())
            assert time.monotonic() - began_s >= ROOM_S
        waiting = asyncio.ensure_future(slots.take())
        await asyncio.sleep(1.5)
        assert not waiting.done()
        for give_back in held:
            give_back()
        (await waiting)()

    asyncio.run(scenario())


def test_one_alone_waits_for_all_and_keeps_all_out() -> None:
    """One that runs alone waits for those that run; those that come after it wait for it."""

    async def scenario() -> None:
        slots = machine(2)
        running = await slots.take()
        alone = await waits(slots.take(1))
        later = await waits(slots.take())
        running()
        give_back = await alone
        assert not later.done()
        give_back()
        (await later)()

    asyncio.run(scenario())


def test_one_alone_on_a_part_leaves_the_others() -> None:
    """One alone on one of two parts keeps the others from that; beside it runs half of them, or another alone."""

    async def scenario() -> None:
        slots = machine(4)
        alone = await slots.take(2)
        beside = [await slots.take(), await slots.take()]
        waiting = await waits(slots.take())
        beside.pop()()
        beside.append(await waiting)
        again = await waits(slots.take(2))
        for give_back in beside:
            give_back()
        also_alone = await again
        third = await waits(slots.take(2))
        alone()
        for give_back in (also_alone, await third):
            give_back()

    asyncio.run(scenario())


def test_the_part_that_is_free_is_taken() -> None:
    """A job takes the first free part of the machine.

    It does not wait for a part with a long session, such as one without answers.
    """

    async def scenario() -> None:
        slots = machine(4)
        first, second, third = [await slots.take() for _ in range(3)]
        first()  # its part has the third place too
        second()
        give_back = await asyncio.wait_for(slots.take(2), 30)
        for held in (third, give_back):
            held()

    asyncio.run(scenario())


def test_whoever_gives_up_leaves_nothing_held() -> None:
    """A cancelled wait gives back the places it already held."""

    async def scenario() -> None:
        slots = machine(1)
        running = await slots.take()
        waiting = await waits(slots.take(1))
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        running()
        give_back = await asyncio.wait_for(slots.take(1), 30)
        give_back()

    asyncio.run(scenario())


@pytest.mark.parametrize("how", ["beside others", "alone"])
def test_what_a_killed_process_held_is_free(how: str) -> None:
    """Other processes see held places, and get them after a kill -9 of the holder."""
    name = f"grade-test-{uuid.uuid4().hex}"
    command = [sys.executable, "-c", _HOLDER, name, how]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        try:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "holds\n"

            async def scenario() -> None:
                waiting = await waits(Machine(2, name).take(1))
                holder.kill()
                (await asyncio.wait_for(waiting, 30))()

            asyncio.run(scenario())
        finally:
            holder.kill()


def test_no_more_places_than_one_alone_holds() -> None:
    """However many places are asked for, one that runs alone holds every one of them."""

    async def scenario() -> None:
        slots = machine(MOST_SLOTS + 5)
        alone = await slots.take(1)
        waiting = await waits(slots.take())
        alone()
        (await waiting)()

    asyncio.run(scenario())


@pytest.mark.parametrize("jobs", [None, 1, 4])
def test_sandboxes_that_share_a_network_run_one_at_a_time(jobs: int | None) -> None:
    """Whatever was asked for, a submission is not given the chance to speak in another's network."""
    assert Machine.of(Isolation(Level.NONE), jobs).slots == 1
    assert Machine.of(Isolation(Level.FULL, Form.USER), 7).slots == 7


def test_a_request_is_seen_while_it_waits() -> None:
    """Only a request that has to wait shows that slots are wanted."""

    async def scenario() -> None:
        slots = machine(1)
        running = await slots.take()
        assert not slots.is_asked()
        waiting = await waits(slots.take())
        assert slots.is_asked()
        running()
        (await waiting)()

    asyncio.run(scenario())


@pytest.mark.parametrize(
    ("slots", "spare", "sessions", "submissions"),
    [(4, 8, 5, 6), (4, 8, 1, 12), (1, 0, 5, 1), (4, 0, 0, 4)],
)
def test_few_submissions_keep_the_slots_in_use(
    slots: int, spare: int, sessions: int, submissions: int
) -> None:
    """The more sessions a submission has, the fewer run side by side."""
    assert Machine(slots, spare=spare).submissions(sessions) == submissions


def test_a_quota_leaves_no_spare_slots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Idle cores do not help a program that may not use them."""
    confined = Isolation(Level.FULL, Form.USER)
    monkeypatch.setattr("grader.classroom.scheduler.cpu_quota", lambda: 1.0)
    limited = Machine.of(confined)
    assert (limited.slots, limited.spare) == (2, 0)
    monkeypatch.setattr("grader.classroom.scheduler.cpu_quota", lambda: None)
    assert Machine.of(confined).spare > 0

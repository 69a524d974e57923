"""Waiting with an end: nothing that was asked meanwhile is lost."""

from __future__ import annotations

import asyncio
import time

import pytest

from grader.live.process.waiting import looked_for, within


@pytest.mark.parametrize("turns", range(5))
def test_a_request_to_end_is_heeded_just_as_the_work_ends(turns: int) -> None:
    """However soon behind the end of the work it comes, one that waits is cancelled, or has its result."""

    async def ask() -> None:
        ended: asyncio.Future[int] = asyncio.get_running_loop().create_future()

        async def lines() -> None:
            await within(ended, 60.0)
            await asyncio.sleep(60)

        task = asyncio.ensure_future(lines())
        await asyncio.sleep(0.01)
        ended.set_result(1)
        for _ in range(turns):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.wait({task}, timeout=5.0)
        assert task.cancelled()

    asyncio.run(ask())


def test_what_takes_too_long_is_cancelled_and_has_cleaned_up() -> None:
    """The error comes when the work has ended its cleaning up; in time, its result or its own error comes."""
    seen: list[str] = []

    async def work(length_s: float) -> str:
        try:
            await asyncio.sleep(length_s)
        finally:
            await asyncio.sleep(0)
            seen.append(f"ended {length_s}")
        if length_s:
            raise ValueError("its own")
        return "done"

    async def ask() -> None:
        with pytest.raises(asyncio.TimeoutError):
            await within(work(60.0), 0.01)
        assert seen == ["ended 60.0"]
        assert await within(work(0.0), 60.0) == "done"
        with pytest.raises(ValueError, match="its own"):
            await within(work(0.01), 60.0)

    asyncio.run(ask())


def test_a_condition_is_looked_at_every_so_often() -> None:
    """A look that takes longer than the time between two does not make the next ones follow at once."""
    looks: list[float] = []

    def look() -> bool:
        looks.append(time.monotonic())
        if len(looks) == 2:
            time.sleep(0.12)
        return len(looks) == 5

    async def wait() -> None:
        await within(looked_for(look, 0.05), 60.0)

    begun = time.monotonic()
    asyncio.run(wait())
    assert len(looks) == 5
    assert looks[0] - begun > 0.04
    assert looks[2] - looks[1] > 0.16


def test_a_look_that_fails_ends_the_wait() -> None:
    """Its error is the waiting task's, and no look follows it or a cancellation."""
    looks: list[str] = []

    def fail() -> bool:
        looks.append("failed")
        raise ValueError("its own")

    def find_nothing() -> bool:
        looks.append("nothing")
        return False

    async def wait() -> None:
        with pytest.raises(ValueError, match="its own"):
            await looked_for(fail, 0.01)
        task = asyncio.ensure_future(looked_for(find_nothing, 0.01))
        await asyncio.sleep(0.05)
        task.cancel()
        before = len(looks)
        await asyncio.sleep(0.05)
        assert task.cancelled()
        assert len(looks) == before

    asyncio.run(wait())
    assert looks[:2] == ["failed", "nothing"]

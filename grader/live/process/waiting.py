"""Waiting for work: for one piece not too long, for several until each has cleaned up; and for a condition."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from typing import Any, TypeVar

T = TypeVar("T")


async def within(work: Awaitable[T], timeout_s: float) -> T:
    """Return the result of some work; cancel it and raise `asyncio.TimeoutError` if it does not end in time.

    Before Python 3.12, `asyncio.wait_for` returns as usual if it is cancelled just as the work has ended: the cancelled
    task then goes on.
    """
    task = asyncio.ensure_future(work)
    try:
        done, _ = await asyncio.wait({task}, timeout=timeout_s)
    finally:
        if not task.done():
            task.cancel()
            await asyncio.wait({task})
    if not done:
        raise TimeoutError
    return task.result()


async def looked_for(look: Callable[[], bool], period_s: float) -> None:
    """Wait until a look finds something, with a look every `period_s`; raises the error of a look.

    The event loop itself calls the look. A task that sleeps between two looks would take twice the time: the loop goes
    round twice to wake it.
    """
    loop = asyncio.get_running_loop()
    found: asyncio.Future[None] = loop.create_future()
    timer: asyncio.TimerHandle

    def call() -> None:
        nonlocal timer
        if found.done():  # The waiting task was cancelled just now.
            return
        try:
            if look():
                found.set_result(None)
                return
        except Exception as problem:
            found.set_exception(problem)
            return
        # Looks with the same beginning stay together, and the loop wakes up for all of them at once.
        next_s = timer.when() + period_s
        now_s = loop.time()
        if next_s < now_s:
            next_s = now_s + period_s
        timer = loop.call_at(next_s, call)

    timer = loop.call_later(period_s, call)
    try:
        await found
    finally:
        timer.cancel()


async def side_by_side(works: Iterable[Coroutine[Any, Any, T]]) -> list[T]:
    """Do all works at a time; the first failure cancels the others. It returns after each has cleaned up."""
    running = [asyncio.ensure_future(work) for work in works]
    try:
        return await asyncio.gather(*running)
    finally:
        # `gather` ends with the first failure or cancellation; the others must then clean up.
        for task in running:
            task.cancel()
        if running:
            await asyncio.wait(running)

"""Waiting for work: for one piece up to a timeout, for several until each has cleaned up."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Coroutine, Iterable
from typing import Any, TypeVar

T = TypeVar("T")


async def within(work: Awaitable[T], timeout_s: float) -> T:
    """Return the result of some work; cancel work that has not ended in time, and raise `asyncio.TimeoutError`.

    Before Python 3.12, `asyncio.wait_for` returns normally if it is cancelled just as the work ends; a caller that was
    asked to end would then go on.
    """
    task = asyncio.ensure_future(work)
    try:
        done, _ = await asyncio.wait({task}, timeout=timeout_s)
    finally:
        if not task.done():
            task.cancel()
            await asyncio.wait({task})
    if not done:
        raise asyncio.TimeoutError
    return task.result()


async def side_by_side(works: Iterable[Coroutine[Any, Any, T]]) -> list[T]:
    """Do all works at the same time; the first that fails ends the others. Always wait until each has cleaned up."""
    running = [asyncio.ensure_future(work) for work in works]
    try:
        return await asyncio.gather(*running)
    finally:
        # `gather` ends with the first work that fails or is cancelled; the others must then clean up.
        for task in running:
            task.cancel()
        if running:
            await asyncio.wait(running)

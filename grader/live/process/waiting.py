"""Waiting for work: for one piece not too long, for several until each has cleaned up."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Coroutine, Iterable
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

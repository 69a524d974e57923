"""Waiting for something that must not take too long."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from typing import TypeVar

T = TypeVar("T")


async def within(work: Awaitable[T], timeout_s: float) -> T:
    """Return what some work gives; what has not ended in time is cancelled, and `asyncio.TimeoutError` raised.

    Before Python 3.12, `asyncio.wait_for` returns as usual where it is cancelled just as the work has ended: then
    whoever was asked to end goes on.
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

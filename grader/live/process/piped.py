"""Processes with pipes, in an event loop: their input, the blocks of their output, and their end."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable
from typing import IO

#: Most bytes that are read at a time.
READ_BYTES = 64 * 1024


class PipedProcess:
    """A started process: its id, its ends of the pipes to it, and its end.

    Parameters
    ----------
    stdin
        None if the process has no input.
    wait
        Waits for the end of the process and returns its exit status (negative: the signal that ended it). It is called
        after the end, or by a thread on a system without descriptors of processes.
    """

    def __init__(
        self,
        pid: int,
        stdin: PipeWriter | None,
        stdout: IO[bytes],
        stderr: IO[bytes],
        wait: Callable[[], int],
    ) -> None:
        self.pid = pid
        self.stdin = stdin
        self.stdout = stdout
        self.stderr = stderr
        self._wait = wait
        self._loop = asyncio.get_running_loop()
        self._status: asyncio.Future[int] = self._loop.create_future()
        try:
            self._end = os.pidfd_open(pid)
        except OSError:
            threading.Thread(target=self._reap, name=f"waits for {pid}", daemon=True).start()
        else:
            self._loop.add_reader(self._end, self._take_status)

    def _take_status(self) -> None:
        self._loop.remove_reader(self._end)
        os.close(self._end)
        self._status.set_result(self._wait())

    def _reap(self) -> None:
        status = self._wait()
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._status.set_result, status)

    async def wait(self) -> int:
        """Wait until it has ended, and return its exit status (negative: the signal that ended it)."""
        return await asyncio.shield(self._status)


async def wait_for_end(pid: int, timeout_s: float) -> None:
    """Wait until a process has ended, up to a time; raises `OSError` if there is none."""
    loop = asyncio.get_running_loop()
    ended = loop.create_future()
    descriptor = os.pidfd_open(pid)

    def note_end() -> None:
        loop.remove_reader(descriptor)
        ended.set_result(None)

    loop.add_reader(descriptor, note_end)
    try:
        await asyncio.wait({ended}, timeout=timeout_s)
    finally:
        loop.remove_reader(descriptor)
        os.close(descriptor)


class BlockReader:
    """Hands on each block from a pipe as it comes, and an empty one at its end.

    Nothing is kept and no task is woken, which took half of the time for a line.

    Attributes
    ----------
    ended
        Done when the pipe has ended, or `stop` was called.
    """

    def __init__(self, pipe: IO[bytes], on_block: Callable[[bytes], None]) -> None:
        self._pipe = pipe
        self._descriptor = pipe.fileno()
        self._on_block = on_block
        self._loop = asyncio.get_running_loop()
        self.ended: asyncio.Future[None] = self._loop.create_future()
        os.set_blocking(self._descriptor, False)
        self._loop.add_reader(self._descriptor, self._read)

    def _read(self) -> None:
        try:
            block = os.read(self._descriptor, READ_BYTES)
        except BlockingIOError:
            return
        if not block:
            self.stop()
            self._pipe.close()
        self._on_block(block)

    def stop(self) -> None:
        """Read no more. An open pipe stays open, because closing it would end a process that writes to it."""
        if not self.ended.done():
            self._loop.remove_reader(self._descriptor)
            self.ended.set_result(None)


class PipeWriter:
    """Writes to a pipe: at once as much as it has room for, and the rest later. A reader that is gone is no error."""

    def __init__(self, pipe: IO[bytes]) -> None:
        self._pipe = pipe
        self._descriptor = pipe.fileno()
        self._loop = asyncio.get_running_loop()
        self._waiting = b""
        self._is_closing = False
        os.set_blocking(self._descriptor, False)

    def write(self, data: bytes) -> None:
        """Write some data after all earlier data, unless the pipe is closed."""
        if not self._is_closing:
            self._waiting += data
            self._write()

    def close(self) -> None:
        """Close the pipe after all data."""
        self._is_closing = True
        if not self._waiting:
            self._pipe.close()

    def _write(self) -> None:
        try:
            written = os.write(self._descriptor, self._waiting)
        except BlockingIOError:
            written = 0
        except OSError:
            written = len(self._waiting)
        self._waiting = self._waiting[written:]
        if self._waiting:
            self._loop.add_writer(self._descriptor, self._write)
            return
        self._loop.remove_writer(self._descriptor)
        if self._is_closing:
            self._pipe.close()

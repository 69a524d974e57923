"""Ends of pipes in an event loop: blocks as they come, and data for a slow reader or for none."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time

import pytest

from confine.namespaces import open_descriptors
from grader.live.process.piped import BlockReader, PipedProcess, PipeWriter, wait_for_end

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")


def test_blocks_are_handed_on_as_they_come_and_the_end_is_an_empty_one() -> None:
    """Each write is one block for a reader that is faster, and the pipe is closed at its end."""
    blocks: list[bytes] = []

    async def read() -> bool:
        reading, writing = os.pipe()
        pipe = os.fdopen(reading, "rb", 0)
        reader = BlockReader(pipe, blocks.append)
        for block in (b"one", b"two"):
            os.write(writing, block)
            while block not in blocks:
                await asyncio.sleep(0.01)
        os.close(writing)
        await reader.ended
        return pipe.closed

    assert asyncio.run(asyncio.wait_for(read(), 60))
    assert blocks == [b"one", b"two", b""]


def test_a_stopped_reader_leaves_its_pipe_open() -> None:
    """A program that goes on writing is neither read nor ended by a signal."""
    blocks: list[bytes] = []

    async def read() -> None:
        reading, writing = os.pipe()
        with os.fdopen(reading, "rb", 0) as pipe:
            reader = BlockReader(pipe, blocks.append)
            reader.stop()
            os.write(writing, b"late")
            await asyncio.sleep(0.05)
            assert reader.ended.done()
            os.close(writing)

    asyncio.run(read())
    assert not blocks


def test_a_slow_reader_gets_all_data() -> None:
    """Data beyond the room of a pipe is written later, in order, before the pipe is closed."""
    sent = b"".join(b"%07d\n" % number for number in range(100_000))
    program = "import sys, time; time.sleep(0.3); sys.stdout.buffer.write(sys.stdin.buffer.read())"

    async def write() -> bytes:
        command = [sys.executable, "-c", program]
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        assert process.stdin is not None
        assert process.stdout is not None
        writer = PipeWriter(process.stdin)
        writer.write(sent[:1000])
        writer.write(sent[1000:])
        writer.close()
        writer.write(b"too late")
        received = await asyncio.to_thread(process.stdout.read)
        process.stdout.close()
        process.wait()
        return received

    assert asyncio.run(write()) == sent


def test_a_reader_that_is_gone_is_no_error() -> None:
    """Data for an ended process is dropped."""

    async def write() -> None:
        reading, writing = os.pipe()
        os.close(reading)
        pipe = os.fdopen(writing, "wb", 0)
        writer = PipeWriter(pipe)
        writer.write(b"data")
        writer.close()
        assert pipe.closed

    asyncio.run(write())


@pytest.mark.parametrize("has_descriptors", [True, False])
def test_the_end_of_a_process_is_its_status(
    monkeypatch: pytest.MonkeyPatch, *, has_descriptors: bool
) -> None:
    """Several processes end in any order, also where the system has no descriptors of processes."""

    def refuse(pid: int) -> int:
        raise OSError(pid)

    if not has_descriptors:
        monkeypatch.setattr(os, "pidfd_open", refuse)

    async def run() -> list[int]:
        started = []
        for command in ("sleep 0.3; exit 3", "exit 4", "kill -9 $$"):
            process = subprocess.Popen(
                ["sh", "-c", command], stdout=subprocess.PIPE, stderr=subprocess.PIPE
            )
            assert process.stdout is not None
            assert process.stderr is not None
            started.append(
                PipedProcess(process.pid, None, process.stdout, process.stderr, process.wait)
            )
        statuses = [await asyncio.wait_for(each.wait(), 60) for each in started]
        for each in started:
            each.stdout.close()
            each.stderr.close()
        return statuses

    before = open_descriptors(0)
    assert asyncio.run(run()) == [3, 4, -9]
    assert open_descriptors(0) == before


def test_an_end_is_waited_for_as_long_as_permitted() -> None:
    """The process that ended can still be waited for with its times; one that goes on is not disturbed."""

    async def waits_s(command: str, most_s: float) -> tuple[float, int | None]:
        process = subprocess.Popen(["sh", "-c", command])
        begun_s = time.monotonic()
        await asyncio.wait_for(wait_for_end(process.pid, most_s), 60)
        took_s = time.monotonic() - begun_s
        status = process.poll()
        process.kill()
        process.wait()
        with pytest.raises(ProcessLookupError):
            await wait_for_end(process.pid, most_s)
        return took_s, status

    before = open_descriptors(0)
    _, status = asyncio.run(waits_s("sleep 0.1; exit 3", 600))
    assert status == 3
    took_s, status = asyncio.run(waits_s("exec sleep 600", 0.2))
    assert took_s > 0.19
    assert status is None
    assert open_descriptors(0) == before

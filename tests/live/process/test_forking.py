"""A server that forks others: causes of its end, and freedom from waits for it and its clients."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from grader.live.session.fork_server import ForkServer
from tests.live.small_lab import until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")

#: Forks programs of the text that it is sent; before each, it does BEFORE.
PROGRAM = """
import os, socket, subprocess, sys, time
from functools import partial
from grader.live.process.forked import Program
from grader.live.process.forking import serve

def program_of(request):
    {before}
    return Program("it", partial(exec, request.decode(), globals()), dict(os.environ))

with socket.socket(fileno=int(sys.argv[1])) as link:
    serve(link, program_of)
"""
#: Fills its standard output to the last byte, for a reader that comes late.
FILLS = """
os.set_blocking(1, False)
for size in (4096, 1):
    try:
        while os.write(1, bytes(size)):
            pass
    except BlockingIOError:
        pass
"""


@dataclass
class Server:
    """A server, and the socket for requests to it."""

    process: subprocess.Popen[bytes]
    link: socket.socket

    def ask(self, text: str) -> int:
        """Have a program started; returns the pipe that it writes to."""
        reader, writer = os.pipe()
        with Path(os.devnull).open("wb") as errors:
            socket.send_fds(self.link, [text.encode()], [writer, errors.fileno()])
        os.close(writer)
        return reader

    @property
    def children(self) -> list[str]:
        """Process ids of programs that the server has started and not yet waited for."""
        return (
            Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        )

    def end(self) -> int:
        """Ask it for no more; returns its exit status, and fails where it does not end."""
        self.link.shutdown(socket.SHUT_WR)
        return self.process.wait(10)


@contextmanager
def server(before: str = "pass") -> Iterator[Server]:
    """Start a server in a session of its own, which ends with the block."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    command = [sys.executable, "-c", PROGRAM.format(before=before), str(theirs.fileno())]
    process = subprocess.Popen(command, pass_fds=[theirs.fileno()], start_new_session=True)
    theirs.close()
    try:
        yield Server(process, ours)
    finally:
        ours.close()
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def read_to_end(pipe: int) -> bytes:
    """Return everything from a pipe until it is closed; fails unless that happens soon."""
    found = b""
    while select.select([pipe], [], [], 10)[0]:
        if not (block := os.read(pipe, 2**16)):
            os.close(pipe)
            return found
        found += block
    raise AssertionError("the pipe is not closed")


def test_a_full_pipe_is_closed_when_its_program_has_ended() -> None:
    """A late reader gets a program's output and then the end: the server keeps nothing open."""
    with server() as it:
        pipe = it.ask(FILLS)
        select.select([pipe], [], [])
        until(lambda: not it.children, 10)
        written = read_to_end(pipe)
        assert len(written) > 60_000
        assert b"ended" not in written, "the pipe was not full"
        assert it.end() == 0


def test_what_else_it_has_started_may_end() -> None:
    """A server of its own, say, that is killed costs it nothing: the programs go on, and others are started."""
    with server("subprocess.Popen(['true'])") as it:
        pipes = [it.ask("pass"), it.ask("pass")]
        assert [read_to_end(pipe).split(b"\n", 1)[1] for pipe in pipes] == [b"ended 0\n"] * 2
        assert read_to_end(it.ask("pass")).endswith(b"ended 0\n")
        assert it.end() == 0


def test_it_waits_at_its_end_for_its_programs_alone() -> None:
    """The server waits at its end for requested programs alone; its other children go on."""
    with server("subprocess.Popen(['sleep', '600'])") as it:
        pipe = it.ask("time.sleep(600)")
        assert it.end() == 0
        assert read_to_end(pipe).endswith(b"ended -9\n")


def test_programs_that_have_just_begun_end_with_it() -> None:
    """Programs that have only just begun, perhaps without a process group, end with the server."""
    for _ in range(5):
        with server() as it:
            pipes = [it.ask("time.sleep(600)") for _ in range(5)]
            assert it.end() == 0
            for pipe in pipes:
                assert read_to_end(pipe).endswith(b"ended -9\n")


def test_a_server_without_a_request_is_not_waited_for() -> None:
    """A refused submission does not wait for imports that nobody needs."""
    before = os.times()
    with ForkServer():
        pass
    after = os.times()
    assert after.children_user - before.children_user < 0.15

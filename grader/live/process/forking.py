"""A process that forks others on request, so that what they need is imported once.

Python that imports rclpy and a session anew takes a seventh of a second of a core, and what grades a submission most
of one; a fork takes a hundredth.
"""

from __future__ import annotations

import asyncio
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from confine.helpers import python, start_helper
from grader.live.process.forked import Program, become, read_pipe

if TYPE_CHECKING:
    from typing_extensions import Self

_MOST_REQUEST_BYTES = 16 * 1024
#: How long a server may take to end when nothing more is asked of it.
_END_S = 5.0


class _Running(Protocol):
    """A server, as a process of this one, or as one of another server's."""

    def wait(self, timeout: float) -> object: ...

    def kill(self) -> None: ...


class ForkingServer:
    """A process that forks others; used as a context, with which all that it started ends.

    It runs a module of the grader's as a program, which calls `serve` with the socket of the number that comes first
    among its arguments.
    """

    def __init__(
        self,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
    ) -> None:
        self._command = python(sys.executable, "-m", module)
        self._arguments, self._environment = arguments, environment

    def __enter__(self) -> Self:
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process: _Running = self._start(theirs)
        return self

    def _start(self, link: socket.socket) -> _Running:
        return start_helper(
            [*self._command, str(link.fileno()), *self._arguments],
            environment=self._environment,
            pass_fds=(link.fileno(),),
            start_new_session=True,
        )

    def fileno(self) -> int:
        """Return the descriptor by which it is asked."""
        return self._link.fileno()

    def has_ended(self) -> bool:
        """Whether its process is gone: it says nothing by this descriptor, so that only its end can be read."""
        return bool(select.select([self], [], [], 0)[0])

    def __exit__(self, *_: object) -> None:
        self._link.shutdown(socket.SHUT_WR)
        try:
            self._process.wait(_END_S)
        except (subprocess.TimeoutExpired, OSError):
            self._process.kill()
            with suppress(OSError):
                self._process.wait(_END_S)
        finally:
            self._link.close()

    async def start(self, request: bytes, errors: Path) -> asyncio.StreamReader:
        """Start what a request asks for, with a file for its standard error.

        Returns what it says, until all has ended: first its process id, or why it could not be started; at last, on a
        line, `ended` and its exit status (negative: the signal that ended it).
        """
        with errors.open("wb") as file:
            reader, writer = os.pipe()
            with suppress(ConnectionError):  # Then nothing will be said.
                socket.send_fds(self._link, [request], [writer, file.fileno()])
        os.close(writer)
        return await read_pipe(reader)


def serve(
    link: socket.socket,
    program_of: Callable[[bytes], Program],
    needed: Sequence[ForkingServer] = (),
) -> None:
    """Fork a program for each request, until there will be no more; what still runs then is killed.

    A request comes with two descriptors, the program's standard output and error. `program_of` raises OSError where
    it cannot be started. Where a server that all `needed` has ended, this one is of no more use: it is to end at once,
    which kills its forks.
    """
    server, null = os.getpid(), os.open(os.devnull, os.O_RDONLY)
    outputs: dict[int, int] = {}
    woken, waking = os.pipe()
    os.set_blocking(waking, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(waking, warn_on_full_buffer=False)
    while True:
        ready, _, _ = select.select(
            [link.fileno(), woken, *(server.fileno() for server in needed)], [], []
        )
        if any(server.fileno() in ready for server in needed):
            return
        if woken in ready:
            os.read(woken, _MOST_REQUEST_BYTES)
            _reap(outputs, os.WNOHANG)
        if link.fileno() not in ready:
            continue
        request, descriptors, *_ = socket.recv_fds(link, _MOST_REQUEST_BYTES, 2)
        if not request:
            break
        try:
            program = program_of(request)
            forked = os.fork()
        except OSError as problem:  # What runs already goes on.
            with suppress(OSError):
                os.write(descriptors[0], f"{problem}\n".encode())
            forked = -1
        if forked == 0:
            with suppress(OSError):
                os.write(descriptors[0], f"{os.getpid()}\n".encode())
            become(program, server, (null, *descriptors))
        os.close(descriptors[1])
        if forked > 0:
            outputs[forked] = descriptors[0]
        else:
            os.close(descriptors[0])
    signal.set_wakeup_fd(-1)
    for pid in outputs:
        for kill in (os.killpg, os.kill):  # One that has just begun leads no group yet.
            with suppress(OSError):
                kill(pid, signal.SIGKILL)
    _reap(outputs, 0)


def _reap(outputs: dict[int, int], options: int) -> None:
    """Take note of forks that have ended, so that their CPU time counts as the server's, and say so."""
    with suppress(ChildProcessError):
        while outputs and (ended := os.waitpid(-1, options))[0]:
            # The program may have started others of its own, such as a server.
            if (output := outputs.pop(ended[0], None)) is not None:
                _say_end(output, os.waitstatus_to_exitcode(ended[1]))
                os.close(output)


def _say_end(output: int, status: int) -> None:
    """Say it without waiting: nobody may read any more, or what was said before may fill the pipe still."""
    with suppress(OSError):
        said = os.open(f"/proc/self/fd/{output}", os.O_WRONLY | os.O_NONBLOCK)
        try:
            os.write(said, f"ended {status}\n".encode())
        finally:
            os.close(said)

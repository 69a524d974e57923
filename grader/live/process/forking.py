"""A process that forks others on request; their common modules are imported once.

A new Python that imports rclpy and a session takes a seventh of a second of a core, and one that grades a submission
most of a second; a fork takes a hundredth.
"""

from __future__ import annotations

import asyncio
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from grader.live.process.forked import Program, become, read_pipe
from grader.live.sandbox.helpers import python, start_helper

if TYPE_CHECKING:
    from typing_extensions import Self

_MOST_REQUEST_BYTES = 16 * 1024
#: Time in which a server must end after its last request, in s.
_END_S = 5.0


class _Running(Protocol):
    """A server, as a child of this process or of another server."""

    def wait(self, timeout: float) -> object: ...

    def kill(self) -> None: ...


class ForkingServer:
    """A process that forks others; used as a context, and all its forks end with it.

    The server runs a module of the grader's as a program. Its first argument is the number of a socket, with which the
    program calls `serve`.
    """

    def __init__(
        self,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
    ) -> None:
        self._command = python(sys.executable, "-m", module)
        self._arguments = arguments
        self._environment = environment

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
        """Return the descriptor of the socket for requests."""
        return self._link.fileno()

    def has_ended(self) -> bool:
        """Return True if its process has ended: it never writes to this descriptor, and only its end can be read."""
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
        """Start the program of a request, with a file for its standard error, and return its output.

        The first line of output is the program's process id, or the reason why it could not be started. When all has ended,
        a line with `ended` and the exit status follows (negative: the signal that ended it).
        """
        with errors.open("wb") as file:
            reader, writer = os.pipe()
            with suppress(ConnectionError):  # The output will be empty.
                socket.send_fds(self._link, [request], [writer, file.fileno()])
        os.close(writer)
        return await read_pipe(reader)


def serve(
    link: socket.socket,
    program_of: Callable[[bytes], Program],
    needed: Sequence[ForkingServer] = (),
) -> None:
    """Fork a program for each request, until the last one; then kill the programs that still run.

    A request comes with two descriptors, the program's standard output and error. `program_of` raises OSError if the
    program cannot be started. If one of the `needed` servers has ended, this server returns at once, and its process
    must end, which kills its forks.
    """
    null = os.open(os.devnull, os.O_RDONLY)
    outputs: dict[int, int] = {}
    woken = _wake_on_ended_child()
    watched = [link.fileno(), woken, *(each.fileno() for each in needed)]
    while True:
        ready, _, _ = select.select(watched, [], [])
        if any(each.fileno() in ready for each in needed):
            return
        if woken in ready:
            os.read(woken, _MOST_REQUEST_BYTES)
            _reap(outputs, os.WNOHANG)
        if link.fileno() not in ready:
            continue
        request, descriptors, *_ = socket.recv_fds(link, _MOST_REQUEST_BYTES, 2)
        if not request:
            break
        output, errors = descriptors
        pid = _fork(program_of, request, (null, output, errors))
        os.close(errors)
        if pid is None:
            os.close(output)
        else:
            outputs[pid] = output
    signal.set_wakeup_fd(-1)
    _kill_all(outputs)
    _reap(outputs, 0)


def _fork(
    program_of: Callable[[bytes], Program], request: bytes, standard: tuple[int, int, int]
) -> int | None:
    """Start the program of a request with its standard descriptors; None, and a reason as output, if that fails."""
    server = os.getpid()
    output = standard[1]
    try:
        program = program_of(request)
        pid = os.fork()
    except OSError as problem:
        with suppress(OSError):
            os.write(output, f"{problem}\n".encode())
        return None
    if pid == 0:
        with suppress(OSError):
            os.write(output, f"{os.getpid()}\n".encode())
        become(program, server, standard)
    return pid


def _wake_on_ended_child() -> int:
    """Return a descriptor that becomes readable when a child process ends."""
    woken, waking = os.pipe()
    os.set_blocking(waking, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(waking, warn_on_full_buffer=False)
    return woken


def _kill_all(pids: Iterable[int]) -> None:
    for pid in pids:
        for kill in (os.killpg, os.kill):  # A new fork leads no group yet.
            with suppress(OSError):
                kill(pid, signal.SIGKILL)


def _reap(outputs: dict[int, int], options: int) -> None:
    """Report forks that have ended; the wait adds their CPU time to the server's."""
    with suppress(ChildProcessError):
        while outputs:
            pid, status = os.waitpid(-1, options)
            if not pid:
                break
            # A program may have started other children, such as a server.
            output = outputs.pop(pid, None)
            if output is not None:
                _say_end(output, os.waitstatus_to_exitcode(status))
                os.close(output)


def _say_end(output: int, status: int) -> None:
    """Report the end of a fork without waiting: the pipe may have no reader any more, or be full."""
    with suppress(OSError):
        said = os.open(f"/proc/self/fd/{output}", os.O_WRONLY | os.O_NONBLOCK)
        try:
            os.write(said, f"ended {status}\n".encode())
        finally:
            os.close(said)

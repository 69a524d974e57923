"""A process that forks others on request, so that their modules are imported once.

Importing rclpy and a session anew takes a seventh of a second of a core, and importing the modules for a whole grading
most of a second; a fork takes a hundredth.
"""

from __future__ import annotations

import asyncio
import os
import select
import signal
import site
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from confine.helpers import python, start_helper
from confine.namespaces import fork_first
from grader.live.process.forked import Program, become, read_pipe

if TYPE_CHECKING:
    from typing import Self

_MOST_REQUEST_BYTES = 16 * 1024
#: Variable with the folders of shared libraries, and starts of the variables that the C library reads once.
_LIBRARIES, _OF_LOADER = "LD_LIBRARY_PATH", ("LD_", "GLIBC_", "MALLOC_")
#: Folder of the commands of this Python, which comes first for their imports.
_SCRIPTS = str(Path(sys.executable).parent)
#: Time for a server to end after its last request.
_END_S = 5.0


class Server(Protocol):
    """A server, as a process of this one, or as one of another server's."""

    def wait(self, timeout: float) -> object:
        """Wait for its end; raises `OSError` or `subprocess.TimeoutExpired` if that takes too long."""

    def kill(self) -> None:
        """Kill it, unless something else ends it."""


class ForkedServer:
    """A server as a fork of this process, instead of a Python started anew."""

    def __init__(self, program: Program) -> None:
        parent = os.getpid()
        null = os.open(os.devnull, os.O_RDWR)
        for stream in (sys.stdout, sys.stderr):
            stream.flush()  # The fork would write it again.
        self._pid = os.fork()
        if self._pid == 0:
            _forget_start()
            become(program, parent, (null, null, null))
        os.close(null)
        self._end = os.pidfd_open(self._pid)

    def wait(self, timeout: float) -> None:
        """Wait for its end, so that its CPU time counts as this process's; raises `TimeoutError`."""
        ended, _, _ = select.select([self._end], [], [], timeout)
        if not ended:
            raise TimeoutError
        os.close(self._end)
        os.waitpid(self._pid, 0)

    def kill(self) -> None:
        """Kill it; not after `wait`."""
        os.kill(self._pid, signal.SIGKILL)


def _forget_start() -> None:
    """Undo, in a fork, the settings of this process that a Python started anew with `-I` would not have."""
    tempfile.tempdir = None
    if sys.path[0] == _SCRIPTS:
        del sys.path[0]


def may_fork_as(environment: Mapping[str, str]) -> bool:
    """Return whether a fork of this process can stand for a Python started anew with `-I` and an environment.

    The dynamic loader and Python keep settings from the start of a process, and a fork has one thread only.
    """
    if threading.active_count() > 1:
        return False
    if sys.getfilesystemencoding() != "utf-8":
        return False
    if (sys.stdout, sys.stderr) != (sys.__stdout__, sys.__stderr__):
        return False
    for name in os.environ:
        if name.startswith(_OF_LOADER) and name != _LIBRARIES:
            return False
    if _entries(os.environ) != _entries(environment):
        return False
    return _has_own_modules_alone()


def _entries(environment: Mapping[str, str]) -> set[str]:
    return set(filter(None, environment.get(_LIBRARIES, "").split(os.pathsep)))


def _has_own_modules_alone() -> bool:
    """Return whether Python takes no modules from the working folder, from variables or from the user's home."""
    if sys.flags.isolated:
        return True
    if site.ENABLE_USER_SITE:
        return False
    for name in ("PYTHONPATH", "PYTHONHOME"):
        if os.environ.get(name):
            return False
    return sys.path[0] == _SCRIPTS


class ForkingServer:
    """A process that forks others; its forks end with it, and it ends with its context.

    It runs a module of the grader as a program. The module calls `serve` with a socket; the descriptor of the socket is
    its first argument.
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
        self._is_asked = False

    def __enter__(self) -> Self:
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process: Server = self._start(theirs)
        return self

    def _start(self, link: socket.socket) -> Server:
        return start_helper(
            [*self._command, str(link.fileno()), *self._arguments],
            environment=self._environment,
            pass_fds=(link.fileno(),),
            start_new_session=True,
        )

    def fileno(self) -> int:
        """Return the descriptor for requests."""
        return self._link.fileno()

    def has_ended(self) -> bool:
        """Return whether its process is gone: it never writes to this descriptor, so that only its end can be read."""
        return bool(select.select([self], [], [], 0)[0])

    def __exit__(self, *_: object) -> None:
        self._link.shutdown(socket.SHUT_WR)
        if not self._is_asked:
            self._process.kill()  # Its imports would take a second more, and nothing runs in it.
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

        The first line is its process id, or the reason why it could not be started; the last one is `ended` and its
        exit status (negative: the signal that ended it).
        """
        with errors.open("wb") as file:
            reader, writer = os.pipe()
            with suppress(ConnectionError):  # Then the output is empty.
                self._ask(request, writer, file.fileno())
        os.close(writer)
        return await read_pipe(reader)

    def _ask(self, request: bytes, output: int, errors: int) -> None:
        self._is_asked = True
        self._send(request, output, errors)

    def _send(self, request: bytes, output: int, errors: int) -> None:
        socket.send_fds(self._link, [request], [output, errors])


def serve(
    link: socket.socket,
    program_of: Callable[[bytes], Program | None],
    needed: Sequence[ForkingServer] = (),
) -> None:
    """Fork a program for each request until the socket is closed, and then kill those that still run.

    A request comes with two descriptors, the program's standard output and error. `program_of` raises `OSError` if the
    program cannot be started, and returns None for a request that starts none. As soon as one of the `needed` servers has
    ended, this one ends too, with its forks.
    """
    null = os.open(os.devnull, os.O_RDONLY)
    outputs: dict[int, int] = {}
    woken, waking = os.pipe()
    os.set_blocking(waking, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(waking, warn_on_full_buffer=False)
    while True:
        # The first request may start the needed servers.
        needed_fds = [server.fileno() for server in needed]
        ready, _, _ = select.select([link.fileno(), woken, *needed_fds], [], [])
        if not set(ready).isdisjoint(needed_fds):
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
        forked = _fork(program_of, request, (null, output, errors))
        os.close(errors)
        if forked is None:
            os.close(output)
        else:
            outputs[forked] = output
    signal.set_wakeup_fd(-1)
    for pid in outputs:
        for kill in (os.killpg, os.kill):  # One that has just begun leads no group yet.
            with suppress(OSError):
                kill(pid, signal.SIGKILL)
    _reap(outputs, 0)


def _fork(
    program_of: Callable[[bytes], Program | None],
    request: bytes,
    descriptors: tuple[int, int, int],
) -> int | None:
    """Fork the program of a request, and return its process id; None if that failed, or if there is no program.

    `descriptors` are its standard input, output and error. The output gets a line with the process id or the reason.
    """
    server = os.getpid()
    output = descriptors[1]
    told, telling = os.pipe()
    try:
        program = program_of(request)
        if program is None:
            return None
        forked = _forked(program)
        if forked == 0:
            os.close(telling)
            os.read(told, 1)  # until the server has written the first line of the output
            become(program, server, descriptors)
        _write_line(output, str(forked))
    except OSError as problem:  # The forks that run already go on.
        _write_line(output, str(problem))
        return None
    finally:
        os.close(told)
        os.close(telling)
    return forked


def _forked(program: Program) -> int:
    """Fork this process for a program, and return as `os.fork` does."""
    if program.own_ids:
        with suppress(OSError):
            return fork_first()
    return os.fork()


def _write_line(output: int, line: str) -> None:
    with suppress(OSError):
        os.write(output, f"{line}\n".encode())


def _reap(outputs: dict[int, int], options: int) -> None:
    """Wait for forks that have ended, so that their CPU time counts as the server's, and report their ends."""
    with suppress(ChildProcessError):
        while outputs:
            pid, status = os.waitpid(-1, options)
            if pid == 0:
                return
            output = outputs.pop(pid, None)
            if output is not None:  # Otherwise a program has started it, such as a server.
                _report_end(output, os.waitstatus_to_exitcode(status))
                os.close(output)


def _report_end(output: int, status: int) -> None:
    """Write the exit status without waiting: the reader may be gone, or earlier output may still fill the pipe."""
    with suppress(OSError):
        unblocked = os.open(f"/proc/self/fd/{output}", os.O_WRONLY | os.O_NONBLOCK)
        try:
            os.write(unblocked, f"ended {status}\n".encode())
        finally:
            os.close(unblocked)

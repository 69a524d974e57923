"""Starts the grader's own processes as forks of one that has imported their modules.

A Python that imports rclpy anew takes a sixth of a second of a core, and its first node nearly another tenth for its
libraries; a fork has them. No ROS context may exist before the fork: neither it nor its threads would be whole in the
child.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import traceback
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.machinery import SourceFileLoader
from io import FileIO
from types import ModuleType
from typing import NoReturn

from confine.limits import set_limit
from confine.namespaces import (
    close_descriptors,
    end_with_parent,
    name_process,
    open_descriptors,
)
from grader.live.process.piped import PipedProcess, PipeWriter

#: The longest message of a program, in bytes: a snapshot of a flooded graph.
_LONGEST_LINE_BYTES = 64 * 2**20


@dataclass(frozen=True)
class Program:
    """The work of a fork, its name, all of its environment, and the descriptors that it keeps open.

    A program with `own_ids` is the first process of a namespace of process ids, if the system permits that.
    """

    name: str
    main: Callable[[], object]
    environment: Mapping[str, str]
    address_space_bytes: int | None = None
    kept: Collection[int] = ()
    own_ids: bool = False


def run_script(file: str, *arguments: str) -> None:
    """Run a Python file as a program, from its bytecode if Python has kept that."""
    sys.argv = [file, *arguments]
    loader = SourceFileLoader("__main__", file)
    program = ModuleType("__main__")
    program.__file__ = file
    sys.modules["__main__"] = program
    loader.exec_module(program)


def start_forked(program: Program) -> PipedProcess:
    """Start a program as a fork in a session of its own, with pipes to it; it ends with this process."""
    stdin, to_it = os.pipe()
    from_it, stdout = os.pipe()
    errors, stderr = os.pipe()
    parent = os.getpid()
    pid = os.fork()
    if pid == 0:
        become(program, parent, (stdin, stdout, stderr))
    for descriptor in (stdin, stdout, stderr):
        os.close(descriptor)
    writer = PipeWriter(FileIO(to_it, "wb"))
    return PipedProcess(pid, writer, FileIO(from_it), FileIO(errors), wait=partial(_wait_for, pid))


def _wait_for(pid: int) -> int:
    _, status = os.waitpid(pid, 0)
    return os.waitstatus_to_exitcode(status)


async def read_pipe(descriptor: int) -> asyncio.StreamReader:
    """Return a reader for a pipe, which closes it at its end."""
    reader = asyncio.StreamReader(limit=_LONGEST_LINE_BYTES)
    protocol = asyncio.StreamReaderProtocol(reader)
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: protocol, os.fdopen(descriptor, "rb", 0)
    )
    return reader


def become(program: Program, parent: int, descriptors: Sequence[int]) -> NoReturn:
    """Turn this fork of `parent` into a program with these standard input, output and error, and end with it."""
    status = 1
    try:
        _leave_everything(program, parent, descriptors)
        program.main()
        status = 0
    except SystemExit as end:
        status = int(end.code is not None)
        if isinstance(end.code, int):
            status = end.code
    except BaseException:
        traceback.print_exc()
    finally:
        # Not as Python ends: the event loop and other objects of this image are the other process's to end.
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(status)


def _leave_everything(program: Program, parent: int, descriptors: Sequence[int]) -> None:
    """Keep nothing of the other process but its image.

    The first process of a namespace cannot see its parent, and `fork_first` has seen to its end.
    """
    if os.getpid() != 1:
        end_with_parent()
        if os.getppid() != parent:
            os._exit(1)
    name_process(program.name)
    os.setsid()
    signal.set_wakeup_fd(-1)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGCHLD):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for target, descriptor in enumerate(descriptors):
        os.dup2(descriptor, target)
    close_descriptors(set(open_descriptors(len(descriptors))).difference(program.kept))
    os.environ.clear()
    os.environ.update(program.environment)
    sys.path += filter(None, program.environment.get("PYTHONPATH", "").split(os.pathsep))
    os.chdir("/")
    sys.argv = [program.name]
    if program.address_space_bytes is not None:
        set_limit("as", program.address_space_bytes)

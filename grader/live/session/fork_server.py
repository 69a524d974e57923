"""Starts the first processes of sandboxes as forks of a process that has imported what they need.

Python that imports rclpy and the session anew takes a seventh of a second of a core, in each of a grading's sandboxes
at the same time; a fork takes a hundredth. The server has an environment made from nothing, starts no thread and
nothing of ROS, and serves one grading. Each sandbox's first process then forks its director and reference nodes in the
same way.
"""

from __future__ import annotations

import asyncio
import compileall
import gc
import importlib
import os
import pickle
import resource
import signal
import socket
import subprocess
import sys
from collections.abc import Collection, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from grader.live.process.forked import Program, become, read_pipe
from grader.live.process.priority import put_self_first
from grader.live.sandbox.environment import INSIDE_FOLDER, LAUNCHING_FOLDER, trusted_environment
from grader.live.sandbox.namespaces import Form, end_with_parent, enter_own_mounts, enter_sandbox, name_process
from grader.live.session.plan import SessionPlan
from grader.recording.definitions import definition_of, type_hash_of

_WITHOUT_ROS = ("grader.live.session.session", "grader.recording.bag", "mcap.writer", "numpy", "runpy", "yaml")
#: Used by every node, and by the director itself.
_STANDARD_TYPES = (
    "rcl_interfaces/msg/Log",
    "rcl_interfaces/msg/ParameterEvent",
    "rcl_interfaces/srv/GetParameters",
    "rcl_interfaces/srv/ListParameters",
    "rcl_interfaces/srv/SetParameters",
    "std_msgs/msg/Empty",
)
_MOST_REQUEST_BYTES = 16 * 1024
#: How long the server may take to end when nothing more is asked of it.
_END_S = 5.0


class ForkServer:
    """The process that forks the first processes of sandboxes; used as a context, with which all that it started ends.

    `types` are those of messages and services that the sessions are likely to use.
    """

    def __init__(self, types: Collection[str] = ()) -> None:
        self._types = types

    def __enter__(self) -> ForkServer:
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-m", __name__, str(theirs.fileno()), *self._types],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=trusted_environment(Path("/"), 0),
                cwd="/",
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
            )
        return self

    def __exit__(self, *_: object) -> None:
        self._link.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    async def start(self, form: Form, plan: Path, errors: Path) -> asyncio.StreamReader:
        """Start the session of a pickled `SessionPlan` in a sandbox of its own, with a file for its standard error.

        Returns what its first process says, until all has ended: first the process id by which the sandbox ends, or why
        the sandbox could not be made. `form` must be the same for all sandboxes of a server.
        """
        reader, writer = os.pipe()
        with errors.open("wb") as file, suppress(ConnectionError):  # Then nothing will be said.
            request = [form.value.encode(), b"\0", os.fsencode(plan)]
            socket.send_fds(self._link, request, [writer, file.fileno()])
        os.close(writer)
        return await read_pipe(reader)


def _serve(link: socket.socket, types: Sequence[str]) -> None:
    """Fork for each request, until there will be no more."""
    gc.disable()  # Nothing of what is imported is for collection.
    for module in _WITHOUT_ROS:
        importlib.import_module(module)
    server, null = os.getpid(), os.open(os.devnull, os.O_RDONLY)
    loaded = False
    while True:
        request, descriptors, *_ = socket.recv_fds(link, _MOST_REQUEST_BYTES, 2)
        if not request:
            break
        word, _, name = request.partition(b"\0")
        form, plan = Form(word.decode()), Path(os.fsdecode(name))
        try:
            if not loaded:
                enter_own_mounts(form)
                _load_ros(types)
                signal.signal(signal.SIGCHLD, lambda number, frame: _reap(os.WNOHANG))
                loaded = True
                # A collection in a fork would touch, and so copy, the memory of all objects that are there now.
                gc.freeze()
                gc.enable()
            forked = os.fork()
        except OSError as problem:  # What runs already goes on.
            forked = -1
            with suppress(OSError):
                os.write(descriptors[0], f"{problem}\n".encode())
        if forked == 0:
            program = Program("sandbox", partial(_run_in_sandbox, form, plan), trusted_environment(plan.parent, 0))
            become(program, server, (null, *descriptors))
        for descriptor in descriptors:
            os.close(descriptor)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    _reap(0)


def _reap(options: int) -> None:
    """Take note of forks that have ended, so that their CPU time counts as the server's."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, options)[0]:
            pass


def _load_ros(types: Sequence[str]) -> None:
    """Import what directors and reference nodes need, and load what their nodes do; start nothing of it."""
    importlib.import_module("grader.live.ros_node.director")
    importlib.import_module("rclpy").get_rmw_implementation_identifier()
    for name in (*_STANDARD_TYPES, *types):
        with suppress(Exception):  # What is not there, or is no type, is told where it is missed.
            interface = importlib.import_module("grader.live.ros_node.graph").interface_named(name)
            importlib.import_module("rclpy.type_support").check_for_type_support(interface)
            recorded = f"{name}_Event" if "/srv/" in name else name
            definition_of(recorded)
            type_hash_of(recorded)
    # Students' processes read these, and may write nothing beside them.
    for folder in (INSIDE_FOLDER, LAUNCHING_FOLDER):
        compileall.compile_dir(folder, quiet=2)


def _run_in_sandbox(form: Form, file: Path) -> None:
    from grader.live.session.session import run

    print(os.getpid(), flush=True)
    plan: SessionPlan = pickle.loads(file.read_bytes())  # the grader's own, in a folder that nobody else may enter
    enter_sandbox(form)
    name_process("session")
    run(plan)


def main() -> None:
    """Serve what comes through the socket of the number in argv[1]; the types to load follow."""
    end_with_parent()  # If that has ended already, so has the other side of the socket.
    put_self_first()
    # What limits the grader's own memory is not for the sandboxes, which have limits of their own.
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
    with socket.socket(fileno=int(sys.argv[1])) as link:
        _serve(link, sys.argv[2:])


if __name__ == "__main__":
    main()

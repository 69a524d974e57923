"""Starts the first processes of sandboxes as forks of a process with all imports done.

The server has an environment made from nothing, starts no thread and nothing of ROS, and serves one
grading; the server of a class branches, so that each grading has its own, and ends it. Each
sandbox's first process then forks its director and reference nodes in the same way. One more fork is the CPU watch of
all sessions.
"""

from __future__ import annotations

import gc

if __name__ == "__main__":
    # Imported modules are never collected; to look for garbage takes a twentieth of their import.
    gc.disable()

import asyncio
import compileall
import importlib
import os
import pickle
import socket
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NoReturn

from confine.limits import lift
from confine.namespaces import (
    Form,
    end_with_parent,
    enter_own_mounts,
    enter_rest_of_sandbox,
    enter_sandbox,
    name_process,
)
from confine.priority import put_self_first
from grader.live.process.cpu_watch import watching_program
from grader.live.process.forked import Program, become
from grader.live.process.forking import (
    ForkedServer,
    ForkingServer,
    Server,
    may_fork_as,
    serve,
)
from grader.live.sandbox.environment import INSIDE_FOLDER, LAUNCHING_FOLDER, trusted_environment
from grader.live.session.plan import SessionPlan
from grader.live.session.warming import build_models, import_for
from ros_bag.definitions import definition_of, type_hash_of

_WITHOUT_ROS = (
    "grader.live.session.session",
    "mcap.writer",
    "numpy",
    "ros_bag.reading",
    "ros_bag.recovery",
    "runpy",
    "yaml",
)
#: Used by every node, and by the director itself.
_STANDARD_TYPES = (
    "rcl_interfaces/msg/Log",
    "rcl_interfaces/msg/ParameterEvent",
    "rcl_interfaces/srv/GetParameters",
    "rcl_interfaces/srv/ListParameters",
    "rcl_interfaces/srv/SetParameters",
    "std_msgs/msg/Empty",
)
_MOST_ANSWER_BYTES = 1024


class ForkServer(ForkingServer):
    """The process that forks the first processes of sandboxes; a context, at whose end all started processes end.

    `likely` are names of message and service types, and absolute paths of the lab's programs. They are loaded for all
    sessions, and may be set anew until the first request that starts something.
    """

    def __init__(self, likely: Collection[str | Path] = ()) -> None:
        super().__init__(__name__, [], trusted_environment(Path("/"), 0))
        self.likely = likely

    def load(self, form: Form) -> None:
        """Have the server load the modules for all labs, in parallel with this process; `form` as for `start_sandbox`."""
        with Path(os.devnull).open("wb") as null, suppress(ConnectionError):
            self._send(form.value.encode(), null.fileno(), null.fileno())

    def request(self, form: Form, plan: Path | None = None) -> bytes:
        """Return the message that asks for the session of a plan, or for a branch."""
        return b"\0".join(map(os.fsencode, (form.value, plan or "", *self.likely)))

    async def start_sandbox(self, form: Form, plan: Path, errors: Path) -> asyncio.StreamReader:
        """Start the session of a pickled `SessionPlan` in a sandbox of its own, with a file for its standard error.

        Returns the output of its first process, see `ForkingServer.start`; its process id ends the sandbox. `form` must
        be the same for all sandboxes of a server.
        """
        return await self.start(self.request(form, plan), errors)

    def branch(self, form: Form) -> ForkServer:
        """Return a fork of this server, which ends by itself."""
        return _Branch(self, form)


class CommandsForkServer(ForkServer):
    """A fork of the command, if the command started like it: the server has its imports then.

    It is for the beginning of a single grading. A class may have to start a server again later, when the process has
    threads.
    """

    def _start(self, link: socket.socket) -> Server:
        environment = trusted_environment(Path("/"), 0)
        if not may_fork_as(environment):
            return super()._start(link)
        serving = partial(_serve_sandboxes, link.fileno())
        return ForkedServer(Program("fork server", serving, environment, kept=[link.fileno()]))


class _Branch(ForkServer):
    def __init__(self, of: ForkServer, form: Form) -> None:
        super().__init__(of.likely)
        self._of, self._form = of, form

    def _start(self, link: socket.socket) -> _Branch:
        with (
            Path(os.devnull).open("wb") as errors,
            suppress(ConnectionError),
        ):  # Then requests will have no answer.
            request = self.request(self._form)
            self._of._ask(request, link.fileno(), errors.fileno())
        return self

    def wait(self, timeout: float) -> None:
        """Wait until it has ended, and all that it started."""
        self._link.settimeout(timeout)
        while self._link.recv(_MOST_ANSWER_BYTES):
            pass

    def kill(self) -> None:
        """Leave it to the server, with which it ends at the latest."""


def _load(form: Form, likely: Sequence[str]) -> None:
    """Load the modules for all sessions, and the likely types and programs, unless they are loaded."""
    new = set(likely) - _loaded
    if not _loaded:
        # First, because the modules start threads, and the kernel then refuses.
        enter_own_mounts(form)
        _load_ros()
        new.update(_STANDARD_TYPES)
    if not new:
        return
    _load_types(sorted(new))
    _loaded.update(new)
    # A collection in a fork would touch, and so copy, the memory of all objects that are there now.
    gc.freeze()
    gc.enable()


def _load_ros() -> None:
    """Import the modules of directors, and start nothing."""
    importlib.import_module("grader.live.ros_node.director")
    importlib.import_module("rclpy").get_rmw_implementation_identifier()
    # Students' processes read these, and may write nothing beside them.
    for folder in (INSIDE_FOLDER, LAUNCHING_FOLDER):
        compileall.compile_dir(folder, quiet=2)


def _load_types(likely: Sequence[str]) -> None:
    """Load the types and the programs' modules, and the libraries of the types."""
    types = list(_types_in(likely))
    for name in types:
        with suppress(Exception):  # Missing types are reported by the step that needs them.
            interface = importlib.import_module("grader.live.ros_node.graph").interface_named(name)
            importlib.import_module("rclpy.type_support").check_for_type_support(interface)
            recorded = f"{name}_Event" if "/srv/" in name else name
            definition_of(recorded)
            type_hash_of(recorded)
    libraries = importlib.import_module("grader.live.ros_node.libraries")
    libraries.load_type_support(types)


def _types_in(likely: Sequence[str]) -> Iterator[str]:
    """Yield the given names of types, and the interfaces of the given programs after importing their modules."""
    for name in likely:
        if Path(name).is_absolute():
            yield from import_for([Path(name)])
        else:
            yield name


def _program_of(request: bytes) -> Program | None:
    """Return the first process of a sandbox, or a branch of this server; None for a request to load modules alone.

    Each request loads missing modules and types.
    """
    word, *started = map(os.fsdecode, request.split(b"\0"))
    form = Form(word)
    _load(form, started[1:])
    if not started:
        return None
    name = started[0]
    plan = Path(name)
    watch = _link_to_watch()
    if not name:
        return Program(
            "fork server",
            _serve_branch,
            trusted_environment(Path("/"), 0),
            kept=(watch.fileno(),),
        )
    return Program(
        "sandbox",
        partial(_run_in_sandbox, form, plan, watch),
        trusted_environment(plan.parent, 0),
        kept=(watch.fileno(),),
        own_ids=form is not Form.NONE,
    )


#: Loaded types and programs; none before the modules for all sessions are loaded.
_loaded: set[str] = set()
#: Process id of the CPU watch, and the link to it. A server and its branches share one, because each watch wakes up
#: two hundred times a second on each core.
_watches: list[tuple[int, socket.socket]] = []


def _link_to_watch() -> socket.socket:
    """Return the link to the CPU watch, which is started for the first session or branch."""
    if not _watches:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        server = os.getpid()
        watch = os.fork()
        if watch == 0:
            null = os.open(os.devnull, os.O_RDWR)
            become(watching_program(theirs), server, (null, null, null))
        theirs.close()
        _watches.append((watch, ours))
    return _watches[0][1]


def _end_watch() -> None:
    """End the CPU watch, and wait for it, so that its CPU time counts as this server's; branches have ended."""
    for watch, link in _watches:
        link.close()
        with suppress(ChildProcessError):
            os.waitpid(watch, 0)
    _watches.clear()


def _run_in_sandbox(form: Form, file: Path, watch: socket.socket) -> None:
    from grader.live.session.session import run

    plan: SessionPlan = pickle.loads(
        file.read_bytes()
    )  # the grader's own, in a folder that nobody else may enter
    if os.getpid() == 1:
        enter_rest_of_sandbox()
    else:
        enter_sandbox(form)
    name_process("session")
    run(plan, watch)


def _serve_branch() -> None:
    put_self_first()
    # The socket for requests takes the place of standard output.
    with socket.socket(fileno=os.dup(1)) as link:
        os.dup2(0, 1)
        serve(link, _program_of)


def main() -> None:
    """Serve the requests on the socket with the number in argv[1]."""
    _serve_sandboxes(int(sys.argv[1]))


def _serve_sandboxes(descriptor: int) -> NoReturn:
    end_with_parent()  # If that has ended already, so has the other side of the socket.
    put_self_first()
    # Sandboxes have memory limits of their own, instead of the grader's.
    lift("as")
    for module in _WITHOUT_ROS:
        importlib.import_module(module)
    build_models()
    with socket.socket(fileno=descriptor) as link:
        serve(link, _program_of)
        _end_watch()
    os._exit(0)  # Skips the cleanup of a process with ROS, which takes 26 ms.


if __name__ == "__main__":
    main()

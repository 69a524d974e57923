"""Starts the first processes of sandboxes as forks of a process that has imported what they need.

The server has an environment made from nothing, starts no thread and nothing of ROS, and serves one grading; that of a
class branches, so that each of its gradings has one of its own, which ends with it. Each sandbox's first process then
forks its director and reference nodes in the same way.
"""

from __future__ import annotations

import asyncio
import compileall
import gc
import importlib
import os
import pickle
import socket
import sys
from collections.abc import Collection, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from confine.limits import lift
from confine.namespaces import (
    Form,
    end_with_parent,
    enter_own_mounts,
    enter_sandbox,
    name_process,
)
from confine.priority import put_self_first
from grader.live.process.forked import Program
from grader.live.process.forking import ForkingServer, serve
from grader.live.sandbox.environment import INSIDE_FOLDER, LAUNCHING_FOLDER, trusted_environment
from grader.live.session.plan import SessionPlan
from grader.recording.definitions import definition_of, type_hash_of

_WITHOUT_ROS = (
    "grader.live.session.session",
    "grader.recording.bag",
    "mcap.writer",
    "numpy",
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
    """The process that forks the first processes of sandboxes; used as a context, with which all that it started ends.

    `types` are those of messages and services that the sessions are likely to use; until the first request they may
    be set anew.
    """

    def __init__(self, types: Collection[str] = ()) -> None:
        super().__init__(__name__, [], trusted_environment(Path("/"), 0))
        self.types = types

    def request(self, form: Form, plan: Path | None = None) -> bytes:
        """Return what asks for the session of a plan, or for a branch."""
        return b"\0".join(map(os.fsencode, (form.value, plan or "", *self.types)))

    async def start_sandbox(self, form: Form, plan: Path, errors: Path) -> asyncio.StreamReader:
        """Start the session of a pickled `SessionPlan` in a sandbox of its own, with a file for its standard error.

        Returns what its first process says, see `ForkingServer.start`; by its process id the sandbox ends. `form` must
        be the same for all sandboxes of a server.
        """
        return await self.start(self.request(form, plan), errors)

    def branch(self, form: Form) -> ForkServer:
        """Return a server that is a fork of this one, for what is to end apart from it."""
        return _Branch(self, form)


class _Branch(ForkServer):
    def __init__(self, of: ForkServer, form: Form) -> None:
        super().__init__(of.types)
        self._of, self._form = of, form

    def _start(self, link: socket.socket) -> _Branch:
        with (
            Path(os.devnull).open("wb") as errors,
            suppress(ConnectionError),
        ):  # Then requests will have no answer.
            socket.send_fds(
                self._of._link, [self.request(self._form)], [link.fileno(), errors.fileno()]
            )
        return self

    def wait(self, timeout: float) -> None:
        """Wait until it has ended, and all that it started."""
        self._link.settimeout(timeout)
        while self._link.recv(_MOST_ANSWER_BYTES):
            pass

    def kill(self) -> None:
        """Leave it to the server, with which it ends at the latest."""


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


def _program_of(request: bytes) -> Program:
    """Return the first process of a sandbox, or a branch of this server; loads what they need the first time."""
    word, name, *types = map(os.fsdecode, request.split(b"\0"))
    form, plan = Form(word), Path(name)
    if not _loaded:
        enter_own_mounts(
            form
        )  # Before: what is loaded has threads of its own, which keep a user from it.
        _load_ros(types)
        _loaded.append(form)
        # A collection in a fork would touch, and so copy, the memory of all objects that are there now.
        gc.freeze()
        gc.enable()
    if not name:
        return Program("fork server", _serve_branch, trusted_environment(Path("/"), 0))
    return Program(
        "sandbox", partial(_run_in_sandbox, form, plan), trusted_environment(plan.parent, 0)
    )


#: The form of sandboxes for which all is loaded.
_loaded: list[Form] = []


def _run_in_sandbox(form: Form, file: Path) -> None:
    from grader.live.session.session import run

    plan: SessionPlan = pickle.loads(
        file.read_bytes()
    )  # the grader's own, in a folder that nobody else may enter
    enter_sandbox(form)
    name_process("session")
    run(plan)


def _serve_branch() -> None:
    put_self_first()
    # What serves others stands in the place of the standard output of programs.
    with socket.socket(fileno=os.dup(1)) as link:
        os.dup2(0, 1)
        serve(link, _program_of)


def main() -> None:
    """Serve what comes through the socket of the number in argv[1]."""
    end_with_parent()  # If that has ended already, so has the other side of the socket.
    put_self_first()
    # What limits the grader's own memory is not for the sandboxes, which have limits of their own.
    lift("as")
    gc.disable()  # Nothing of what is imported is for collection.
    for module in _WITHOUT_ROS:
        importlib.import_module(module)
    with socket.socket(fileno=int(sys.argv[1])) as link:
        serve(link, _program_of)
    os._exit(0)  # For what a process with ROS tidies up at its end, 26 ms, somebody would wait.


if __name__ == "__main__":
    main()

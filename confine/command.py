"""The one place that decides how a program in a sandbox is confined."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from confine.bubblewrap import (
    SETTINGS,
    SYSTEM_FOLDERS,
    file_system_options,
    namespace_options,
    start_options,
)
from confine.cgroup import PROCESSES, SandboxCgroup
from confine.isolation import Isolation, Level, confined_uid
from confine.limits import attainable_limits
from confine.machine import processes_of_user, tasks_of
from confine.reduced import Confinement
from confine.room import Room
from confine.seccomp import open_filter

_MAX_FILE_BYTES = 64 * 1024 * 1024
_MAX_OPEN_FILES = 1024
#: Too small for any core file. A limit of 0 does not keep a program that takes core files, such as apport on Ubuntu,
#: from being started as root for each crash; this one does. Reference: Linux, fs/coredump.c.
_NO_CORE_BYTES = 1
#: Address space of one process where no control group limits the memory of all together.
_MAX_ADDRESS_BYTES = 4 * 1024**3
_DEVICES = ("null", "zero", "full", "random", "urandom")


class Confined(NamedTuple):
    """A command line that runs a program confined, and the descriptors that it needs.

    Bubblewrap, if it is used, writes the process id of its child to `info_fd`; the caller closes it.
    """

    argv: list[str]
    pass_fds: tuple[int, ...] = ()
    info_fd: int | None = None


@contextmanager
def confined(
    isolation: Isolation,
    command: Sequence[str],
    *,
    environment: Mapping[str, str],
    room: Room,
    slot: int,
    cwd: str,
    group: SandboxCgroup | None,
) -> Iterator[Confined]:
    """Give the command line that runs a `command` in the sandbox of a slot, for as long as its descriptors are open.

    Without bubblewrap no descriptor is passed on, because the confined program would inherit it. `cwd` is a path inside
    the sandbox.
    """
    uid = confined_uid(isolation, slot)
    limits = {"nofile": _MAX_OPEN_FILES, "fsize": _MAX_FILE_BYTES, "core": _NO_CORE_BYTES}
    if group is None:
        limits["as"] = _MAX_ADDRESS_BYTES
    if isolation.level is Level.NONE:
        limited = _limited(limits, environment, command)
        yield Confined(["setpriv", "--pdeathsig", "KILL", *limited])
        return
    if not isolation.namespaces:
        limits["nproc"] = PROCESSES + _threads_of_others(uid)
        read, write = _readable(room), _writable(room)
        restricted = Confinement(list(command), dict(environment), cwd, read, write, uid, limits)
        yield Confined(restricted.argv(sys.executable))
        return
    if group is None:
        limits["nproc"] = PROCESSES  # counted by user id, which is less exact than a group
    with ExitStack() as passed:
        info_read, info_write = os.pipe()
        passed.callback(os.close, info_write)
        os.set_blocking(info_read, False)
        seccomp = open_filter()
        passed.callback(os.close, seccomp)
        argv = namespace_options(isolation.form, isolation.old_bubblewrap, info_write, seccomp)
        argv += file_system_options(room)
        argv += start_options(cwd, uid)
        argv += _limited(limits, environment, command)
        if group is not None:
            argv = group.entering(argv)
        yield Confined(argv, (info_write, seccomp), info_read)


def _limited(
    limits: Mapping[str, int], environment: Mapping[str, str], command: Sequence[str]
) -> list[str]:
    """Return the command line that runs a command below limits in an environment made from nothing."""
    argv = ["prlimit"]
    for name, value in attainable_limits(limits).items():
        argv.append(f"--{name}={value}")
    argv += ["--", "env", "-i", "--"]
    for name, text in environment.items():
        argv.append(f"{name}={text}")
    if "=" in command[0]:  # `env` would take this program for one more variable.
        argv += ["sh", "-c", 'exec "$@"', "sh"]
    return [*argv, *command]


def _threads_of_others(uid: int | None) -> int:
    """Return how many threads count against the limit of a program that runs as the caller."""
    if uid is not None:
        return 0
    return sum(len(tasks_of(pid)) for pid in processes_of_user(os.getuid()))


def _readable(room: Room) -> list[str]:
    """Return the files and folders that a program may read if it sees the machine's own ones.

    A folder with a covered one below it is replaced by its entries.
    """
    found = [Path("/proc")]
    found += [Path("/") / name for name in SYSTEM_FOLDERS]
    found += [Path("/etc") / name for name in SETTINGS]
    queue = room.roots
    while queue:
        folder = queue.pop()
        if folder in room.covered or folder == Path("/"):
            continue
        if any(hidden.is_relative_to(folder) for hidden in room.covered):
            queue += list(folder.iterdir())
        else:
            found.append(folder)
    return [str(path) for path in (*found, *room.tools.values())]


def _writable(room: Room) -> list[str]:
    """Return the files and folders that a program may change if it sees the machine's own ones."""
    devices = [f"/dev/{name}" for name in _DEVICES]
    return [*map(str, room.areas.values()), *devices]

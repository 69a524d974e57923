"""The one place that decides how a sandbox and the student's processes in it are confined.

A *sandbox* is a set of namespaces (network with only loopback up, mounts, IPC, processes) in which a session runs;
inside it bubblewrap confines each student's process further. Started as root, each sandbox has a user id of its own; an
ordinary user has it in a user namespace. Where neither works, Landlock and the system call filter remain. What is
permitted is found by `grader.live.sandbox.probing`.
"""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path, PurePosixPath
from typing import Any

import grader
from grader.limits import attainable_limits
from grader.live.sandbox.cgroup import PROCESSES, CgroupParents, SandboxCgroup
from grader.live.sandbox.confine import Confinement, confines_signals
from grader.live.sandbox.environment import (
    INSIDE_FOLDER,
    LAUNCHING_FOLDER,
    interpreter_links,
    interpreter_roots,
)
from grader.live.sandbox.machine import processes_of_user, tasks_of
from grader.live.sandbox.namespaces import Form
from grader.live.sandbox.seccomp import open_filter

#: Paths inside a confined student's process.
WORKSPACE = "/ws"
HOME = "/home/student"
TEMPORARY = "/tmp"
SHARED_MEMORY = "/dev/shm"
INSIDE = "/inside"
LAUNCHING = "/launching"
PARAMETERS = "/parameters"
INTERFACES = "/interfaces"

#: Ids that nobody uses: of these, those of each network, and what is left where only few ids are mapped.
#: References: systemd's "Users, Groups, UIDs and GIDs on systemd Systems"; user_namespaces(7).
STUDENT_UIDS = (range(1_879_048_192, 2_147_352_576), range(64_100, 64_228))
_UIDS_OF_NETWORK = 128
_MAX_FILE_BYTES = 64 * 1024 * 1024
_MAX_OPEN_FILES = 1024
#: Too small for any core file. Where a program of the machine's takes them, as apport does on Ubuntu, a limit of 0 does
#: not keep it from being started, as root, for each crash; this one does. Reference: Linux, fs/coredump.c.
_NO_CORE_BYTES = 1
#: Address space of one process where no control group limits the memory of all together.
_MAX_ADDRESS_BYTES = 4 * 1024**3
#: Of `/etc`, what programs need to run.
_SETTINGS = ("ld.so.cache", "localtime", "alternatives", "timezone")
#: Where `setpriv`, `prlimit` and `env` are found in a sandbox.
_PATH_OF_TOOLS = "/usr/bin:/bin:/usr/sbin:/sbin"
_DEVICES = ("null", "zero", "full", "random", "urandom")


class Level(str, Enum):
    """How well students' code is confined, from the best to none; `at_least` compares."""

    FULL = "full"
    NO_CGROUP = "no cgroup"
    REDUCED = "reduced"
    NONE = "none"

    def at_least(self, other: Level) -> bool:
        """Whether this level is `other` or a better one."""
        order = list(Level)
        return order.index(self) <= order.index(other)

    @classmethod
    def of(cls, word: str) -> Level:
        """Return the level that an argument of the command line names."""
        return cls(word.replace("-", " "))


_NAMESPACES = (
    "own network with loopback only",
    "own process ids",
    "sized private /tmp, /dev/shm and home",
)
_FILES = "no file may be changed but its own, and none read that is not needed"
_FILTER = "no privileges, and a system call filter"
_LIMITS = "limits on memory, processes, disk, files, output and time"
_ALL_TOGETHER = "a limit that the kernel keeps on the memory and processes of a session as a whole"


@dataclass(frozen=True)
class Isolation:
    """The confinement of a machine's sandboxes, and what it covers.

    Bubblewrap may be so old that it lacks `--disable-userns`. Control groups can be made at the level full. `first_uid`
    is that of the sandbox number 0, where each sandbox's student has a user id of its own; `remedy` says what would
    give more.
    """

    level: Level
    form: Form = Form.NONE
    old_bubblewrap: bool = False
    groups: CgroupParents | None = None
    first_uid: int | None = None
    remedy: str = ""

    @property
    def own_uid(self) -> bool:
        """Whether each sandbox's student has a user id of its own."""
        return self.first_uid is not None

    @property
    def namespaces(self) -> bool:
        """Whether sandboxes are namespaces of their own."""
        return self.form is not Form.NONE

    def describe(self) -> dict[str, Any]:
        """Return what a recording keeps of this: level, form, what is and what is not covered."""
        covers, lacks = self._coverage()
        words = {"level": self.level.value, "form": self.form.value, "remedy": self.remedy}
        return {**words, "covers": covers, "lacks": lacks}

    def _coverage(self) -> tuple[list[str], list[str]]:
        if self.namespaces:
            covers = [*_NAMESPACES, _FILES, _FILTER, _LIMITS]
            return (
                ([*covers, _ALL_TOGETHER], [])
                if self.level is Level.FULL
                else (covers, [_ALL_TOGETHER])
            )
        if self.level is Level.NONE:
            return ["limits on output and time"], [*_NAMESPACES, _FILES, _FILTER, _LIMITS]
        covers, lacks = (
            [_FILES, _FILTER, _LIMITS, "no connections by TCP"],
            [*_NAMESPACES, _ALL_TOGETHER],
        )
        lacks.append("UDP to other machines is not blocked")
        if not self.own_uid and os.geteuid() == 0:
            lacks.append(
                "a user id of its own: students' code runs as root, without its privileges"
            )
        if not self.own_uid and not confines_signals():
            lacks.append("signals to the grader's processes")
        return covers, lacks


def student_uid(isolation: Isolation, slot: int) -> int | None:
    """User id under which a sandbox's student runs, or None where it is the caller's own."""
    return isolation.first_uid + slot if isolation.first_uid is not None else None


def sandbox_cgroup(isolation: Isolation, slot: int) -> SandboxCgroup | None:
    """Return the control group of a sandbox, where groups can be made."""
    label = f"sandbox-{student_uid(isolation, slot) or slot}"
    return SandboxCgroup(isolation.groups, label) if isolation.groups is not None else None


@contextmanager
def free_slot() -> Iterator[int]:
    """Yield a number from 1 to 101 that no other sandbox in this network has at the time.

    It makes the sandbox's user id and control group where sandboxes have their own, and its ROS domain where they share
    a network. Whoever holds the socket of that name holds the number; it leaves nothing behind.
    """
    for number in range(1, 102):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as held:
            try:
                held.bind(f"\0grade-sandbox-{number}")
            except OSError:
                continue
            yield number
            return
    raise RuntimeError("there are 101 sandboxes on this machine already")


def first_student_uid() -> int:
    """Return the user id from which those of sandboxes in this network are counted.

    A grader in another container numbers its sandboxes alike, and where both have the users of the machine, the kernel
    would take both students for one. So each network has its own ids, by the number of its namespace. A container with
    users of its own has only few, and nobody outside has them.
    """
    many, few = STUDENT_UIDS
    namespace = Path("/proc/self/ns/net").stat().st_ino
    first = many[namespace % (len(many) // _UIDS_OF_NETWORK) * _UIDS_OF_NETWORK]
    mapped = [
        [int(word) for word in line.split()]
        for line in Path("/proc/self/uid_map").read_text().splitlines()
    ]
    last = first + _UIDS_OF_NETWORK - 1
    return (
        first
        if any(start <= first and last < start + count for start, _, count in mapped)
        else few[0]
    )


@dataclass(frozen=True)
class Room:
    """What a student's process, run by an interpreter, sees of the file system.

    It may change its areas and read our tools: where it sees such a folder in a sandbox -> where that is.
    """

    areas: Mapping[str, Path]
    tools: Mapping[str, Path]
    interpreter: Path

    @classmethod
    def below(cls, scratch: Path, interpreter: Path) -> Room:
        """Return the room of a sandbox whose own folders are made in one of ours."""
        areas = {WORKSPACE: "ws", HOME: "home", TEMPORARY: "tmp", SHARED_MEMORY: "shm"}
        tools = {INSIDE: INSIDE_FOLDER, LAUNCHING: LAUNCHING_FOLDER}
        tools |= {PARAMETERS: scratch / "parameters", INTERFACES: scratch / "interfaces"}
        return cls({seen: scratch / name for seen, name in areas.items()}, tools, interpreter)

    def make(self, scratch: Path, mount: Callable[[Path], None] | None = None) -> None:
        """Make the folders, each a file system of its own if there is a way to mount one."""
        scratch.chmod(0o711)
        for ours in (PARAMETERS, INTERFACES):
            self.tools[ours].mkdir()
            self.tools[ours].chmod(0o755)  # whatever the umask is
        for folder in self.areas.values():
            folder.mkdir()
            if mount is not None:
                mount(folder)
        for area in (HOME, TEMPORARY, SHARED_MEMORY):
            self.areas[area].chmod(0o1777)

    def seen(self, isolation: Isolation) -> dict[str, str]:
        """Return where a student's process sees its folders."""
        folders = {**self.areas, **self.tools}
        return {
            target: target if isolation.namespaces else str(folder)
            for target, folder in folders.items()
        }


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
) -> Iterator[tuple[list[str], tuple[int, ...], int | None]]:
    """Give what runs a student's `command` in the sandbox of a slot: a command line, and the descriptors that it needs.

    The last of the three is where bubblewrap says the process id of its child, if it is used; who takes it, closes it.
    Without bubblewrap nothing is passed on, since the student's process would inherit it. `cwd` is as that sees it.
    """
    uid = student_uid(isolation, slot)
    limits = {"nofile": _MAX_OPEN_FILES, "fsize": _MAX_FILE_BYTES, "core": _NO_CORE_BYTES}
    limits |= {} if group is not None else {"as": _MAX_ADDRESS_BYTES}
    if isolation.level is Level.NONE:
        yield ["setpriv", "--pdeathsig", "KILL", *_limited(limits, environment, command)], (), None
        return
    if not isolation.namespaces:
        # It counts all of a user's threads.
        others = (
            sum(len(tasks_of(pid)) for pid in processes_of_user(os.getuid())) if uid is None else 0
        )
        limits["nproc"] = PROCESSES + others
        read, write = (
            _readable(room),
            [*map(str, room.areas.values()), *(f"/dev/{name}" for name in _DEVICES)],
        )
        confinement = Confinement(list(command), dict(environment), cwd, read, write, uid, limits)
        yield confinement.argv(sys.executable), (), None
        return
    if group is None:
        limits["nproc"] = PROCESSES  # Counted by user id, so that a group says it better.
    with ExitStack() as passed:
        info_read, info_write = os.pipe()
        passed.callback(os.close, info_write)
        os.set_blocking(info_read, False)
        seccomp = open_filter()
        passed.callback(os.close, seccomp)
        arguments = [
            "bwrap",
            "--unshare-pid",
            "--unshare-ipc",
            "--unshare-uts",
            "--unshare-cgroup-try",
        ]
        arguments += [
            "--die-with-parent",
            "--new-session",
            "--info-fd",
            str(info_write),
            "--hostname",
            "lab",
        ]
        arguments += ["--seccomp", str(seccomp)]
        if isolation.form is Form.USER:
            arguments += ["--unshare-user", "--uid", "1000", "--gid", "1000"]
            arguments += [] if isolation.old_bubblewrap else ["--disable-userns"]
        else:
            arguments += ["--cap-drop", "ALL"]
            arguments += [
                word
                for name in ("SETUID", "SETGID", "SETPCAP")
                for word in ("--cap-add", f"CAP_{name}")
            ]
        arguments += _file_system(room)
        # What launch files set, such as LD_PRELOAD or PATH, must not reach the programs that still have privileges.
        arguments += ["--clearenv", "--setenv", "PATH", _PATH_OF_TOOLS, "--chdir", cwd, "--"]
        if uid is not None:
            arguments += [
                "setpriv",
                "--reuid",
                str(uid),
                "--regid",
                str(uid),
                "--clear-groups",
                "--inh-caps=-all",
            ]
            arguments += ["--bounding-set=-all", "--no-new-privs"]
        arguments += _limited(limits, environment, command)
        yield (
            group.entering(arguments) if group is not None else arguments,
            (info_write, seccomp),
            info_read,
        )


def _limited(
    limits: Mapping[str, int], environment: Mapping[str, str], command: Sequence[str]
) -> list[str]:
    variables = [f"{name}={value}" for name, value in environment.items()]
    # `env` would take a program with this sign in its path for one more variable.
    shell = ["sh", "-c", 'exec "$@"', "sh"] if "=" in command[0] else []
    had = attainable_limits(limits)
    limited = ["prlimit", *(f"--{name}={value}" for name, value in had.items()), "--"]
    return [*limited, "env", "-i", "--", *variables, *shell, *command]


def _file_system(room: Room) -> list[str]:
    arguments: list[str] = []
    made: set[str] = {"/"}

    def parents(target: str) -> None:
        for parent in reversed(PurePosixPath(target).parents):
            if str(parent) not in made:
                made.add(str(parent))
                arguments.extend(["--perms", "0755", "--dir", str(parent)])

    def bind(kind: str, source: str, target: str) -> None:
        parents(target)
        arguments.extend([kind, source, target])

    bind("--ro-bind", "/usr", "/usr")
    made.update(("/usr", "/usr/bin", "/usr/lib", "/usr/local"))
    for name in ("bin", "sbin", "lib", "lib32", "lib64", "libx32"):
        path = Path("/") / name
        if path.is_symlink():
            arguments += ["--symlink", str(path.readlink()), str(path)]
        elif path.is_dir():
            bind("--ro-bind", str(path), str(path))
    for name in _SETTINGS:
        if (Path("/etc") / name).exists():
            bind("--ro-bind", f"/etc/{name}", f"/etc/{name}")
    arguments += ["--proc", "/proc", "--dev", "/dev"]
    for target, source in room.areas.items():
        bind("--bind", str(source), target)
        made.add(target)
    for target, source in room.tools.items():
        bind("--ro-bind", str(source), target)
    # After these, since a virtual environment may well lie below /tmp.
    for root in interpreter_roots(room.interpreter):
        if not root.is_relative_to("/usr") and str(root) != "/":
            bind("--ro-bind", str(root), str(root))
    for link, target in interpreter_links(room.interpreter).items():
        if not link.is_relative_to("/usr"):
            bind("--symlink", target, str(link))
    # The grader's own package, oracles and solution included, is covered where it lies among what a student sees.
    roots = [Path("/usr"), *interpreter_roots(room.interpreter)]
    for folder in _own_folders(roots):
        if any(folder.is_relative_to(root) for root in roots):
            arguments += ["--perms", "0555", "--tmpfs", str(folder), "--remount-ro", str(folder)]
    return [*arguments, "--remount-ro", "/"]


def _own_folders(roots: Sequence[Path]) -> list[Path]:
    """Return the grader's package and, in a checkout, what lies beside it and is no part of an interpreter."""
    package = Path(grader.__file__).parent
    checkout = package.parent
    if not (checkout / "rubric.yaml").is_file():
        return [package]
    folders = [p for p in checkout.iterdir() if p.is_dir() and not p.is_symlink()]
    theirs = (
        {checkout / name for name in ("bin", "lib", "lib64", "include", "share")}
        if checkout in roots
        else set()
    )
    return [
        p
        for p in sorted(folders)
        if p not in theirs and not any(root.is_relative_to(p) for root in roots)
    ]


def _readable(room: Room) -> list[str]:
    """Return what a student's process may read where it sees the machine's own files, our own left out."""
    found = [
        Path("/proc"),
        *(Path("/") / n for n in ("bin", "sbin", "lib", "lib32", "lib64", "libx32")),
    ]
    found += [Path("/etc") / name for name in _SETTINGS]
    queue = [Path("/usr"), *interpreter_roots(room.interpreter)]
    ours = _own_folders(queue)
    while queue:
        folder = queue.pop()
        if folder in ours or folder == Path("/"):
            continue
        if any(own.is_relative_to(folder) for own in ours):
            queue += list(folder.iterdir())
        else:
            found.append(folder)
    return [str(path) for path in (*found, *room.tools.values())]

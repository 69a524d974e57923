"""Becomes a student's command, confined without namespaces: for containers and hosts that permit none.

Run as `python -I -m grader.live.sandbox.confine SPEC`, where SPEC is a `Confinement` as JSON. It gives up privileges,
restricts files and signals by Landlock, filters system calls, TCP among them, sets limits, and executes the command.

References
----------
The kernel's `Documentation/userspace-api/landlock.rst` (Linux 5.13 and newer); numbers from `linux/landlock.h`.
"""

from __future__ import annotations

import ctypes
import json
import os
import stat
import struct
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from grader.limits import set_limit
from grader.live.sandbox.namespaces import call, end_with_parent
from grader.live.sandbox.seccomp import FilterProgram, filter_program

_SET_SECCOMP, _CAPBSET_DROP, _SET_NO_NEW_PRIVS, _CAP_AMBIENT = 22, 24, 38, 47
_AMBIENT_CLEAR_ALL = 4
_FILTER_MODE = 2
_LAST_CAPABILITY = 63

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION_FLAG = _PATH_BENEATH = 1
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
_REFER, _TRUNCATE, _IOCTL_DEV = 1 << 13, 1 << 14, 1 << 15
_ALL_OF_VERSION_1 = (1 << 13) - 1
_OF_FILES = _EXECUTE | _WRITE_FILE | _READ_FILE | _TRUNCATE | _IOCTL_DEV
_READ = _EXECUTE | _READ_FILE | _READ_DIR
_ABSTRACT_SOCKETS_AND_SIGNALS = 0b11


@dataclass(frozen=True)
class Confinement:
    """What `confine` needs to know.

    What is in `read` may be read and executed, what is in `write` changed as well. `uid` is the user id to take, where
    this is root; `limits` are `resource.RLIMIT_*` in lower case -> value.
    """

    command: list[str]
    environment: dict[str, str]
    cwd: str
    read: list[str]
    write: list[str]
    uid: int | None
    limits: dict[str, int]

    def argv(self, python: str) -> list[str]:
        """Return the command line that runs this."""
        return [python, "-I", "-m", "grader.live.sandbox.confine", json.dumps(asdict(self))]


def main() -> None:
    """Confine this process as argv[1] says, and become the command."""
    plan = Confinement(**json.loads(sys.argv[1]))
    for name, value in plan.limits.items():
        set_limit(name, value)
    _prctl(_SET_NO_NEW_PRIVS, 1)
    restrict([Path(p) for p in plan.read], [Path(p) for p in plan.write])
    if os.geteuid() == 0:
        _give_up_privileges(plan.uid)
    try:
        os.chdir(plan.cwd)  # as the student's user, who named it
    except OSError as error:
        sys.exit(
            f"this cannot be started: its working folder {plan.cwd} cannot be entered: {error.strerror}"
        )
    end_with_parent()
    program = FilterProgram.of(filter_program(own_spaces=False, own_user=plan.uid is not None))
    _prctl(_SET_SECCOMP, _FILTER_MODE, ctypes.addressof(program))
    os.execvpe(plan.command[0], plan.command, plan.environment)


def _give_up_privileges(uid: int | None) -> None:
    _prctl(_CAP_AMBIENT, _AMBIENT_CLEAR_ALL)
    for capability in range(_LAST_CAPABILITY + 1):
        with suppress(OSError):  # one that this kernel does not have
            _prctl(_CAPBSET_DROP, capability)
    if uid is not None:
        os.setgroups([])
        os.setresgid(uid, uid, uid)
        os.setresuid(uid, uid, uid)


def landlock_version() -> int:
    """Return the version of Landlock's interface, 0 where the kernel has none."""
    with suppress(OSError):
        return call("syscall", _CREATE_RULESET, None, 0, _VERSION_FLAG)
    return 0


def confines_signals() -> bool:
    """Whether this kernel's Landlock keeps a process from sending signals to those outside."""
    return landlock_version() >= 6


def restrict(read: Iterable[Path], write: Iterable[Path]) -> None:
    """Let this process and all that come from it open nothing but the given files and what is below the folders.

    From version 6 on they also can neither signal processes outside nor connect to their abstract sockets. The process
    must have set `no_new_privs`. It raises `OSError` if the kernel refuses.
    """
    version = landlock_version()
    handled = _ALL_OF_VERSION_1
    handled |= (_REFER if version >= 2 else 0) | (_TRUNCATE if version >= 3 else 0)
    handled |= _IOCTL_DEV if version >= 5 else 0
    attributes = struct.pack("=Q", handled)
    if confines_signals():
        # Between the two stands what is restricted of TCP, which the system call filter does without gaps.
        attributes += struct.pack("=QQ", 0, _ABSTRACT_SOCKETS_AND_SIGNALS)
    ruleset = call("syscall", _CREATE_RULESET, attributes, len(attributes), 0)
    for path in read:
        _allow(ruleset, path, _READ & handled)
    for path in write:
        _allow(ruleset, path, handled)
    call("syscall", _RESTRICT_SELF, ruleset, 0)
    os.close(ruleset)


def _allow(ruleset: int, path: Path, access: int) -> None:
    with suppress(FileNotFoundError):
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
        try:
            if not stat.S_ISDIR(os.fstat(opened).st_mode):
                access &= _OF_FILES
            call(
                "syscall", _ADD_RULE, ruleset, _PATH_BENEATH, struct.pack("=Qi", access, opened), 0
            )
        finally:
            os.close(opened)


def _prctl(option: int, first: int, second: int = 0) -> None:
    call("prctl", option, first, second, 0, 0)


if __name__ == "__main__":
    main()

"""Becomes a student's command, confined without namespaces: for containers and hosts that permit none.

Run as `python -I -m grader.live.confine SPEC`, where SPEC is a `Confinement` as JSON. It gives up privileges,
restricts files and signals by Landlock, filters system calls, TCP among them, sets limits, and executes the command.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import signal
import struct
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from grader.live.landlock import restrict
from grader.live.seccomp import filter_program

_SET_PDEATHSIG, _SET_SECCOMP, _CAPBSET_DROP, _SET_NO_NEW_PRIVS, _CAP_AMBIENT = 1, 22, 24, 38, 47
_AMBIENT_CLEAR_ALL = 4
_FILTER_MODE = 2
_LAST_CAPABILITY = 63


@dataclass(frozen=True)
class Confinement:
    """What `confine` needs to know.

    Attributes
    ----------
    read, write : list of str
        Files and folders that may be read (and executed), and those that may be changed as well.
    uid : int or None
        User id to take, where this is root.
    limits : dict
        `resource.RLIMIT_*` in lower case -> value.
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
        return [python, "-I", "-m", "grader.live.confine", json.dumps(asdict(self))]


def main() -> None:
    """Confine this process as argv[1] says, and become the command."""
    plan = Confinement(**json.loads(sys.argv[1]))
    for name, value in plan.limits.items():
        resource.setrlimit(getattr(resource, f"RLIMIT_{name.upper()}"), (value, value))
    _prctl(_SET_NO_NEW_PRIVS, 1)
    restrict([Path(p) for p in plan.read], [Path(p) for p in plan.write])
    if os.geteuid() == 0:
        _give_up_privileges(plan.uid)
    try:
        os.chdir(plan.cwd)  # as the student's user, who named it
    except OSError as error:
        sys.exit(f"this cannot be started: its working folder {plan.cwd} cannot be entered: {error.strerror}")
    _prctl(_SET_PDEATHSIG, signal.SIGKILL)
    _filter_system_calls(own_user=plan.uid is not None)
    os.execvpe(plan.command[0], plan.command, plan.environment)


def _give_up_privileges(uid: int | None) -> None:
    _prctl(_CAP_AMBIENT, _AMBIENT_CLEAR_ALL)
    for capability in range(_LAST_CAPABILITY + 1):
        ctypes.CDLL(None).prctl(_CAPBSET_DROP, capability, 0, 0, 0)
    if uid is not None:
        os.setgroups([])
        os.setresgid(uid, uid, uid)
        os.setresuid(uid, uid, uid)


def _filter_system_calls(*, own_user: bool) -> None:
    steps = filter_program(own_spaces=False, own_user=own_user)
    held = ctypes.create_string_buffer(steps, len(steps))
    # The kernel's `struct sock_fprog`.
    program = ctypes.create_string_buffer(struct.pack("HxxxxxxQ", len(steps) // 8, ctypes.addressof(held)), 16)
    _prctl(_SET_SECCOMP, _FILTER_MODE, ctypes.addressof(program))


def _prctl(option: int, first: int, second: int = 0) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    words = [ctypes.c_ulong(word) for word in (first, second, 0, 0)]
    if libc.prctl(option, *words) != 0:
        raise OSError(ctypes.get_errno(), f"prctl {option} refused")


if __name__ == "__main__":
    main()

"""Becomes a command, confined without namespaces: for containers and hosts that permit none.

Run as `python -I -m confine.reduced SPEC`, where SPEC is a `Confinement` as JSON. It gives up privileges, restricts
files and signals by Landlock, filters system calls, TCP among them, sets limits, and executes the command.
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from confine.landlock import restrict
from confine.limits import set_limit
from confine.namespaces import call, end_with_parent
from confine.seccomp import FilterProgram, filter_program

_SET_SECCOMP, _CAPBSET_DROP, _SET_NO_NEW_PRIVS, _CAP_AMBIENT = 22, 24, 38, 47
_AMBIENT_CLEAR_ALL = 4
_FILTER_MODE = 2
_LAST_CAPABILITY = 63


@dataclass(frozen=True)
class Confinement:
    """A command and its restrictions.

    Files and folders in `read` may be read and executed, those in `write` changed as well. `uid` is the user id to
    take, if this is root; `limits` are `resource.RLIMIT_*` in lower case -> value.
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
        return [python, "-I", "-m", "confine.reduced", json.dumps(asdict(self))]


def main() -> None:
    """Confine this process as argv[1] says, and become the command."""
    plan = Confinement(**json.loads(sys.argv[1]))
    for name, value in plan.limits.items():
        set_limit(name, value)
    _prctl(_SET_NO_NEW_PRIVS, 1)
    restrict(map(Path, plan.read), map(Path, plan.write))
    if os.geteuid() == 0:
        _give_up_privileges(plan.uid)
    try:
        os.chdir(plan.cwd)  # as the confined user, because the command named the folder
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


def _prctl(option: int, first: int, second: int = 0) -> None:
    call("prctl", option, first, second, 0, 0)


if __name__ == "__main__":
    main()

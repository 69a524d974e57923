"""Finds how well students' code can be confined on this machine, by running a program in a real sandbox."""

from __future__ import annotations

import os
import stat
import subprocess
import tempfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from grader.errors import IsolationError
from grader.limits import limit_behind
from grader.live.sandbox.cgroup import SandboxCgroup, cgroup_parents
from grader.live.sandbox.confine import confines_signals, landlock_version
from grader.live.sandbox.helpers import find_tool, run_helper
from grader.live.sandbox.isolation import (
    TEMPORARY,
    Isolation,
    Level,
    Room,
    first_student_uid,
    free_slot,
    sandbox_cgroup,
    student_uid,
)
from grader.live.sandbox.namespaces import Form
from grader.live.sandbox.running import run_confined
from grader.live.sandbox.scratch import scratch_prefix

_PROBE_BYTES = 96 * 1024 * 1024
_TIMEOUT_S = 30.0

#: Says who and how privileged it is, and whether the system call filter holds.
_WHO = """
import ctypes, os
status = open("/proc/self/status").read()
denied = ctypes.CDLL(None).unshare(0x10000000)
words = {line.split(":")[0]: line.split()[1] for line in status.splitlines() if len(line.split()) > 1}
print("in", os.getuid(), int(words["CapEff"], 16), words["NoNewPrivs"], words["Seccomp"], denied)
"""
#: Two processes that together take twice the limit. As soon as one has ended, all is known.
_TAKE_MEMORY = f"""
import os, time
for _ in range(2):
    if os.fork() == 0:
        taken = bytearray({_PROBE_BYTES})
        taken[::4096] = b"x" * len(taken[::4096])
        time.sleep(0.5)
        os._exit(0)
os.wait()
print("in")
"""


def probe_isolation(interpreter: Path) -> Isolation:
    """Find the strongest confinement that works here."""
    missing = [tool for tool in ("setpriv", "prlimit") if find_tool(tool) is None]
    if missing:
        return Isolation(Level.NONE, remedy=f"Install util-linux ({', '.join(missing)} not found).")
    problem, remedy = None, "Install bubblewrap: sudo apt-get install bubblewrap"
    if find_tool("bwrap") is not None:
        root = os.geteuid() == 0
        usage = run_helper(["bwrap", "--help"])
        old = "--disable-userns" not in usage.stdout + usage.stderr
        form, first_uid = (Form.ROOT, first_student_uid()) if root else (Form.USER, None)
        found = Isolation(Level.NO_CGROUP, form, old, first_uid=first_uid)
        problem = _try(found, interpreter)
        if problem is None:
            return _with_groups(found, interpreter)
        remedy = _remedy(problem)
    return _without_namespaces(interpreter, remedy)


def require(isolation: Isolation, least: Level) -> None:
    """Raise `IsolationError`, with the one thing that would fix it, unless the confinement is good enough."""
    if isolation.level.at_least(least):
        return
    freely = "" if least is not Level.REDUCED else " If you trust this code, add --trust-code."
    raise IsolationError(
        f"students' code can be confined here at the level '{isolation.level.value}' only, "
        f"and '{least.value}' is required",
        remedy=f"{isolation.remedy}{freely} `grade doctor` shows more.",
    )


def _with_groups(found: Isolation, interpreter: Path) -> Isolation:
    for parents in cgroup_parents():
        full = replace(found, level=Level.FULL, groups=parents)
        if _limits_memory(full, interpreter):
            return full
    reason = "no control group for memory and processes can be made here"
    return replace(
        found, remedy=f"For the level full, run as root on the machine itself: {reason}."
    )


def _without_namespaces(interpreter: Path, remedy: str) -> Isolation:
    if landlock_version() < 1:
        return Isolation(Level.NONE, remedy=f"{remedy} (This kernel has no Landlock either.)")
    root = os.geteuid() == 0
    found = Isolation(Level.REDUCED, first_uid=first_student_uid() if root else None, remedy=remedy)
    problem = _try(found, interpreter)
    if problem is not None and root:
        remedy = f"{remedy.rstrip('.')}. Or {_remedy_for_own_uid(interpreter, problem)}"
        found = Isolation(Level.REDUCED, remedy=remedy)
        # As root it could end the grader, where signals are not confined.
        problem = _try(found, interpreter) if confines_signals() else problem
    return found if problem is None else Isolation(Level.NONE, remedy=remedy)


def _remedy_for_own_uid(interpreter: Path, problem: str) -> str:
    """Say what keeps students' code from running under a user id of its own."""
    closed = _closed_to_others(interpreter)
    if closed is not None:
        return f"let other users run {interpreter} (chmod o+x {closed}), or give another interpreter with --python."
    last = problem.splitlines()[-1][:200]
    return f"let root run {interpreter} under other user ids (what was tried ended with: {last})."


def _closed_to_others(interpreter: Path) -> Path | None:
    """Return the outermost folder on the way to an interpreter, or to its target, that others may not enter."""
    for path in dict.fromkeys((interpreter, interpreter.resolve())):
        for folder in reversed(path.parents):
            if not folder.stat().st_mode & stat.S_IXOTH:
                return folder
    return None


def _try(isolation: Isolation, interpreter: Path) -> str | None:
    """Run the interpreter in a sandbox with the real arguments; return None or what went wrong."""
    try:
        run = _run(isolation, interpreter, _WHO)
    except (OSError, subprocess.TimeoutExpired) as problem:
        return str(problem)
    answer = run.stdout.split()
    if run.returncode != 0 or answer[:1] != ["in"]:
        return run.stderr.strip() or "no answer from the sandbox"
    _, uid, capabilities, no_new_privileges, seccomp, denied = answer
    wanted = student_uid(isolation, 0)
    if (wanted is not None and int(uid) != wanted) or capabilities != "0":
        return f"the sandbox runs as user {uid} with capabilities {capabilities}"
    return (
        None
        if (no_new_privileges, seccomp, denied) == ("1", "2", "-1")
        else "the system call filter does not hold"
    )


def _limits_memory(isolation: Isolation, interpreter: Path) -> bool:
    """Whether two processes that together take twice the limit are ended by the kernel."""
    with free_slot() as slot:
        group = sandbox_cgroup(isolation, slot)
        assert group is not None
        try:
            group.make(memory_bytes=_PROBE_BYTES)
            _run(isolation, interpreter, _TAKE_MEMORY, slot, group)
            return group.exceeded()["memory"] > 0
        except (OSError, subprocess.TimeoutExpired):
            return False
        finally:
            group.remove()


def _run(
    isolation: Isolation,
    interpreter: Path,
    program: str,
    slot: int = 0,
    group: SandboxCgroup | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a program as sessions run a student's, in a sandbox of its own."""
    with tempfile.TemporaryDirectory(
        prefix=scratch_prefix(), ignore_cleanup_errors=True
    ) as scratch:
        room = Room.below(Path(scratch), interpreter)
        room.make(Path(scratch))
        command, environment = [str(interpreter), "-c", program], {"PATH": "/usr/bin"}
        cwd = room.seen(isolation)[TEMPORARY]
        return run_confined(
            isolation,
            room,
            command,
            environment=environment,
            slot=slot,
            cwd=cwd,
            timeout_s=_TIMEOUT_S,
            group=group,
        )


def _remedy(problem: str) -> str:
    """Say what permits namespaces, if the attempt to make them ended with this problem."""
    limit = limit_behind(problem)
    if limit is not None:
        return f"Namespaces cannot be made here: {limit.present}. {limit.remedy}"
    restricted = Path("/proc/sys/kernel/apparmor_restrict_unprivileged_userns")
    with suppress(OSError):
        if restricted.read_text().strip() == "1" and os.geteuid() != 0:
            return "This system restricts user namespaces (AppArmor): run with sudo."
    with suppress(OSError):
        if (
            Path("/proc/sys/user/max_user_namespaces").read_text().strip() == "0"
            and os.geteuid() != 0
        ):
            return (
                "This system permits no user namespaces: sudo sysctl user.max_user_namespaces=10000"
            )
    if Path("/.dockerenv").exists() or Path("/run/.containerenv").exists():
        return "In a container, namespaces need `--privileged`; or run on the machine itself."
    last = problem.splitlines()[-1][:200] if problem else "no reason was given"
    return f"Namespaces cannot be made here ({last}): run on the machine itself or in a privileged container."

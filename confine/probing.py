"""Finds how well programs can be confined on this machine, by running one in a real sandbox."""

from __future__ import annotations

import os
import stat
import subprocess
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from confine.cgroup import SandboxCgroup, cgroup_parents
from confine.helpers import find_tool, run_helper
from confine.isolation import (
    Isolation,
    Level,
    confined_uid,
    first_confined_uid,
    free_slot,
    sandbox_cgroup,
)
from confine.landlock import confines_signals, landlock_version
from confine.limits import limit_behind
from confine.namespaces import Form
from confine.room import TEMPORARY, Room, made_private_room
from confine.running import run_confined
from confine.scratch import scratch_prefix

#: Makes a room for an interpreter in a folder, with /tmp among its areas.
MakeRoom = Callable[[Path, Path], Room]

#: An interpreter needs a third of it.
_PROBE_BYTES = 32 * 1024 * 1024
_TIMEOUT_S = 30.0
#: The programs need the standard library alone; each look for installed packages takes some 40 ms.
_BARE = ("-I", "-S")

#: Prints its user id, its privileges, and whether the system call filter holds.
_TELL_PRIVILEGES = """
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


def probe_isolation(interpreter: Path, make_room: MakeRoom = made_private_room) -> Isolation:
    """Find the strongest confinement that works here for programs of an interpreter in such a room."""
    missing = [tool for tool in ("setpriv", "prlimit") if find_tool(tool) is None]
    if missing:
        return Isolation(Level.NONE, remedy=f"Install util-linux ({', '.join(missing)} not found).")
    probe = _Probe(interpreter, make_room)
    if find_tool("bwrap") is None:
        return probe.without_namespaces("Install bubblewrap: sudo apt-get install bubblewrap")
    found = _with_bubblewrap()
    problem = probe.problem_with(found)
    if problem is not None:
        return probe.without_namespaces(_remedy(problem))
    return probe.with_groups(found)


def _with_bubblewrap() -> Isolation:
    """Return the confinement by the installed bubblewrap, which may not work here."""
    usage = run_helper(["bwrap", "--help"])
    old = "--disable-userns" not in usage.stdout + usage.stderr
    if os.geteuid() == 0:
        return Isolation(Level.NO_CGROUP, Form.ROOT, old, first_uid=first_confined_uid())
    return Isolation(Level.NO_CGROUP, Form.USER, old)


class _Probe:
    """Tries confinements with one interpreter."""

    def __init__(self, interpreter: Path, make_room: MakeRoom) -> None:
        self.interpreter = interpreter
        self.make_room = make_room

    def with_groups(self, found: Isolation) -> Isolation:
        """Return a confinement by namespaces at the level full if a control group limits memory here."""
        for parents in cgroup_parents():
            full = replace(found, level=Level.FULL, groups=parents)
            if self._limits_memory(full):
                return full
        reason = "no control group for memory and processes can be made here"
        remedy = f"For the level full, run as root on the machine itself: {reason}."
        return replace(found, remedy=remedy)

    def without_namespaces(self, remedy: str) -> Isolation:
        """Return the level reduced if it works, else none; `remedy` says how to get namespaces."""
        if landlock_version() < 1:
            return Isolation(Level.NONE, remedy=f"{remedy} (This kernel has no Landlock either.)")
        found = Isolation(Level.REDUCED, remedy=remedy)
        if os.geteuid() == 0:
            own_user = replace(found, first_uid=first_confined_uid())
            problem = self.problem_with(own_user)
            if problem is None:
                return own_user
            remedy = f"{remedy.rstrip('.')}. Or {self._remedy_for_own_uid(problem)}"
            if not confines_signals():  # As root it could end each process of the machine.
                return Isolation(Level.NONE, remedy=remedy)
            found = replace(found, remedy=remedy)
        if self.problem_with(found) is not None:
            return Isolation(Level.NONE, remedy=remedy)
        return found

    def problem_with(self, isolation: Isolation) -> str | None:
        """Run the interpreter in a sandbox with the real arguments; return None or a description of the failure."""
        try:
            run = self._run(isolation, _TELL_PRIVILEGES)
        except (OSError, subprocess.TimeoutExpired) as problem:
            return str(problem)
        answer = run.stdout.split()
        if run.returncode != 0 or answer[:1] != ["in"]:
            return run.stderr.strip() or "no answer from the sandbox"
        _, uid, capabilities, no_new_privileges, seccomp, denied = answer
        wanted = confined_uid(isolation, 0)
        has_other_uid = wanted is not None and int(uid) != wanted
        if has_other_uid or capabilities != "0":
            return f"the sandbox runs as user {uid} with capabilities {capabilities}"
        if (no_new_privileges, seccomp, denied) != ("1", "2", "-1"):
            return "the system call filter does not hold"
        return None

    def _limits_memory(self, isolation: Isolation) -> bool:
        """Return whether the kernel ends two processes that together take twice the limit."""
        with free_slot() as slot:
            group = sandbox_cgroup(isolation, slot)
            assert group is not None
            try:
                group.make(memory_bytes=_PROBE_BYTES)
                self._run(isolation, _TAKE_MEMORY, slot, group)
                return group.exceeded()["memory"] > 0
            except (OSError, subprocess.TimeoutExpired):
                return False
            finally:
                group.remove()

    def _run(
        self, isolation: Isolation, program: str, slot: int = 0, group: SandboxCgroup | None = None
    ) -> subprocess.CompletedProcess[str]:
        """Run a program in a sandbox of its own."""
        with tempfile.TemporaryDirectory(
            prefix=scratch_prefix(), ignore_cleanup_errors=True
        ) as scratch:
            room = self.make_room(Path(scratch), self.interpreter)
            return run_confined(
                isolation,
                room,
                [str(self.interpreter), *_BARE, "-c", program],
                environment={"PATH": "/usr/bin"},
                slot=slot,
                cwd=room.seen(isolation)[TEMPORARY],
                timeout_s=_TIMEOUT_S,
                group=group,
            )

    def _remedy_for_own_uid(self, problem: str) -> str:
        """Name the obstacle to running programs under a user id of their own."""
        interpreter = self.interpreter
        closed = _closed_to_others(interpreter)
        if closed is not None:
            return f"let other users run {interpreter} (chmod o+x {closed}), or give another interpreter with --python."
        last = problem.splitlines()[-1][:200]
        return (
            f"let root run {interpreter} under other user ids (what was tried ended with: {last})."
        )


def _closed_to_others(interpreter: Path) -> Path | None:
    """Return the outermost folder on the way to an interpreter, or to its target, that others may not enter."""
    for path in dict.fromkeys((interpreter, interpreter.resolve())):
        for folder in reversed(path.parents):
            if not folder.stat().st_mode & stat.S_IXOTH:
                return folder
    return None


def _remedy(problem: str) -> str:
    """Name the setting that permits namespaces, if the attempt to make them ended with this problem."""
    limit = limit_behind(problem)
    if limit is not None:
        return f"Namespaces cannot be made here: {limit.present}. {limit.remedy}"
    if os.geteuid() != 0:
        if _setting("kernel/apparmor_restrict_unprivileged_userns") == "1":
            return "This system restricts user namespaces (AppArmor): run with sudo."
        if _setting("user/max_user_namespaces") == "0":
            return (
                "This system permits no user namespaces: sudo sysctl user.max_user_namespaces=10000"
            )
    if Path("/.dockerenv").exists() or Path("/run/.containerenv").exists():
        return "In a container, namespaces need `--privileged`; or run on the machine itself."
    last = "no reason was given"
    if problem:
        last = problem.splitlines()[-1][:200]
    return f"Namespaces cannot be made here ({last}): run on the machine itself or in a privileged container."


def _setting(name: str) -> str | None:
    """Return a setting of the kernel below /proc/sys, None if there is none."""
    with suppress(OSError):
        return (Path("/proc/sys") / name).read_text(encoding="ascii").strip()
    return None

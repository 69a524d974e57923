"""The one place that decides how a cell and the student's processes in it are confined.

A *cell* is a set of namespaces of its own (network with only loopback up, mounts, IPC, processes)
in which a session's processes run. Inside it each student's process is confined further by
bubblewrap: read-only root, own process ids, no capabilities, limits. Two forms work: R, started as
root, which gives each cell a user id of its own; and U, started as an ordinary user, in a user
namespace. Which one a machine permits is found by trying it with the real argument list.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path, PurePosixPath
from typing import Any

from grader.live.environment import INSIDE_FOLDER, interpreter_roots

#: Paths inside a confined student's process.
WORKSPACE = "/ws"
HOME = "/home/student"
INSIDE = "/inside"
LAUNCHING = "/launching"
PARAMETERS = "/parameters"

_FIRST_UID = 64100
_TMPFS_BYTES = 64 * 1024 * 1024
_MAX_PROCESSES = 256
_MAX_FILE_BYTES = 64 * 1024 * 1024
_MAX_OPEN_FILES = 1024


class Form(str, Enum):
    """How namespaces are had on this machine."""

    ROOT = "root"
    USER = "user"
    NONE = "none"


@dataclass(frozen=True)
class Isolation:
    """The confinement of a machine's cells, and what it covers.

    Attributes
    ----------
    old_bubblewrap : bool
        Whether bubblewrap lacks `--size` and `--disable-userns`.
    remedy : str
        What would give more, where more can be had.
    """

    form: Form
    old_bubblewrap: bool = False
    remedy: str = ""

    @property
    def level(self) -> str:
        """Name of the level, as reports state it."""
        return "none" if self.form is Form.NONE else "confined"

    def describe(self) -> dict[str, Any]:
        """Return what a recording keeps of this: level, form, and what is and is not covered."""
        covered = [
            "own network with loopback only",
            "own process ids",
            "private /tmp, /dev/shm and home",
            "read-only file system",
            "no capabilities",
            "limits on processes, open files and file sizes",
            "time limit",
        ]
        if self.form is Form.NONE:
            return {
                "level": self.level,
                "form": self.form.value,
                "covers": ["limits on processes, open files and file sizes", "time limit"],
                "lacks": covered[:-2],
                "remedy": self.remedy,
            }
        return {
            "level": self.level,
            "form": self.form.value,
            "covers": covered,
            "lacks": ["memory limit", "system call filter"],
        }

    def to_plain(self) -> dict[str, Any]:
        """Return this as plain data, for the session process."""
        return {**asdict(self), "form": self.form.value}

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Isolation:
        """Undo `to_plain`."""
        return cls(Form(plain["form"]), bool(plain["old_bubblewrap"]), str(plain["remedy"]))


def cell_argv(isolation: Isolation, command: Sequence[str]) -> list[str]:
    """Return the command line that runs `command` in a new cell; all of the cell ends with its first process."""
    ends_with_us = ["setpriv", "--pdeathsig", "KILL"]
    if isolation.form is Form.NONE:
        return [*ends_with_us, *command]
    user = ["--user", "--map-root-user"] if isolation.form is Form.USER else []
    spaces = ["--net", "--mount", "--ipc", "--uts", "--pid", "--fork", "--kill-child", "--mount-proc"]
    return [*ends_with_us, "unshare", *user, *spaces, *command]


def student_uid(isolation: Isolation, slot: int) -> int | None:
    """User id under which a cell's student runs, or None where it is the caller's own."""
    return _FIRST_UID + slot if isolation.form is Form.ROOT else None


def student_argv(
    isolation: Isolation,
    command: Sequence[str],
    *,
    environment: Mapping[str, str],
    workspace: Path,
    tools: Mapping[str, Path],
    interpreter: Path,
    slot: int,
    info_fd: int,
    cwd: str,
) -> list[str]:
    """Return the command line that runs a student's `command`, confined; must be used inside a cell.

    Parameters
    ----------
    workspace : Path
        Folder shown to the student as `/ws`, writable.
    tools : mapping
        Folders of ours that the process needs: where it sees them -> where they are. Read-only.
    slot : int
        Number of the cell among those that run at a time.
    info_fd : int
        Descriptor to which bubblewrap writes the child's process id.
    cwd : str
        Working folder as the student's process sees it.
    """
    limits = [
        f"--nproc={_MAX_PROCESSES}",
        f"--nofile={_MAX_OPEN_FILES}",
        f"--fsize={_MAX_FILE_BYTES}",
        "--core=0",
    ]
    limited = ["prlimit", *limits, "--", *command]
    if isolation.form is Form.NONE:
        return [
            "setpriv",
            "--pdeathsig",
            "KILL",
            "env",
            "-i",
            *(f"{k}={v}" for k, v in environment.items()),
            *limited,
        ]
    arguments = [
        "bwrap",
        "--unshare-pid",
        "--unshare-ipc",
        "--unshare-uts",
        "--unshare-cgroup-try",
        "--die-with-parent",
    ]
    arguments += ["--new-session", "--info-fd", str(info_fd), "--hostname", "lab"]
    if isolation.form is Form.USER:
        arguments += ["--unshare-user", "--uid", "1000", "--gid", "1000"]
        arguments += [] if isolation.old_bubblewrap else ["--disable-userns"]
    else:
        arguments += [
            "--cap-drop",
            "ALL",
            "--cap-add",
            "CAP_SETUID",
            "--cap-add",
            "CAP_SETGID",
            "--cap-add",
            "CAP_SETPCAP",
        ]
    arguments += _file_system(isolation, workspace, tools, interpreter)
    arguments += [
        "--clearenv",
        *(word for key, value in environment.items() for word in ("--setenv", key, value)),
    ]
    arguments += ["--chdir", cwd, "--"]
    if isolation.form is Form.ROOT:
        uid = str(student_uid(isolation, slot))
        arguments += ["setpriv", "--reuid", uid, "--regid", uid, "--clear-groups", "--inh-caps=-all"]
        arguments += ["--bounding-set=-all", "--no-new-privs"]
    return [*arguments, *limited]


def _file_system(isolation: Isolation, workspace: Path, tools: Mapping[str, Path], interpreter: Path) -> list[str]:
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
    for name in ("ld.so.cache", "localtime", "alternatives", "timezone"):
        if (Path("/etc") / name).exists():
            bind("--ro-bind", f"/etc/{name}", f"/etc/{name}")
    bind("--bind", str(workspace), WORKSPACE)
    for target, source in tools.items():
        bind("--ro-bind", str(source), target)
    arguments += ["--proc", "/proc", "--dev", "/dev"]
    size = [] if isolation.old_bubblewrap else ["--size", str(_TMPFS_BYTES)]
    for target in ("/dev/shm", "/tmp", HOME):
        parents(target)
        arguments.extend(["--perms", "1777", *size, "--tmpfs", target])
        made.add(target)
    # After these, since a virtual environment may well lie below /tmp.
    for root in interpreter_roots(interpreter):
        if not root.is_relative_to("/usr") and str(root) != "/":
            bind("--ro-bind", str(root), str(root))
    arguments += _hidden_package(interpreter)
    return [*arguments, "--remount-ro", "/"]


def _hidden_package(interpreter: Path) -> list[str]:
    """Cover the grader's own package, oracles and solution included, where it lies among what a student sees."""
    package = INSIDE_FOLDER.parents[1]
    if not any(package.is_relative_to(root) for root in (Path("/usr"), *interpreter_roots(interpreter))):
        return []
    return ["--perms", "0555", "--tmpfs", str(package), "--remount-ro", str(package)]


def probe_isolation(interpreter: Path) -> Isolation:
    """Find the strongest form that works here, by running a program in a real cell."""
    missing = [tool for tool in ("unshare", "setpriv", "prlimit") if shutil.which(tool) is None]
    if missing:
        return Isolation(Form.NONE, remedy=f"Install util-linux ({', '.join(missing)} not found).")
    if shutil.which("bwrap") is None:
        return Isolation(Form.NONE, remedy="Install bubblewrap: sudo apt-get install bubblewrap")
    usage = subprocess.run(["bwrap", "--help"], capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    old = "--size" not in usage.stdout + usage.stderr
    isolation = Isolation(Form.ROOT if os.geteuid() == 0 else Form.USER, old)
    problem = _try(isolation, interpreter)
    return isolation if problem is None else Isolation(Form.NONE, old, remedy=_remedy(problem))


def _try(isolation: Isolation, interpreter: Path) -> str | None:
    """Run the interpreter in a cell with the real arguments; return None or what went wrong."""
    here = INSIDE_FOLDER
    command = student_argv(
        isolation,
        [str(interpreter), "-c", "import os; print('in', os.getpid())"],
        environment={"PATH": "/usr/bin"},
        workspace=here,
        tools={INSIDE: here},
        interpreter=interpreter,
        slot=0,
        info_fd=2,
        cwd="/",
    )
    try:
        run = subprocess.run(
            cell_argv(isolation, command),
            capture_output=True,
            text=True,
            timeout=20,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.TimeoutExpired) as problem:
        return str(problem)
    return (
        None
        if run.returncode == 0 and run.stdout.startswith("in ")
        else (run.stderr.strip() or "no answer from the cell")
    )


def _remedy(problem: str) -> str:
    restricted = Path("/proc/sys/kernel/apparmor_restrict_unprivileged_userns")
    if restricted.exists() and restricted.read_text().strip() == "1" and os.geteuid() != 0:
        return "This system restricts user namespaces (AppArmor): run with sudo, or allow them for bubblewrap."
    if Path("/.dockerenv").exists():
        return "In a container, namespaces need `--privileged`, or run on the host."
    return f"Namespaces cannot be made here: {problem.splitlines()[-1][:200]}"

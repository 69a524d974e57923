"""Runs a command in given surroundings, and reports the things left behind.

A program of its own: `python -I surroundings.py SURROUNDINGS COMMAND...`, where SURROUNDINGS is the `Surroundings` as
JSON. It starts the command as another user or without the means to make namespaces, becomes the parent of whatever
outlives it, and writes a `Remains` as JSON to the file named. Standard library only.
"""

from __future__ import annotations

import ctypes
import fcntl
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO

SET_CHILD_SUBREAPER, SET_SECCOMP, SECCOMP_MODE_FILTER = 36, 22, 2
CLONE_NEWNS, MS_BIND, MS_REC, MS_PRIVATE = 0x20000, 0x1000, 0x4000, 0x40000
#: Longest time between the end of a command and the end of its processes.
ENDS_WITHIN_S = 20.0

#: Capabilities of root in a container of Docker.
CONTAINER_CAPABILITIES = (
    "chown", "dac_override", "fsetid", "fowner", "mknod", "net_raw", "setgid", "setuid", "setfcap", "setpcap",
    "net_bind_service", "sys_chroot", "kill", "audit_write",
)  # fmt: skip
#: Numbers of x86-64: unshare, setns, mount, umount2, pivot_root, and the newer calls for mounts.
MOUNTS_AND_NAMESPACES = (272, 308, 165, 166, 155, 428, 429, 430, 431, 432, 433, 442)
CLONE, CLONE3 = 56, 435
NAMESPACE_FLAGS = 0x7E020080
EPERM, ENOSYS = 1, 38


@dataclass(frozen=True)
class Surroundings:
    """Where a command runs.

    Attributes
    ----------
    told : str
        File for the `Remains`.
    place : str
        Folder that only this command uses.
    user, group : int or None
        Ids to run as; None for the caller's.
    readable : list of str
        Folders that every user must be able to reach, though one above them may be closed to others.
    container : bool
        Deny namespaces, mounts and most capabilities, like a plain container.
    limit_s : float
        Time after which the command counts as hung and is killed.
    """

    told: str
    place: str
    user: int | None = None
    group: int | None = None
    readable: list[str] = field(default_factory=list)
    container: bool = False
    limit_s: float = 600.0


@dataclass
class Remains:
    """End of a command, and new things on the machine after it.

    Attributes
    ----------
    exit_status : int or None
        None if it had to be killed.
    """

    exit_status: int | None = None
    output: str = ""
    errors: str = ""
    processes: list[str] = field(default_factory=list)
    mounts: list[str] = field(default_factory=list)


def run(surroundings: Surroundings, command: list[str]) -> Remains:
    """Run the command to its end, and look for the things it left."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    if os.geteuid() == 0:
        _bring_loopback_up()
    left = Remains()
    # Files and not pipes, which whatever outlives the command would hold open.
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        program = subprocess.Popen(
            [*_as(surroundings), *command],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=errors,
            preexec_fn=lambda: _enter(surroundings),
        )
        try:
            left.exit_status = program.wait(surroundings.limit_s)
        except subprocess.TimeoutExpired:
            program.kill()
            program.wait()
        left.output, left.errors = _text_of(output), _text_of(errors)
    left.processes = _outliving()
    mounts = Path("/proc/self/mountinfo").read_text(encoding="utf-8").splitlines()
    left.mounts = [line for line in mounts if surroundings.place in line]
    return left


def _bring_loopback_up() -> None:
    """Bring the loopback of a new network up; where it is up, this changes nothing."""
    get_flags, set_flags, up = 0x8913, 0x8914, 0x1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        request = struct.pack("16sh14x", b"lo", 0)
        flags = struct.unpack("16sh14x", fcntl.ioctl(sock, get_flags, request))[1]
        fcntl.ioctl(sock, set_flags, struct.pack("16sh14x", b"lo", flags | up))


def _text_of(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode("utf-8", "backslashreplace")


def _as(surroundings: Surroundings) -> list[str]:
    if surroundings.user is not None:
        return [
            "setpriv",
            f"--reuid={surroundings.user}",
            f"--regid={surroundings.group}",
            "--clear-groups",
            "--",
        ]
    if surroundings.container and os.geteuid() == 0:
        allowed = ",".join(f"+{name}" for name in CONTAINER_CAPABILITIES)
        return ["setpriv", f"--bounding-set=-all,{allowed}", "--inh-caps=-all", "--"]
    return []


def _enter(surroundings: Surroundings) -> None:
    """Prepare the child, before it becomes the command."""
    libc = ctypes.CDLL(None, use_errno=True)
    if os.geteuid() == 0:
        closed = _closed_folders(surroundings.readable)
    else:
        closed = {}
    if closed:
        _do(libc.unshare(CLONE_NEWNS))
        _do(libc.mount(b"none", b"/", None, MS_REC | MS_PRIVATE, None))
        for folder, roots in closed.items():
            _open_to_all(libc, folder, roots)
    if surroundings.container:
        if os.geteuid() != 0:
            libc.prctl(38, 1, 0, 0, 0)
        program = _container_filter()
        steps = ctypes.create_string_buffer(program, len(program))
        head = struct.pack("HxxxxxxQ", len(program) // 8, ctypes.addressof(steps))
        _do(libc.prctl(SET_SECCOMP, SECCOMP_MODE_FILTER, ctypes.c_char_p(head), 0, 0))


def _do(answer: int) -> None:
    if answer != 0:
        raise OSError(ctypes.get_errno(), "the surroundings cannot be made")


def _closed_folders(readable: list[str]) -> dict[Path, list[Path]]:
    """Return folders that others may not enter -> paths below that must be reachable."""
    found: dict[Path, list[Path]] = {}
    for root in map(Path, readable):
        for parent in reversed(root.parents):
            if not parent.stat().st_mode & 0o001:
                found.setdefault(parent, []).append(root)
                break
    return found


def _open_to_all(libc: ctypes.CDLL, folder: Path, roots: list[Path]) -> None:
    """Hide all of a folder but a few below it, and let everyone through to those."""
    handles = {root: os.open(root, os.O_PATH | os.O_DIRECTORY) for root in roots}
    _do(libc.mount(b"tmpfs", bytes(folder), b"tmpfs", 0, b"mode=0755"))
    for root, handle in handles.items():
        root.mkdir(parents=True)
        _do(libc.mount(b"/proc/self/fd/%d" % handle, bytes(root), None, MS_BIND | MS_REC, None))
        os.close(handle)


def _container_filter() -> bytes:
    """Return a seccomp program that denies namespaces and mounts."""
    load, equal, any_bit, answer = 0x20, 0x15, 0x45, 0x06
    allow, error = 0x7FFF0000, 0x00050000

    def step(code: int, operand: int, if_true: int = 0, if_false: int = 0) -> bytes:
        return struct.pack("=HBBI", code, if_true, if_false, operand)

    steps = [step(load, 0)]
    for number in MOUNTS_AND_NAMESPACES:
        steps += [step(equal, number, 0, 1), step(answer, error | EPERM)]
    steps += [step(equal, CLONE3, 0, 1), step(answer, error | ENOSYS)]
    steps += [
        step(equal, CLONE, 0, 3),
        step(load, 16),
        step(any_bit, NAMESPACE_FLAGS, 0, 1),
        step(answer, error | EPERM),
    ]
    return b"".join([*steps, step(answer, allow)])


def _outliving() -> list[str]:
    """Return the command lines of processes that outlived the command for long, and end them."""
    end_s = time.monotonic() + ENDS_WITHIN_S
    while _descendants() and time.monotonic() < end_s:
        time.sleep(0.05)
    found = [_command_of(pid) for pid in _descendants()]
    while left := _descendants():
        for pid in left:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.01)
    return found


def _descendants() -> list[int]:
    """Return all processes below this one that run; those that have ended are waited for."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    found, queue = [], [os.getpid()]
    while queue:
        pid = queue.pop()
        with suppress(OSError):
            for task in Path(f"/proc/{pid}/task").iterdir():
                children = [int(word) for word in (task / "children").read_text().split()]
                found += children
                queue += children
    return found


def _command_of(pid: int) -> str:
    try:
        words = (
            Path(f"/proc/{pid}/cmdline")
            .read_bytes()
            .replace(b"\0", b" ")
            .decode("utf-8", "replace")
        )
        owner = Path(f"/proc/{pid}").stat().st_uid
    except OSError:
        return f"{pid}"
    return f"{pid} of user {owner}: {words[:200]}"


def main() -> None:
    """Run the command line."""
    surroundings = Surroundings(**json.loads(sys.argv[1]))
    Path(surroundings.told).write_text(
        json.dumps(asdict(run(surroundings, sys.argv[2:]))), encoding="utf-8"
    )


if __name__ == "__main__":
    main()

"""Makes a process the first of a new sandbox: network, mounts, IPC, host name and process ids of its own.

It has the effect of `unshare --net --mount --ipc --uts --pid --fork --kill-child --mount-proc` without starting a
program: a fork goes on in the same image.

References
----------
unshare(2), pid_namespaces(7), user_namespaces(7), proc(5).
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import select
import signal
import socket
import struct
import threading
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from enum import StrEnum
from pathlib import Path
from typing import Any, NoReturn

_NEW_MOUNTS, _NEW_UTS, _NEW_IPC, _NEW_USER, _NEW_PIDS, _NEW_NET = (
    0x00020000, 0x04000000, 0x08000000, 0x10000000, 0x20000000, 0x40000000,
)  # fmt: skip
#: Namespaces of a sandbox, besides the one of process ids.
_OF_SANDBOX = _NEW_NET | _NEW_MOUNTS | _NEW_IPC | _NEW_UTS
_NOSUID, _NODEV, _NOEXEC, _RECURSIVE, _PRIVATE = 0x2, 0x4, 0x8, 0x4000, 0x40000
_SET_PDEATHSIG, _SET_NAME, _SET_CHILD_SUBREAPER = 1, 15, 36
_STANDARD_DESCRIPTORS = 3
#: Newest process id of the reader's namespace; the writer sets it.
_LAST_ID = Path("/proc/sys/kernel/ns_last_pid")
_LIBC = ctypes.CDLL(None, use_errno=True)
#: Looked up now: a fork of a process with threads would wait for ever, if one of these held the loader's lock then.
_CALLS: dict[str, Callable[..., int]] = {
    name: getattr(_LIBC, name)
    for name in ("mount", "prctl", "setns", "syscall", "unshare")
    if hasattr(_LIBC, name)
}


class Form(StrEnum):
    """The way to namespaces on this machine: as root, in a user namespace, or none."""

    ROOT = "root"
    USER = "user"
    NONE = "none"


def enter_own_mounts(form: Form) -> None:
    """Have this process, which may have one thread only, see a file system of its own, with an empty `/dev/shm`.

    Libraries may leave files there when they are loaded. Without namespaces nothing changes. It raises `OSError` if the
    system does not permit it.
    """
    if form is not Form.NONE:
        _unshare(_NEW_MOUNTS)
        call("mount", b"none", b"/dev/shm", b"tmpfs", _NOSUID | _NODEV, b"size=1m")


def enter_sandbox(form: Form) -> None:
    """Become the first process of a new sandbox; without namespaces, stay in the present ones.

    The calling process, which may have one thread only, is left outside: it waits for the process that goes on, ends
    with its status, and all of the sandbox ends with it. It raises `OSError` if the system permits no such namespaces.
    """
    if form is Form.NONE:
        end_with_parent()
        return
    _unshare(_OF_SANDBOX | _NEW_PIDS)
    descriptors = open_descriptors(_STANDARD_DESCRIPTORS)
    there, held = os.pipe()
    first = os.fork()
    if first:
        _wait_for(first, [*descriptors, there])
    os.close(held)
    end_with_parent()
    # A parent that ended before that call kills nothing. Its process id tells nothing here, but its pipe is closed.
    if select.select([there], [], [], 0)[0]:
        os._exit(1)
    os.close(there)
    _mount_proc()


def fork_first() -> int:
    """Fork this process into a new namespace of process ids, and return as `os.fork` does.

    The fork is the first process there, and ends with the calling thread; `enter_rest_of_sandbox` completes its sandbox.
    Unlike `enter_sandbox`, this forks a large process only once. Raises `OSError` if the system does not permit it: an
    ordinary user cannot come back from a new namespace.
    """
    with ExitStack() as opened:
        parent = os.pidfd_open(os.getpid())
        opened.callback(os.close, parent)
        present = os.open("/proc/self/ns/pid", os.O_RDONLY | os.O_CLOEXEC)
        opened.callback(os.close, present)
        call("setns", present, _NEW_PIDS)  # The way back, which the system may refuse.
        call("unshare", _NEW_PIDS)
        forked = -1
        try:
            forked = os.fork()
        finally:
            if forked != 0:
                _return_to(present)
        if forked == 0:
            end_with_parent()
            # A parent that ended before that call kills nothing.
            if select.select([parent], [], [], 0)[0]:
                os._exit(1)
    return forked


def _return_to(namespace: int) -> None:
    """Let later forks of this process be in a namespace of process ids, or end."""
    try:
        call("setns", namespace, _NEW_PIDS)
    except OSError:  # Later forks would be in a sandbox of others.
        os._exit(1)


def enter_rest_of_sandbox() -> None:
    """Have the fork of `fork_first` leave all other namespaces too."""
    _unshare(_OF_SANDBOX)
    _mount_proc()


def _mount_proc() -> None:
    """Show the processes of this namespace in `/proc`."""
    call("mount", b"proc", b"/proc", b"proc", _NOSUID | _NODEV | _NOEXEC, None)


def enter_own_network() -> None:
    """Leave this process's network for a new one; within a sandbox that takes no privilege."""
    call("unshare", _NEW_NET)


def _unshare(spaces: int) -> None:
    """Leave the namespaces of some kinds for new ones, mounts among them; an ordinary user takes a user namespace too."""
    user = os.geteuid()
    group = os.getegid()
    parent = os.getppid()
    if user == 0:
        call("unshare", spaces)
    else:
        call("unshare", spaces | _NEW_USER)
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1")
    end_with_parent()  # Only now: a change of privileges takes this back.
    if os.getppid() != parent:
        os._exit(1)
    call("mount", b"none", b"/", None, _RECURSIVE | _PRIVATE, None)


def end_with_parent() -> None:
    """Have this process killed at the end of the thread that has started it."""
    call("prctl", _SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)


def name_process(name: str) -> None:
    """Give this process another name in the system's list of processes."""
    call("prctl", _SET_NAME, name.encode()[:15], 0, 0, 0)


def adopt_orphans() -> None:
    """Become the parent of orphaned descendants, so that these can be found."""
    call("prctl", _SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def mount_tmpfs(target: str, size_bytes: int, files: int) -> None:
    """Mount an empty file system of a size of its own."""
    call(
        "mount",
        b"tmpfs",
        target.encode(),
        b"tmpfs",
        0,
        f"size={size_bytes},nr_inodes={files},mode=0755".encode(),
    )


def bring_loopback_up() -> None:
    """Let a new network reach itself."""
    get_flags, set_flags, up = 0x8913, 0x8914, 0x1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        request = struct.pack("16sh14x", b"lo", 0)
        flags = struct.unpack("16sh14x", fcntl.ioctl(sock, get_flags, request))[1]
        fcntl.ioctl(sock, set_flags, struct.pack("16sh14x", b"lo", flags | up))


def use_up_process_ids(number: int) -> None:
    """Use up the lowest process ids of this sandbox, so that its later processes have other ids than confined ones.

    Ids of a confined program count anew, in a namespace of its own, and libraries make identities from process ids.

    References
    ----------
    `ns_last_pid` in pid_namespaces(7); kernels without it get threads, which end at once.
    """
    try:
        last = int(_LAST_ID.read_text(encoding="ascii"))
        _LAST_ID.write_text(str(last + number), encoding="ascii")
    except OSError:
        _use_up_by_threads(number)


def _use_up_by_threads(number: int) -> None:
    for _ in range(number):
        thread = threading.Thread(
            target=int
        )  # Its id is of the same kind, and it is cheaper than a fork.
        thread.start()
        thread.join()


def open_descriptors(least: int) -> list[int]:
    """Return this process's open files from a number on.

    Closing all possible descriptors instead takes some 50 ms in a Python built for older systems: there may be a million.
    """
    numbers = map(int, os.listdir("/proc/self/fd"))  # noqa: PTH208
    return [number for number in numbers if number >= least]


def close_descriptors(descriptors: Iterable[int]) -> None:
    """Close files, except those that are closed already."""
    for descriptor in descriptors:
        with suppress(OSError):
            os.close(descriptor)


def _wait_for(pid: int, descriptors: Iterable[int]) -> NoReturn:
    """Wait for a process, and end as it did."""
    status = 1
    try:
        # A reader of the other process's pipes must not wait for this one too.
        close_descriptors(descriptors)
        _, ended = os.waitpid(pid, 0)
        status = os.waitstatus_to_exitcode(ended)
        if status < 0:
            status = 128 - status
    finally:
        os._exit(status)


def call(function: str, *arguments: Any) -> int:
    """Call a function of the C library that Python does not offer; raises `OSError` if its answer is negative."""
    words = []
    for argument in arguments:
        if isinstance(argument, int):
            words.append(ctypes.c_ulong(argument))
        else:
            words.append(argument)
    answer = _CALLS[function](*words)
    if answer < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{function}: {os.strerror(number)}")
    return answer

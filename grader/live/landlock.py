"""What a process may open and signal, restricted by Landlock, which needs no privilege (Linux 5.13 and newer).

References
----------
The kernel's `Documentation/userspace-api/landlock.rst`; structures and numbers from `linux/landlock.h`.
"""

from __future__ import annotations

import ctypes
import os
import stat
import struct
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION_FLAG = 1
_LIBC = ctypes.CDLL(None, use_errno=True)
_PATH_BENEATH = 1

_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
_REFER, _TRUNCATE, _IOCTL_DEV = 1 << 13, 1 << 14, 1 << 15
_ALL_OF_VERSION_1 = (1 << 13) - 1
_OF_FILES = _EXECUTE | _WRITE_FILE | _READ_FILE | _TRUNCATE | _IOCTL_DEV
_READ = _EXECUTE | _READ_FILE | _READ_DIR
_ABSTRACT_SOCKETS_AND_SIGNALS = 0b11


def landlock_version() -> int:
    """Return the version of Landlock's interface, 0 where the kernel has none."""
    found = _LIBC.syscall(_CREATE_RULESET, None, 0, _VERSION_FLAG)
    return max(0, int(found))


def confines_signals(version: int) -> bool:
    """Whether this version keeps a process from sending signals to those outside."""
    return version >= 6


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
    if confines_signals(version):
        # Between the two stands what is restricted of TCP, which the system call filter does without gaps.
        attributes += struct.pack("=QQ", 0, _ABSTRACT_SOCKETS_AND_SIGNALS)
    ruleset = _call(_CREATE_RULESET, attributes, len(attributes), 0)
    for path in read:
        _allow(ruleset, path, _READ & handled)
    for path in write:
        _allow(ruleset, path, handled)
    _call(_RESTRICT_SELF, ruleset, 0)
    os.close(ruleset)


def _allow(ruleset: int, path: Path, access: int) -> None:
    with suppress(FileNotFoundError):
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
        try:
            if not stat.S_ISDIR(os.fstat(opened).st_mode):
                access &= _OF_FILES
            _call(_ADD_RULE, ruleset, _PATH_BENEATH, struct.pack("=Qi", access, opened), 0)
        finally:
            os.close(opened)


def _call(number: int, *arguments: object) -> int:
    answer = int(_LIBC.syscall(number, *arguments))
    if answer < 0:
        raise OSError(ctypes.get_errno(), "Landlock refused")
    return answer

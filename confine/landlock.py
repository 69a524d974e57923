"""Restricts a process to some files and folders by Landlock.

References
----------
The kernel's `Documentation/userspace-api/landlock.rst` (Linux 5.13 and newer); numbers from `linux/landlock.h`.
"""

from __future__ import annotations

import os
import stat
import struct
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from confine.namespaces import call

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION_FLAG = _PATH_BENEATH = 1
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
_REFER, _TRUNCATE, _IOCTL_DEV = 1 << 13, 1 << 14, 1 << 15
_ALL_OF_VERSION_1 = (1 << 13) - 1
#: Version of the interface -> the right that it added.
_ADDED_RIGHTS = {2: _REFER, 3: _TRUNCATE, 5: _IOCTL_DEV}
_OF_FILES = _EXECUTE | _WRITE_FILE | _READ_FILE | _TRUNCATE | _IOCTL_DEV
_READ = _EXECUTE | _READ_FILE | _READ_DIR
_ABSTRACT_SOCKETS_AND_SIGNALS = 0b11
_CONFINES_SIGNALS_SINCE = 6


def landlock_version() -> int:
    """Return the version of Landlock's interface, 0 if the kernel has none."""
    with suppress(OSError):
        return call("syscall", _CREATE_RULESET, None, 0, _VERSION_FLAG)
    return 0


def confines_signals() -> bool:
    """Return whether this kernel's Landlock keeps a process from sending signals to those outside."""
    return landlock_version() >= _CONFINES_SIGNALS_SINCE


def restrict(read: Iterable[Path], write: Iterable[Path]) -> None:
    """Let this process and all that come from it open nothing but the given files and folders.

    From version 6 on they also can neither signal processes outside nor connect to their abstract sockets. The process
    must have set `no_new_privs`. It raises `OSError` if the kernel refuses.
    """
    version = landlock_version()
    handled = _ALL_OF_VERSION_1
    for since, right in _ADDED_RIGHTS.items():
        if version >= since:
            handled |= right
    attributes = struct.pack("=Q", handled)
    if version >= _CONFINES_SIGNALS_SINCE:
        # The zero restricts nothing of TCP: the system call filter denies all of it.
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
            rule = struct.pack("=Qi", access, opened)
            call("syscall", _ADD_RULE, ruleset, _PATH_BENEATH, rule, 0)
        finally:
            os.close(opened)

"""Sets the kernel's limits on processes as far as the hard limits permit, and names limits that are too low.

A process may lower its hard limits, and only a privileged one may raise them: sudo, systemd and Docker start their
commands below limits that no sandbox can exceed. A limit has the name of its `resource.RLIMIT_*` in lower case, such
as "nofile".

References
----------
getrlimit(2); `rlimit_core`, 0 by default, in sudoers(5); "Process Properties" in systemd.exec(5).
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

with suppress(ImportError):  # Windows, where nothing can be confined, has no such module.
    import resource

_MIB = 1024**2


# -- attainable limits -------------------------------------------------------------------------------


def attainable(name: str, wanted: int, pid: int = 0) -> int:
    """Return the highest attainable value up to `wanted` for a limit of a process; of this process for 0."""
    hard = resource.prlimit(pid, _number_of(name))[1]
    if _is_lower(hard, wanted):
        return hard
    return wanted


def attainable_limits(wanted: Mapping[str, int]) -> dict[str, int]:
    """Return the highest attainable values up to the wanted ones for limits of this process's children."""
    return {name: attainable(name, value) for name, value in wanted.items()}


def set_limit(name: str, soft: int, hard: int | None = None, pid: int = 0) -> None:
    """Limit a process, this one for 0; without `hard` the limit cannot be raised again.

    Neither value exceeds the present hard limit.
    """
    if hard is None:
        hard = soft
    values = attainable(name, soft, pid), attainable(name, hard, pid)
    resource.prlimit(pid, _number_of(name), values)


def set_soft_limit(name: str, soft: int) -> None:
    """Lower or raise a soft limit of this process, which it can undo."""
    hard = resource.getrlimit(_number_of(name))[1]
    resource.setrlimit(_number_of(name), (attainable(name, soft), hard))


def lift(name: str) -> None:
    """Raise a limit of this process as far as its hard limit permits."""
    hard = resource.getrlimit(_number_of(name))[1]
    resource.setrlimit(_number_of(name), (hard, hard))


def _is_lower(limit: int, value: int) -> bool:
    """Return whether a limit is lower than a value; the largest has the number -1."""
    if limit == resource.RLIM_INFINITY:
        return False
    return limit < value


def _number_of(name: str) -> int:
    number: int = getattr(resource, f"RLIMIT_{name.upper()}")
    return number


# -- limits that are too low ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Need:
    """A limit on which confined programs depend.

    Below `least` they fail. `usual` is the value that they get on other machines, and the highest that is made use of.
    An error message has one of the `signs` if the limit was exceeded, for example "Too many open files".
    """

    name: str
    words: str
    least: int
    usual: int
    unit: str = ""
    signs: tuple[str, ...] = ()

    def amount(self, value: int) -> str:
        """Return a value of this limit with its unit."""
        if self.unit != "MiB":
            return f"{value} {self.unit}".rstrip()
        if value < _MIB / 10:
            return f"{value} bytes"
        return f"{value / _MIB:.4g} MiB"


_NO_MEMORY = (os.strerror(errno.ENOMEM), "MemoryError", "failed to map segment from shared object")
_NO_PROCESS = (os.strerror(errno.EAGAIN), "can't start new thread")
#: Measured with a few Python programs of a dozen threads each, in one sandbox at a time: these worked under all of the
#: least values at once, and failed at half of those for open files, processes and file size.
NEEDS = (
    Need("nofile", "open files", 64, 1024, "", (os.strerror(errno.EMFILE),)),
    Need("nproc", "processes and threads of a user", 64, 256, "", _NO_PROCESS),
    Need("as", "address space of a process", 768 * _MIB, 4096 * _MIB, "MiB", _NO_MEMORY),
    Need("data", "data segment of a process", 768 * _MIB, 4096 * _MIB, "MiB", _NO_MEMORY),
    Need("fsize", "file size", 16 * _MIB, 64 * _MIB, "MiB", (os.strerror(errno.EFBIG),)),
    Need("stack", "stack of a process", _MIB, 8 * _MIB, "MiB"),
    Need("cpu", "CPU time of a process", 600, 3600, "s"),
)
#: Multiple of the usual value from which a limit is not taken for the cause of an error.
_FAR_ABOVE = 16


@dataclass(frozen=True)
class Shortage:
    """A limit that is too low; confined programs do not get the part that is `in_use`."""

    need: Need
    value: int
    in_use: int = 0

    @property
    def is_fatal(self) -> bool:
        """True if programs fail under it."""
        return self.value < self.need.least + self.in_use

    @property
    def present(self) -> str:
        """The limit and its value, in words."""
        need = self.need
        words = f"the limit on {need.words} ({need.name}) is {need.amount(self.value)}"
        if self.in_use:
            words += f", and {self.in_use} of them are in use"
        return words

    def __str__(self) -> str:
        """Return the present value of the limit, and the one that it should have."""
        if self.is_fatal:
            least = self.need.amount(self.need.least + self.in_use)
            return f"{self.present}; at least {least} are required"
        usual = self.need.amount(self.need.usual)
        return f"{self.present}; programs get {usual} on other machines"

    @property
    def remedy(self) -> str:
        """Places where such a limit is set, and can be raised."""
        name = self.need.name
        places = [
            f"`{name}` in /etc/security/limits.conf",
            f"Limit{name.upper()}= of a systemd unit",
        ]
        if name != "as":  # Docker has no option for it.
            places.append(f"`--ulimit {name}=` of a container")
        named = ", ".join(places)
        return (
            f"Raise the hard limit '{name}' where this is started: {named}, or `ulimit` in a shell."
        )


def shortages(in_use: Mapping[str, int]) -> list[Shortage]:
    """Return the hard limits of this process that are lower than usual.

    `in_use` is the part of a limit that others take, for limits that count more than one process.
    """
    found = []
    for need in NEEDS:
        used = in_use.get(need.name, 0)
        value = resource.getrlimit(_number_of(need.name))[1]
        if _is_lower(value, need.usual + used):
            found.append(Shortage(need, value, used))
    return found


def raise_soft_limits() -> None:
    """Raise limits of this process to the usual ones, as far as its hard limits permit.

    Soft limits on memory stay: the caller may have set them for work of its own.
    """
    for need in NEEDS:
        if need.signs == _NO_MEMORY:
            continue
        soft = resource.getrlimit(_number_of(need.name))[0]
        if _is_lower(soft, attainable(need.name, need.usual)):
            set_soft_limit(need.name, need.usual)


def limit_behind(problem: str) -> Shortage | None:
    """Return the limit of this process behind an error message such as "Too many open files"; None if there is none."""
    if sys.platform != "linux":
        return None
    for need in NEEDS:
        value = resource.getrlimit(_number_of(need.name))[0]
        if not _is_lower(value, need.usual * _FAR_ABOVE):
            continue
        if any(sign in problem for sign in need.signs):
            return Shortage(need, value)
    return None

"""The levels of confinement, and the numbers, user ids and control groups of a machine's sandboxes.

A *sandbox* is a set of namespaces (network with only loopback up, mounts, IPC, processes); inside it bubblewrap
confines each program further. Started as root, each sandbox has a user id of its own; an ordinary user has it in a user
namespace. Without namespaces, Landlock and the system call filter remain. `confine.probing` finds the best that works.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from confine.cgroup import CgroupParents, SandboxCgroup
from confine.landlock import confines_signals
from confine.namespaces import Form

#: Unassigned user ids: a range with a part for each network, and one for containers with few ids.
#: References: systemd's "Users, Groups, UIDs and GIDs on systemd Systems"; user_namespaces(7).
CONFINED_UIDS = (range(1_879_048_192, 2_147_352_576), range(64_100, 64_228))
_UIDS_OF_NETWORK = 128
#: Highest number of a sandbox, which is less than a network has user ids.
_LAST_SLOT = 101


class ConfinementError(Exception):
    """The required confinement is not available here; `remedy` names the fix."""

    def __init__(self, problem: str, remedy: str) -> None:
        super().__init__(problem)
        self.remedy = remedy


class Level(StrEnum):
    """A level of confinement, from the best to none; `at_least` compares."""

    FULL = "full"
    NO_CGROUP = "no cgroup"
    REDUCED = "reduced"
    NONE = "none"

    def at_least(self, other: Level) -> bool:
        """Return whether this level is `other` or a better one."""
        order = list(Level)
        return order.index(self) <= order.index(other)

    @classmethod
    def of(cls, word: str) -> Level:
        """Return the level named by an argument of the command line, such as "no-cgroup"."""
        return cls(word.replace("-", " "))


_NAMESPACES = (
    "own network with loopback only",
    "own process ids",
    "sized private /tmp, /dev/shm and home",
)
_FILES = "no file may be changed but its own, and none read that is not needed"
_FILTER = "no privileges, and a system call filter"
_LIMITS = "limits on memory, processes, disk, files, output and time"
_ALL_TOGETHER = "a limit that the kernel keeps on the memory and processes of a sandbox as a whole"
_OWN_UID = "a user id of its own: confined code runs as root, without its privileges"


@dataclass(frozen=True)
class Isolation:
    """The confinement of a machine's sandboxes.

    An `old_bubblewrap` has no `--disable-userns`. `groups` are the parents of control groups at the level full.
    `first_uid` is the user id of sandbox number 0, if each sandbox has one of its own. `remedy` names the way to a
    better level.
    """

    level: Level
    form: Form = Form.NONE
    old_bubblewrap: bool = False
    groups: CgroupParents | None = None
    first_uid: int | None = None
    remedy: str = ""

    @property
    def own_uid(self) -> bool:
        """True if each sandbox has a user id of its own."""
        return self.first_uid is not None

    @property
    def namespaces(self) -> bool:
        """True if sandboxes are namespaces of their own."""
        return self.form is not Form.NONE

    def require(self, least: Level) -> None:
        """Raise `ConfinementError` unless the level is `least` or better."""
        if not self.level.at_least(least):
            raise ConfinementError(
                f"code can be confined here at the level '{self.level.value}' only, "
                f"and '{least.value}' is required",
                self.remedy,
            )

    def describe(self) -> dict[str, Any]:
        """Return the level, the form, the remedy, and lists of covered and uncovered threats."""
        covers, lacks = self._coverage()
        return {
            "level": self.level.value,
            "form": self.form.value,
            "remedy": self.remedy,
            "covers": covers,
            "lacks": lacks,
        }

    def _coverage(self) -> tuple[list[str], list[str]]:
        if self.namespaces:
            covers = [*_NAMESPACES, _FILES, _FILTER, _LIMITS]
            if self.level is Level.FULL:
                return [*covers, _ALL_TOGETHER], []
            return covers, [_ALL_TOGETHER]
        if self.level is Level.NONE:
            return ["limits on output and time"], [*_NAMESPACES, _FILES, _FILTER, _LIMITS]
        covers = [_FILES, _FILTER, _LIMITS, "no connections by TCP"]
        lacks = [*_NAMESPACES, _ALL_TOGETHER, "UDP to other machines is not blocked"]
        if not self.own_uid:
            if os.geteuid() == 0:
                lacks.append(_OWN_UID)
            if not confines_signals():
                lacks.append("signals to processes outside")
        return covers, lacks


def confined_uid(isolation: Isolation, slot: int) -> int | None:
    """Return the user id of a sandbox's programs; None if these run as the caller."""
    if isolation.first_uid is None:
        return None
    return isolation.first_uid + slot


def sandbox_cgroup(isolation: Isolation, slot: int) -> SandboxCgroup | None:
    """Return the control group of a sandbox, where groups can be made."""
    if isolation.groups is None:
        return None
    number = confined_uid(isolation, slot) or slot
    return SandboxCgroup(isolation.groups, f"sandbox-{number}")


@contextmanager
def free_slot() -> Iterator[int]:
    """Yield a number from 1 to 101 that no other sandbox in this network has at the time.

    The user id and the control group of a sandbox are made of its number. The holder of the socket of that name holds
    the number, and nothing is left behind.
    """
    for number in range(1, _LAST_SLOT + 1):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as held:
            try:
                held.bind(f"\0confine-sandbox-{number}")
            except OSError:
                continue
            yield number
            return
    raise RuntimeError(f"there are {_LAST_SLOT} sandboxes on this machine already")


def first_confined_uid() -> int:
    """Return the lowest user id of sandboxes in this network.

    Two containers number their sandboxes alike; if both have the users of the machine, equal ids would be one user to
    the kernel. Each network therefore has its own ids, by the number of its namespace. A container with users of its
    own has only few ids, and nobody outside has them.
    """
    many, few = CONFINED_UIDS
    namespace = Path("/proc/self/ns/net").stat().st_ino
    networks = len(many) // _UIDS_OF_NETWORK
    first = many[namespace % networks * _UIDS_OF_NETWORK]
    if _is_mapped(first, first + _UIDS_OF_NETWORK - 1):
        return first
    return few[0]


def _is_mapped(first: int, last: int) -> bool:
    """Return whether this user namespace has all user ids of a range."""
    for line in Path("/proc/self/uid_map").read_text(encoding="ascii").splitlines():
        start, _, count = map(int, line.split())
        if start <= first and last < start + count:
            return True
    return False

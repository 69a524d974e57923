"""Attaches a filter to the UDP sockets of trusted processes, which share a network with confined ones.

A confined program can write to every UDP socket of its sandbox. The sockets of trusted processes are marked, so that a
filter can tell their packets from others (`MARK`); its program is the caller's.

References
----------
socket(7): SO_MARK, SO_ATTACH_FILTER; pidfd_getfd(2).
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import suppress

from confine.namespaces import call
from confine.seccomp import FilterProgram

_SO_ATTACH_FILTER, _SO_MARK, _PIDFD_GETFD = 26, 36, 438
#: Mark of packets from trusted sockets.
MARK = 0x67726164

#: A process id, and the name of a descriptor's target, such as `socket:[4026]`.
_Key = tuple[int, str]


class PacketFilter:
    """The filter of one sandbox's trusted sockets.

    `program` gives the filter (classic BPF, as `struct sock_filter`) that protects some names, which only packets with
    the mark may bear. Attaching it takes a third of a millisecond for each socket, and begins with `arm`.
    """

    def __init__(self, program: Callable[[Collection[bytes]], bytes]) -> None:
        self._program = program
        self._names: set[bytes] = set()
        self._sockets: dict[_Key, socket.socket] = {}
        #: All sockets seen so far, of other kinds too.
        self._known: set[_Key] = set()
        self._marks = True
        self._is_armed = False

    def arm(self) -> None:
        """Filter packets to the sockets of all protected processes from now on; to be called before confined programs."""
        if not self._is_armed:
            self._is_armed = True
            self._filter(self._sockets.values())

    def protect(self, pid: int, name: str = "") -> None:
        """Filter packets to a process's UDP sockets, and protect its name, in hexadecimal digits.

        Where sockets cannot be marked, no name is protected. Before `arm`, the sockets are only marked.
        """
        new = dict(_udp_sockets(pid, self._known))
        for found in new.values():
            self._marks = self._marks and _set(found, _SO_MARK, MARK)
        self._sockets |= new
        unfiltered = new
        if name and self._marks and bytes.fromhex(name) not in self._names:
            self._names.add(bytes.fromhex(name))
            unfiltered = self._sockets
        if unfiltered and self._is_armed:
            self._filter(unfiltered.values())

    def _filter(self, sockets: Iterable[socket.socket]) -> None:
        steps = self._program(self._names)  # The kernel reads it by a pointer in the next line.
        program = bytes(FilterProgram.of(steps))
        for found in sockets:
            _set(found, _SO_ATTACH_FILTER, program)


def _udp_sockets(pid: int, known: set[_Key]) -> Iterator[tuple[_Key, socket.socket]]:
    """Yield the new UDP sockets of a process, as copies of its descriptors, and add all of its sockets to `known`."""
    folder = f"/proc/{pid}/fd"
    with suppress(OSError):
        handle = os.pidfd_open(pid)
        try:
            for name in os.listdir(folder):  # noqa: PTH208 - twice a second; as paths it would take several times as long
                try:
                    key = (pid, os.readlink(f"{folder}/{name}"))  # noqa: PTH115
                    if key in known or not key[1].startswith("socket:"):
                        continue
                    descriptor = call("syscall", _PIDFD_GETFD, handle, int(name), 0)
                    found = socket.socket(fileno=descriptor)
                except OSError:
                    continue
                known.add(key)
                if (found.family, found.type) == (socket.AF_INET, socket.SOCK_DGRAM):
                    yield key, found
                else:
                    found.close()
        finally:
            os.close(handle)


def _set(found: socket.socket, option: int, value: int | bytes) -> bool:
    """Set an option of a socket; False if the system does not permit it, as in a plain container."""
    try:
        found.setsockopt(socket.SOL_SOCKET, option, value)
    except OSError:
        return False
    return True

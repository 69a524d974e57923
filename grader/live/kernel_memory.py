"""Memory that the kernel holds for processes and that belongs to none of them, so that no sum over them shows it."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

#: Below this all sockets of the machine together are not worth a closer look, in pages.
_NOTABLE_PAGES = 16 * 1024
_TABLES = ("udp", "udp6", "tcp", "tcp6")


def network_bytes(user: int | None = None) -> int:
    """Return what lies in the sockets of this process's network, in bytes.

    All networks of a machine share the memory for it: what one keeps, others lack. No control group of version 1
    counts it.

    Parameters
    ----------
    user : int or None
        Count the sockets of this user alone.
    """
    with suppress(OSError):
        pages = re.findall(r"^(?:UDP|TCP): .*\bmem (\d+)", Path("/proc/net/sockstat").read_text(), re.MULTILINE)
        if sum(map(int, pages)) < _NOTABLE_PAGES:
            return 0
    return sum(_queued(Path("/proc/net") / name, user) for name in _TABLES)


def _queued(table: Path, user: int | None) -> int:
    total = 0
    with suppress(OSError, ValueError, IndexError), table.open(encoding="ascii", errors="replace") as lines:
        next(lines, None)
        for line in lines:
            words = line.split()
            if user is None or int(words[7]) == user:
                sent, _, received = words[4].partition(":")
                total += int(sent, 16) + int(received, 16)
    return total


def available_share() -> float:
    """Return the share of the machine's memory that can still be had, 1 where that is not known."""
    with suppress(OSError, ValueError, ZeroDivisionError):
        text = Path("/proc/meminfo").read_text()
        told = {name: int(amount) for name, amount in re.findall(r"^(\w+): +(\d+) kB", text, re.MULTILINE)}
        return told.get("MemAvailable", told["MemTotal"]) / told["MemTotal"]
    return 1.0

"""Temporary folders whose names hold their owner, so that stale ones of a killed grader are found and removed."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

from confine.helpers import run_helper

_NAME = re.compile(r"confine-(\d+)-(\d+)-(\d+)-.+")


def scratch_prefix() -> str:
    """Return how the names of this process's temporary folders begin."""
    return f"confine-{_namespace()}-{os.getpid()}-{_start_ticks(os.getpid())}-"


def remove_stale() -> list[str]:
    """Remove the temporary folders of this user's gradings that have ended; returns their names.

    A process is known by its number, its start and the namespace in which both hold. What belongs to another namespace,
    such as a container that shares the folder, cannot be judged from here, and stays.
    """
    removed: list[str] = []
    if not Path("/proc/self/ns/pid").exists():
        return removed
    for path in sorted(Path(tempfile.gettempdir()).glob("confine-*")):
        with suppress(OSError):
            if _is_stale(path):
                remove_tree(path)
                removed.append(path.name)
    return removed


def remove_tree(folder: Path) -> None:
    """Remove a folder as far as that is permitted, whatever is in it.

    Students' processes may have nested them deeper than Python's functions follow, and closed them to their owner.
    """
    with suppress(RecursionError):
        shutil.rmtree(folder, ignore_errors=True)
    if folder.is_dir() and not folder.is_symlink():
        for command in (["chmod", "-R", "u+rwX"], ["rm", "-rf"]):
            run_helper([*command, "--", str(folder.absolute())])


def _is_stale(path: Path) -> bool:
    named = _NAME.fullmatch(path.name)
    if (
        named is None
        or path.is_symlink()
        or path.lstat().st_uid != os.getuid()
        or int(named[1]) != _namespace()
    ):
        return False
    return _start_ticks(int(named[2])) != int(named[3])


def _namespace() -> int:
    return Path("/proc/self/ns/pid").stat().st_ino


def _start_ticks(pid: int) -> int | None:
    """Return when a process was started, in clock ticks since boot; None if there is no such process."""
    try:
        status = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    return int(status.rsplit(")", 1)[1].split()[19])

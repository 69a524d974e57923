"""Temporary folders with their owner in the name, so that stale ones of a killed process are found and removed."""

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
    """Return the beginning of the names of this process's temporary folders, such as "confine-4026531836-712-98113-"."""
    return f"confine-{_namespace()}-{os.getpid()}-{_start_ticks(os.getpid())}-"


def remove_stale() -> list[str]:
    """Remove the temporary folders of this user's processes that have ended; returns the folders' names.

    A process is known by its number, its start and its namespace of processes. Folders of another namespace, such as a
    container that shares this folder, stay, because their processes cannot be seen from here.
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
    """Remove a folder and everything in it, as far as that is permitted.

    Confined programs may have nested folders deeper than Python's functions follow, and closed them to their owner.
    """
    with suppress(RecursionError):
        shutil.rmtree(folder, ignore_errors=True)
    if folder.is_dir() and not folder.is_symlink():
        for command in (["chmod", "-R", "u+rwX"], ["rm", "-rf"]):
            run_helper([*command, "--", str(folder.absolute())])


def _is_stale(path: Path) -> bool:
    named = _NAME.fullmatch(path.name)
    if named is None or path.is_symlink():
        return False
    if path.lstat().st_uid != os.getuid():
        return False
    namespace, pid, start_ticks = map(int, named.groups())
    if namespace != _namespace():
        return False
    return _start_ticks(pid) != start_ticks


def _namespace() -> int:
    return Path("/proc/self/ns/pid").stat().st_ino


def _start_ticks(pid: int) -> int | None:
    """Return the start of a process, in clock ticks since boot; None if there is no such process."""
    try:
        status = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    return int(status.rsplit(")", 1)[1].split()[19])

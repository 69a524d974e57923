"""Keeps slowly computed values, such as compiled patterns, in the user's cache.

Only the grader's own processes write it, and no sandbox sees it. Its values are trusted like the hashes of known files of
labs (see `grader.lab.kept_lab`): a program with access to one of them has access to both.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TypeVar, cast

from grader.files import replace_file

T = TypeVar("T")

#: Values of a kind; beyond, the oldest half is removed.
_MOST = 2000
_PACKAGES = Path(__file__).parents[1]


def computed(kind: str, key: object, compute: Callable[[], T]) -> T:
    """Return a computed value, from the cache if it is there; it must be the same for each equal key.

    Parameters
    ----------
    kind
        Name of the folder, such as `patterns`.
    key
        Everything that decides about the value, distinguished by `repr`, besides the version of Python.
    """
    kept = recalled(kind, key)
    if kept is not None:
        return cast(T, kept)
    value = compute()
    keep(kind, key, value)
    return value


def recalled(kind: str, key: object) -> object | None:
    """Return a value of the cache; None if it is missing, another user's, or unreadable."""
    try:
        with _path(kind, key).open("rb") as file:
            if os.fstat(file.fileno()).st_uid != os.geteuid():
                return None
            return cast(object, pickle.load(file))
    # Each class has exceptions of its own for a value of another version.
    except Exception:
        return None


def keep(kind: str, key: object, value: object) -> None:
    """Put a value into the cache, if the cache can be written.

    A value of a class that no module names, such as one made by a function, cannot be kept.
    """
    path = _path(kind, key)
    # Which of the last three is raised depends on the value.
    with suppress(OSError, pickle.PicklingError, AttributeError, TypeError):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, pickle.dumps(value, pickle.HIGHEST_PROTOCOL))
        _shorten(path.parent)


def _path(kind: str, key: object) -> Path:
    """Return the file of a value, such as `~/.cache/grade/patterns/0123abcd`."""
    caches = os.environ.get("XDG_CACHE_HOME")
    if not caches:
        caches = os.environ.get("HOME", "/nowhere") + "/.cache"
    stated = repr((sys.version, key))
    digest = hashlib.sha256(stated.encode("utf-8", "surrogateescape"))
    return Path(caches, "grade", kind, digest.hexdigest())


def _shorten(folder: Path) -> None:
    """Remove the oldest half of too many values."""
    files = list(folder.iterdir())
    if len(files) <= _MOST:
        return
    files.sort(key=_changed_ns)
    for file in files[: _MOST // 2]:
        with suppress(OSError):
            file.unlink()


def _changed_ns(file: Path) -> int:
    """Return the time of a file's last change; 0 if another process has removed it."""
    with suppress(OSError):
        return file.stat().st_mtime_ns
    return 0


@cache
def state_of_code() -> str:
    """Return a hash of name, time and size of each module of the grader; Python finds changed modules by the same."""
    states: list[tuple[str, int, int]] = []
    for package in ("grader", "launch_plan", "ros_bag"):
        states += _states(str(_PACKAGES / package))
    return hashlib.sha256(repr(sorted(states)).encode()).hexdigest()


def _states(folder: str) -> Iterator[tuple[str, int, int]]:
    """Yield name, time and size of each module in a folder."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                yield from _states(entry.path)
            elif entry.name.endswith(".py"):
                state = entry.stat()
                yield entry.path, state.st_mtime_ns, state.st_size

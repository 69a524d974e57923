"""The user's cache, such as `~/.cache/grade`: only the grader's own processes write it, and no sandbox sees it.

It has builds, and values that take longer to compute than to read. Whoever could write it could also name files of labs
as known (see `grader.lab.kept_lab`), so its values are trusted as much as these.
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


def cache_folder(name: str) -> Path:
    """Return the folder of a cache of the user, such as `~/.cache/grade/interfaces`."""
    chosen = os.environ.get("XDG_CACHE_HOME")
    if not chosen:
        chosen = os.environ.get("HOME", "/nowhere") + "/.cache"
    return Path(chosen, "grade", name)


def computed(kind: str, key: object, compute: Callable[[], T]) -> T:
    """Return a computed value, from the cache if it is there; it must be the same for each equal key.

    Parameters
    ----------
    kind
        Name of the folder, such as `patterns`.
    key
        All that the value depends on, with a `repr` that says so. The version of Python counts in any case.
    """
    kept = recalled(kind, key)
    if kept is not None:
        return cast(T, kept)
    value = compute()
    keep(kind, key, value)
    return value


def recalled(kind: str, key: object) -> object | None:
    """Return a value of the cache; None without one, or without one of this user that can be read."""
    try:
        with _path(kind, key).open("rb") as file:
            if os.fstat(file.fileno()).st_uid != os.geteuid():
                return None
            return cast(object, pickle.load(file))
    except Exception:  # Of a value that is cut short or no longer fits, each class has exceptions of its own.
        return None


def keep(kind: str, key: object, value: object) -> None:
    """Put a value into the cache, if that can be written."""
    path = _path(kind, key)
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, pickle.dumps(value, pickle.HIGHEST_PROTOCOL))
        _shorten(path.parent)


def _path(kind: str, key: object) -> Path:
    digest = hashlib.sha256(repr((sys.version, key)).encode("utf-8", "surrogateescape"))
    return cache_folder(kind) / digest.hexdigest()[:40]


def _shorten(folder: Path) -> None:
    """Remove the oldest half of too many values."""
    if len(os.listdir(folder)) <= _MOST:
        return
    aged = sorted((entry.stat().st_mtime_ns, entry.path) for entry in os.scandir(folder))
    for _, path in aged[: _MOST // 2]:
        with suppress(OSError):
            os.unlink(path)


@cache
def state_of_code() -> str:
    """Return a hash of name, time and size of each module of the grader; Python finds changed modules by the same."""
    states = []
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

"""The user's cache of builds, which only the grader's own processes write; no sandbox sees it."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder(name: str) -> Path:
    """Return the folder of a cache of the user, such as `~/.cache/grade/interfaces`."""
    chosen = os.environ.get("XDG_CACHE_HOME")
    if not chosen:
        chosen = os.environ.get("HOME", "/nowhere") + "/.cache"
    return Path(chosen, "grade", name)

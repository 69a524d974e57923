"""Compiles the library that names the frames of a student's program at its crash; a cache keeps it."""

from __future__ import annotations

import functools
import hashlib
import subprocess
import tempfile
from pathlib import Path

from confine.helpers import find_tool, run_helper, search_path
from confine.scratch import scratch_prefix
from grader.files import replace_files
from grader.live.sandbox.cache import cache_folder
from grader.live.student_tap.crashes import LIBRARY, SOURCE

_OPTIONS = ("-O1", "-shared", "-fPIC")
_COMPILING_S = 30.0


@functools.cache  # Each session of a submission asks.
def crash_library() -> Path | None:
    """Return the compiled library, from the user's cache or else compiled now; None without a compiler for C."""
    compiler = find_tool("cc")
    if compiler is None:
        return None
    source = SOURCE.read_bytes()
    name = hashlib.sha256(source).hexdigest()[:32]
    library = cache_folder("crash_tap") / f"{name}.so"
    if library.is_file():
        return library
    try:
        library.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        _compile(compiler, library)
    except (OSError, subprocess.SubprocessError):
        return None
    return library


def _compile(compiler: str, library: Path) -> None:
    """Compile the library; another process can do the same at the same time."""
    with tempfile.TemporaryDirectory(prefix=scratch_prefix()) as folder:
        made = Path(folder, LIBRARY)
        command = [compiler, *_OPTIONS, "-o", str(made), str(SOURCE)]
        done = run_helper(command, environment={"PATH": search_path()}, timeout_s=_COMPILING_S)
        done.check_returncode()
        replace_files({library: made.read_bytes()})

"""Functions of a lab beside its rubric: checks, and oracles for the expected values of a recording."""

from __future__ import annotations

import hashlib
import marshal
import sys
import time
import traceback
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, TypeAlias, cast

from grader.user_cache import computed

#: Device, number and size of a file, and the times of its last changes in ns.
_State: TypeAlias = tuple[int, int, int, int, int]
#: Time after which a file's last change shows in its times, in ns; file systems resolve up to 2 s.
_SETTLED_NS = 4_000_000_000
#: Modules with the states of their files when these were read, by the lab's folder and the file in it.
_unchanged: dict[tuple[Path, str], tuple[_State, ModuleType]] = {}


def load_oracle(lab_folder: Path, reference: str) -> Callable[..., Any]:
    """Load `file.py:function`, relative to the rubric's folder; raises ValueError if there is none."""
    file, _, function = reference.partition(":")
    module = load_file(lab_folder, file)
    oracle: Callable[..., Any] | None = getattr(module, function, None)
    # A rubric must not call any function that its file imports.
    if getattr(oracle, "__module__", None) != module.__name__ or oracle is None:
        raise ValueError(f"{file} has no function {function}")
    return oracle


def load_file(lab_folder: Path, file: str) -> ModuleType:
    """Execute a Python file of a lab, as a module; raises ValueError if it is missing."""
    state = _state_of(lab_folder / file)
    known = _unchanged.get((lab_folder, file))
    if known is not None and known[0] == state:
        return known[1]
    module = _module_of(lab_folder, file)
    # A change within the clock's resolution would not show in the state of a file that has just been written.
    if state is not None and state[-1] + _SETTLED_NS < time.time_ns():
        _unchanged[lab_folder, file] = state, module
    return module


def _state_of(path: Path) -> _State | None:
    """Return numbers that differ after each change of a file, the time of the last one at the end; None without a file."""
    try:
        state = path.stat()
    except OSError:
        return None
    return state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns


def _module_of(lab_folder: Path, file: str) -> ModuleType:
    """Return a file of a lab as a module, executed once for its contents; raises ValueError if it is missing."""
    path = (lab_folder / file).resolve()
    if not (path.is_relative_to(lab_folder.resolve()) and path.is_file()):
        raise ValueError(f"there is no file {file} beside the rubric")
    # Named by its contents, because a lab can have copies, and a file can change. The contents are executed, never
    # bytecode beside the file.
    text = path.read_bytes()
    name = "lab_oracles_" + hashlib.sha256(text).hexdigest()[:16]
    if name not in sys.modules:
        module = sys.modules[name] = ModuleType(name)
        module.__file__ = str(path)
        try:
            exec(compiled(text, file), vars(module))
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


@lru_cache(maxsize=64)
def compiled(text: bytes, file: str) -> CodeType:
    """Return the code of a file of a lab, without executing it; forks of a prepared process share it."""
    code = computed("code", (text, file), lambda: marshal.dumps(compile(text, file, "exec")))
    return cast(CodeType, marshal.loads(code))


def describe_failure(problem: BaseException, reference: str) -> str:
    """Describe an exception with its line in the lab's file.

    For example `describe_failure(problem, "oracle.py:expected")` gives "oracle.py, line 3: KeyError: 'x'".
    """
    file = reference.partition(":")[0]
    if isinstance(problem, SyntaxError):
        return f"{file}, line {problem.lineno}: {problem.msg}"
    place = file
    for frame in traceback.extract_tb(problem.__traceback__):
        if frame.filename == file:
            place = f"{file}, line {frame.lineno}"
    return f"{place}: {type(problem).__name__}: {problem}"

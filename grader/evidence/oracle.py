"""Functions of a lab beside its rubric: checks, and oracles for the expected values of a recording."""

from __future__ import annotations

import hashlib
import marshal
import sys
import traceback
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, cast

from grader.user_cache import computed


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
    try:
        state = (lab_folder / file).stat()
    except OSError:
        changes = (0, 0, 0)
    else:
        changes = (state.st_ino, state.st_size, state.st_mtime_ns)
    return _module_of(lab_folder, file, changes)


@lru_cache(maxsize=64)
def _module_of(lab_folder: Path, file: str, _changes: tuple[int, int, int]) -> ModuleType:
    """Return a file of a lab as a module. `_changes` differs after a change of the file, which is then read again."""
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

"""The lab's own functions beside the rubric: oracles, which give expected values for what was recorded, and checks."""

from __future__ import annotations

import hashlib
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any


def load_oracle(lab_folder: Path, reference: str) -> Callable[..., Any]:
    """Load `file.py:function`, relative to the rubric's folder; raises ValueError if there is none."""
    file, _, function = reference.partition(":")
    module = load_file(lab_folder, file)
    oracle: Callable[..., Any] | None = getattr(module, function, None)
    # What it imports is not its own: by that, a rubric from anywhere could call anything.
    if getattr(oracle, "__module__", None) != module.__name__ or oracle is None:
        raise ValueError(f"{file} has no function {function}")
    return oracle


def load_file(lab_folder: Path, file: str) -> ModuleType:
    """Execute a Python file of a lab, as a module; raises ValueError if it is not there."""
    path = (lab_folder / file).resolve()
    if not (path.is_relative_to(lab_folder.resolve()) and path.is_file()):
        raise ValueError(f"there is no file {file} beside the rubric")
    # By its contents: copies of a lab may lie in several places, and a file may change. It is these that are executed,
    # and no bytecode that lies beside the file.
    text = path.read_bytes()
    name = "lab_oracles_" + hashlib.sha256(text).hexdigest()[:16]
    if name not in sys.modules:
        module = sys.modules[name] = ModuleType(name)
        module.__file__ = str(path)
        try:
            exec(compile(text, file, "exec"), vars(module))
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]


def describe_failure(problem: BaseException, reference: str) -> str:
    """Say what an exception is, with the line of the lab's file (`file.py:function`) where it came up."""
    file = reference.partition(":")[0]
    if isinstance(problem, SyntaxError):
        return f"{file}, line {problem.lineno}: {problem.msg}"
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(problem.__traceback__)
        if frame.filename == file
    ]
    line = f", line {lines[-1]}" if lines else ""
    return f"{file}{line}: {type(problem).__name__}: {problem}"

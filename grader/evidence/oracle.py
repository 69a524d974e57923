"""The lab's oracles: pure functions beside the rubric that give expected values for what was recorded."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def load_oracle(lab_folder: Path, reference: str) -> Callable[..., Any]:
    """Load an oracle, `file.py:function` relative to the rubric's folder.

    Raises
    ------
    ValueError
        If there is no such file in the folder, or no such function in the file: a mistake in the rubric.
    """
    file, _, function = reference.partition(":")
    path = (lab_folder / file).resolve()
    if not (path.is_relative_to(lab_folder.resolve()) and path.is_file()):
        raise ValueError(f"there is no oracle file {file} beside the rubric")
    # By its contents: copies of a lab may lie in several places, and a file may change.
    name = "lab_oracles_" + hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    oracle: Callable[..., Any] | None = getattr(sys.modules[name], function, None)
    # What it imports is not its own: by that, a rubric from anywhere could call anything.
    if getattr(oracle, "__module__", None) != name or oracle is None:
        raise ValueError(f"{file} has no function {function}")
    return oracle

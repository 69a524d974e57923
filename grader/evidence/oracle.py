"""The lab's oracles: pure functions beside the rubric that give expected values for what was recorded."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def load_oracle(lab_folder: Path, reference: str) -> Callable[..., Any]:
    """Load an oracle.

    Parameters
    ----------
    lab_folder : Path
        The rubric's folder.
    reference : str
        ``file.py:function``, relative to it.

    Raises
    ------
    ValueError
        If there is no such file or function: a mistake in the rubric.
    """
    file, _, function = reference.partition(":")
    path = (lab_folder / file).resolve()
    name = "lab_oracles_" + hashlib.sha256(str(path).encode()).hexdigest()[:16]
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None or not path.is_file():
            raise ValueError(f"there is no oracle file {file} beside the rubric")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    oracle: Callable[..., Any] | None = getattr(sys.modules[name], function, None)
    if oracle is None:
        raise ValueError(f"{file} has no function {function}")
    return oracle

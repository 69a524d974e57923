"""What a rubric names in Python files beside it: oracles, and the settings of its reference nodes."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from grader.yaml_with_lines import suggestion


def load_oracle(lab_folder: Path, reference: str) -> Callable[..., Any]:
    """Load a function or class: an oracle is a pure function that gives expected values for what was recorded.

    Parameters
    ----------
    lab_folder : Path
        The rubric's folder.
    reference : str
        ``file.py:function``, relative to it.

    Raises
    ------
    ValueError
        If there is no such file, function or class, or it cannot be loaded: a mistake in the rubric.
    """
    file, _, function = reference.partition(":")
    path = (lab_folder / file).resolve()
    name = "lab_oracles_" + hashlib.sha256(str(path).encode()).hexdigest()[:16]
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None or not path.is_file():
            beside = (str(other.relative_to(lab_folder)) for other in (lab_folder / file).parent.glob("*.py"))
            raise ValueError(f"there is no Python file {file} beside the rubric" + suggestion(file, beside))
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except Exception as problem:
            del sys.modules[name]
            raise ValueError(f"{file} cannot be loaded: {type(problem).__name__}: {problem}") from problem
    module = sys.modules[name]
    oracle: Callable[..., Any] | None = getattr(module, function, None)
    if not callable(oracle):
        own = (key for key, value in vars(module).items() if getattr(value, "__module__", None) == name)
        raise ValueError(f"{file} has no function or class {function!r}" + suggestion(function, own))
    return oracle

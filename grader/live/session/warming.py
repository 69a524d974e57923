"""Loads, before the sessions' processes are forked, everything that each of them would load otherwise."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from grader.lab.steps import STEPS
from launch_plan.plan import prepare_reader

#: Ends of the names of modules with interfaces.
_INTERFACES = (".msg", ".srv", ".action")


def build_models() -> None:
    """Build the validators of all steps and of launch plans, which are built late."""
    for model in STEPS.values():
        model.model_rebuild()
    prepare_reader()


def import_for(programs: Iterable[Path]) -> list[str]:
    """Import the modules that a lab's programs import, also within functions; return the names of their interfaces.

    Modules of the lab itself are not imported, but read for their imports. A failure is left to the program that needs
    the module. An import such as `from std_msgs.msg import Empty` names the interface "std_msgs/msg/Empty".
    """
    interfaces = []
    seen: set[Path] = set()
    waiting = list(programs)
    while waiting:
        file = waiting.pop()
        if file in seen:
            continue
        seen.add(file)
        for module, names in _imports_in(file):
            beside = file.parent / f"{module}.py"
            if beside.is_file():
                waiting.append(beside)
                continue
            with suppress(Exception):
                importlib.import_module(module)
            if module.endswith(_INTERFACES):
                interfaces += [f"{module.replace('.', '/')}/{name}" for name in names]
    return interfaces


def _imports_in(file: Path) -> list[tuple[str, list[str]]]:
    """Return the modules that a file imports, each with the names that are imported from it."""
    found: list[tuple[str, list[str]]] = []
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return found
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, []) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.append((node.module, [alias.name for alias in node.names]))
    return found

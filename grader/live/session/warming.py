"""Loads modules, builds models and finds the interpreter once, before the processes of sessions are forked.

Every session and director built the models of its steps, and every reference node imported its modules anew: in the
solution's grading, a sixth of the CPU time of sessions and directors, and a quarter of the simulated arm's.
"""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from confine.interpreters import OWN_INTERPRETER, interpreter_roots
from grader.lab.steps import STEPS
from grader.lab.steps.call import CallRecord
from grader.lab.steps.get_parameters import ParameterValue
from grader.recording.record import prepare
from grader.recording.session import (
    Endpoint,
    GraphSnapshot,
    Published,
    RecordingGap,
    ServiceEndpoint,
    Trusted,
)
from launch_plan.plan import prepare_reader
from ros_bag.qos import Qos

#: Ends of the names of modules with interfaces.
_INTERFACES = (".msg", ".srv", ".action")
#: Attributes with the blocks of a statement.
_BLOCKS = ("body", "orelse", "handlers", "finalbody", "cases")


def build_models() -> None:
    """Build the validators of all steps and of launch plans, and the readers of a director's reports.

    The folders of this interpreter are found too: most sessions show them to their programs.
    """
    interpreter_roots(OWN_INTERPRETER)
    for model in STEPS.values():
        model.model_rebuild()
        prepare([model.result])
    prepare([GraphSnapshot, Endpoint, ServiceEndpoint, Qos, Trusted, Published, RecordingGap])
    prepare([CallRecord, ParameterValue])
    prepare_reader()


def import_for(programs: Iterable[Path]) -> list[str]:
    """Import the modules of a lab's programs, imports within functions included; return the names of their interfaces.

    Modules of the lab itself are not imported, but read for their imports. Missing modules are passed over, because the
    program itself reports them. An import such as `from std_msgs.msg import Empty` names the interface "std_msgs/msg/Empty".
    """
    interfaces: list[str] = []
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
                folder = module.replace(".", "/")
                interfaces += map(f"{folder}/{{}}".format, names)
    return interfaces


def _imports_in(file: Path) -> list[tuple[str, list[str]]]:
    """Return the imported modules of a file, each with the names imported from it."""
    found: list[tuple[str, list[str]]] = []
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return found
    for node in _statements_in(tree.body):
        if not isinstance(node, (ast.Import, ast.ImportFrom)):
            continue
        names = [alias.name for alias in node.names]
        if isinstance(node, ast.Import):
            for name in names:
                found.append((name, []))
        elif node.level == 0:
            found.append((node.module or "", names))
    return found


def _statements_in(body: Sequence[ast.AST]) -> Iterator[ast.AST]:
    """Yield statements with those within them; expressions, which hold no import, are most of a file."""
    for node in body:
        yield node
        for name in _BLOCKS:
            yield from _statements_in(getattr(node, name, ()))

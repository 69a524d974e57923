"""From a request to a plan."""

from __future__ import annotations

import math
import sys
import time
from typing import Any

from ._context import LaunchContext
from ._installed import SubmittedModules
from ._problems import problem_of, relative
from ._written import carry_written_files

SCHEMA = "ros-lab-grader/launch-plan/v1"
_CLOCK_GRAIN_NS = 10_000_000  # by so much the times of files may be behind


def evaluate(file: str, arguments: dict[str, Any], root: str) -> dict[str, Any]:
    """Evaluate a launch file as `ros2 launch FILE name:=value` would, without starting anything.

    Parameters
    ----------
    file : str
        Path of the launch file.
    arguments : dict
        Value by name, as given on the command line.
    root : str
        Folder of the submission; lines are reported of the files in it.

    Returns
    -------
    dict
        The plan, ready for JSON.
    """
    context = LaunchContext()
    context.session.root = root
    outcome, problem, began_ns = "ok", None, time.time_ns() - _CLOCK_GRAIN_NS
    given = {str(name): str(value) for name, value in arguments.items()}
    sys.meta_path.append(SubmittedModules(root))
    sys.argv = ["ros2", "launch", file, *(f"{name}:={value}" for name, value in given.items())]
    try:
        _launch(context, file, given)
        carry_written_files(context.session, began_ns)
    except BaseException as error:
        try:
            outcome, problem = problem_of(error, root, file, context)
        except Exception as second:
            problem = _last_resort(error, second, relative(file, root))
            outcome = "error"
    return _plan(context, outcome, problem, given, root)


def _last_resort(error: BaseException, second: Exception, file: str) -> dict[str, Any]:
    name, why = type(error).__name__, type(second).__name__
    message = f"{name} (which could not be described: {why})"
    return {
        "kind": "exception",
        "message": message,
        "file": file,
        "line": None,
        "remedy": "Mend the launch file.",
    }


def _launch(context: LaunchContext, file: str, arguments: dict[str, str]) -> None:
    from ._description import LaunchDescription
    from ._session import visit_all
    from ._sources import AnyLaunchDescriptionSource
    from .actions import IncludeLaunchDescription

    source = AnyLaunchDescriptionSource(file)
    include = IncludeLaunchDescription(source, launch_arguments=list(arguments.items()))
    visit_all([include], context, LaunchDescription())
    context.session.do_deferred()
    context.session.play(context)


def _plan(
    context: LaunchContext, outcome: str, problem: dict[str, Any] | None, given: dict[str, str], root: str
) -> dict[str, Any]:
    session = context.session
    declared = {entry["name"] for entry in session.arguments}
    if outcome == "ok":
        for name in sorted(set(given) - declared):
            session.warn(f"the argument '{name}' is given, but the launch file declares no such argument", None)
    configurations = {n: v for n, v in context.launch_configurations.items() if isinstance(v, str)}
    plan = {
        "schema": SCHEMA,
        "outcome": outcome,
        "problem": problem,
        "arguments": session.arguments,
        "configurations": configurations,
        "processes": [{k: v for k, v in p.items() if not k.startswith("_")} for p in session.processes],
        "includes": [{**entry, "file": relative(entry["file"], root)} for entry in session.includes],
        "logs": session.logs,
        "warnings": session.warnings,
        "shutdowns": session.shutdowns,
        "signals": session.signals,
        "transitions": session.transitions,
        "loaded_components": session.components,
        "not_started": session.unassessed,
        "parameter_files": session.parameter_files,
    }
    plain: dict[str, Any] = _plain(plan, root, 0)
    return plain


def _plain(value: Any, root: str, depth: int) -> Any:
    if depth > 40:
        return "…"
    if isinstance(value, dict):
        source = value.get("source")
        plain = {str(k): _plain(v, root, depth + 1) for k, v in value.items() if k != "source"}
        if "source" in value:
            path, line = source or (None, None)
            if "file" not in plain:
                plain["file"] = None if path is None else relative(path, root)
            elif path is not None:
                plain["by"] = relative(path, root)
            plain["line"] = line
        return plain
    if isinstance(value, (list, tuple)):
        return [_plain(item, root, depth + 1) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, (bool, int, float)) or value is None:
        return value
    try:
        return str(value)
    except Exception:
        return f"<{type(value).__name__}>"

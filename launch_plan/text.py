"""A plan as text for a terminal."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from typing import Any

from launch_plan.format import PARAMETERS_PLACEHOLDER
from launch_plan.plan import Note, Plan, Process


def as_text(plan: Plan) -> str:
    """Return a plan as lines, e.g. `talker-1  at once` with the command line below."""
    return "\n".join(_lines(plan))


def moment(when: Mapping[str, Any] | None) -> str:
    """Return the moment of a start, e.g. "2 s after the launch" or "2 s after the exit of arm-1"."""
    if not when:
        return "at once"
    event = _event(when.get("since") or when)
    if "after_s" in when:
        return f"{when['after_s']:g} s after {event}"
    return f"after {event}"


def _event(when: Mapping[str, Any]) -> str:
    for key, value in when.items():
        if key.endswith("_of"):
            event = key.removeprefix("on_").removesuffix("_of")
            return f"the {event} of {value}"
    return "the shutdown" if "on_shutdown" in when else "the launch"


def _lines(plan: Plan) -> Iterator[str]:
    yield f"outcome: {plan.outcome}"
    if plan.problem is not None:
        problem = plan.problem
        yield f"{_place(problem.file, problem.line)}{problem.message} [{problem.kind}]"
        yield f"  {problem.remedy}"
    for argument in plan.arguments:
        default = "required" if argument.default is None else f"default {argument.default!r}"
        yield f"argument {argument.name}: {default}"
    for include in plan.includes:
        yield f"include {include.file}"
    for process in plan.processes:
        yield from _process_lines(process)
    for kept_back in plan.not_started:
        yield f"not started: {kept_back.get('what')}: {kept_back.get('why')}"
    yield from _notes("log", plan.logs)
    yield from _notes("warning", plan.warnings)


def _process_lines(process: Process) -> Iterator[str]:
    yield f"process {process.id}: {moment(process.when)}"
    yield f"  command: {shlex.join(process.command(PARAMETERS_PLACEHOLDER))}"
    if process.full_name is not None:
        yield f"  node: {process.full_name}"
    for name, value in process.effective_parameters().items():
        yield f"  parameter {name}: {value!r}"
    for source, target in process.remappings:
        yield f"  remapping {source} -> {target}"


def _notes(title: str, notes: tuple[Note, ...]) -> Iterator[str]:
    for note in notes:
        yield f"{title}: {_place(note.file, note.line)}{note.message}"


def _place(file: str | None, line: int | None) -> str:
    """Return the place of a message, e.g. "robot.launch.py:7: "."""
    if file is None:
        return ""
    return f"{file}: " if line is None else f"{file}:{line}: "

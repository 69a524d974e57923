"""Parameters with values from an assumption about a launch argument.

A launch file with an undeclared argument is evaluated with an assumed value. Nobody has chosen this value, so
parameters that depend on it are left to the node's own defaults.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from launch_plan.format import PARAMETERS_PLACEHOLDER
from launch_plan.plan import Parameter, Plan, Process

#: A line of a parameter file with one value, e.g. `    rate: 50`.
_VALUE = re.compile(r"\s+[^\s:#-][^:]*: *\S")
#: Words of a command line before a parameter, or before a file of parameters.
_FLAGS = ("-p", "--param", "--params-file")


def without_assumed_parameters(plan: Plan, twin: Plan) -> Plan:
    """Return a plan without the parameters that differ in its twin.

    The twin is a plan of the same file with another assumption.
    """
    twins: dict[str, Process] = {}
    for process in twin.processes:
        twins[process.id] = process
    kept: list[Process] = []
    for process in plan.processes:
        other = twins.get(process.id, process)
        kept.append(_without(process, other))
    return replace(plan, processes=tuple(kept))


def left_out(plan: Plan, without: Plan) -> dict[str, list[str]]:
    """Return the names of the parameters left out of a plan, by process."""
    found: dict[str, list[str]] = {}
    for process, bare in zip(plan.processes, without.processes, strict=True):
        names = set(process.effective_parameters())
        names.difference_update(bare.effective_parameters())
        if names:
            found[process.id] = sorted(names)
    return found


def _without(process: Process, twin: Process) -> Process:
    if len(process.argv) != len(twin.argv):
        return process
    files: dict[str, str] = {}
    for name, text in process.parameter_files.items():
        files[name] = _common(text, twin.parameter_files.get(name, text))
    twins = [item for item in twin.parameters if item.name is not None]
    kept: list[Parameter] = []
    for item in process.parameters:
        if item.name is None or item in twins:
            kept.append(item)
    argv = _words(process.argv, twin.argv, files)
    return replace(process, argv=argv, parameters=tuple(kept), parameter_files=files)


def _common(text: str, other: str) -> str:
    """Return a parameter file without the values that differ in another file."""
    lines = text.split("\n")
    others = other.split("\n")
    if len(lines) != len(others):
        return text
    kept: list[str] = []
    for line, twin in zip(lines, others, strict=True):
        if line == twin or not _VALUE.match(line):
            kept.append(line)
    return "\n".join(kept)


def _words(
    words: Sequence[str], others: Sequence[str], files: Mapping[str, str]
) -> tuple[str, ...]:
    """Return a command line without differing parameters and without files of no value."""
    kept: list[str] = []
    before = ""
    for word, other in zip(words, others, strict=True):
        is_dropped = word != other
        if _is_empty(word, files):
            is_dropped = True
        kept.append(word)
        if is_dropped and before in _FLAGS:
            del kept[-2:]
        before = word
    return tuple(kept)


def _is_empty(path: str, files: Mapping[str, str]) -> bool:
    """Tell whether a word of a command line is a file of the plan without a value."""
    name = path.removeprefix(f"{PARAMETERS_PLACEHOLDER}/")
    if name not in files:
        return False
    for line in files[name].split("\n"):
        if _VALUE.match(line):
            return False
    return True

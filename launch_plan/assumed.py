"""Parameters that follow from an assumption about a launch argument.

A launch file that uses an argument without declaring it is evaluated with an assumed value. Nobody chose
that value, so parameters that depend on it are left to the node's own defaults.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from launch_plan.format import PARAMETERS_PLACEHOLDER
from launch_plan.plan import Plan, Process

#: A line of a parameter file with one value, e.g. `    rate: 50`.
_VALUE = re.compile(r"\s+[^\s:#-][^:]*: *\S")
#: Words of a command line before a parameter, or before a file of parameters.
_FLAGS = frozenset(("-p", "--param", "--params-file"))


def without_assumed_parameters(plan: Plan, twin: Plan) -> Plan:
    """Return a plan without the parameters that differ in its twin, a plan of the same file with another assumption."""
    twins = {process.id: process for process in twin.processes}
    processes = [_without(process, twins.get(process.id, process)) for process in plan.processes]
    return replace(plan, processes=tuple(processes))


def left_out(plan: Plan, without: Plan) -> dict[str, list[str]]:
    """Return the names of parameters that a plan has and its form without them lacks, by process."""
    found: dict[str, list[str]] = {}
    for process, bare in zip(plan.processes, without.processes, strict=True):
        names = process.effective_parameters().keys() - bare.effective_parameters()
        if names:
            found[process.id] = sorted(names)
    return found


def _without(process: Process, twin: Process) -> Process:
    if len(process.argv) != len(twin.argv):
        return process
    files: dict[str, str] = {}
    for name, text in process.parameter_files.items():
        files[name] = _common(text, twin.parameter_files.get(name, text))
    kept = [item for item in process.parameters if item.name is None or item in twin.parameters]
    return replace(
        process,
        argv=_words(process.argv, twin.argv, files),
        parameters=tuple(kept),
        parameter_files=files,
    )


def _common(text: str, other: str) -> str:
    """Return a parameter file without the values that differ in another one."""
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
    """Return a command line without parameters that differ, and without files that no longer hold a value."""
    kept: list[str] = []
    for word, other in zip(words, others, strict=True):
        is_left_out = word != other or _is_empty(word, files)
        if is_left_out and not _FLAGS.isdisjoint(kept[-1:]):
            kept.pop()
        else:
            kept.append(word)
    return tuple(kept)


def _is_empty(path: str, files: Mapping[str, str]) -> bool:
    """Tell whether a word of a command line is a file of the plan without a value."""
    name = path.removeprefix(f"{PARAMETERS_PLACEHOLDER}/")
    if name not in files:
        return False
    return not any(map(_VALUE.match, files[name].split("\n")))

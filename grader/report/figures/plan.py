"""A launch file's contents as a tree."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from grader.evidence.recorded import Recorded
from grader.lab.steps.words import fields, literal
from grader.report.figures.svg import Figure, FigureKind
from launch_plan.plan import (
    Argument,
    Component,
    MalformedPlanError,
    Parameter,
    Plan,
    Process,
)

_MOST_ITEMS = 60
_MOST_CHOICES = 20
#: Longest command line in characters.
_LONGEST_PROGRAM = 300


class Item(NamedTuple):
    """A name in the tree with its value, and the place in a file that sets it, such as `arm.launch.py:12`."""

    name: str
    value: str
    where: str


class Warned(NamedTuple):
    """A warning with its place."""

    message: str
    where: str


@dataclass(frozen=True)
class Branch:
    """A process in the tree."""

    name: str
    runs: str
    where: str
    conditions: Sequence[str]
    #: Arguments of a node before those of ROS; an executable's arguments are in `runs`.
    words: Sequence[str]
    parameters: Sequence[Item]
    #: Variables that not all processes share.
    environment: Sequence[Item]
    #: Pairs of the original and the new name.
    remappings: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Tree:
    """A launch plan as the page's template writes it."""

    outcome: str
    problem: str
    arguments: Sequence[Item]
    includes: Sequence[Item]
    #: Variables that all processes share.
    environment: Sequence[Item]
    processes: Sequence[Branch]
    #: Actions with the reason why they are not started.
    not_started: Sequence[Item]
    warnings: Sequence[Warned]


class PlanTree(FigureKind):
    """The arguments, includes and processes of a launch file."""

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """List arguments, includes and processes with their settings."""
        try:
            plan = Plan.from_plain(recorded.record.plan)
        except MalformedPlanError:
            # Checks report this.
            return None
        return Figure(table="plan", content=_tree_of(plan))


def _tree_of(plan: Plan) -> Tree:
    processes = plan.processes[:_MOST_ITEMS]
    shared = _shared_environment(processes)
    warnings = []
    for note in plan.warnings[:_MOST_ITEMS]:
        warnings.append(Warned(note.message, _location(note.file, note.line)))
    problem = ""
    if plan.problem:
        problem = plan.problem.message
    arguments = [_argument(argument) for argument in plan.arguments[:_MOST_ITEMS]]
    branches = [_branch(process, shared) for process in processes]
    not_started = [_not_started(action) for action in plan.not_started[:_MOST_ITEMS]]
    return Tree(
        outcome=plan.outcome,
        problem=problem,
        arguments=arguments,
        includes=_includes(plan),
        environment=shared,
        processes=branches,
        not_started=not_started,
        warnings=warnings,
    )


def _location(file: str | None, line: int | None) -> str:
    """Write a place in a file, such as `arm.launch.py:12`."""
    if not file:
        return ""
    if not line:
        return file
    return f"{file}:{line}"


def _argument(argument: Argument) -> Item:
    """Return an argument with its default and choices."""
    value = "must be given"
    if argument.default is not None:
        value = literal(argument.default)
    if argument.choices:
        choices = ", ".join(argument.choices[:_MOST_CHOICES])
        value += f" (one of {choices})"
    return Item(argument.name, value, _location(argument.file, argument.line))


def _includes(plan: Plan) -> list[Item]:
    items = []
    for include in plan.includes[:_MOST_ITEMS]:
        where = _location(include.by, include.line)
        items.append(Item(include.file, fields(include.arguments), where))
    return items


def _not_started(action: Mapping[str, Any]) -> Item:
    """Return an action that is not started, with the reason."""
    reason = _condition(str(action.get("why") or ""))
    where = _location(action.get("file"), action.get("line"))
    return Item(action.get("what") or "", reason, where)


# -- processes ---------------------------------------------------------------------------------


def _branch(process: Process, shared: Sequence[Item]) -> Branch:
    """Return a process with its settings; the environment leaves out shared variables."""
    parameters = []
    for given in process.parameters[:_MOST_ITEMS]:
        parameters += _parameters(given)
    own_environment = [item for item in _environment(process) if item not in shared]
    where = _location(process.file, process.line)
    return Branch(
        name=process.full_name or process.id,
        runs=_program(process),
        where=where,
        conditions=_conditions(process),
        words=_words(process),
        parameters=parameters,
        environment=own_environment,
        remappings=process.remappings[:_MOST_ITEMS],
    )


def _environment(process: Process) -> list[Item]:
    variables = itertools.islice(process.env.items(), _MOST_ITEMS)
    return [Item(name, literal(value), "") for name, value in variables]


def _shared_environment(processes: Sequence[Process]) -> list[Item]:
    """Return the variables that all of several processes share."""
    if len(processes) < 2:
        return []
    first, *others = map(_environment, processes)
    return [item for item in first if all(item in other for other in others)]


def _program(process: Process) -> str:
    """Return the package and executable of a node, such as `arm/driver`, or a command line."""
    if process.kind == "executable":
        command = (process.path, *process.argv[:_MOST_ITEMS])
        return " ".join(command)[:_LONGEST_PROGRAM]
    names = [name for name in (process.package, process.executable) if name]
    return "/".join(names) or process.path


def _words(process: Process) -> list[str]:
    """Return a node's own arguments, up to those of ROS."""
    if process.kind == "executable":
        return []
    words = process.argv[:_MOST_ITEMS]
    return list(itertools.takewhile(lambda word: word != "--ros-args", words))


def _condition(text: str) -> str:
    """Write `LaunchConfiguration(`, as students do, for the `LaunchConfig(` in descriptions by `launch`."""
    return text.replace("LaunchConfig(", "LaunchConfiguration(")


def _conditions(process: Process) -> list[str]:
    """Describe when a process starts, and further facts about it."""
    found = []
    if process.condition_note:
        found.append(_condition(process.condition_note))
    if process.when:
        found.append(_when(process.when))
    if process.respawn:
        found.append("started again whenever it ends")
    if process.autostart:
        found.append("configured and activated at once")
    if process.absent:
        found.append(f"not started here: {process.absent}")
    found += [_loaded(component) for component in process.components[:_MOST_ITEMS]]
    return [text for text in found if text]


def _loaded(component: Component) -> str:
    """Write a component: `loads arm::Driver as driver`."""
    words = f"loads {component.plugin or ''}"
    if component.name:
        words += f" as {component.name}"
    return words


_MOMENTS = {
    "on_start_of": "starts when {} has started",
    "on_exit_of": "starts when {} has ended",
    "on_completion_of": "starts after {}",
    "on_transition_of": "starts when {} has changed its state",
    "on_shutdown": "starts at the shutdown",
}


def _when(when: Mapping[str, Any]) -> str:
    """Put the start of a process in words: `after_s: 2` is "starts after 2 s"."""
    moments = [words.format(when[key]) for key, words in _MOMENTS.items() if key in when]
    if "state" in when:
        moments.append(f"to {when['state']}")
    if "after_s" in when:
        since = _counted_from(when.get("since"))
        moments.append(f"starts after {when['after_s']} s{since}")
    return " ".join(moments)


def _counted_from(since: Any) -> str:
    """Put the beginning of a delay in words: `, counted from when arm-1 has started`."""
    if not isinstance(since, Mapping):
        return ""
    # One level only: the beginning may have a beginning of its own.
    known = {key: value for key, value in since.items() if key != "since"}
    if not known:
        return ""
    moment = _when(known).replace("starts", "counted from", 1)
    return f", {moment}"


# -- parameters --------------------------------------------------------------------------------


def _parameters(given: Parameter) -> list[Item]:
    """Return a parameter, or all parameters of a file."""
    if given.name is not None:
        return [Item(given.name, literal(given.value), given.type or "")]
    items = []
    for pattern, values in given.sections():
        where = _file_for(given.file, pattern)
        items += [Item(name, literal(value), where) for name, value in values.items()]
    if not items:
        return [Item(f"file {given.file}", "", "")]
    return items[:_MOST_ITEMS]


def _file_for(file: str | None, pattern: str) -> str:
    """Return a parameter file with its pattern of nodes, unless it is for every node."""
    if pattern.strip("/") in ("", "**"):
        return f"{file}"
    return f"{file}, for {pattern}"

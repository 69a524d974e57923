"""Checks of a launch file: loading, arguments, nodes, parameters, and all nodes running together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from grader.checks.base import (
    Context,
    Part,
    apart,
    credit_of,
    describe_diagnosis,
    excused,
    excused_part,
    failed,
    graded,
    inconclusive,
    not_reached,
    of_parts,
    passed,
    percent,
    quantise,
)
from grader.checks.fields import NumbersOf
from grader.checks.package import build_cause
from grader.checks.preconditions import environment_gap_of
from grader.checks.service import parameter_cause
from grader.evidence import bounds
from grader.evidence.bounds import MANY_DELAYS, Delayed
from grader.evidence.build_faults import BuildFault, build_fault
from grader.evidence.compiled import not_assessable, unbuilt_programs, why_not_built
from grader.evidence.cpu_delay import Span
from grader.evidence.crash.causes import Diagnosis
from grader.evidence.environment_gap import absent_module
from grader.evidence.installed_faults import executable_fault, start_fault, use_fault
from grader.evidence.newer_python import python_needed
from grader.evidence.recorded import Floats, NumericStream, Recorded, clock_step_s
from grader.evidence.timing import timing_of
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.lab.steps.call import CallResult
from grader.lab.steps.get_parameters import GetParametersResult
from grader.lab.steps.plan import PlanResult, Repair, repair_of
from grader.recording.session import ProcessRun
from grader.recording.submission import PackageFact
from grader.result import Finding, Location
from launch_plan.plan import Argument, MalformedPlanError, Plan, Problem, Process

#: Stands for a plan that was not recorded.
_NO_PLAN = Plan("error", Problem("not_evaluated", "the launch file could not be evaluated"))


def _read_plan(plain: Any) -> Plan:
    """Return a plan as it was recorded, or one of nothing."""
    try:
        return Plan.from_plain(plain)
    except MalformedPlanError:
        return _NO_PLAN


def plan_of(context: Context, step: str) -> Plan:
    """Return the plan that a step made of the launch file, or one of nothing if it was not reached."""
    run = context.session.step(step)
    if run is None:
        return _read_plan(None)
    return _read_plan(PlanResult.of(run).plan)


def worked_around(context: Context, step: str, *kinds: str) -> list[Repair]:
    """Return the problems of some kinds, or of all, that were repaired on a copy to judge the rest."""
    run = context.session.step(step)
    if run is None:
        return []
    repairs = PlanResult.of(run).repairs
    if not kinds:
        return repairs
    return [repair for repair in repairs if repair.kind in kinds]


def _left_out(context: Context, step: str) -> Mapping[str, Sequence[str]]:
    """Return the parameters, by process, that were left out because their argument has no value."""
    run = context.session.step(step)
    if run is None:
        return {}
    left_out = PlanResult.of(run).left_out
    if left_out is None:
        return {}
    return left_out


class LaunchLoads(Parameters):
    """The launch file can be evaluated as `ros2 launch` would, as it was handed in."""

    artifact: ref.Artifact
    step: ref.PlanLabel
    repaired_rest: Share = Field(
        0.75,
        description="Share that the checks which depend on this one earn where a mistake was repaired on a copy.",
    )
    not_installed_costs: Share = Field(
        0.0, description="Cost of a file that its package's build does not install."
    )
    unbuilt_rest: Share = Field(
        0.9,
        description="The same share if only a package has a mistake: it does not build, or `ros2 launch` cannot start its "
        "executables.",
    )


def launch_loads(context: Context, p: LaunchLoads) -> Finding:
    """Judge the evaluation; a module that is missing on the grading computer costs nothing.

    This check charges the mistakes that were repaired on a copy, and other checks judge the rest.
    """
    expected = "`ros2 launch` brings it up without an error"
    plan = plan_of(context, p.step)
    unread = _unread(context, p.step, plan)
    if unread:
        return inconclusive(expected, "not evaluated", unread)
    problem = plan.problem
    noted = worked_around(context, p.step)
    if problem is not None:
        noted.append(repair_of(problem))
    faults = [each for each in noted if not _excuse(context, each)]
    undecided = _compiled_programs(context, noted)
    if problem is not None and faults:
        undecided = undecided or _not_assessable(context, plan, problem)
    where = _at(context, problem)
    if undecided:
        measured = problem.message if problem is not None else "a compiled program"
        return inconclusive(expected, measured, undecided, where=where, retry=False)
    if not faults:
        return _loads(context, p, expected, plan, noted)
    if problem is None:
        return _repaired(faults, expected, p.repaired_rest)
    return _stopped(p, expected, plan, problem, where)


def _unread(context: Context, step: str, plan: Plan) -> str:
    """Say why a launch file was not read, through no fault of its own; empty if it was read."""
    if plan is _NO_PLAN:
        return "The recording does not hold an evaluation of the launch file."
    if plan.problem is None:
        return ""
    run = context.session.step(step)
    assert run is not None
    # The outcome of a file that is busy by itself is "failed".
    if (plan.problem.kind, run.outcome) == ("too_slow", "timeout"):
        return "Not your fault: the grading computer was too busy to read the launch file in time."
    return ""


def _stopped(
    p: LaunchLoads, expected: str, plan: Plan, problem: Problem, where: tuple[Location, ...]
) -> Finding:
    """State the mistake that ends the evaluation of a launch file."""
    reason = _capitalised(problem.message)
    if problem.file and problem.line:
        reason += f" ({problem.file}, line {problem.line})"
    finding = failed(expected, problem.message, reason, hint=problem.remedy, where=where)
    if plan.arguments:
        # The arguments that it declares before it stops are judged.
        return replace(finding, passes_on=credit_of(p.repaired_rest) or None)
    return finding


def _loads(
    context: Context, p: LaunchLoads, expected: str, plan: Plan, noted: Sequence[Repair]
) -> Finding:
    """State that a launch file can be evaluated, and the mistakes of its packages."""
    packages = _package_faults(context, p.artifact, plan)
    if packages:
        found = _repaired(list(packages.values()), expected, p.unbuilt_rest)
        return context.charge(found, next(iter(packages)))
    measured = f"{len(plan.processes)} processes, {len(plan.arguments)} arguments"
    notes = [_excuse(context, each) for each in noted]
    for warning in plan.warnings:
        at = ""
        if warning.file:
            at = f" ({warning.file}:{warning.line})"
        notes.append(f"{warning.message}{at}")
    notes += _silent(plan)
    package = _leaves_out(context, p.artifact)
    if package is None:
        where = _at(context, plan.problem)
        return passed(expected, measured, where=where, notes=notes)
    build = "CMakeLists.txt"
    if package.build_type == "ament_python":
        build = "setup.py"
    reason = f"The package {package.name} does not install it, so that `ros2 launch` finds it by its path only."
    hint = f"Install it in {build}, as the remark about the package says."
    path = f"{package.path}/{build}".lstrip("/")
    where = (Location(file=path),)
    share = 1 - p.not_installed_costs
    return graded(share, expected, measured, reason, hint=hint, where=where, notes=notes)


def _not_assessable(context: Context, plan: Plan, problem: Problem) -> str:
    """Say why the launch file cannot be evaluated here; empty if the problem is its own."""
    file = problem.file or ""
    if problem.kind == "syntax_error":
        source = context.submission.texts.get(file, "")
        needed = python_needed(source)
        if needed:
            return f"It uses syntax of Python {needed} or later, which the grading computer lacks. Your instructor decides."
    if plan.outcome != "not_assessable":
        return ""
    if problem.kind == "missing_module":
        # The file may name a module that it does not import, or that is installed here.
        if not absent_module(problem.module, file, problem.line, context.submission):
            return ""
    return "The grader cannot evaluate this launch file."


def _leaves_out(context: Context, artifact: str) -> PackageFact | None:
    """Return the package that holds an artifact's file and surely does not install it, if one does."""
    owner = _owner(context, artifact)
    if owner is None or owner.shared is None:
        return None
    return None if context.path_of(artifact) in owner.shared.values() else owner


def _owner(context: Context, artifact: str) -> PackageFact | None:
    """Return the package with an artifact's file in its folder."""
    path = context.path_of(artifact) or ""
    owners = []
    for package in context.submission.packages:
        if path.startswith(f"{package.path}/".lstrip("/")):
            owners.append(package)
    return max(owners, key=lambda package: len(package.path), default=None)


def _compiled_programs(context: Context, noted: Sequence[Repair]) -> str:
    """Say that a program of the launch file is compiled and was not built here; empty without such a program."""
    programs = unbuilt_programs(context.submission)
    for each in noted:
        if each.kind != "unknown_executable":
            continue
        for name, package in programs.items():
            if f"'{name}'" in each.message or "$" in name:
                return not_assessable(context.submission, package, name)
    return ""


def _package_faults(context: Context, artifact: str, plan: Plan) -> dict[str, Repair]:
    """Return the faults of the packages that a launch file names or belongs to, by their causes.

    `ros2 launch` needs these packages built, with executables that Linux can start.
    """
    owner = _owner(context, artifact)
    texts = context.submission.texts
    found = {}
    for package in context.submission.packages:
        named = [each.executable for each in plan.processes if each.package == package.name]
        if not named and package != owner:
            continue
        build = context.submission.build_of(package)
        fault = None
        if build is not None and not why_not_built(build):
            fault = build_fault(package, build, texts) or use_fault(package, build, texts)
        if fault is None:
            fault = start_fault(package, build, texts, filter(None, named))
        if fault is not None:
            found[build_cause(package)] = Repair(
                "package", fault.message, fault.file, fault.line, fault.remedy, _AS_MEANT
            )
    return found


_AS_MEANT = "the package was installed as its build files intend"


def _excuse(context: Context, noted: Repair) -> str:
    """Say why an unknown name is no mistake of the launch file; empty if it is one."""
    submission = context.submission
    message = _capitalised(noted.message)
    if noted.kind not in ("unknown_executable", "unknown_package"):
        return ""
    for artifact in submission.artifacts:
        if artifact.path is None and artifact.expected.removesuffix(".py") in message:
            return f"{message} Its file is missing, which costs points in another check."
    has_suggestion = "Did you mean" in noted.remedy
    if noted.kind == "unknown_package" and not submission.packages and not has_suggestion:
        return f"{message} The files were handed in without their package, so that its name cannot be wrong."
    return ""


def _repaired(faults: Sequence[Repair], expected: str, rest: float) -> Finding:
    """State the mistakes that keep a launch file from loading, and their repair on a copy."""
    repairs = [noted.repair for noted in faults if noted.repair]
    done = f": {'; '.join(repairs)}" if repairs else ""
    messages = dict.fromkeys(_capitalised(noted.message) for noted in faults)
    remedies = dict.fromkeys(noted.remedy for noted in faults)
    stops = f"{' '.join(messages)} `ros2 launch` stops there."
    reason = f"{stops} To judge the rest, it was repaired on a copy{done}."
    hint = " ".join(remedies)
    where = [Location(file=each.file, line=each.line) for each in faults if each.file]
    finding = failed(expected, "it stops with an error", reason, hint=hint, where=where)
    return replace(finding, passes_on=credit_of(rest) or None)


def _at(context: Context, problem: Problem | None) -> tuple[Location, ...]:
    if problem is not None and problem.file:
        return (Location(problem.file, problem.line),)
    return (context.location(),)


def _silent(plan: Plan) -> list[str]:
    """Note, without a cost, that the output of some nodes goes only to a log file."""
    names = []
    places = []
    for process in plan.processes:
        is_node = process.kind != "executable" and not process.absent
        if is_node and process.output == "log":
            names.append(process.called or process.runs)
            if process.file:
                places.append(f"{process.file}:{process.line}")
    if not names:
        return []
    different = list(dict.fromkeys(names))
    verb = "prints" if len(different) == 1 else "print"
    goes = f"What {', '.join(different)} {verb} goes into a log file and not to the screen"
    at = ""
    if places:
        at = f" ({', '.join(dict.fromkeys(places))})"
    return [f"{goes}; output='screen' shows it{at}."]


def _capitalised(message: str) -> str:
    """Return a message as a sentence; a name at its beginning stays as it is."""
    first = message.split(" ", 1)[0]
    text = message
    if first.isalpha():
        text = message[:1].upper() + message[1:]
    if text.endswith((".", "?", "!")):
        return text
    return f"{text}."


class WantedArgument(Parameters):
    """A launch argument with its default."""

    name: ref.GivenName
    default: str


class LaunchArguments(Parameters):
    """The launch file declares arguments with defaults; each is a part, half for being declared."""

    step: ref.PlanLabel
    arguments: tuple[WantedArgument, ...] = Field(min_length=1)
    other_default_credit: Share = Field(
        0.5, description="Credit of one that is declared with another default."
    )
    other_step: ref.PlanLabel | None = Field(
        None, description="Step that evaluated the file with other values of all arguments."
    )
    no_effect_credit: Share = Field(
        0.25, description="Credit of the declarations where these values change nothing."
    )


def _same(a: Any, b: Any) -> bool:
    """Tell whether two values mean the same: 100 and "100.0", True and "true"."""
    if str(a).strip().lower() == str(b).strip().lower():
        return True
    if isinstance(a, bool) or isinstance(b, bool):
        return False
    try:
        return float(a) == float(b)
    except (TypeError, ValueError, OverflowError):
        return False


def launch_arguments(context: Context, p: LaunchArguments) -> Finding:
    """Judge the declared arguments by the plan."""
    expected = ", ".join(f"{wanted.name} = {wanted.default!r}" for wanted in p.arguments)
    plan = plan_of(context, p.step)
    undefined = worked_around(context, p.step, "undefined_configuration")
    assumed = " ".join(noted.message for noted in undefined)
    declared = _declared(plan)
    parts = []
    for wanted in p.arguments:
        got = declared.get(wanted.name)
        if got is not None:
            part = _with_effect(context, p, plan, _judge_default(got, wanted, p), wanted)
            parts.append(part)
        elif f"'{wanted.name}'" in assumed:
            # An undeclared argument keeps the file from loading, and another check charges it.
            parts.append(Part(1.0))
        else:
            parts.append(_not_declared(plan, wanted, p))
    shown = []
    for argument in declared.values():
        shown.append(f"{argument.name} = {argument.default!r}")
    if not shown:
        shown = ["no arguments"]
    return of_parts(expected, parts, measured=", ".join(shown))


def _declared(plan: Plan) -> dict[str, Argument]:
    """Return the arguments by their names.

    Of several declarations the first sets the value, because an included file may declare the argument again.
    """
    declared: dict[str, Argument] = {}
    for argument in plan.arguments:
        declared.setdefault(argument.name, argument)
    return declared


def _judge_default(got: Argument, wanted: WantedArgument, p: LaunchArguments) -> Part:
    """Judge the default of a declared argument."""
    where = (Location(file=got.file, line=got.line),)
    if got.default is not None and _same(got.default, wanted.default):
        return Part(1.0, where=where)
    if got.default is None:
        default = "no default"
    else:
        default = f"the default {got.default!r}"
    reason = f"The argument {wanted.name} has {default}; {wanted.default!r} is asked for."
    return Part(p.other_default_credit, "", reason, where=where)


def _with_effect(
    context: Context, p: LaunchArguments, plan: Plan, part: Part, wanted: WantedArgument
) -> Part:
    """Judge a declared argument by what the launch file does with other values of all arguments."""
    if p.other_step is None or part.share < 1 or plan.problem is not None:
        return part
    other = plan_of(context, p.other_step)
    if other.problem is not None or _starts(plan) != _starts(other):
        return part
    reason = (
        f"The argument {wanted.name} has no effect: with other values the file starts the same."
    )
    useless = replace(part, share=p.no_effect_credit, reason=reason, hint=_USE_ARGUMENT)
    return context.charge_part(useless, _argument_cause(wanted.name))


_USE_ARGUMENT = "Pass LaunchConfiguration('NAME') on to the nodes, in place of a constant."


def _starts(plan: Plan) -> tuple[object, ...]:
    """Return all that a launch file starts."""
    return plan.processes, plan.loaded_components, plan.parameter_files


def _argument_cause(argument: str) -> str:
    """Name the mistake of a launch argument that does not reach the nodes."""
    return f"argument {argument}"


def _not_declared(plan: Plan, wanted: WantedArgument, p: LaunchArguments) -> Part:
    """State that an argument is not declared, and which others are."""
    asked = {each.name for each in p.arguments}
    others = dict.fromkeys(each.name for each in plan.arguments if each.name not in asked)
    known = f"; declared are {', '.join(others)}" if others else ""
    until = "" if plan.problem is None else " until the file stops"
    return Part(0.0, reason=f"The argument {wanted.name} is not declared{until}{known}.")


class WantedNode(Parameters):
    """A node that the launch file starts."""

    node: ref.RosName
    artifact: ref.Artifact
    executable: ref.GivenName
    charged_by: ref.EarlierCheckId
    types_charged_by: ref.EarlierCheckId | None = Field(
        None,
        description="In rubrics of earlier versions: a check that charges parameters declared with a wrong type.",
    )
    hears_charged_by: ref.EarlierCheckId | None = Field(
        None,
        description="Check that charges what another node sends it; an exception by that is no second fault.",
    )


class LaunchNodes(Parameters):
    """The launch file starts nodes under their names; each is a part."""

    step: ref.PlanLabel
    nodes: tuple[WantedNode, ...] = Field(min_length=1)
    other_name_credit: Share = Field(0.5, description="Credit of one that runs under another name.")
    down_costs: Share = Field(
        0.0, description="Least share of the credit that is lost where one of them does not run."
    )
    other_step: ref.PlanLabel | None = Field(
        None, description="Step that evaluated the file with other arguments."
    )
    optional_costs: Share = Field(
        0.4, description="Share of the credit that is lost where these arguments leave a node out."
    )

    def sought(self) -> Sequence[ref.Sought]:
        """Return the nodes."""
        return [ref.Sought("node", wanted.node) for wanted in self.nodes]


def _entry_for(context: Context, plan: Plan, node: str, executable: str = "") -> Process | None:
    """Return the plan's process of a node: by the node's name, executable or source, or by elimination.

    By its source, an unnamed process runs the only file that has the node's name as a text. By elimination it is
    the only process without a name that does not run the program of a single node, and so holds several nodes.
    """
    short = _short(node)
    program = executable.removesuffix(".py")
    by_name = [entry for entry in plan.processes if entry.called == short]
    if by_name:
        return by_name[0]
    if program:
        for entry in plan.processes:
            if entry.runs.removesuffix(".py") == program:
                return entry
    by_source = _by_source(context, plan, short)
    if by_source is not None:
        return by_source
    several = _holders_of_several(context, plan)
    return several[0] if len(several) == 1 else None


def _by_source(context: Context, plan: Plan, short: str) -> Process | None:
    """Return the only unnamed process whose file has a node's name as a text."""
    found = None
    for entry in plan.processes:
        if _names_itself(context, entry, short):
            if found is not None:
                return None
            found = entry
    return found


def _names_itself(context: Context, entry: Process, short: str) -> bool:
    """Tell whether an unnamed process runs a file that has a node's name as a text."""
    if entry.called is not None:
        return False
    text = _source_of(context, entry)
    return any(f"{quote}{short}{quote}" in text for quote in "'\"")


def _source_of(context: Context, entry: Process) -> str:
    """Return the text of the student's file that a launched process runs; empty if it is not known."""
    file = _file_of(context, entry)
    if file is None:
        return ""
    return context.submission.texts.get(file, "")


def _file_of(context: Context, entry: Process) -> str | None:
    """Return the student's file that a launched process runs; None if its executable has none of the lab's names."""
    for artifact in context.submission.artifacts:
        if artifact.expected.removesuffix(".py") == entry.runs.removesuffix(".py"):
            return artifact.path
    return None


def _short(node: str) -> str:
    """Return a node's name without its namespace."""
    return node.rsplit("/", 1)[-1]


def _holders_of_several(context: Context, plan: Plan) -> list[Process]:
    """Return the unnamed processes that run no program of a single node."""
    single = set()
    for artifact in context.submission.artifacts:
        if not artifact.bonus:
            single.add(artifact.expected.removesuffix(".py"))
    found = []
    for entry in plan.processes:
        is_unnamed = entry.kind == "node" and entry.called is None and not entry.absent
        if is_unnamed and entry.runs.removesuffix(".py") not in single:
            found.append(entry)
    return found


def launch_nodes(context: Context, p: LaunchNodes) -> Finding:
    """Judge each node by the plan, and by the graph if it was really started."""
    expected = ", ".join(wanted.node for wanted in p.nodes)
    plan = plan_of(context, p.step)
    problem = plan.problem
    if problem is not None:
        reason = f"{_capitalised(problem.message)} `ros2 launch` stops there and starts nothing."
        where = _at(context, problem)
        return failed(expected, "nothing was started", reason, hint=problem.remedy, where=where)
    entries = {}
    for wanted in p.nodes:
        entries[wanted.node] = _entry_for(context, plan, wanted.node, wanted.executable)
    absent = _absent(context, entries)
    if absent and _has_components(plan):
        reason = "The grader runs no component containers, so it cannot judge nodes that are loaded into one."
        measured = f"no {', '.join(absent)}, but components"
        return inconclusive(expected, measured, reason, retry=False)
    parts = [_judge_node(context, p, wanted, entries) for wanted in p.nodes]
    parts = _less_for_missing(parts, p.down_costs)
    up = _nodes_up(context, plan) or "no node of the student in the graph"
    costs = _left_out_by_arguments(context, p, entries)
    finding = of_parts(expected, parts, measured=up, costs=costs)
    return replace(finding, retry=not any(part.doubt for part in parts))


def _left_out_by_arguments(
    context: Context, p: LaunchNodes, entries: Mapping[str, Process | None]
) -> list[tuple[float, str]]:
    """Charge the nodes that the file starts with its default arguments only."""
    if p.other_step is None:
        return []
    other = plan_of(context, p.other_step)
    if other.problem is not None or _has_components(other):
        return []
    left_out = []
    for wanted in p.nodes:
        if entries[wanted.node] is None:
            continue
        if _entry_for(context, other, wanted.node, wanted.executable) is None:
            left_out.append(wanted.node)
    if not left_out:
        return []
    reason = f"With other arguments the file does not start {', '.join(left_out)}."
    return [(p.optional_costs, reason)]


def _absent(context: Context, entries: Mapping[str, Process | None]) -> list[str]:
    """Return the nodes that neither the plan starts nor the graph shows."""
    absent = []
    for node, entry in entries.items():
        if entry is None and node not in context.session.nodes:
            absent.append(node)
    return absent


def _has_components(plan: Plan) -> bool:
    if plan.loaded_components:
        return True
    return any(process.components for process in plan.processes)


def _less_for_missing(parts: list[Part], down_costs: float) -> list[Part]:
    """Return the parts, all with less credit if a node surely does not run."""
    mean = sum(part.share for part in parts) / len(parts)
    lost = [part for part in parts if part.share == 0.0]
    is_down = any(part.best is None for part in lost)
    if not mean or not is_down:
        return parts
    kept = min(1.0, (1 - down_costs) / mean)
    return [replace(part, share=part.share * kept) for part in parts]


def _nodes_up(context: Context, plan: Plan) -> str:
    """List the student's nodes in the graph, and which of them ended."""
    shown = []
    for node in context.session.nodes:
        if node not in context.reference_nodes:
            ended = ""
            if _died(context, _entry_for(context, plan, node)):
                ended = " (ended)"
            shown.append(f"{node}{ended}")
    return ", ".join(shown)


def _judge_node(
    context: Context,
    p: LaunchNodes,
    wanted: WantedNode,
    entries: Mapping[str, Process | None],
) -> Part:
    """Judge one wanted node.

    Parameters
    ----------
    entries
        The plan's process of each wanted node.
    """
    entry = entries[wanted.node]
    instead = None
    if entry is not None:
        instead = _other_program(context, entry, wanted)
    if instead is not None:
        return instead
    if wanted.node in context.session.nodes and not _died(context, entry):
        return Part(1.0)
    if entry is None:
        reason = f"Nothing in the launch file starts {wanted.executable} as {wanted.node}."
        return Part(0.0, "", reason)
    # Nodes of one process end together, by the fault of any of them.
    mates = [each for each in p.nodes if entries[each.node] is entry]
    part = _judge_absent(context, p, wanted, entry)
    return _charged_once(context, entry, part, wanted, mates)


def _other_program(context: Context, entry: Process, wanted: WantedNode) -> Part | None:
    """Charge a node's name for the program of another artifact; None if the node's own program has it."""
    own = context.path_of(wanted.artifact)
    file = _file_of(context, entry)
    if None in (own, file):
        return None
    runs = entry.runs.removesuffix(".py")
    if file == own:
        return None
    if runs == wanted.executable:
        return None
    if _short(wanted.node) in _source_of(context, entry):
        return None
    reason = f"{wanted.node} runs {file}, not {own}."
    hint = f"Give this Node the executable of {own}: executable='{wanted.executable}'."
    where = (Location(file=entry.file, line=entry.line),)
    return Part(0.0, "", reason, hint=hint, where=where)


def _judge_absent(context: Context, p: LaunchNodes, wanted: WantedNode, entry: Process) -> Part:
    """Judge a node that the launch file starts, but that is not up under its name."""
    gap = _environment_gap(context, entry, wanted)
    if gap is not None:
        return Part(0.0, best=1.0, doubt=f"{wanted.node} did not come up. {gap}")
    other_name = _other_name(context, entry, wanted)
    if other_name is not None and not _died(context, entry):
        reason = f"{wanted.executable} runs under the name {other_name}, not {wanted.node}."
        where = (Location(file=entry.file, line=entry.line),)
        hint = f"Give the Node name='{_short(wanted.node)}'."
        if _short(other_name) == _short(wanted.node):
            hint = "Take the namespace out of the Node, or out of the group around it."
        return Part(p.other_name_credit, "", reason, hint=hint, where=where)
    return _why_down(context, entry, wanted.executable)


def _charged_once(
    context: Context,
    entry: Process,
    part: Part,
    wanted: WantedNode,
    mates: Sequence[WantedNode],
) -> Part:
    """Charge the part of a missing node, unless another check charges the cause.

    Parameters
    ----------
    mates
        All wanted nodes of the same process.
    """
    if context.path_of(wanted.artifact) is None:
        missing = replace(part, reason=f"The file for {wanted.node} is missing.")
        return context.excuse_part(missing, wanted.charged_by)
    cause = _cause_of_end(context, entry, wanted)
    if not context.charged_under(cause):
        alone = _broken_alone(context, entry, wanted)
        if alone:
            return replace(excused_part(part, alone), charged_by=wanted.charged_by)
    by: list[str | None] = []
    for mate in mates:
        by += _chargers(context, entry, mate)
    return context.charge_part(part, cause, by)


def _broken_alone(context: Context, entry: Process, wanted: WantedNode) -> str:
    """Name the check of a node that ends alone too, by another fault than when launched; empty without one."""
    run = context.session.process(entry.id)
    if run is None:
        return ""
    if not context.charged(wanted.charged_by):
        return ""
    end = _end_of(context, run)
    alone: list[_End] = []
    for ends in _ends_alone(context, wanted).values():
        alone += ends
    if end in (None, *alone):
        return ""
    if not any(alone):
        return ""
    title = context.titles.get(wanted.charged_by, wanted.charged_by)
    return f"The program does not run alone either, by another fault, which is charged under '{title}'."


def _cause_of_end(context: Context, entry: Process, wanted: WantedNode) -> str | None:
    """Name the mistake of an entry point or of a parameter's type that ended a launched node; None for another end."""
    faulty = _entry_fault(context, entry)
    if faulty is not None:
        return build_cause(faulty.package)
    found = _diagnosis(context, entry)
    if found is None or found.kind != "parameter-type":
        return None
    return parameter_cause(wanted.node, found.subject)


@dataclass(frozen=True)
class _EntryFault:
    """The fault of an entry point, and its package."""

    package: PackageFact
    fault: BuildFault


def _entry_fault(context: Context, entry: Process) -> _EntryFault | None:
    """Return the fault of the entry point of a launched process; None if it may lead to a function."""
    submission = context.submission
    for package in submission.packages:
        build = submission.build_of(package)
        if build is None:
            continue
        if package.name != entry.package:
            continue
        fault = executable_fault(package, build, submission.texts, entry.runs)
        if fault is not None:
            return _EntryFault(package, fault)
    return None


def _environment_gap(context: Context, entry: Process, wanted: WantedNode) -> str | None:
    """Name the requirement of a launched node that is missing on the grading computer."""
    found = _diagnosis(context, entry)
    return environment_gap_of(context, wanted.artifact, found)


def _diagnosis(context: Context, entry: Process) -> Diagnosis | None:
    """Explain the end of a launched process; None if it was not started, or if its output explains nothing."""
    run = context.session.process(entry.id)
    if run is None:
        return None
    return context.explain(run)


def _other_name(context: Context, entry: Process, wanted: WantedNode) -> str | None:
    """Return the other name under which a node runs; None if it has its own."""
    used = context.session.used(wanted.node)
    if used != wanted.node:
        return used
    if entry.called in (_short(wanted.node), None):
        return None
    return entry.full_name or entry.called


def _died(context: Context, entry: Process | None) -> bool:
    """Tell whether a launched process ended by itself for good; its node may have been up before."""
    if entry is None or entry.respawn:
        return False
    run = context.session.process(entry.id)
    return run is not None and run.ended_unasked


def _chargers(context: Context, entry: Process, wanted: WantedNode) -> list[str | None]:
    """Return the checks with a charge for the end of a launched node, if they took points."""
    by: list[str | None] = []
    if entry.called in (_short(wanted.node), None):
        by.append(wanted.charged_by)
    run = context.session.process(entry.id)
    end = None
    if run is not None:
        end = _end_of(context, run)
    ends_alone: dict[str, list[_End]] = {}
    if end is not None:
        ends_alone = _ends_alone(context, wanted)
    by.append(_charged_alone(context, end, ends_alone))
    found = _diagnosis(context, entry)
    if found is None:
        return by
    ended_alone = any(map(any, ends_alone.values()))
    if found.kind == "parameter-type":
        by.append(wanted.types_charged_by)
        return by
    if end is not None and not ended_alone:
        by.append(wanted.hears_charged_by)
    return by


#: Distinguishing features of a program's end; None if it did not end by itself.
_End = tuple[object, ...] | None


def _ends_alone(context: Context, wanted: WantedNode) -> dict[str, list[_End]]:
    """Return the ends of a node's program in each other session."""
    ends = {}
    for session in context.sessions.values():
        if session is not context.session:
            runs = session.processes_of(wanted.artifact)
            ends[session.record.session] = [_end_of(context, run) for run in runs]
    return ends


def _charged_alone(
    context: Context, end: _End, ends_alone: Mapping[str, Sequence[_End]]
) -> str | None:
    """Return the check that charges the same end of the program in another session.

    It is the first that points at the line of this end, or else the first of that session.
    """
    alike = {session for session, ends in ends_alone.items() if end in ends}
    found = []
    for check, finding in context.findings.items():
        sessions = {location.session for location in finding.where}
        if alike & sessions and context.charged(check):
            found.append(check)
    file_and_line = None
    if end is not None:
        file_and_line = end[:2]
    for check in found:
        places = [(location.file, location.line) for location in context.findings[check].where]
        if file_and_line in places:
            return check
    return next(iter(found), None)


def _end_of(context: Context, run: ProcessRun) -> _End:
    """Return the features of a process's end; None if it went on until it was stopped."""
    if not run.ended_unasked:
        return None
    found = context.explain(run)
    if found is None:
        return run.limit, run.exit_status
    return found.file, found.line, found.kind, found.exception_type


def _why_down(context: Context, entry: Process, executable: str) -> Part:
    """Say why a launched node does not run."""
    location = Location(file=entry.file, line=entry.line)
    run = context.session.process(entry.id)
    if run is None:
        why = f": {entry.absent}" if entry.absent else ""
        return Part(0.0, "", f"{executable} was not started{why}.", where=(location,))
    if not run.ended_unasked:
        return Part(0.0, "", f"{executable} ran, but no such node appeared.", where=(location,))
    ended = f"{executable} ended with status {run.exit_status}"
    faulty = _entry_fault(context, entry)
    if faulty is not None:
        fault = faulty.fault
        reason = f"{ended}. {fault.message}"
        at_fault = Location(file=fault.file, line=fault.line)
        return Part(0.0, "", reason, hint=fault.remedy, where=(location, at_fault))
    found = context.explain(run)
    if found is None:
        shown = "."
        if run.output:
            shown = f": {run.output[-1].text!r}."
        return Part(0.0, "", f"{ended}{shown}", where=(location,))
    if found.kind == "parameter-type" and entry.file:
        location = _parameter_at(context, entry, entry.file, found.subject)
    where = [location]
    if found.file:
        where.append(Location(file=found.file, line=found.line))
    reason = f"{ended}: {describe_diagnosis(found)}"
    return Part(0.0, "", reason, hint=found.remedy, where=tuple(where))


def _parameter_at(context: Context, entry: Process, file: str, parameter: str) -> Location:
    """Point at the line of a launch file that gives a process a parameter."""
    text = context.submission.texts.get(file, "")
    return Location(file=file, line=parameter_line(text, entry.line, parameter))


#: Greatest number of lines of a node's entry in a launch file.
_MOST_LINES = 60


def parameter_line(text: str, node_line: int | None, parameter: str) -> int | None:
    """Find the line of a launch file that gives a node a parameter.

    Without such a line, it is the line on which the node is made.
    """
    if not node_line:
        return node_line
    following = text.split("\n")[node_line : node_line + _MOST_LINES]
    for number, line in enumerate(following, node_line + 1):
        if f"'{parameter}'" in line or f'"{parameter}"' in line:
            return number
        if "Node(" in line:
            break
    return node_line


class WantedNodeParameter(Parameters):
    """A parameter of a launched node, with the value for the default arguments and for others."""

    node: ref.RosName
    executable: ref.GivenName
    step: ref.GetLabel
    name: ref.GivenName
    value: Any
    other: Any = None
    argument: ref.GivenName | None = Field(
        None, description="Launch argument that it follows; its default is judged elsewhere."
    )
    weight: float = Field(1.0, gt=0, description="Weight beside the other parameters.")


class LaunchParameters(Parameters):
    """Parameters reach the running nodes, and follow the launch arguments; each is a part."""

    step: ref.PlanLabel
    parameters: tuple[WantedNodeParameter, ...] = Field(min_length=1)
    other_step: ref.PlanLabel = Field(
        description="Step that evaluated the file with other arguments."
    )
    unwired_credit: Share = Field(
        0.5, description="Credit of one that does not follow its argument."
    )


def launch_parameters(context: Context, p: LaunchParameters) -> Finding:
    """Judge values in the running nodes, or in the plan if a node does not declare the parameter."""
    values = []
    for wanted in p.parameters:
        values.append(f"{_short(wanted.node)}.{wanted.name} = {wanted.value!r}")
    expected = ", ".join(values)
    plan = plan_of(context, p.step)
    other = plan_of(context, p.other_step)
    left_out = _left_out(context, p.step)
    parts = []
    for wanted in p.parameters:
        entry = _entry_for(context, plan, wanted.node, wanted.executable)
        if entry is None:
            # The check of the nodes charges a node that is not started.
            continue
        if wanted.name in left_out.get(entry.id, ()):
            # The check of the loading charges the argument without a value.
            parts.append(Part(1.0, weight=wanted.weight))
            continue
        part = _judge_parameter(context, p, wanted, entry, plan, other)
        if entry.file and part.reason:
            location = _parameter_at(context, entry, entry.file, wanted.name)
            part = replace(part, where=(location,))
        if wanted.argument is not None:
            part = context.charge_part(part, _argument_cause(wanted.argument))
        parts.append(replace(part, weight=wanted.weight))
    if not parts:
        return not_reached("None of the nodes is started.", expected=expected)
    return of_parts(expected, parts)


@dataclass(frozen=True)
class _Given:
    """Value of a wanted parameter: as planned, and as the node has it."""

    planned: Any
    #: The running node's value, or the planned one if it was not read.
    value: Any
    #: True if the node declares it, but did not tell its value.
    is_unreadable: bool
    #: True if the running node told its value.
    is_read: bool
    #: Words for a value that the running node did not tell.
    unread: str = ""

    @property
    def shown(self) -> str:
        """The value and its origin in words."""
        if self.value is None:
            return "missing"
        if self.is_read:
            return f"= {self.value!r}"
        return f"= {self.value!r} by the launch file ({self.unread})"

    @classmethod
    def of(cls, context: Context, wanted: WantedNodeParameter, entry: Process) -> _Given:
        """Look a parameter up in the plan and in the running node."""
        planned = entry.effective_parameters(wanted.node).get(wanted.name)
        step = context.session.step(wanted.step)
        if step is None:
            result = GetParametersResult()
        else:
            result = GetParametersResult.of(step)
        running = result.read.get(wanted.name)
        if running is not None:
            return cls(planned, running.value, is_unreadable=False, is_read=True)
        was_asked = step is not None and step.outcome == "done"
        is_unreadable = was_asked and result.declares(wanted.name)
        if _died(context, entry):
            unread = "the node had ended"
        elif was_asked and not is_unreadable:
            unread = "the node does not declare it, so it has no effect"
        else:
            unread = "not read from the node"
        return cls(planned, planned, is_unreadable, is_read=False, unread=unread)


def _judge_parameter(
    context: Context,
    p: LaunchParameters,
    wanted: WantedNodeParameter,
    entry: Process,
    plan: Plan,
    other: Plan,
) -> Part:
    """Judge one parameter by two plans, with the default arguments and with others."""
    short = _short(wanted.node)
    given = _Given.of(context, wanted, entry)
    value = given.value
    text = f"{short}.{wanted.name} {given.shown}"
    if given.planned is None:
        own = f"; {value!r} is the node's own default" if value is not None else ""
        return Part(0.0, text, f"The launch file gives {short} no {wanted.name}{own}.")
    subject = f"{wanted.name} of {short}"
    if given.is_unreadable:
        return Part(0.0, f"{short}.{wanted.name} unreadable", f"{subject} could not be read.")
    # The check of the arguments charges a wrong default, and a missing argument.
    declared = _declared(plan)
    argument = declared.get(wanted.argument or "")
    follows = False
    if argument is not None:
        follows = _same(value, argument.default)
    if not _same(value, wanted.value) and not follows:
        return Part(0.0, text, f"{subject} is {value!r}, not {wanted.value!r}.")
    if wanted.argument is not None and argument is None:
        return Part(1.0, text)
    return _judge_wiring(context, p, wanted, given.planned, other, text)


def _judge_wiring(
    context: Context,
    p: LaunchParameters,
    wanted: WantedNodeParameter,
    planned: Any,
    other: Plan,
    text: str,
) -> Part:
    """Judge whether a parameter follows its launch argument."""
    entry = _entry_for(context, other, wanted.node, wanted.executable)
    changed = None
    if entry is None:
        if other.problem is None:
            # The check of the nodes charges a node that these arguments leave out.
            return Part(1.0, f"{text} (not started with other arguments)")
    else:
        changed = entry.effective_parameters(wanted.node).get(wanted.name)
    if wanted.other is None or _same(changed, wanted.other):
        return Part(1.0, text)
    shown = "nothing" if changed is None else repr(changed)
    how = "is not wired to its launch argument"
    if changed is not None and not _same(changed, planned):
        how = "follows its launch argument, but not as it should"
    subject = f"{wanted.name} of {_short(wanted.node)}"
    reason = f"{subject} {how}: with another argument it is {shown}, not {wanted.other!r}."
    return Part(p.unwired_credit, f"{text} ({shown} with another argument)", reason)


class _Doer(Parameters):
    """Task of a launched node, and the check that charges the node's own faults."""

    charged_by: ref.EarlierCheckId
    node: ref.RosName | None = Field(
        None,
        description="The node that does it; if it is not up, the check of the nodes charges that.",
    )


class TogetherCommands(_Doer):
    """Commands arrive as they do alone."""

    topic: ref.Topic
    alone_session: ref.SessionId
    window: ref.Window
    least_share: Share = 0.8
    rate_step: ref.GetLabel | None = Field(
        None, description="Step that read the parameter below in the running node."
    )
    rate_parameter: ref.GivenName | None = Field(
        None,
        description="Parameter that sets the rate; which value it is given is judged elsewhere.",
    )

    @property
    def expected(self) -> str:
        """Name the task in words."""
        return (
            f"commands at {percent(self.least_share)} or more of the rate the publisher has alone"
        )

    def judged(self, context: Context, span: Span | None, delayed: Delayed) -> Part | None:
        """Compare the rate with the rate of the publisher alone."""
        timing = timing_of(context.session.stream(self.topic), span)
        if timing is None:
            reason = "No commands arrived while all ran together; do the nodes follow the simulation's clock?"
            return Part(0.0, "no commands", reason)
        rate_hz = timing.rate_hz
        alone_hz = self._alone_hz(context)
        if self._is_as_set(context, rate_hz):
            return Part(1.0, f"commands at {rate_hz:.1f} Hz, as {self.rate_parameter} sets it")
        if alone_hz is None:
            return Part(1.0, f"commands at {rate_hz:.1f} Hz")
        rate = bounds.count(rate_hz, delayed)
        share = rate.credit(lambda rate_hz: self._share(rate_hz, alone_hz))
        limits = (rate_hz, alone_hz) if share.low < 1 else ()
        shown = apart(rate_hz, *limits, places=1)
        alone_shown = apart(alone_hz, *limits, places=1)
        reason = (
            f"Commands come at {shown} Hz, while alone they come at {alone_shown} Hz on average."
        )
        text = f"commands at {shown} Hz (alone, {alone_shown} Hz on average)"
        return Part.between(share, text, reason)

    def _share(self, rate_hz: float, alone_hz: float) -> float:
        return quantise(min(1.0, rate_hz / alone_hz / self.least_share), 2)

    def _alone_hz(self, context: Context) -> float | None:
        """Return the rate of the publisher alone; None if it was not measured, or if the clock was set."""
        alone = context.sessions.get(self.alone_session)
        if alone is None:
            return None
        span = alone.window(self.window)
        if span is not None and clock_step_s(alone.record, span) > 0:
            return None
        timing = timing_of(alone.stream(self.topic), span)
        return timing.rate_hz if timing is not None else None

    def _is_as_set(self, context: Context, rate_hz: float) -> bool:
        """Tell whether a rate is about the one that the node's parameter sets."""
        wanted_hz = context.parameter(self.rate_step, self.rate_parameter)
        if not isinstance(wanted_hz, (int, float)):
            return False
        return 0 < wanted_hz * self.least_share <= rate_hz <= 2 * wanted_hz


class TogetherFollows(_Doer):
    """A reference node's simulation moves as it is commanded."""

    exactly_one = ("command", "commanded")

    topic: ref.Topic
    field: ref.FieldPath
    command: ref.Topic | None = Field(None, description="Topic of the commands, in the same field.")
    commanded: NumbersOf | None = Field(
        None, description="Topic and field of the commands, where that is another."
    )
    index: int | None = Field(None, description="Element that is compared; else all.")
    subject: str = Field("the simulation", description="What follows, in words.")
    unit: str = Field("", description="Unit of the field.")
    off_share: Share = Field(
        0.5, description="By how much of the command's size it may be off; one that rests is 1."
    )
    off: float = Field(0.05, ge=0, description="By how much it may be off besides.")

    @property
    def follows(self) -> NumbersOf:
        """Topic and field of the commands."""
        return self.commanded or NumbersOf.model_construct(
            topic=self.command or "", field=self.field
        )

    @property
    def expected(self) -> str:
        """Name the task in words."""
        return f"{self.subject} follows"

    def judged(self, context: Context, span: Span | None, delayed: Delayed) -> Part | None:
        """Compare the second half of the motion with the commands."""
        command = self.follows.series(context.session)
        state = context.session.numeric(self.topic, self.field)
        if command is None or state is None:
            return None
        if not self._can_follow(context, command, state):
            return None
        if self.index is None:
            columns = slice(None)
        else:
            columns = slice(self.index, self.index + 1)
        commands = command.values[:, columns]
        if not commands.size or float(np.ptp(commands, axis=0).max()) < _STILL:
            return None
        states = state.values[:, columns]
        sampled = [np.interp(command.source_ns, state.source_ns, column) for column in states.T]
        measured: Floats = np.array(sampled).T
        half = len(measured) // 2
        off = _root_mean_square((measured - commands)[half:])
        size = _root_mean_square(commands[half:])
        text = f"{self.subject} is off by {off:.3f} {self.unit}".rstrip()
        # A resting one is off by the whole size of the command.
        if off < self.off_share * size + self.off:
            return Part(1.0, text)
        reason = f"{self.subject.capitalize()} does not follow the commands."
        return Part.between(bounds.absence(MANY_DELAYS, delayed), text, reason)

    def _can_follow(self, context: Context, command: NumericStream, state: NumericStream) -> bool:
        """Tell whether the reference node takes commands of this type and length."""
        if command.values.shape[1] != state.values.shape[1]:
            return False
        topic = self.follows.topic
        types = set()
        for endpoint in context.session.endpoints_on(topic, "subscription"):
            if endpoint.node in context.reference_nodes:
                types.add(endpoint.type)
        return not types or context.session.stream(topic).topic_type in types


#: Range of commands below which nothing moves, in the unit of the field.
_STILL = 1e-3


def _root_mean_square(rows: Floats) -> float:
    """Return the root of the mean squared length of rows."""
    return float(np.sqrt(np.mean((rows**2).sum(axis=1))))


class TogetherAnswers(_Doer):
    """The service answers."""

    expected: ClassVar[str] = "a service that answers"

    step: ref.CallLabel

    def judged(self, context: Context, span: Span | None, delayed: Delayed) -> Part | None:
        """Judge whether its first call was answered."""
        step = context.session.step(self.step)
        if step is None:
            calls = []
        else:
            calls = CallResult.of(step).calls
        if calls and calls[0].response is not None:
            return Part(1.0, "the service answers")
        reason = "The service does not answer while all run together."
        return Part(0.0, "no answer from the service", reason)


class StayingNode(Parameters):
    """Endpoints that a launched node keeps under the names that it has alone."""

    node: ref.RosName
    artifact: ref.Artifact
    alone_session: ref.SessionId
    subscriptions: tuple[ref.Topic, ...] = ()
    services: tuple[ref.RosName, ...] = ()


#: A task of any kind.
_Task = TogetherCommands | TogetherFollows | TogetherAnswers


class LaunchTogether(Parameters):
    """The launched nodes and the reference nodes work together; each part that is asked for counts the same."""

    example: ClassVar = {"answers": {"step": "call", "charged_by": "talker.publishes"}}

    commands: TogetherCommands | None = None
    follows: TogetherFollows | None = None
    answers: TogetherAnswers | None = None
    stays: tuple[StayingNode, ...] = Field(
        (), description="Nodes whose endpoints the launch file may not move elsewhere."
    )

    @property
    def other_domain_costs(self) -> float:
        """All of the credit: nodes in another ROS domain do not work together with the lab's."""
        return 1.0

    @property
    def doers(self) -> tuple[_Task, ...]:
        """The parts that are asked for."""
        tasks = (self.commands, self.follows, self.answers)
        return tuple(task for task in tasks if task is not None)

    @model_validator(mode="after")
    def _asks_for_something(self) -> LaunchTogether:
        if not self.doers:
            raise ValueError("at least one of commands, follows, answers is needed")
        return self


def launch_together(context: Context, p: LaunchTogether) -> Finding:
    """Judge the nodes while all run; a node with a fault of its own is left out."""
    expected = ", ".join(doer.expected for doer in p.doers)
    span = None
    if p.commands is not None:
        span = context.session.window(p.commands.window)
    whole = _whole(context, p, span)
    delayed = Delayed(0.0, 0.0)
    if whole is not None:
        delayed = bounds.longest_delay(context.session, whole)
    roles = _roles(context, p)
    judged = []
    down = []
    for role in roles:
        part = role.doer.judged(context, span, delayed)
        if not role.is_up(context):
            text = f"not judged without its node: {role.doer.expected}"
            down.append(Part(1.0, text, weight=0.0))
        elif part is not None:
            judged.append(role.charged_once(context, roles, part))
    if all(part.is_excused for part in judged):
        return _nothing_to_judge(expected, roles)
    where = (context.location(_topic_of(p)),)
    moved = [*_moved(context, p), *_moved_nodes(context, p)]
    finding = of_parts(expected, [*judged, *down], costs=moved, where=where)
    if moved:
        return replace(finding, hint=_STAY)
    return finding


#: Instruction for a launch file that moves endpoints.
_STAY = "Take the namespace or the remapping out of the launch file, or begin the name in the program with '/'."
_MOVES = (
    "A namespace moves each name without a leading '/', and a remapping the names that it lists."
)


def _topic_of(p: LaunchTogether) -> str | None:
    """Return the topic of the commands, or else of the states; None without both."""
    if p.commands is not None:
        return p.commands.topic
    if p.follows is not None:
        return p.follows.topic
    return None


def _moved(context: Context, p: LaunchTogether) -> list[tuple[float, str]]:
    """Charge all of the credit if the launch file moves the commands to a topic on which no other node listens."""
    if p.commands is None:
        return []
    alone = context.sessions.get(p.commands.alone_session)
    if alone is None:
        return []
    topic = p.commands.topic
    by_hand = alone.used(topic)
    launched = context.session.used(topic)
    if launched in (topic, by_hand):
        return []
    reason = f"Launched, the commands are on {launched}, and alone on {by_hand}. "
    return [(1.0, reason + _MOVES)]


def _moved_nodes(context: Context, p: LaunchTogether) -> list[tuple[float, str]]:
    """Charge all of the credit for each running node with an endpoint that the launch file moves away."""
    plan = _read_plan(context.session.record.plan)
    costs = []
    for staying in p.stays:
        entry = _entry_for(context, plan, staying.node)
        if entry is None:
            continue
        if _died(context, entry):
            continue
        moved = _moved_away(context, staying, "subscription", staying.subscriptions)
        moved += _moved_away(context, staying, "service", staying.services)
        if moved:
            reason = (
                f"Launched, {_short(staying.node)} is not on {', '.join(moved)}, and alone it is. "
            )
            costs.append((1.0, reason + _MOVES))
    return costs


def _moved_away(
    context: Context, staying: StayingNode, kind: str, names: Sequence[str]
) -> list[str]:
    """Return the wanted names of endpoints that a node has alone, and no launched node has."""
    alone = context.sessions.get(staying.alone_session)
    if alone is None:
        return []
    launched = _names_in(context, context.session, kind)
    if not launched:
        return []
    moved = []
    for name in names:
        by_hand = _names_in(context, alone, kind) & {name, alone.used(name)}
        right = by_hand | {name}
        if by_hand and launched.isdisjoint(right):
            moved.append(name)
    return moved


def _names_in(context: Context, recorded: Recorded, kind: str) -> set[str]:
    """Return the names of the student's subscriptions or services in all graphs of a session."""
    names = set()
    for graph in recorded.record.graph:
        for service in graph.services:
            if kind == "service":
                names.add((service.name, service.node))
        for endpoint in graph.endpoints:
            if endpoint.kind == kind:
                names.add((endpoint.topic, endpoint.node))
    return {name for name, node in names if node not in context.reference_nodes}


def _whole(context: Context, p: LaunchTogether, span: Span | None) -> Span | None:
    """Return the window of the commands, or the whole session if there are none to judge."""
    if p.commands is not None:
        return span
    record = context.session.record
    return Span(record.started_ns, record.ended_ns)


@dataclass(frozen=True)
class _Role:
    """A task, and the node and process that have it."""

    doer: _Task
    #: The node's name as the student used it; None if the check names no node.
    node: str | None
    #: The launched process that runs the node.
    process: Process | None

    def charged_once(self, context: Context, roles: Sequence[_Role], part: Part) -> Part:
        """Charge a part of this task, or take its weight if another check charges the fault.

        A node's own fault is charged alone, and so is the fault of another node of its process.
        """
        mates = [self.doer]
        if self.process is not None:
            mates = [role.doer for role in roles if role.process == self.process]
        charged = context.charge_part(part, None, [mate.charged_by for mate in mates])
        if charged.is_excused:
            return replace(charged, weight=0.0)
        return charged

    def is_up(self, context: Context) -> bool:
        """Tell whether the node came up and went on; the check of the nodes charges other nodes."""
        if self.node is None:
            return True
        return self.node in context.session.nodes and not _died(context, self.process)


def _roles(context: Context, p: LaunchTogether) -> list[_Role]:
    """Find the node and the process of each task."""
    plan = _read_plan(context.session.record.plan)
    roles = []
    for doer in p.doers:
        node = None
        if doer.node is not None:
            node = context.session.used(doer.node)
        process = None
        if node is not None:
            process = _entry_for(context, plan, node)
        roles.append(_Role(doer, node, process))
    return roles


def _nothing_to_judge(expected: str, roles: Sequence[_Role]) -> Finding:
    """State that every node has a fault that another check charges."""
    reason = "Not tested, because each node has a fault that costs points in another check."
    first = roles[0].process
    if first is not None and all(role.process == first for role in roles):
        # One process holds all nodes, and its fault costs its points once.
        return excused(failed(expected, "nothing", ""), reason)
    return not_reached(reason, expected=expected)

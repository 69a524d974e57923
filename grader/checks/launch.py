"""Checks of a launch file: that it loads, what it declares and starts, and that it works when it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from grader.checks.base import (
    MANY_DELAYS,
    Context,
    Part,
    apart,
    cpu_delay_doubt,
    credit_of,
    describe_diagnosis,
    failed,
    graded,
    inconclusive,
    not_reached,
    of_parts,
    passed,
    quantise,
    without_delay,
)
from grader.checks.fields import NumbersOf
from grader.checks.preconditions import environment_gap_of
from grader.evidence.cpu_delay import Span
from grader.evidence.environment_gap import absent_module
from grader.evidence.newer_python import is_newer_python
from grader.evidence.recorded import clock_step_s
from grader.evidence.timing import timing_of
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.recording.launch_plan import MalformedPlanError, Plan, Problem, Process
from grader.recording.session import ProcessRun
from grader.recording.submission import PackageFact
from grader.result import Finding, Location

#: Where no plan was recorded.
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
    return _read_plan(run.result.get("plan") if run is not None else None)


def worked_around(context: Context, step: str, *kinds: str) -> list[Mapping[str, Any]]:
    """Return the problems of some kinds that the live half noted and worked around, to judge the rest."""
    run = context.session.step(step)
    found = run.result.get("mended", []) if run is not None else []
    return [m for m in found if m["kind"] in kinds or not kinds]


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


def launch_loads(context: Context, p: LaunchLoads) -> Finding:
    """Judge the evaluation; a module that we do not have is no fault of the student's.

    What was repaired on a copy is charged here, and the rest is judged there.
    """
    expected = "a launch description without an error"
    plan = plan_of(context, p.step)
    if plan is _NO_PLAN:
        return inconclusive(
            expected,
            "not evaluated",
            "The recording does not hold an evaluation of the launch file.",
        )
    problem = plan.problem
    noted = [*worked_around(context, p.step), *([vars(problem)] if problem is not None else [])]
    faults = [each for each in noted if not _excuse(context, each)]
    if problem is None and faults:
        return _repaired(faults, expected, p.repaired_rest)
    if problem is None or not faults:
        notes = [_excuse(context, each) for each in noted]
        notes += [
            f"{w.message} ({w.file}:{w.line})" if w.file else w.message for w in plan.warnings
        ]
        measured = f"{len(plan.processes)} processes, {len(plan.arguments)} arguments"
        notes += _silent(plan)
        if (package := _leaves_out(context, p.artifact)) is None:
            return passed(expected, measured, where=_at(context, problem), notes=notes)
        build = "setup.py" if package.build_type == "ament_python" else "CMakeLists.txt"
        where = (Location(file=f"{package.path}/{build}".lstrip("/")),)
        reason = f"The package {package.name} does not install it, so that `ros2 launch` finds it by its path only."
        hint = f"Install it in {build}, as the remark about the package says."
        return graded(
            1 - p.not_installed_costs,
            expected,
            measured,
            reason,
            hint=hint,
            where=where,
            notes=notes,
        )
    newer = problem.kind == "syntax_error" and is_newer_python(
        context.submission.texts.get(problem.file or "", "")
    )
    # A module may be said to be missing that the launch file does not import, or that is not missing here.
    made_up = problem.kind == "missing_module" and not absent_module(
        problem.module, problem.file or "", problem.line, context.submission
    )
    if newer or (plan.outcome == "not_assessable" and not made_up):
        lacking = "It uses syntax of Python 3.12 or later, which the grading computer lacks. Your instructor decides."
        reason = lacking if newer else "The grader cannot evaluate this launch file."
        return inconclusive(
            expected, problem.message, reason, where=_at(context, problem), retry=False
        )
    location = f" ({problem.file}, line {problem.line})" if problem.file and problem.line else ""
    reason = _capitalised(problem.message) + location
    finding = failed(
        expected, problem.message, reason, hint=problem.remedy, where=_at(context, problem)
    )
    # What it declares until it stops was seen, and counts.
    return replace(finding, rest=credit_of(p.repaired_rest)) if plan.arguments else finding


def _leaves_out(context: Context, artifact: str) -> PackageFact | None:
    """Return the package that holds an artifact's file and surely does not install it, if one does."""
    path = context.path_of(artifact) or ""
    owners = [p for p in context.submission.packages if path.startswith(f"{p.path}/".lstrip("/"))]
    owner = max(owners, key=lambda package: len(package.path), default=None)
    known = owner.shared if owner is not None else None
    return owner if known is not None and path not in known.values() else None


def _excuse(context: Context, noted: Mapping[str, Any]) -> str:
    """Say why a name of something that is not there is no mistake of the launch file, if it is none."""
    submission, said = context.submission, _capitalised(noted["message"])
    missing = [a.expected.removesuffix(".py") for a in submission.artifacts if a.path is None]
    if noted["kind"] in ("unknown_executable", "unknown_package") and any(
        name in said for name in missing
    ):
        return f"{said} Its file is missing, which costs points in another check."
    near = "Did you mean" in noted["remedy"]
    if noted["kind"] == "unknown_package" and not submission.packages and not near:
        return f"{said} The files were handed in without their package, so that its name cannot be wrong."
    return ""


def _repaired(faults: Sequence[Mapping[str, Any]], expected: str, rest: float) -> Finding:
    """State that a launch file does not load as it was handed in, by what, and what was repaired to judge the rest."""
    done = "; ".join(noted["repair"] for noted in faults if noted.get("repair"))
    reasons = " ".join(dict.fromkeys(_capitalised(noted["message"]) for noted in faults))
    judged = f"To judge the rest, it was repaired on a copy{f': {done}' if done else ''}."
    finding = failed(
        expected,
        "it stops with an error",
        f"{reasons} `ros2 launch` stops there. {judged}",
        hint=" ".join(dict.fromkeys(str(noted["remedy"]) for noted in faults)),
        where=[
            Location(file=noted["file"], line=noted["line"]) for noted in faults if noted["file"]
        ],
    )
    return replace(finding, rest=credit_of(rest))


def _at(context: Context, problem: Problem | None) -> tuple[Location, ...]:
    return (
        Location(problem.file, problem.line) if problem and problem.file else context.location(),
    )


def _silent(plan: Plan) -> list[str]:
    """Advise where what nodes print goes to a log file alone; it costs nothing."""
    quiet = [
        p for p in plan.processes if p.output == "log" and p.kind != "executable" and not p.absent
    ]
    if not quiet:
        return []
    named = list(dict.fromkeys(p.called or p.runs for p in quiet))
    places = ", ".join(dict.fromkeys(f"{p.file}:{p.line}" for p in quiet if p.file))
    verb = "prints" if len(named) == 1 else "print"
    shown = f"What {', '.join(named)} {verb} goes into a log file and not to the screen; output='screen' shows it"
    return [shown + (f" ({places})." if places else ".")]


def _capitalised(message: str) -> str:
    first = message.split(" ", 1)[0]
    text = (
        message[:1].upper() + message[1:] if first.isalpha() else message
    )  # a name stays as it is
    return text if text.endswith((".", "?", "!")) else text + "."


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


def _same(a: Any, b: Any) -> bool:
    """Whether two values mean the same: 100 and "100.0", True and "true"."""
    if str(a).strip().lower() == str(b).strip().lower():
        return True
    try:
        return not isinstance(a, bool) and not isinstance(b, bool) and float(a) == float(b)
    except (TypeError, ValueError, OverflowError):
        return False


def launch_arguments(context: Context, p: LaunchArguments) -> Finding:
    """Judge the declared arguments by the plan."""
    expected = ", ".join(f"{a.name} = {a.default!r}" for a in p.arguments)
    plan = plan_of(context, p.step)
    declared = {a.name: a for a in plan.arguments}
    parts = []
    assumed = " ".join(
        str(noted["message"]) for noted in worked_around(context, p.step, "undefined_configuration")
    )
    for wanted in p.arguments:
        got = declared.get(wanted.name)
        if got is None and f"'{wanted.name}'" in assumed:
            parts.append(
                Part(1.0)
            )  # That it is not declared keeps the file from loading, and is charged there.
        elif got is None:
            others = ", ".join(n for n in declared if n not in {a.name for a in p.arguments})
            known = f"; declared are {others}" if others else ""
            until = "" if plan.problem is None else " until the file stops"
            parts.append(
                Part(0.0, reason=f"The argument {wanted.name} is not declared{until}{known}.")
            )
        else:
            right = got.default is not None and _same(got.default, wanted.default)
            default = "no default" if got.default is None else f"the default {got.default!r}"
            reason = (
                ""
                if right
                else f"The argument {wanted.name} has {default}; {wanted.default!r} is asked for."
            )
            where = (Location(file=got.file, line=got.line),)
            parts.append(Part(1.0 if right else p.other_default_credit, "", reason, where=where))
    measured = ", ".join(f"{n} = {a.default!r}" for n, a in declared.items()) or "no arguments"
    return of_parts(expected, parts, measured=measured)


class WantedNode(Parameters):
    """A node that the launch file starts."""

    node: ref.RosName
    artifact: ref.Artifact
    executable: ref.GivenName
    charged_by: ref.EarlierCheckId
    types_charged_by: ref.EarlierCheckId | None = Field(
        None, description="Check that charges parameters declared with a wrong type."
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


def _entry_for(context: Context, plan: Plan, node: str, executable: str = "") -> Process | None:
    """Return the plan's process that was meant: by the node's name, by its executable, or the one that holds several.

    That is the only one that neither has a name nor runs what another node would.
    """
    short, stem = node.rsplit("/", 1)[-1], executable.removesuffix(".py")
    by_name = [e for e in plan.processes if e.called == short]
    by_program = [e for e in plan.processes if stem and e.runs.removesuffix(".py") == stem]
    single = {
        artifact.expected.removesuffix(".py")
        for artifact in context.submission.artifacts
        if not artifact.bonus
    }
    programs = (e for e in plan.processes if e.kind == "node" and e.called is None and not e.absent)
    several = [e for e in programs if e.runs.removesuffix(".py") not in single]
    return next(iter(by_name or by_program or (several if len(several) == 1 else [])), None)


def launch_nodes(context: Context, p: LaunchNodes) -> Finding:
    """Judge each node by the plan, and by the graph when it was really started."""
    expected = ", ".join(n.node for n in p.nodes)
    plan = plan_of(context, p.step)
    if (problem := plan.problem) is not None:
        reason = f"{_capitalised(problem.message)} `ros2 launch` stops there and starts nothing."
        return failed(
            expected,
            "nothing was started",
            reason,
            hint=problem.remedy,
            where=_at(context, problem),
        )
    entries = {n.node: _entry_for(context, plan, n.node, n.executable) for n in p.nodes}
    absent = [
        node
        for node, entry in entries.items()
        if entry is None and node not in context.session.nodes
    ]
    if absent and (plan.loaded_components or any(process.components for process in plan.processes)):
        reason = "The grader runs no component containers, so it cannot judge nodes that are loaded into one."
        return inconclusive(
            expected, f"no {', '.join(absent)}, but components", reason, retry=False
        )
    parts = []
    for wanted in p.nodes:
        # Nodes of one process end together, and the fault of one is the others' end.
        mates = [each for each in p.nodes if entries[each.node] is entries[wanted.node]]
        parts.append(_judge_node(context, entries[wanted.node], wanted, mates, p.other_name_credit))
    mean = sum(part.share for part in parts) / len(parts)
    if mean and any(part.share == 0.0 and part.best is None for part in parts):
        kept = min(1.0, (1 - p.down_costs) / mean)
        parts = [replace(part, share=part.share * kept) for part in parts]
    seen = (n for n in context.session.nodes if n not in context.reference_nodes)
    up = ", ".join(n + " (ended)" * _died(context, _entry_for(context, plan, n)) for n in seen)
    finding = of_parts(expected, parts, measured=up or "no node of the student in the graph")
    return replace(finding, retry=not any(part.doubt for part in parts))


def _judge_node(
    context: Context,
    entry: Process | None,
    wanted: WantedNode,
    mates: Sequence[WantedNode],
    other_name_credit: float,
) -> Part:
    if wanted.node in context.session.nodes and not _died(context, entry):
        return Part(1.0)
    if entry is None:
        return Part(
            0.0, "", f"Nothing in the launch file starts {wanted.executable} as {wanted.node}."
        )
    name = wanted.node.rsplit("/", 1)[-1]
    if context.path_of(wanted.artifact) is None:
        note = f"The file for {wanted.node} is missing, which costs points in {wanted.charged_by}."
        return Part(1.0, notes=(note,))
    if note := next(
        (note for mate in mates if (note := _charged_elsewhere(context, entry, mate))), ""
    ):
        return Part(1.0, notes=(note,))
    run = context.session.process(entry.id)
    found = context.explain(run) if run is not None else None
    if (gap := environment_gap_of(context, wanted.artifact, found)) is not None:
        return Part(0.0, best=1.0, doubt=f"{wanted.node} did not come up. {gap}")
    used = context.session.used(wanted.node)
    if not _died(context, entry) and (entry.called not in (name, None) or used != wanted.node):
        shown = used if used != wanted.node else entry.full_name or entry.called
        reason = f"{wanted.executable} runs under the name {shown}, not {wanted.node}."
        return Part(
            other_name_credit, "", reason, where=(Location(file=entry.file, line=entry.line),)
        )
    return _why_down(context, entry, wanted.executable)


def _died(context: Context, entry: Process | None) -> bool:
    """Whether a launched process ended by itself for good; for a moment its node may have been there."""
    if entry is None or entry.respawn:
        return False
    run = context.session.process(entry.id)
    return run is not None and run.exited_ns is not None and run.interrupted_ns is None


def _charged_elsewhere(context: Context, entry: Process, wanted: WantedNode) -> str:
    """Say in which check that by which a launched node does not run costs points already; nothing where in none."""
    run = context.session.process(entry.id)
    found = context.explain(run) if run is not None else None
    end = _end_of(context, run) if run is not None else None
    others = [
        session
        for session in context.sessions.values()
        if session is not context.session and end is not None
    ]
    ends = {
        s.record.session: [_end_of(context, r) for r in s.processes_of(wanted.artifact)]
        for s in others
    }
    alike = {session for session, alone in ends.items() if end in alone}
    charged = [
        check
        for check, finding in context.findings.items()
        if alike & {at.session for at in finding.where}
    ]
    of_types = found is not None and found.kind == "parameter-type"
    ends_here = found is not None and end is not None and not any(map(any, ends.values()))
    for holds, what, check in (
        (
            entry.called in (wanted.node.rsplit("/", 1)[-1], None),
            "has a fault of its own",
            wanted.charged_by,
        ),
        (True, "ended as it does alone", next(filter(context.charged, charged), None)),
        (of_types, "ended because of a parameter's type", wanted.types_charged_by),
        (ends_here and not of_types, "ended by what it hears here", wanted.hears_charged_by),
    ):
        if holds and context.charged(check):
            return f"{wanted.node} {what}, which costs points in {check}."
    return ""


def _end_of(context: Context, run: ProcessRun) -> tuple[object, ...] | None:
    """Return what tells one end of a program from another; None for one that went on until it was stopped."""
    if run.exited_ns is None or run.interrupted_ns is not None:
        return None
    found = context.explain(run)
    return (
        (run.limit, run.exit_status)
        if found is None
        else (found.file, found.line, found.kind, found.exception_type)
    )


def _why_down(context: Context, entry: Process, executable: str) -> Part:
    location = (Location(file=entry.file, line=entry.line),)
    run = context.session.process(entry.id)
    if run is None:
        why = f": {entry.absent}" if entry.absent else ""
        return Part(0.0, "", f"{executable} was not started{why}.", where=location)
    if run.exited_ns is None or run.interrupted_ns is not None:
        return Part(0.0, "", f"{executable} ran, but no such node appeared.", where=location)
    found = context.explain(run)
    if found is None:
        shown = f": {run.output[-1].text!r}." if run.output else "."
        return Part(
            0.0, "", f"{executable} ended with status {run.exit_status}{shown}", where=location
        )
    line = entry.line
    if found.kind == "parameter-type" and entry.file:
        line = parameter_line(
            context.submission.texts.get(entry.file, ""), entry.line, found.subject
        )
    cause = (Location(file=found.file, line=found.line),) if found.file else ()
    reason = f"{executable} ended with status {run.exit_status}: {describe_diagnosis(found)}"
    return Part(
        0.0, "", reason, hint=found.remedy, where=(Location(file=entry.file, line=line), *cause)
    )


#: Lines that a node's entry in a launch file takes at most.
_MOST_LINES = 60


def parameter_line(text: str, node_line: int | None, parameter: str) -> int | None:
    """Find the line of a launch file that gives a node a parameter; else the one on which the node is made."""
    first = node_line or 0
    for number, line in enumerate(
        text.split("\n")[first : first + _MOST_LINES] if first else (), first + 1
    ):
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
    """Judge values in the running nodes, or in the plan where a node does not declare the parameter."""
    expected = ", ".join(
        f"{w.node.rsplit('/', 1)[-1]}.{w.name} = {w.value!r}" for w in p.parameters
    )
    plan, other = plan_of(context, p.step), plan_of(context, p.other_step)
    parts = []
    for wanted in p.parameters:
        entry = _entry_for(context, plan, wanted.node, wanted.executable)
        if entry is None:
            continue  # The node is not started, which is charged with the nodes.
        part = _judge_parameter(context, p, wanted, entry, plan, other)
        if entry.file and part.reason:
            line = parameter_line(
                context.submission.texts.get(entry.file, ""), entry.line, wanted.name
            )
            part = replace(part, where=(Location(file=entry.file, line=line),))
        parts.append(part)
    if not parts:
        return not_reached("None of the nodes is started.", expected=expected)
    return of_parts(expected, parts)


def _judge_parameter(
    context: Context,
    p: LaunchParameters,
    wanted: WantedNodeParameter,
    entry: Process,
    plan: Plan,
    other: Plan,
) -> Part:
    planned = entry.effective_parameters(wanted.node).get(wanted.name)
    step = context.session.step(wanted.step)
    result = step.result if step is not None else {}
    running = result.get("values", {}).get(wanted.name)
    short = wanted.node.rsplit("/", 1)[-1]
    subject, value = (
        f"{wanted.name} of {short}",
        running["value"] if running is not None else planned,
    )
    text = f"{short}.{wanted.name} {'missing' if value is None else f'= {value!r}'}"
    if planned is None:
        own = f"; {value!r} is the node's own default" if value is not None else ""
        return Part(0.0, text, f"The launch file gives {short} no {wanted.name}{own}.")
    if (
        running is None
        and step is not None
        and step.outcome == "done"
        and wanted.name in result.get("declared", [])
    ):
        return Part(0.0, f"{short}.{wanted.name} unreadable", f"{subject} could not be read.")
    # What default the launch file gives the argument is charged with the arguments, and so is one that is missing.
    declared = {a.name: a.default for a in plan.arguments}
    follows = wanted.argument is not None and _same(value, declared.get(wanted.argument))
    if not _same(value, wanted.value) and not follows:
        return Part(0.0, text, f"{subject} is {value!r}, not {wanted.value!r}.")
    entry_then = _entry_for(context, other, wanted.node, wanted.executable)
    changed = (
        entry_then.effective_parameters(wanted.node).get(wanted.name)
        if entry_then is not None
        else None
    )
    no_argument = wanted.argument is not None and wanted.argument not in declared
    if wanted.other is None or no_argument or _same(changed, wanted.other):
        return Part(1.0, text)
    shown = "nothing" if changed is None else repr(changed)
    moves = changed is not None and not _same(changed, planned)
    how = (
        "follows its launch argument, but not as it should"
        if moves
        else "is not wired to its launch argument"
    )
    reason = f"{subject} {how}: with another argument it is {shown}, not {wanted.other!r}."
    return Part(p.unwired_credit, f"{text} ({shown} with another argument)", reason)


class _Doer(Parameters):
    """What a launched node does, and where its own faults are charged."""

    charged_by: ref.EarlierCheckId
    node: ref.RosName | None = Field(
        None,
        description="The node that does it; if it is not up, the check of the nodes charges that.",
    )


class TogetherCommands(_Doer):
    """Commands arrive as they do alone."""

    expected: ClassVar[str] = "commands at the rate the publisher has alone"

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

    def judged(
        self, context: Context, span: Span | None, delay_s: float, *, late: bool
    ) -> Part | None:
        """Compare the rate with the one alone."""
        timing = timing_of(context.session.stream(self.topic), span)
        if timing is None:
            reason = "No commands arrived while all ran together; do the nodes follow the simulation's clock?"
            return Part(0.0, "no commands", reason)
        wanted_hz, alone = (
            context.parameter(self.rate_step, self.rate_parameter),
            context.sessions.get(self.alone_session),
        )
        alone_span = alone.window(self.window) if alone is not None else None
        by_itself = timing_of(alone.stream(self.topic), alone_span) if alone is not None else None
        clock_set = (
            alone is not None
            and alone_span is not None
            and clock_step_s(alone.record, alone_span) > 0
        )
        alone_hz = by_itself.rate_hz if by_itself is not None and not clock_set else None
        as_set = (
            isinstance(wanted_hz, (int, float))
            and 0 < wanted_hz * self.least_share <= timing.rate_hz <= 2 * wanted_hz
        )
        if alone_hz is None or as_set:
            return Part(1.0, f"commands at {timing.rate_hz:.1f} Hz")
        most_hz = (
            without_delay(timing.rate_hz, delay_s, span.duration_s)
            if span is not None
            else timing.rate_hz
        )
        share, best = (
            quantise(min(1.0, hz / alone_hz / self.least_share), 2)
            for hz in (timing.rate_hz, most_hz)
        )
        both = (timing.rate_hz, alone_hz)
        shown, alone_shown = (apart(hz, *(both if share < 1 else ()), places=1) for hz in both)
        reason = f"Commands come at {shown} Hz, while alone they come at {alone_shown} Hz."
        return Part(share, f"commands at {shown} Hz ({alone_shown} Hz alone)", reason, best)


class TogetherFollows(_Doer):
    """What a reference node simulates moves as it is commanded."""

    exactly_one = ("command", "commanded")

    topic: ref.Topic
    field: ref.FieldPath
    command: ref.Topic | None = Field(None, description="Topic of the commands, in the same field.")
    commanded: NumbersOf | None = Field(
        None, description="Topic and field of the commands, where that is another."
    )
    index: int | None = Field(None, description="Element that is compared; else all.")
    subject: str = Field("the robot", description="What follows, in words.")
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
        """What it is to do, in words."""
        return f"{self.subject} follows"

    def judged(
        self, context: Context, span: Span | None, delay_s: float, *, late: bool
    ) -> Part | None:
        """Compare the second half of the motion with the commands."""
        command, state = (
            self.follows.series(context.session),
            context.session.numeric(self.topic, self.field),
        )
        if command is None or state is None:
            return None
        widths = {command.values.shape[1], state.values.shape[1]}
        topic, index = (
            self.follows.topic,
            slice(None) if self.index is None else slice(self.index, self.index + 1),
        )
        own = (
            e
            for e in context.session.endpoints_on(topic, "subscription")
            if e.node in context.reference_nodes
        )
        asked = {endpoint.type for endpoint in own}
        heard = not asked or context.session.stream(topic).topic_type in asked
        commands, states = command.values[:, index], state.values[:, index]
        # It takes no commands of another type or length, and cannot follow what does not move.
        if (
            not heard
            or len(widths) > 1
            or not commands.size
            or float(np.ptp(commands, axis=0).max()) < 1e-3
        ):
            return None
        measured = np.array(
            [np.interp(command.source_ns, state.source_ns, column) for column in states.T]
        ).T
        half = len(measured) // 2
        # Each the root of the mean over all rows of a row's squared length.
        off, size = (
            np.sqrt(np.mean((rows[half:] ** 2).sum(axis=1)))
            for rows in (measured - commands, commands)
        )
        text = f"{self.subject} is off by {off:.3f} {self.unit}".rstrip()
        # What rests is off by the whole size of the command.
        if off < self.off_share * size + self.off:
            return Part(1.0, text)
        return Part(
            0.0, text, f"{self.subject.capitalize()} does not follow the commands.", float(late)
        )


class TogetherAnswers(_Doer):
    """The service answers."""

    expected: ClassVar[str] = "a service that answers"

    step: ref.CallLabel

    def judged(
        self, context: Context, span: Span | None, delay_s: float, *, late: bool
    ) -> Part | None:
        """See whether its first call was answered."""
        step = context.session.step(self.step)
        calls: Sequence[Mapping[str, Any]] = (
            step.result.get("calls", []) if step is not None else []
        )
        if calls and calls[0]["response"] is not None:
            return Part(1.0, "the service answers")
        return Part(
            0.0, "no answer from the service", "The service does not answer while all run together."
        )


class LaunchTogether(Parameters):
    """The launched nodes and the reference nodes work together; each part that is asked for counts the same."""

    example: ClassVar = {"answers": {"step": "call", "charged_by": "talker.publishes"}}

    commands: TogetherCommands | None = None
    follows: TogetherFollows | None = None
    answers: TogetherAnswers | None = None

    @property
    def doers(self) -> tuple[TogetherCommands | TogetherFollows | TogetherAnswers, ...]:
        """The parts that are asked for."""
        return tuple(
            part for part in (self.commands, self.follows, self.answers) if part is not None
        )

    @model_validator(mode="after")
    def _asks_for_something(self) -> LaunchTogether:
        if not self.doers:
            raise ValueError("at least one of commands, follows, answers is needed")
        return self


def launch_together(context: Context, p: LaunchTogether) -> Finding:
    """Judge what happened while all ran; a part whose node is at fault by itself is left out."""
    expected = ", ".join(doer.expected for doer in p.doers)
    record = context.session.record
    span = context.session.window(p.commands.window) if p.commands is not None else None
    whole = span if p.commands is not None else Span(record.started_ns, record.ended_ns)
    delay_s, length_s = (
        (context.session.longest_delay_s(whole), whole.duration_s)
        if whole is not None
        else (0.0, 0.0)
    )
    late = delay_s > MANY_DELAYS * length_s
    doers = p.doers
    parts = [doer.judged(context, span, delay_s, late=late) for doer in doers]
    # The nodes under whatever names, and the processes of the launch file that run them.
    names = [context.session.used(doer.node) if doer.node is not None else None for doer in doers]
    plan = _read_plan(context.session.record.plan)
    processes = [_entry_for(context, plan, name) if name is not None else None for name in names]
    judged = []
    for part, doer, name, process in zip(parts, doers, names, processes, strict=True):
        # What is charged alone is not charged again, neither in this node nor in others of its process.
        mates = [mate for mate, other in zip(doers, processes, strict=True) if other == process]
        is_charged = any(
            context.charged(mate.charged_by) for mate in (mates if process is not None else [doer])
        )
        # A node that did not come up, or did not stay, is charged with the nodes.
        is_up = name is None or (name in context.session.nodes and not _died(context, process))
        if part is not None and is_up and (part.share == 1 or not is_charged):
            judged.append(part)
    if not judged:
        reason = "Not tested, because each node has a fault that costs points in another check."
        if processes[0] is not None and all(process == processes[0] for process in processes):
            # One process holds them all, and its fault costs its points once.
            return passed(expected, "nothing", notes=(reason,))
        return not_reached(reason, expected=expected)
    topic = next((doer.topic for doer in (p.commands, p.follows) if doer is not None), None)
    return of_parts(
        expected, judged, where=(context.location(topic),), doubt=cpu_delay_doubt(delay_s, length_s)
    )

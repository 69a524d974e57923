"""Checks of a launch file: that it loads, what it declares and starts, and that it works when it runs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from grader import references as ref
from grader.checks.finding import (
    Context,
    apart,
    environment_gap,
    failed,
    graded,
    in_steps,
    inconclusive,
    kept_from_core,
    not_reached,
    passed,
    told,
)
from grader.evidence.chance import is_believed
from grader.evidence.diagnosis import Diagnosis
from grader.evidence.elsewhere import is_newer_python, missing_here
from grader.evidence.launch_source import parameter_line
from grader.evidence.recorded import Recorded, Span, clock_step_s
from grader.evidence.timing import Timing, timing_of
from grader.recording.plan import MalformedPlanError, Plan, Problem, Process
from grader.recording.session import ProcessRun
from grader.references import Parameters, Share
from grader.result import Finding, Outcome, Where


def plan_of(context: Context, step: str) -> Plan | None:
    """Return the plan that a step made of the launch file, if it was reached."""
    run = context.session.step(step)
    try:
        return Plan.from_plain(run.result["plan"]) if run is not None and "plan" in run.result else None
    except MalformedPlanError:
        return None


def mended(context: Context, step: str, *kinds: str) -> list[Mapping[str, Any]]:
    """Return the problems of some kinds that the live half noted and mended, so that the rest could be judged."""
    run = context.session.step(step)
    return [m for m in (run.result.get("mended", []) if run is not None else []) if m["kind"] in kinds]


class LaunchLoads(Parameters):
    """The launch file can be evaluated as `ros2 launch` would."""

    artifact: ref.Artifact
    step: ref.PlanLabel


def launch_loads(context: Context, p: LaunchLoads) -> Finding:
    """Judge the evaluation; a module that we do not have is no fault of the student's.

    A misnamed executable or an undeclared argument is charged by the checks of nodes and of arguments.
    """
    expected = "a launch description without an error"
    plan = plan_of(context, p.step)
    if plan is None:
        return inconclusive(expected, "not evaluated", "The recording does not hold an evaluation of the launch file.")
    problem = plan.problem
    where = (
        (Where(file=problem.file, line=problem.line),) if problem is not None and problem.file else (context.where(),)
    )
    if plan.outcome == "not_assessable" and problem is not None and not _is_made_up(problem, context):
        reason = "The grader cannot evaluate this launch file."
        return inconclusive(expected, problem.message, reason, where=where, retry=False)
    text = context.submission.texts.get(problem.file or "", "") if problem is not None else ""
    if problem is not None and problem.kind == "syntax_error" and is_newer_python(text):
        reason = "It is written in Python 3.12 or later, and was read with an older one. A person has to decide."
        return inconclusive(expected, problem.message, reason, where=where, retry=False)
    if problem is not None and problem.kind not in ("unknown_executable", "unknown_package"):
        place = f" ({problem.file}, line {problem.line})" if problem.file and problem.line else ""
        return failed(expected, problem.message, _sentence(problem.message) + place, hint=problem.remedy, where=where)
    notes = [f"{w.message} ({w.file}:{w.line})" if w.file else w.message for w in plan.warnings]
    notes += _silent(plan)
    return passed(
        expected,
        f"{len(plan.processes)} processes, {len(plan.arguments)} arguments",
        where=where,
        notes=notes,
    )


def _is_made_up(problem: Problem, context: Context) -> bool:
    """Whether a module is said to be missing that the launch file does not import, or that is not missing here."""
    said = problem.kind == "missing_module"
    return said and missing_here(problem.module, problem.file or "", problem.line, context.submission) is None


def _silent(plan: Plan) -> list[str]:
    """Advise where what nodes print goes to a log file alone; it costs nothing."""
    quiet = [p for p in plan.processes if p.output == "log" and p.kind != "executable" and not p.absent]
    if not quiet:
        return []
    named = list(dict.fromkeys(p.called or p.runs for p in quiet))
    places = ", ".join(dict.fromkeys(f"{p.file}:{p.line}" for p in quiet if p.file))
    verb = "prints" if len(named) == 1 else "print"
    said = f"What {', '.join(named)} {verb} goes into a log file and not to the screen; output='screen' shows it"
    return [said + (f" ({places})." if places else ".")]


def _sentence(message: str) -> str:
    first = message.split(" ", 1)[0]
    text = message[:1].upper() + message[1:] if first.isalpha() else message  # a name stays as it is
    return text if text.endswith((".", "?", "!")) else text + "."


class WantedArgument(Parameters):
    """A launch argument with its default."""

    name: str
    default: str


class LaunchArguments(Parameters):
    """The launch file declares arguments with defaults; each is a part, half for being declared."""

    step: ref.PlanLabel
    arguments: tuple[WantedArgument, ...]
    other_default_credit: Share = Field(0.5, description="Credit of one that is declared with another default.")


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
    declared = {a.name: a for a in plan.arguments} if plan is not None else {}
    parts, reasons, spots = [], [], []
    for wanted in p.arguments:
        got = declared.get(wanted.name)
        if got is None:
            parts.append(0.0)
            others = [n for n in declared if n not in {a.name for a in p.arguments}]
            reasons.append(
                f"The argument {wanted.name} is not declared"
                + (f"; declared are {', '.join(others)}." if others else ".")
            )
            continue
        spots.append(Where(file=got.file, line=got.line))
        right = got.default is not None and _same(got.default, wanted.default)
        parts.append(1.0 if right else p.other_default_credit)
        if not right:
            default = "no default" if got.default is None else f"the default {got.default!r}"
            reasons.append(f"The argument {wanted.name} has {default}; {wanted.default!r} is asked for.")
    for problem in mended(context, p.step, "undefined_configuration"):
        reasons.append(_sentence(problem["message"]))
        spots.append(Where(file=problem["file"], line=problem["line"]))
    measured = ", ".join(f"{n} = {a.default!r}" for n, a in declared.items()) or "no arguments"
    return graded(sum(parts) / len(parts), expected, measured, " ".join(reasons), where=spots or (context.where(),))


class WantedNode(Parameters):
    """A node that the launch file starts."""

    node: ref.RosName
    artifact: ref.Artifact
    executable: str
    charged_by: ref.EarlierCheckId
    types_charged_by: ref.EarlierCheckId | None = Field(
        None, description="Check that charges parameters declared with a wrong type."
    )


class LaunchNodes(Parameters):
    """The launch file starts nodes under their names; each is a part."""

    step: ref.PlanLabel
    nodes: tuple[WantedNode, ...]
    other_name_credit: Share = Field(0.5, description="Credit of one that runs under another name.")


def _entry_for(plan: Plan, node: str, executable: str) -> Process | None:
    """Return the plan's process that was meant: by the node's name, else by its executable."""
    short = node.rsplit("/", 1)[-1]
    by_name = next((e for e in plan.processes if e.called == short), None)
    stem = executable.removesuffix(".py")
    return by_name or next((e for e in plan.processes if e.runs.removesuffix(".py") == stem), None)


def _only_in_container(plan: Plan, node: str, executable: str) -> bool:
    """Whether a node is to be loaded into a container, which is not run here."""
    short = node.rsplit("/", 1)[-1]
    listed = [c for process in plan.processes for c in process.components]
    named = [(c.name, c.plugin) for c in listed]
    named += [(c.get("name"), c.get("plugin")) for each in plan.loaded_components for c in each.get("components") or []]
    wanted = executable.removesuffix(".py").replace("_", "").lower()
    return any(name == short or str(plugin).rsplit(":", 1)[-1].lower() == wanted for name, plugin in named)


def launch_nodes(context: Context, p: LaunchNodes) -> Finding:
    """Judge each node by the plan, and by the graph when it was really started."""
    expected = ", ".join(n.node for n in p.nodes)
    plan = plan_of(context, p.step)
    if plan is None or plan.problem is not None:
        return _nothing_started(context, plan, expected)
    if (contained := _contained(context, plan, p, expected)) is not None:
        return contained
    if unseen := [wanted.node for wanted in p.nodes if _is_unseen(context, plan, wanted)]:
        reason = f"{', '.join(unseen)} was made, and goes on, but was not seen in the graph."
        return inconclusive(expected, _in_the_graph(context, plan), reason, where=(context.where(),))
    judged = [_judge_node(context, plan, wanted, p.other_name_credit) for wanted in p.nodes]
    share = sum(j.share for j in judged)
    reasons = [j.reason for j in judged if j.reason]
    hints = [j.hint for j in judged if j.hint]
    notes = [j.note for j in judged if j.note]
    spots = [spot for j in judged for spot in j.where]
    stopping: list[Mapping[str, Any]] = []
    for noted in mended(context, p.step, "unknown_executable", "unknown_package"):
        if any(
            a.path is None and a.expected.removesuffix(".py") in noted["message"] for a in context.submission.artifacts
        ):
            notes.append(f"{_sentence(noted['message'])} Its file is missing, which is charged elsewhere.")
            continue
        share -= 1.0
        stopping.append(noted)
    if stopping:
        at = "there" if len(stopping) == 1 else "at the first of them"
        said = " ".join(_sentence(noted["message"]) for noted in stopping)
        reasons.insert(0, f"{said} `ros2 launch` stops {at} and starts nothing.")
        hints = [str(noted["remedy"]) for noted in stopping] + hints
        spots = [Where(file=noted["file"], line=noted["line"]) for noted in stopping] + spots
    measured = _in_the_graph(context, plan, mended_first=bool(stopping))
    undecided = [j.undecided for j in judged if j.undecided]
    if share + len(undecided) > max(0.0, share):
        return inconclusive(expected, measured, " ".join(undecided), where=spots or (context.where(),), retry=False)
    return graded(
        max(0.0, share / len(p.nodes)),
        expected,
        measured,
        " ".join(reasons),
        hint=hints[0] if hints else "",
        where=spots or (context.where(),),
        notes=notes,
    )


def _in_the_graph(context: Context, plan: Plan, *, mended_first: bool = False) -> str:
    """Name the student's nodes that were seen, and how those ended that did not stay.

    Where the grader put something right for them to come up, that is said.
    """
    seen = (n for n in context.session.nodes if n not in context.reference_nodes)
    up = ", ".join(node + _end_shown(context, _entry_for(plan, node, "")) for node in seen)
    if not up:
        return "no node of the student's in the graph"
    return f"your file starts nothing; with the names corrected by the grader: {up}" if mended_first else up


def _end_shown(context: Context, entry: Process | None) -> str:
    run = context.session.process(entry.id) if entry is not None and _died(context, entry) else None
    if run is None or run.exited_ns is None:
        return ""
    return f" (ended after {(run.exited_ns - run.started_ns) / 1e9:.1f} s with status {run.exit_status})"


def _contained(context: Context, plan: Plan, p: LaunchNodes, expected: str) -> Finding | None:
    """State that nodes are loaded into a container, so that the grader cannot see them, or None if none is."""
    absent = [n for n in p.nodes if n.node not in context.session.nodes]
    contained = [n.node for n in absent if _only_in_container(plan, n.node, n.executable)]
    if not contained:
        return None
    return inconclusive(
        expected,
        f"{', '.join(contained)} in a container of components",
        "The grader cannot evaluate nodes that are loaded into a container of components: it runs none.",
        where=(context.where(),),
        retry=False,
    )


def _nothing_started(context: Context, plan: Plan | None, expected: str) -> Finding:
    problem = plan.problem if plan is not None else None
    spot = Where(file=problem.file, line=problem.line) if problem is not None and problem.file else context.where()
    reason = _sentence(problem.message) if problem is not None else "The launch file could not be evaluated."
    return failed(
        expected,
        "nothing was started",
        f"{reason} `ros2 launch` stops there and starts nothing.",
        hint=problem.remedy if problem is not None else "",
        where=(spot,),
    )


@dataclass(frozen=True)
class _JudgedNode:
    """The share of one node, why something is lost or undecided, and a note where another check charges for it."""

    share: float
    reason: str = ""
    note: str = ""
    hint: str = ""
    where: tuple[Where, ...] = ()
    undecided: str = ""


def _judge_node(context: Context, plan: Plan, wanted: WantedNode, other_name_credit: float) -> _JudgedNode:
    entry = _entry_for(plan, wanted.node, wanted.executable)
    if wanted.node in context.session.nodes and not _died(context, entry):
        return _JudgedNode(1.0)
    if entry is None:
        return _JudgedNode(0.0, f"Nothing in the launch file starts {wanted.executable} as {wanted.node}.")
    name = wanted.node.rsplit("/", 1)[-1]
    if context.path_of(wanted.artifact) is None:
        note = f"The file for {wanted.node} is missing, which is charged in {wanted.charged_by}."
        return _JudgedNode(1.0, note=note)
    if entry.called in (name, None) and context.charged(wanted.charged_by):
        other = next(
            (n for n in context.session.nodes if n.rsplit("/", 1)[-1] == name), context.session.used(wanted.node)
        )
        how = f"came up as {other}" if other != wanted.node else "did not come up"
        note = f"{wanted.node} {how} by its own fault, which is charged in {wanted.charged_by}."
        return _JudgedNode(1.0, note=note)
    if (charged := _charged_alone(context, entry, wanted.artifact)) is not None:
        return _JudgedNode(1.0, note=f"{wanted.node} ended as it does by itself, which is charged in {charged}.")
    run = context.session.process(entry.id)
    found = context.explain(run) if run is not None else None
    if (gap := environment_gap(context, wanted.artifact, found)) is not None:
        return _JudgedNode(0.0, undecided=f"{wanted.node} did not come up. {gap}")
    if _declares_another_type(context, found, wanted.types_charged_by):
        note = (
            f"{wanted.node} takes no value of the type that the lab asks for, as charged in {wanted.types_charged_by}."
        )
        return _JudgedNode(1.0, note=note)
    used = context.session.used(wanted.node)
    if not _died(context, entry) and (entry.called not in (name, None) or used != wanted.node):
        shown = used if used != wanted.node else entry.full_name or entry.called
        reason = f"{wanted.executable} runs under the name {shown}, not {wanted.node}."
        return _JudgedNode(other_name_credit, reason, where=(Where(file=entry.file, line=entry.line),))
    return _why_down(context, entry, wanted.executable)


def _is_unseen(context: Context, plan: Plan, wanted: WantedNode) -> bool:
    """Whether a launched program made the node under its name, as the tap notes, and the graph never showed it."""
    entry = _entry_for(plan, wanted.node, wanted.executable)
    run = context.session.process(entry.id) if entry is not None else None
    if run is None or run.interrupted_ns is None or run.limit is not None or not is_believed(context.session):
        return False
    if wanted.node in context.session.nodes:
        return False
    return any(claim.process == run.name and claim.node == wanted.node for claim in context.session.record.claims)


def _died(context: Context, entry: Process | None) -> bool:
    """Whether a launched process ended by itself for good; for a moment its node may have been there."""
    if entry is None or entry.respawn:
        return False
    run = context.session.process(entry.id)
    return run is not None and run.exited_ns is not None and run.interrupted_ns is None


def _charged_alone(context: Context, entry: Process, artifact: str) -> str | None:
    """Return the check that charged the end of a launched node, where the node ends the same way in another session."""
    run = context.session.process(entry.id)
    end = _end_of(context, run) if run is not None else None
    if end is None:
        return None
    others = [session for session in context.sessions.values() if session is not context.session]
    alike = {s.record.session for s in others if end in (_end_of(context, r) for r in s.processes_of(artifact))}
    for check, finding in context.findings.items() if alike else ():
        spots = {(spot.file, spot.line) for spot in finding.where if spot.line} | {s.session for s in finding.where}
        if finding.outcome in (Outcome.FAILED, Outcome.PARTIAL) and spots & {end[:2], *alike}:
            return check
    return None


def _end_of(context: Context, run: ProcessRun) -> tuple[object, ...] | None:
    """Return what tells one end of a program from another: the line and its exception, else limit and status.

    None for one that went on until it was stopped.
    """
    if run.exited_ns is None or run.interrupted_ns is not None:
        return None
    found = context.explain(run)
    if found is None:
        return (None, None, run.limit, run.exit_status)
    return (found.file, found.line, found.kind, found.exception_type)


def _why_down(context: Context, entry: Process, executable: str) -> _JudgedNode:
    spot = (Where(file=entry.file, line=entry.line),)
    run = context.session.process(entry.id)
    if run is None:
        why = f": {entry.absent}" if entry.absent else ""
        return _JudgedNode(0.0, f"{executable} was not started{why}.", where=spot)
    if run.exited_ns is None or run.interrupted_ns is not None:
        return _JudgedNode(0.0, f"{executable} ran, but no such node appeared.", where=spot)
    found = context.explain(run)
    if found is None:
        said = f", saying {run.output[-1].text!r}." if run.output else "."
        return _JudgedNode(0.0, f"{executable} ended with status {run.exit_status}{said}", where=spot)
    hint = found.remedy
    if found.kind == "parameter-type" and entry.file:
        text = context.submission.texts.get(entry.file, "")
        spot = (Where(file=entry.file, line=parameter_line(text, entry.line, found.subject)),)
        hint, in_the_node = _type_hint(found.message, found.subject)
        spot = (Where(file=found.file, line=found.line),) if in_the_node and found.file else spot
    return _JudgedNode(0.0, f"{executable} ended with status {run.exit_status}: {told(found)}", hint=hint, where=spot)


def _declares_another_type(context: Context, found: Diagnosis | None, charged_by: str | None) -> bool:
    """Whether a node ended since it declares a parameter with a wrong type, which another check has charged."""
    if found is None or found.kind != "parameter-type" or not context.charged(charged_by):
        return False
    return _type_hint(found.message, found.subject)[1]


_TYPES = re.compile(r"of type '(\w+)', expecting type '(\w+)'")
_PYTHON_TYPES = {"bool": "bool", "double": "float", "integer": "int"}


def _type_hint(message: str, name: str) -> tuple[str, bool]:
    """Say how to fix a parameter given in another type than declared, and whether that is to be done in the node."""
    match = _TYPES.search(message)
    given, declared = match[0].lower().split("'")[1::2] if match is not None else ("", "")
    if (given, declared) == ("double", "integer"):
        return f"Declare {name} with a float, as 100.0: one declared with an integer takes no 100.0.", True
    if given == "string":
        kind = _PYTHON_TYPES.get(declared, "str")
        written = f"ParameterValue(LaunchConfiguration(...), value_type={kind})"
        return f"Write the value without quotation marks; for a launch argument, {written}.", False
    if declared == "string":
        return f"Declare {name} with a default of the type that the lab gives it, not with a string.", True
    kind = _PYTHON_TYPES.get(declared, "str")
    return f"Give it the type that is declared: ParameterValue(LaunchConfiguration(...), value_type={kind}).", False


class WantedNodeParameter(Parameters):
    """A parameter of a launched node, with the value for the default arguments and for others."""

    node: ref.RosName
    executable: str
    step: ref.GetLabel
    name: str
    value: Any
    other: Any = None
    argument: str | None = Field(None, description="Launch argument that it follows; its default is judged elsewhere.")


class LaunchParameters(Parameters):
    """Parameters reach the running nodes, and follow the launch arguments; each is a part."""

    step: ref.PlanLabel
    parameters: tuple[WantedNodeParameter, ...]
    other_step: ref.PlanLabel = Field(description="Step that evaluated the file with other arguments.")
    unwired_credit: Share = Field(0.5, description="Credit of one that does not follow its argument.")


def launch_parameters(context: Context, p: LaunchParameters) -> Finding:
    """Judge values in the running nodes, or in the plan where a node does not declare the parameter."""
    expected = ", ".join(f"{w.node.rsplit('/', 1)[-1]}.{w.name} = {w.value!r}" for w in p.parameters)
    plan, other = plan_of(context, p.step), plan_of(context, p.other_step)
    parts, reasons, texts, spots = [], [], [], []
    for wanted in p.parameters:
        entry = _entry_for(plan, wanted.node, wanted.executable) if plan is not None else None
        if plan is not None and entry is None:
            continue  # The node is not started, which is charged with the nodes.
        share, reason, text = _judge_parameter(context, wanted, plan, other, p.unwired_credit)
        if plan is not None and reason and _planned(plan, wanted) is _MISSING:
            reason += _misdirected(plan, wanted, p.parameters)
        parts.append(share)
        texts.append(text)
        reasons += [reason] if reason else []
        if entry is not None and entry.file and reason:
            line = parameter_line(context.submission.texts.get(entry.file, ""), entry.line, wanted.name)
            spots.append(Where(file=entry.file, line=line))
    if not parts:
        return not_reached("None of the nodes is started.", expected=expected)
    where = tuple(dict.fromkeys(spots)) or (context.where(),)
    return graded(sum(parts) / len(parts), expected, ", ".join(texts), " ".join(reasons), where=where)


_MISSING = object()


def _planned(plan: Plan | None, wanted: WantedNodeParameter) -> Any:
    """Return the value that a plan gives a node's parameter."""
    entry = _entry_for(plan, wanted.node, wanted.executable) if plan is not None else None
    return entry.effective_parameters(wanted.node).get(wanted.name, _MISSING) if entry is not None else _MISSING


def _judge_parameter(
    context: Context, wanted: WantedNodeParameter, plan: Plan | None, other: Plan | None, unwired_credit: float
) -> tuple[float, str, str]:
    planned = _planned(plan, wanted)
    step = context.session.step(wanted.step)
    running = (step.result.get("values", {}) if step is not None else {}).get(wanted.name)
    short = wanted.node.rsplit("/", 1)[-1]
    value = running["value"] if running is not None else planned
    if value is _MISSING:
        return 0.0, f"The launch file gives {short} no {wanted.name}.", f"{short}.{wanted.name} missing"
    text = f"{short}.{wanted.name} = {value!r}"
    if (
        running is None
        and step is not None
        and step.outcome == "done"
        and wanted.name in step.result.get("declared", [])
    ):
        return 0.0, f"{wanted.name} of {short} could not be read.", f"{short}.{wanted.name} unreadable"
    if planned is _MISSING:
        own = f"{value!r} is the node's own default"
        return 0.0, f"The launch file gives {short} no {wanted.name}; {own}.", f"{text} (its own default)"
    if not _same(value, wanted.value) and not _follows_default(plan, wanted, value):
        return 0.0, f"{wanted.name} of {short} is {value!r}, not {wanted.value!r}.", text
    if wanted.other is None or _lacks_argument(plan, wanted):
        return 1.0, "", text
    changed = _planned(other, wanted)
    if changed is not _MISSING and _same(changed, wanted.other):
        return 1.0, "", text
    subject = f"{wanted.name} of {short}"
    shown = "nothing" if changed is _MISSING else repr(changed)
    instead = f"with another argument it is {shown}, not {wanted.other!r}."
    reason = f"{subject} is not wired to its launch argument: {instead}"
    if changed is not _MISSING and not _same(changed, planned):
        reason = f"{subject} follows its launch argument, but not as it should: {instead}"
    return unwired_credit, reason, f"{text} ({shown} with another argument)"


def _misdirected(plan: Plan, wanted: WantedNodeParameter, all_wanted: Sequence[WantedNodeParameter]) -> str:
    """Say which node gets a parameter in place of the one that is to have it, if one does."""
    due = {w.node.rsplit("/", 1)[-1] for w in all_wanted if w.name == wanted.name}
    others = (e for e in plan.processes if e.called not in due and wanted.name in e.effective_parameters())
    found = next((e.called or e.runs for e in others), None)
    return f" It gives it to {found} instead." if found is not None else ""


def _lacks_argument(plan: Plan | None, wanted: WantedNodeParameter) -> bool:
    """Whether the launch file declares no argument of this name for the parameter to follow, which is charged there."""
    return plan is not None and wanted.argument is not None and wanted.argument not in {a.name for a in plan.arguments}


def _follows_default(plan: Plan | None, wanted: WantedNodeParameter, value: Any) -> bool:
    """Whether a value is the default that the launch file gives the argument, which is charged with the arguments."""
    declared = {a.name: a.default for a in plan.arguments} if plan is not None else {}
    return wanted.argument is not None and _same(value, declared.get(wanted.argument))


_NODE: Any = Field(None, description="The node that does it; if it is not up, the check of the nodes charges that.")


class TogetherCommands(Parameters):
    """Commands arrive as they do alone."""

    topic: ref.Topic
    alone_session: ref.SessionId
    charged_by: ref.EarlierCheckId
    window: ref.Window
    least_share: Share = 0.8
    node: ref.RosName | None = _NODE
    rate_step: ref.GetLabel | None = Field(None, description="Step that read the parameter below in the running node.")
    rate_parameter: str | None = Field(
        None, description="Parameter that sets the rate; which value it is given is judged elsewhere."
    )


class TogetherFollows(Parameters):
    """The arm moves as it is commanded."""

    topic: ref.Topic
    command: ref.Topic
    field: ref.FieldPath
    index: int
    charged_by: ref.EarlierCheckId
    node: ref.RosName | None = _NODE


class TogetherAnswers(Parameters):
    """The service answers."""

    step: ref.CallLabel
    charged_by: ref.EarlierCheckId
    node: ref.RosName | None = _NODE


class LaunchTogether(Parameters):
    """The launched nodes and the arm work together; each of the three parts counts the same."""

    commands: TogetherCommands
    follows: TogetherFollows
    answers: TogetherAnswers


def launch_together(context: Context, p: LaunchTogether) -> Finding:
    """Judge what happened while all ran; a part whose node is at fault by itself is left out."""
    expected = "commands at the rate the publisher has alone, an arm that follows, a service that answers"
    span = context.session.window(p.commands.window)
    delay_s, length_s = (context.session.longest_delay_s(span), span.duration_s) if span is not None else (0.0, 0.0)
    parts = [
        _commands_come(context, p.commands, span, delay_s) if _is_up(context, p.commands.node) else None,
        _arm_follows(context, p.follows, late=delay_s > _MANY_DELAYS * length_s)
        if _is_up(context, p.follows.node)
        else None,
        _service_answers(context, p.answers) if _is_up(context, p.answers.node) else None,
    ]
    judged = [part for part in parts if part is not None]
    if not judged:
        return not_reached(
            "None of the nodes does its part, by faults that other checks charge.",
            expected=expected,
        )
    return graded(
        sum(part.share for part in judged) / len(judged),
        expected,
        "; ".join(part.text for part in judged),
        " ".join(part.reason for part in judged if part.share < 1),
        where=(context.where(p.commands.topic),),
        best=sum(max(part.share, part.best) for part in judged) / len(judged),
        doubt=kept_from_core(delay_s, length_s),
    )


@dataclass(frozen=True)
class _Part:
    """What one part earns, what was seen of it, why it earns no more, and what it may earn without the delays."""

    share: float
    text: str
    reason: str = ""
    best: float = 0.0


def _is_up(context: Context, node: str | None) -> bool:
    """Whether a node came up, under whatever name, and stayed; one that did not is charged with the nodes."""
    if node is None:
        return True
    used = context.session.used(node)
    try:
        entry = _entry_for(Plan.from_plain(context.session.record.plan), used, "")
    except MalformedPlanError:
        entry = None
    return used in context.session.nodes and not _died(context, entry)


def _commands_come(context: Context, p: TogetherCommands, span: Span | None, delay_s: float) -> _Part | None:
    timing = timing_of(context.session.stream(p.topic), span)
    alone = context.sessions.get(p.alone_session)
    alone_timing = _timing_alone(alone, p)
    if timing is None:
        if context.charged(p.charged_by):
            return None
        reason = "No commands came while all ran together; do the nodes follow the simulation's clock?"
        return _Part(0.0, "no commands", reason)
    if (moved := _moved_by_launch(context, alone, p)) is not None:
        reason = f"The launch file moves the commands to {moved}, where nobody listens."
        return _Part(0.0, f"commands on {moved}", reason)
    if alone_timing is None:
        return _Part(1.0, f"commands at {timing.rate_hz:.1f} Hz")
    told = _as_told(context, timing, p)
    kept = 1 - min(0.5, delay_s / span.duration_s) if span is not None else 1.0
    rates = (timing.rate_hz / alone_timing.rate_hz, timing.rate_hz / kept / alone_timing.rate_hz)
    share, best = (1.0 if told else in_steps(min(1.0, rate / p.least_share), 2) for rate in rates)
    both = (timing.rate_hz, alone_timing.rate_hz)
    shown, alone_shown = (apart(hz, *(both if share < 1 else ()), places=1) for hz in both)
    text = f"commands at {shown} Hz ({alone_shown} Hz alone)"
    return _Part(share, text, f"Commands come at {shown} Hz, while alone they come at {alone_shown} Hz.", best)


def _timing_alone(alone: Recorded | None, p: TogetherCommands) -> Timing | None:
    """Measure the commands of the session in which they come alone; None where its clock was set meanwhile."""
    span = alone.window(p.window) if alone is not None else None
    if alone is None or (span is not None and clock_step_s(alone.record, span)):
        return None
    return timing_of(alone.stream(p.topic), span)


def _as_told(context: Context, timing: Timing, p: TogetherCommands) -> bool:
    """Whether commands come as often as the launched node's own parameter says."""
    wanted_hz = context.parameter(p.rate_step, p.rate_parameter)
    return isinstance(wanted_hz, (int, float)) and 0 < wanted_hz * p.least_share <= timing.rate_hz <= 2 * wanted_hz


def _moved_by_launch(context: Context, alone: Recorded | None, p: TogetherCommands) -> str | None:
    """Return the topic on which the commands come if the launch file alone gives it another name than the lab's.

    A namespace is charged with the names of the nodes.
    """
    used = context.session.used(p.topic)
    if alone is None or used == p.topic or alone.used(p.topic) != p.topic:
        return None
    named = p.node is None or context.session.used(p.node) == p.node
    listeners = context.session.endpoints_on(p.topic, "subscription", context.reference_nodes)
    return used if named and not any(e.topic == used for e in listeners) else None


#: Share of a window for which a process was kept from a core, from which what others do may depend on that.
_MANY_DELAYS = 0.25


def _arm_follows(context: Context, p: TogetherFollows, *, late: bool) -> _Part | None:
    command, state = (context.numeric(t, p.field) for t in (p.command, p.topic))
    if command is None or state is None or max(command.values.shape[1], state.values.shape[1]) <= p.index:
        return None
    if _never_hears(context, p.command):
        return None  # Another type is charged where it is published.
    if command.values.shape[1] != state.values.shape[1] or float(np.ptp(command.values[:, p.index])) < 1e-3:
        return None  # The arm takes no commands of another length, and cannot follow what does not move.
    measured = np.interp(command.source_ns, state.source_ns, state.values[:, p.index])
    half = len(measured) // 2
    error = float(np.sqrt(np.mean((measured[half:] - command.values[half:, p.index]) ** 2)))
    size = float(np.sqrt(np.mean(command.values[half:, p.index] ** 2)))
    text = f"the arm is off by {error:.3f} rad"
    # An arm that stands still is off by the whole size of the command.
    if error < 0.5 * size + 0.05:
        return _Part(1.0, text)
    if context.charged(p.charged_by):
        return None
    return _Part(0.0, text, "The arm does not follow the commands.", float(late))


def _never_hears(context: Context, topic: str) -> bool:
    """Whether the reference nodes ask for a topic in another type than that in which it is published."""
    own = context.session.endpoints_on(topic, "subscription")
    asked = {e.type for e in own if e.node in context.reference_nodes}
    return bool(asked) and context.session.stream(topic).topic_type not in asked


def _service_answers(context: Context, p: TogetherAnswers) -> _Part | None:
    step = context.session.step(p.step)
    calls: Sequence[Mapping[str, Any]] = step.result.get("calls", []) if step is not None else []
    if calls and calls[0]["response"] is not None:
        return _Part(1.0, "the service answers")
    if context.charged(p.charged_by):
        return None
    return _Part(0.0, "no answer from the service", "The service does not answer while all run together.")

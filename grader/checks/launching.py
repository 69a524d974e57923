"""Checks of a launch file: that it loads, what it declares and starts, and that it works when it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from grader.checks.finding import (
    Context,
    Parameters,
    Share,
    failed,
    graded,
    inconclusive,
    missing_artifact,
    not_reached,
    passed,
)
from grader.evidence.timing import timing_of
from grader.result import Finding, Outcome, Where


def plan_of(context: Context, step: str) -> Mapping[str, Any] | None:
    """Return the plan that a step made of the launch file, if it was reached."""
    run = context.session.step(step)
    plan = run.result.get("plan") if run is not None else None
    return plan if isinstance(plan, dict) else None


class LaunchLoads(Parameters):
    """The launch file can be evaluated as `ros2 launch` would."""

    artifact: str
    step: str


#: Problems of a plan that come later than loading: the file itself is in order.
_LATER_PROBLEMS = frozenset({"package_not_found", "executable_not_found"})


def _spot(context: Context, problem: Mapping[str, Any]) -> tuple[Where, ...]:
    if problem.get("file"):
        return (Where(file=str(problem["file"]), line=int(problem.get("line") or 0) or None),)
    return (context.where(),)


def launch_loads(context: Context, p: LaunchLoads) -> Finding:
    """Judge the evaluation; a module that we do not have is no fault of the student's."""
    expected = "a launch description without an error"
    if (missing := missing_artifact(context, p.artifact, expected)) is not None:
        return missing
    plan = plan_of(context, p.step)
    if plan is None:
        return inconclusive(expected, "not evaluated", "The recording does not hold an evaluation of the launch file.")
    problem = plan.get("problem") or {}
    if plan["outcome"] == "not_assessable":
        return inconclusive(expected, str(problem.get("message", "")), "The grader cannot evaluate this launch file.", where=_spot(context, problem))
    if plan["outcome"] == "error" and problem.get("kind") not in _LATER_PROBLEMS:
        return failed(expected, str(problem["message"]), str(problem["message"]), hint=str(problem.get("remedy", "")), where=_spot(context, problem))
    notes = [f"{w['message']} ({w.get('file')}:{w.get('line')})" for w in plan.get("warnings", [])]
    processes, arguments = plan.get("processes", []), plan.get("arguments", [])
    return passed(expected, f"{len(processes)} processes, {len(arguments)} arguments", where=(context.where(),), notes=notes)


class WantedArgument(Parameters):
    """A launch argument with its default."""

    name: str
    default: str


class LaunchArguments(Parameters):
    """The launch file declares arguments with defaults; each is a part, half for being declared."""

    step: str
    arguments: tuple[WantedArgument, ...]


def _same(a: Any, b: Any) -> bool:
    """Whether two values mean the same: 100 and "100.0", True and "true"."""
    if str(a).strip().lower() == str(b).strip().lower():
        return True
    try:
        return not isinstance(a, bool) and not isinstance(b, bool) and float(a) == float(b)
    except (TypeError, ValueError):
        return False


def launch_arguments(context: Context, p: LaunchArguments) -> Finding:
    """Judge the declared arguments by the plan."""
    expected = ", ".join(f"{a.name} = {a.default!r}" for a in p.arguments)
    plan = plan_of(context, p.step) or {}
    declared = {a["name"]: a for a in plan.get("arguments", [])}
    parts, reasons, spots = [], [], []
    for wanted in p.arguments:
        got = declared.get(wanted.name)
        if got is None:
            parts.append(0.0)
            others = [n for n in declared if n not in {a.name for a in p.arguments}]
            reasons.append(f"The argument {wanted.name} is not declared" + (f"; declared are {', '.join(others)}." if others else "."))
            continue
        spots.append(Where(file=got.get("file"), line=got.get("line")))
        right = got.get("default") is not None and _same(got["default"], wanted.default)
        parts.append(1.0 if right else 0.5)
        if not right:
            default = "no default" if got.get("default") is None else f"the default {got['default']!r}"
            reasons.append(f"The argument {wanted.name} has {default}; {wanted.default!r} is asked for.")
    measured = ", ".join(f"{n} = {a.get('default')!r}" for n, a in declared.items()) or "no arguments"
    return graded(sum(parts) / len(parts), expected, measured, " ".join(reasons), where=spots or (context.where(),))


class WantedNode(Parameters):
    """A node that the launch file starts."""

    node: str
    artifact: str
    executable: str
    charged_by: str


class LaunchNodes(Parameters):
    """The launch file starts nodes under their names; each is a part."""

    nodes: tuple[WantedNode, ...]


def _entry_for(plan: Mapping[str, Any], wanted: WantedNode) -> Mapping[str, Any] | None:
    """Return the plan's process that was meant: by node name, else by executable."""
    short = wanted.node.rsplit("/", 1)[-1]
    entries = plan.get("processes", [])
    for entry in entries:
        if entry.get("name") == short:
            return entry  # type: ignore[no-any-return]
    stem = wanted.executable.removesuffix(".py")
    for entry in entries:
        if str(entry.get("executable", "")).removesuffix(".py") == stem:
            return entry  # type: ignore[no-any-return]
    return None


def _charged(context: Context, check: str) -> bool:
    """Whether a check has already taken points for the fault."""
    finding = context.findings.get(check)
    return finding is not None and finding.outcome in (Outcome.FAILED, Outcome.PARTIAL, Outcome.NOT_REACHED)


def launch_nodes(context: Context, p: LaunchNodes) -> Finding:
    """Judge each node by the plan, and by the graph when it was really started."""
    expected = ", ".join(n.node for n in p.nodes)
    plan = context.session.record.plan or {}
    problem = plan.get("problem") or {}
    if plan.get("outcome") == "error":
        return _unresolved(context, p, expected, plan, problem)
    parts, reasons, notes, spots = [], [], [], []
    for wanted in p.nodes:
        share, reason, note = _judge_node(context, plan, wanted)
        parts.append(share)
        reasons += [reason] if reason else []
        notes += [note] if note else []
        entry = _entry_for(plan, wanted)
        spots += [Where(file=entry.get("file"), line=entry.get("line"))] if entry and share < 1 else []
    up = [n for n in context.session.nodes if n not in context.reference_nodes]
    measured = ", ".join(up) or "no node of the student's in the graph"
    return graded(sum(parts) / len(parts), expected, measured, " ".join(reasons), where=spots or (context.where(),), notes=notes)


def _unresolved(context: Context, p: LaunchNodes, expected: str, plan: Mapping[str, Any], problem: Mapping[str, Any]) -> Finding:
    """Judge a plan in which a package or executable was not found: `ros2 launch` would start nothing.

    An executable whose artifact was not handed in is charged where the artifact is.
    """
    missing = [n for n in p.nodes if context.path_of(n.artifact) is None]
    message = str(problem.get("message", ""))
    if missing and any(n.executable in message for n in missing):
        note = f"{message} The missing file is charged elsewhere."
        return passed(expected, "described, but a file is missing", where=_spot(context, problem), notes=(note,))
    found = [n for n in p.nodes if _entry_for(plan, n) is not None]
    share = 0.5 * max(0, len(found) - 1) / len(p.nodes) if found else 0.0
    reason = f"{message} `ros2 launch` stops there and starts nothing."
    return graded(share, expected, "nothing was started", reason, hint=str(problem.get("remedy", "")), where=_spot(context, problem))


def _judge_node(context: Context, plan: Mapping[str, Any], wanted: WantedNode) -> tuple[float, str, str]:
    """Return the share, the reason for what is lost, and a note where somebody else charges for it."""
    entry = _entry_for(plan, wanted)
    if wanted.node in context.session.nodes:
        return 1.0, "", ""
    if entry is None:
        if context.path_of(wanted.artifact) is None:
            return 0.0, f"The launch file starts no {wanted.executable}.", ""
        return 0.0, f"Nothing in the launch file starts {wanted.executable}.", ""
    name = wanted.node.rsplit("/", 1)[-1]
    run = context.session.process(str(entry.get("id")))
    if entry.get("name") in (name, None) and _charged(context, wanted.charged_by):
        return 1.0, "", f"{wanted.node} did not come up by its own fault, which is charged in {wanted.charged_by}."
    used = context.session.used(wanted.node)
    if entry.get("name") not in (name, None) or used != wanted.node:
        return 0.5, f"{wanted.executable} runs under the name {entry.get('name') or used}, not {name}.", ""
    if run is None:
        return 0.0, f"{wanted.executable} was not started.", ""
    said = f", saying {run.output[-1].text!r}" if run.output else ""
    state = f"ended with status {run.exit_status}{said}" if run.exited_ns and not run.interrupted_ns else "ran, but no such node appeared"
    return 0.0, f"{wanted.executable} {state}.", ""


class WantedNodeParameter(Parameters):
    """A parameter of a launched node, with the value for the default arguments and for others."""

    node: str
    artifact: str
    step: str
    name: str
    value: Any
    other: Any = None


class LaunchParameters(Parameters):
    """Parameters reach the running nodes, and follow the launch arguments; each is a part."""

    parameters: tuple[WantedNodeParameter, ...]
    other_step: str


def launch_parameters(context: Context, p: LaunchParameters) -> Finding:
    """Judge values in the running nodes, or in the plan where a node does not declare the parameter."""
    expected = ", ".join(f"{w.node} {w.name} = {w.value!r}" for w in p.parameters)
    plan, other = context.session.record.plan or {}, plan_of(context, p.other_step) or {}
    parts, reasons, texts = [], [], []
    for wanted in p.parameters:
        share, reason, text = _judge_parameter(context, wanted, plan, other)
        parts.append(share)
        texts.append(text)
        reasons += [reason] if reason else []
    return graded(sum(parts) / len(parts), expected, ", ".join(texts), " ".join(reasons), where=(context.where(),))


_MISSING = object()


def _planned(plan: Mapping[str, Any], wanted: WantedNodeParameter) -> Any:
    """Return a parameter's value in a plan; the last one given wins."""
    short, value = wanted.node.rsplit("/", 1)[-1], _MISSING
    for entry in plan.get("processes", []):
        executable = str(entry.get("executable", "")).removesuffix(".py")
        if entry.get("name") != short and not (entry.get("name") is None and executable in wanted.node):
            continue
        for parameter in entry.get("parameters", []):
            if parameter.get("name") == wanted.name:
                value = parameter.get("value")
            elif isinstance(parameter.get("content"), dict):
                value = _in_file(parameter["content"], wanted, value)
    return value


def _in_file(content: Mapping[str, Any], wanted: WantedNodeParameter, value: Any) -> Any:
    short = wanted.node.rsplit("/", 1)[-1]
    for key in ("/**", short, wanted.node):
        section = content.get(key)
        parameters = section.get("ros__parameters", {}) if isinstance(section, dict) else {}
        if isinstance(parameters, dict) and wanted.name in parameters:
            value = parameters[wanted.name]
    return value


def _judge_parameter(
    context: Context, wanted: WantedNodeParameter, plan: Mapping[str, Any], other: Mapping[str, Any]
) -> tuple[float, str, str]:
    planned = _planned(plan, wanted)
    step = context.session.step(wanted.step)
    running = (step.result.get("values", {}) if step is not None else {}).get(wanted.name)
    short = wanted.node.rsplit("/", 1)[-1]
    value = running["value"] if running is not None else planned
    if value is _MISSING:
        return 0.0, f"The launch file gives {short} no {wanted.name}.", f"{short}.{wanted.name} missing"
    text = f"{short}.{wanted.name} = {value!r}"
    if running is None and step is not None and step.outcome == "done" and wanted.name in step.result.get("declared", []):
        return 0.0, f"{wanted.name} of {short} could not be read.", text
    if not _same(value, wanted.value):
        return 0.0, f"{wanted.name} of {short} is {value!r}, not {wanted.value!r}.", text
    if planned is _MISSING:
        return 0.0, f"The launch file gives {short} no {wanted.name}; {value!r} is the node's own default.", text
    if wanted.other is None:
        return 1.0, "", text
    changed = _planned(other, wanted)
    if changed is not _MISSING and _same(changed, wanted.other):
        return 1.0, "", text
    shown = "nothing" if changed is _MISSING else repr(changed)
    return 0.5, f"{wanted.name} of {short} is not wired to its launch argument: with another argument it is {shown}, not {wanted.other!r}.", text


class TogetherCommands(Parameters):
    """Commands arrive as they do alone."""

    topic: str
    alone_session: str
    charged_by: str
    window: str
    least_share: Share = 0.8


class TogetherFollows(Parameters):
    """The arm moves as it is commanded."""

    topic: str
    command: str
    field: str
    index: int
    charged_by: str


class TogetherAnswers(Parameters):
    """The service answers."""

    step: str
    charged_by: str


class LaunchTogether(Parameters):
    """The launched nodes and the arm work together; each of the three parts counts the same."""

    commands: TogetherCommands
    follows: TogetherFollows
    answers: TogetherAnswers


def launch_together(context: Context, p: LaunchTogether) -> Finding:
    """Judge what happened while all ran; a part whose node is at fault by itself is left out."""
    expected = "commands at the rate the publisher has alone, an arm that follows, a service that answers"
    parts = [_commands_come(context, p.commands), _arm_follows(context, p.follows), _service_answers(context, p.answers)]
    judged = [part for part in parts if part is not None]
    if not judged:
        return not_reached("Each of the nodes fails by its own fault, which is charged in its own criterion.", expected=expected)
    measured = "; ".join(text for _, text, _ in judged)
    reasons = " ".join(reason for share, _, reason in judged if share < 1)
    return graded(sum(s for s, _, _ in judged) / len(judged), expected, measured, reasons, where=(context.where(p.commands.topic),))


def _commands_come(context: Context, p: TogetherCommands) -> tuple[float, str, str] | None:
    timing = timing_of(context.session.stream(p.topic), context.session.window(p.window))
    alone = context.sessions.get(p.alone_session)
    alone_timing = timing_of(alone.stream(p.topic), alone.window(p.window)) if alone is not None else None
    if timing is None:
        if _charged(context, p.charged_by):
            return None
        return 0.0, "no commands", "No commands came while all ran together; do the nodes follow the simulation's clock?"
    if alone_timing is None:
        return 1.0, f"commands at {timing.rate_hz:.1f} Hz", ""
    share = min(1.0, timing.rate_hz / alone_timing.rate_hz / p.least_share)
    text = f"commands at {timing.rate_hz:.1f} Hz ({alone_timing.rate_hz:.1f} Hz alone)"
    return share, text, f"Commands come at {timing.rate_hz:.1f} Hz, while alone they come at {alone_timing.rate_hz:.1f} Hz."


def _arm_follows(context: Context, p: TogetherFollows) -> tuple[float, str, str] | None:
    command, state = (context.session.numeric(t, p.field) for t in (p.command, p.topic))
    if command is None or state is None or max(command.values.shape[1], state.values.shape[1]) <= p.index:
        return None
    if command.values.shape[1] != state.values.shape[1] or float(np.ptp(command.values[:, p.index])) < 1e-3:
        return None  # The arm takes no commands of another length, and cannot follow what does not move.
    measured = np.interp(command.source_ns, state.source_ns, state.values[:, p.index])
    half = len(measured) // 2
    error = float(np.sqrt(np.mean((measured[half:] - command.values[half:, p.index]) ** 2)))
    scale = float(np.sqrt(np.mean(command.values[half:, p.index] ** 2))) + 0.05
    text = f"the arm follows within {error:.3f} rad"
    return (1.0 if error < scale else 0.0), text, "The arm does not follow the commands."


def _service_answers(context: Context, p: TogetherAnswers) -> tuple[float, str, str] | None:
    step = context.session.step(p.step)
    calls: Sequence[Mapping[str, Any]] = step.result.get("calls", []) if step is not None else []
    if calls and calls[0]["response"] is not None:
        return 1.0, "the service answers", ""
    return None if _charged(context, p.charged_by) else (0.0, "no answer from the service", "The service does not answer while all run together.")

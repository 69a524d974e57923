"""The action of the step `set_parameters`: valid values, or values that the node must refuse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from grader.evidence.near_miss import Candidate, near_miss
from grader.lab.steps.base import Answer
from grader.lab.steps.set_parameters import SetParametersResult, SetParametersStep
from grader.live.ros_node.plain import plain
from grader.live.ros_node.probe import Probe
from grader.live.ros_node.steps.get_parameters import NO_ANSWER, ParameterServices

_STANDARD_PARAMETERS = ("use_sim_time", "start_type_description_service")


def set_parameters(probe: Probe, step: SetParametersStep) -> Answer:
    """Set parameters; one of another type, or with a misspelt name, as the student has it.

    Other checks find these faults. This step shows the effect of the parameter.
    """
    node = ParameterServices(probe, step.node, step.timeout_s)
    if step.refusal_expected:
        return _set_invalid(node, step.values)
    refused = node.refused(step.values)
    if refused is None:
        return Answer("timeout", SetParametersResult(NO_ANSWER, node.name))
    names: dict[str, str] = {}
    if refused:
        names = _set_as_meant(node, step.values, refused)
    outcome = "failed" if refused else "done"
    return Answer(outcome, _result(node, refused=refused, names=names or None))


def _set_as_meant(
    node: ParameterServices, values: Mapping[str, Any], refused: dict[str, str]
) -> dict[str, str]:
    """Set refused values again, and take those from `refused` that were accepted; returns the names as spelt there."""
    names: dict[str, str] = {}
    held = node.all_values()
    for name in tuple(refused):
        own = name if name in held else _misspelt(name, values, held)
        if own is None:
            continue
        if node.refused({own: in_type_of(held[own], values[name])}) == {}:
            del refused[name]
            if own != name:
                names[name] = own
    return names


def _set_invalid(node: ParameterServices, wanted: Mapping[str, Any]) -> Answer:
    """Set values that the node must refuse, and restore those that it accepted, for the steps that follow.

    A number is sent in the type of the parameter, because rclpy itself refuses another type.
    """
    held = node.all_values()
    before = {name: held[name] for name in wanted if name in held}
    sent = {name: in_type_of(before.get(name), value) for name, value in wanted.items()}
    refused = node.refused(sent)
    after: dict[str, Any] = {}
    if refused is not None:
        after = {name: value for name, value in node.all_values().items() if name in wanted}
    changed = _changed(before, after)
    if changed:
        node.refused(changed)
    is_answered = refused is not None and before.keys() == after.keys()
    problem = None if is_answered else NO_ANSWER
    result = _result(node, problem, refused=refused or {}, before=before, after=after)
    return Answer("done" if is_answered else "timeout", result)


def _changed(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Return the earlier values of the parameters that have another value now."""
    changed = {}
    for name, value in before.items():
        if name in after and after[name] != value:
            changed[name] = value
    return changed


def _result(
    node: ParameterServices, problem: str | None = None, **found: Any
) -> SetParametersResult:
    """Return a result, cut to the size that is passed on of a message."""
    kept = {key: value for key, value in found.items() if value is not None}
    return SetParametersResult(problem, **plain({"node": node.name, **kept}))


def _misspelt(name: str, values: Mapping[str, Any], held: Mapping[str, Any]) -> str | None:
    """Return the declared parameter that was meant by a name, if one of the value's type is like it."""
    candidates = []
    for own, value in held.items():
        is_other = own not in values and own not in _STANDARD_PARAMETERS
        if is_other and type(value) is type(values[name]):
            candidates.append(Candidate(own, ""))
    near = near_miss(name, "", candidates)
    return None if near is None else near.name


def in_type_of(held: Any, value: Any) -> Any:
    """Return a parameter's new value in the type of the value that it holds: false becomes "false" or "False"."""
    if isinstance(held, str):
        text = str(value)
        if isinstance(value, bool):
            text = text.lower()
        return text.capitalize() if held[:1].isupper() else text
    if not isinstance(held, (bool, int, float)):
        return value
    try:
        return type(held)(value)
    except (TypeError, ValueError):
        return value

"""The action of the step `get_parameters`, and the parameter services of a node, which other steps use too."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rclpy.parameter import Parameter, parameter_value_to_python

from grader.lab.steps.base import Answer
from grader.lab.steps.get_parameters import (
    GetParametersResult,
    GetParametersStep,
    ParameterValue,
)
from grader.live.ros_node.plain import plain
from grader.live.ros_node.probe import Probe

#: Problem of a step without an answer of the node.
NO_ANSWER = "the node's parameter services do not answer"
#: Names and types of the services for reading.
_LIST = ("list_parameters", "ListParameters")
_GET = ("get_parameters", "GetParameters")
#: Names of a node's parameters that are passed on.
_MOST_DECLARED = 200


def get_parameters(probe: Probe, step: GetParametersStep) -> Answer:
    """Read the parameters with some names."""
    node = ParameterServices(probe, step.node, step.timeout_s)
    node.make_clients()
    declared = node.declared()
    if declared is None:
        return Answer("timeout", GetParametersResult(NO_ANSWER, node.name))
    values = node.values([name for name in step.names if name in declared])
    if values is None:
        return Answer("timeout", GetParametersResult(NO_ANSWER, node.name))
    names = plain(declared[:_MOST_DECLARED])
    return Answer("done", GetParametersResult(node=node.name, declared=names, values=values))


class ParameterServices:
    """The parameter services of a student's node; each method returns None if the node does not answer."""

    def __init__(self, probe: Probe, node: str, timeout_s: float) -> None:
        self._probe = probe
        self._timeout_s = timeout_s
        #: Full name that the student uses.
        self.name = probe.node_name(node)

    def make_clients(self) -> None:
        """Make the clients for reading at once if the node has the services, so that there is one wait for both."""
        offered = {service.name for service in self._probe.watch.last.services}
        for operation, kind in (_LIST, _GET):
            if f"{self.name}/{operation}" in offered:
                self._probe.make_client(f"{self.name}/{operation}", f"rcl_interfaces/srv/{kind}")

    def _ask(self, operation: str, kind: str, **fields: Any) -> Any:
        service, service_type = f"{self.name}/{operation}", f"rcl_interfaces/srv/{kind}"
        return self._probe.ask(service, service_type, self._timeout_s, fields)

    def declared(self) -> list[str] | None:
        """Return the names of all parameters."""
        listed = self._ask(*_LIST)
        return None if listed is None else list(listed.result.names)

    def values(self, names: list[str]) -> dict[str, ParameterValue] | None:
        """Return the values of parameters."""
        got = self._ask(*_GET, names=names)
        if got is None:
            return None
        values = {}
        for name, value in zip(names, got.values, strict=False):
            kind = Parameter.Type(value.type).name.lower()
            values[name] = ParameterValue(kind, plain(parameter_value_to_python(value)))
        return values

    def all_values(self) -> dict[str, Any]:
        """Return the values of all parameters, as far as they are passed on; empty if there was no answer."""
        declared = self.declared()
        if declared is None:
            return {}
        values = self.values(declared[:_MOST_DECLARED]) or {}
        return {name: each.value for name, each in values.items()}

    def refused(self, values: Mapping[str, Any]) -> dict[str, str] | None:
        """Set parameters, and return the reasons of those that were refused."""
        given = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        answer = self._ask("set_parameters", "SetParameters", parameters=given)
        if answer is None:
            return None
        refused = {}
        for name, result in zip(values, answer.results, strict=False):
            if not result.successful:
                refused[name] = result.reason
        return refused

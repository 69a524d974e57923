"""The registry: every check that a rubric can use, with the model of its parameters.

A check is a pure function of a `Context` and its parameters; it gives a `Finding` and knows nothing
of points.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any, get_type_hints

from pydantic import BaseModel

from grader import yaml_text
from grader.checks import (
    action,
    answers,
    documentation,
    fields,
    latency,
    launch,
    lifecycle,
    motion,
    oracle_values,
    package,
    parameters,
    person,
    properties,
    publisher,
    service,
    silence,
    subscriber,
    transforms,
)
from grader.checks.base import Context
from grader.checks.own import find_own
from grader.checks.preconditions import DOUBTS, missing_file, proof
from grader.checks.situation import Basis, Measurement, first_answer, last_answer
from grader.lab.kept_lab import lab_folder
from grader.lab.lab_code import OwnParameters
from grader.lab.references import OwnCheck, Parameters
from grader.result import Finding, Outcome


class Check(Basis):
    """A check that a rubric can use."""

    @property
    def parameters(self) -> type[Parameters]:
        """The model of its parameters, which its function names."""
        model: type[Parameters] = get_type_hints(self.find)["p"]
        return model

    def judge(self, context: Context, p: BaseModel) -> Finding:
        """Judge one session or submission by the rules about the file, the measurement, and the doubts about it."""
        measurement = Measurement(context=context, check=self, p=p)
        missing = first_answer(measurement, (missing_file,))
        if missing is not None:
            return missing
        finding = replace(measured(measurement), decided_by=measured.__name__)
        if context.recorded is None or finding.outcome is Outcome.NOT_REACHED:
            return finding
        return last_answer(replace(measurement, finding=finding), DOUBTS)


def measured(measurement: Measurement) -> Finding:
    """Measure and give credit; leave the check undecided if delays of the machine make different credit possible."""
    finding = measurement.check.find(measurement.context, measurement.p)
    if finding.where or finding.outcome is Outcome.NOT_REACHED:
        return finding
    return replace(finding, where=proof(measurement.context, measurement.p))


_CHECKS = (
    # A node that publishes.
    Check(publisher.topic_published, by_endpoints=True),
    Check(publisher.topic_rate, by_clock=True),
    Check(publisher.topic_jitter, by_clock=True),
    Check(publisher.offered_qos, by_endpoints=True),
    # A node that listens.
    Check(subscriber.topics_subscribed, by_endpoints=True),
    Check(subscriber.requested_qos, by_endpoints=True),
    Check(subscriber.survives, by_endpoints=True, by_clock=True),
    # A node that serves.
    Check(service.service_offered, by_endpoints=True),
    Check(service.call_answered),
    Check(service.parameters_declared, by_endpoints=True),
    # A node that serves an action.
    Check(action.action_server, by_endpoints=True, by_clock=True),
    Check(answers.call_value),
    # A node with changes of parameters or state while it runs.
    Check(parameters.parameter_effect, by_clock=True),
    Check(parameters.parameter_rejected),
    Check(lifecycle.lifecycle, by_clock=True),
    # Nodes that broadcast transforms.
    Check(transforms.transform_tree, by_clock=True),
    # A launch file.
    Check(launch.launch_loads, by_endpoints=True),
    Check(launch.launch_arguments, by_endpoints=True),
    Check(launch.launch_nodes, by_endpoints=True),
    Check(launch.launch_parameters, by_endpoints=True),
    Check(launch.launch_together, by_clock=True),
    # A package.
    Check(package.package_builds),
    # Contents of messages, and their changes over time.
    Check(fields.field_range, by_clock=True),
    Check(fields.field_matches),
    Check(motion.reaches, by_clock=True),
    Check(oracle_values.topic_equals_oracle, by_clock=True),
    Check(properties.signal_property, by_clock=True),
    # When something is published, and when nothing is.
    Check(latency.message_latency, by_clock=True),
    Check(silence.silent_until, by_clock=True),
    # Written documents.
    Check(documentation.readme),
    Check(documentation.code_explained),
    Check(documentation.concepts_explained),
    # Questions that only a person can judge.
    Check(person.person),
)


#: Checks that earlier versions of the grader had built in, in the folder of the shipped lab: a mapping of their
#: names in recorded rubrics to "file.py:function".
_FORMER_CHECKS = "reference/former_checks.yaml"


@cache
def former_checks() -> dict[str, OwnCheck]:
    """Return the checks that earlier versions of the grader had built in, by their names."""
    file = lab_folder() / _FORMER_CHECKS
    if not file.is_file():
        return {}
    functions = yaml_text.load(file.read_text(encoding="utf-8"))
    return {name: OwnCheck(lab_folder(), function) for name, function in functions.items()}


def check_named(name: str) -> Check:
    """Return a check by its name in a rubric, which may be one of the lab's own."""
    if name in REGISTRY:
        return REGISTRY[name]
    # Its author may not have thought of a clock that was set, which must not cost points.
    return Check(partial(_find_own, name), by_clock=True, of_author=True)


def check_given(name: str, p: BaseModel) -> Check:
    """Return a check by its name and its parameters, with the traits that a check of the lab's own states."""
    check = check_named(name)
    if not isinstance(p, OwnParameters):
        return check
    return replace(check, by_endpoints=p.traits.by_endpoints)


def _find_own(name: str, context: Context, p: Any) -> Finding:
    """Call a lab's own check, or one that was built in once."""
    own = former_checks().get(name) or OwnCheck(context.lab_folder, name)
    return find_own(own, context, p)


#: Checks by their names in a rubric, which are the names of their functions.
REGISTRY = {check.find.__name__: check for check in _CHECKS}

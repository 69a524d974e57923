"""The registry: every check that a rubric can use, with the model of its parameters.

A check is a pure function of a `Context` and its parameters; it gives a `Finding` and knows nothing
of points.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module
from typing import Any, get_type_hints

from pydantic import BaseModel

from grader import yaml_text
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


@dataclass(frozen=True)
class _Place:
    """The module of a check's function in this folder, and the traits of the check, see `Basis`."""

    module: str
    by_endpoints: bool = False
    by_clock: bool = False


class _Checks(Mapping[str, Check]):
    """Checks by their names, which are the names of their functions.

    The module of a check is imported at the first look for it: a rubric uses half of the modules, and each takes 3 ms.
    """

    def __init__(self, places: Mapping[str, _Place]) -> None:
        self._places = places

    def __getitem__(self, name: str) -> Check:
        place = self._places[name]
        module = import_module(f"{__package__}.{place.module}")
        find = getattr(module, name)
        return Check(find, by_endpoints=place.by_endpoints, by_clock=place.by_clock)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


REGISTRY = _Checks(
    {
        # A node that publishes.
        "topic_published": _Place("publisher", by_endpoints=True),
        "topic_rate": _Place("publisher", by_clock=True),
        "topic_jitter": _Place("publisher", by_clock=True),
        "offered_qos": _Place("publisher", by_endpoints=True),
        # A node that listens.
        "topics_subscribed": _Place("subscriber", by_endpoints=True),
        "requested_qos": _Place("subscriber", by_endpoints=True),
        "survives": _Place("subscriber", by_endpoints=True, by_clock=True),
        # A node that serves.
        "service_offered": _Place("service", by_endpoints=True),
        "call_answered": _Place("service"),
        "parameters_declared": _Place("service", by_endpoints=True),
        # A node that serves an action.
        "action_server": _Place("action", by_endpoints=True, by_clock=True),
        "call_value": _Place("answers"),
        # A node with changes of parameters or state while it runs.
        "parameter_effect": _Place("parameters", by_clock=True),
        "parameter_rejected": _Place("parameters"),
        "lifecycle": _Place("lifecycle", by_clock=True),
        # Nodes that broadcast transforms.
        "transform_tree": _Place("transforms", by_clock=True),
        # A launch file.
        "launch_loads": _Place("launch", by_endpoints=True),
        "launch_arguments": _Place("launch", by_endpoints=True),
        "launch_nodes": _Place("launch", by_endpoints=True),
        "launch_parameters": _Place("launch", by_endpoints=True),
        "launch_together": _Place("launch", by_clock=True),
        # A package.
        "package_builds": _Place("package"),
        # Contents of messages, and their changes over time.
        "field_range": _Place("fields", by_clock=True),
        "field_matches": _Place("fields"),
        "reaches": _Place("motion", by_clock=True),
        "topic_equals_oracle": _Place("oracle_values", by_clock=True),
        "signal_property": _Place("properties", by_clock=True),
        # When something is published, and when nothing is.
        "message_latency": _Place("latency", by_clock=True),
        "silent_until": _Place("silence", by_clock=True),
        # Written documents.
        "readme": _Place("documentation"),
        "code_explained": _Place("documentation"),
        "concepts_explained": _Place("documentation"),
        # Questions that only a person can judge.
        "person": _Place("person"),
    }
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

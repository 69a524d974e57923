"""The registry: every check that a rubric can use, with the model of its parameters.

A check is a pure function of a `Context` and its parameters; it gives a `Finding` and knows nothing
of points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from grader.checks import comparison, documentation, launching, reception, services, traffic
from grader.checks.finding import Context
from grader.references import Parameters
from grader.result import Finding


@dataclass(frozen=True)
class Check:
    """A check: its parameters' model and its function.

    Attributes
    ----------
    by_endpoints : bool
        Whether it can be passed without all messages of its topics.
    by_clock : bool
        Whether what it finds wrong may be so since the system's clock was set at some time in the session.
    """

    parameters: type[Parameters]
    judge: Callable[[Context, Any], Finding]
    by_endpoints: bool = False
    by_clock: bool = False


REGISTRY: dict[str, Check] = {
    # A node that publishes.
    "topic_published": Check(traffic.TopicPublished, traffic.topic_published, by_endpoints=True),
    "topic_rate": Check(traffic.TopicRate, traffic.topic_rate),
    "topic_jitter": Check(traffic.TopicJitter, traffic.topic_jitter),
    "message_values": Check(traffic.MessageValues, traffic.message_values),
    "sinusoids": Check(traffic.Sinusoids, traffic.sinusoids),
    "offered_qos": Check(traffic.OfferedQos, traffic.offered_qos, by_endpoints=True),
    # A node that listens.
    "topics_subscribed": Check(reception.TopicsSubscribed, reception.topics_subscribed, by_endpoints=True),
    "reported_series": Check(reception.ReportedSeries, reception.reported_series, by_clock=True),
    "reported_statistics": Check(reception.ReportedStatistics, reception.reported_statistics, by_clock=True),
    "survives": Check(reception.Survives, reception.survives, by_endpoints=True, by_clock=True),
    "report_share": Check(reception.ReportShare, reception.report_share),
    # A node that serves.
    "service_offered": Check(services.ServiceOffered, services.service_offered, by_endpoints=True),
    "call_answered": Check(services.CallAnswered, services.call_answered),
    "call_gated": Check(services.CallGated, services.call_gated),
    "parameters_declared": Check(services.ParametersDeclared, services.parameters_declared, by_endpoints=True),
    "calls_in_time": Check(services.CallsInTime, services.calls_in_time, by_clock=True),
    # A launch file.
    "launch_loads": Check(launching.LaunchLoads, launching.launch_loads, by_endpoints=True),
    "launch_arguments": Check(launching.LaunchArguments, launching.launch_arguments, by_endpoints=True),
    "launch_nodes": Check(launching.LaunchNodes, launching.launch_nodes, by_endpoints=True),
    "launch_parameters": Check(launching.LaunchParameters, launching.launch_parameters, by_endpoints=True),
    "launch_together": Check(launching.LaunchTogether, launching.launch_together, by_clock=True),
    # A tool that compares QoS profiles.
    "ends_by_itself": Check(comparison.EndsByItself, comparison.ends_by_itself, by_endpoints=True, by_clock=True),
    "topics_carry_traffic": Check(
        comparison.TopicsCarryTraffic, comparison.topics_carry_traffic, by_endpoints=True, by_clock=True
    ),
    "qos_profiles": Check(comparison.QosProfiles, comparison.qos_profiles, by_endpoints=True),
    "reported_traffic": Check(comparison.ReportedTraffic, comparison.reported_traffic, by_clock=True),
    # What is written.
    "readme": Check(documentation.Readme, documentation.readme),
    "docstrings": Check(documentation.Docstrings, documentation.docstrings),
    "comments": Check(documentation.Comments, documentation.comments),
    "concepts_explained": Check(documentation.ConceptsExplained, documentation.concepts_explained),
}

PARAMETERS_OF: dict[str, type[Parameters]] = {name: check.parameters for name, check in REGISTRY.items()}

__all__ = ["PARAMETERS_OF", "REGISTRY", "Check", "Context"]

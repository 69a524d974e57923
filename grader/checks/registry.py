"""The registry: every check that a rubric can use, with the model of its parameters.

A check is a pure function of a `Context` and its parameters; it gives a `Finding` and knows nothing
of points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel

from grader.checks import documentation, launch, publisher, qos_tool, service, subscriber
from grader.checks.base import Context, undecided
from grader.checks.preconditions import clock_set, explained, missing_artifact, not_assessable_here, proof, unseen
from grader.lab.references import Parameters
from grader.result import Finding, Outcome


@dataclass(frozen=True)
class Check:
    """A check: its parameters' model and its function, which finds the file of its artifact to be there."""

    parameters: type[Parameters]
    find: Callable[[Context, Any], Finding]
    #: Whether it can be passed without all messages of its topics.
    by_endpoints: bool = False
    #: Whether what it finds wrong may be so since the system's clock was set at some time in the session, or in
    #: the window of the check.
    by_clock: bool = False
    #: Kinds of the endpoints or nodes that its parameters name, where nothing but the graph shows them.
    seeks: tuple[str, ...] = ()

    def judge(self, context: Context, p: BaseModel) -> Finding:
        """Judge one session or submission.

        The file of its artifact must be there. What was found is then asked, in this order: whether the program says
        why it shows nothing; whether it needs what is missing where it is graded; whether it made what nobody saw; and
        whether the clock was set in the check's window, or where something is lost, in its session.
        """
        artifact = getattr(p, "artifact", None)
        if (missing := missing_artifact(context, artifact)) is not None:
            return missing
        finding = self.find(context, p)
        if context.recorded is None or finding.outcome is Outcome.NOT_REACHED:
            return finding
        finding = explained(context, p, finding)
        if artifact is not None and self.by_endpoints and finding.outcome is Outcome.FAILED:
            finding = not_assessable_here(context, artifact, finding.expected) or finding
        if self.seeks and finding.outcome in LOST:
            finding = unseen(context, p, finding, self.seeks) or finding
        lost = finding.outcome in LOST
        if self.by_clock and (clock := clock_set(context, p, lost=lost)):
            finding = undecided(finding, clock)
        return replace(finding, where=finding.where or proof(context, p))


#: Outcomes by which points are lost.
LOST = (Outcome.FAILED, Outcome.PARTIAL)

REGISTRY: dict[str, Check] = {
    # A node that publishes.
    "topic_published": Check(
        publisher.TopicPublished, publisher.topic_published, by_endpoints=True, seeks=("publisher",)
    ),
    "topic_rate": Check(publisher.TopicRate, publisher.topic_rate, by_clock=True),
    "topic_jitter": Check(publisher.TopicJitter, publisher.topic_jitter, by_clock=True),
    "message_values": Check(publisher.MessageValues, publisher.message_values),
    "sinusoids": Check(publisher.Sinusoids, publisher.sinusoids),
    "offered_qos": Check(publisher.OfferedQos, publisher.offered_qos, by_endpoints=True),
    # A node that listens.
    "topics_subscribed": Check(
        subscriber.TopicsSubscribed, subscriber.topics_subscribed, by_endpoints=True, seeks=("subscription",)
    ),
    "reported_series": Check(subscriber.ReportedSeries, subscriber.reported_series, by_clock=True),
    "reported_statistics": Check(subscriber.ReportedStatistics, subscriber.reported_statistics, by_clock=True),
    "survives": Check(subscriber.Survives, subscriber.survives, by_endpoints=True, by_clock=True),
    # A node that serves.
    "service_offered": Check(service.ServiceOffered, service.service_offered, by_endpoints=True, seeks=("service",)),
    "call_answered": Check(service.CallAnswered, service.call_answered),
    "call_gated": Check(service.CallGated, service.call_gated),
    "parameters_declared": Check(service.ParametersDeclared, service.parameters_declared, by_endpoints=True),
    "calls_in_time": Check(service.CallsInTime, service.calls_in_time, by_clock=True),
    # A launch file.
    "launch_loads": Check(launch.LaunchLoads, launch.launch_loads, by_endpoints=True),
    "launch_arguments": Check(launch.LaunchArguments, launch.launch_arguments, by_endpoints=True),
    "launch_nodes": Check(launch.LaunchNodes, launch.launch_nodes, by_endpoints=True, seeks=("node",)),
    "launch_parameters": Check(launch.LaunchParameters, launch.launch_parameters, by_endpoints=True),
    "launch_together": Check(launch.LaunchTogether, launch.launch_together, by_clock=True),
    # A tool that compares QoS profiles.
    "ends_by_itself": Check(qos_tool.EndsByItself, qos_tool.ends_by_itself, by_endpoints=True, by_clock=True),
    "topics_carry_traffic": Check(
        qos_tool.TopicsCarryTraffic, qos_tool.topics_carry_traffic, by_endpoints=True, by_clock=True
    ),
    "qos_profiles": Check(
        qos_tool.QosProfiles, qos_tool.qos_profiles, by_endpoints=True, seeks=("publisher", "subscription")
    ),
    "reported_traffic": Check(qos_tool.ReportedTraffic, qos_tool.reported_traffic, by_clock=True),
    # What is written.
    "readme": Check(documentation.Readme, documentation.readme),
    "code_explained": Check(documentation.CodeExplained, documentation.code_explained),
    "concepts_explained": Check(documentation.ConceptsExplained, documentation.concepts_explained),
}

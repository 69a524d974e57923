"""The registry: every check that a rubric can use, with the model of its parameters.

A check is a pure function of a `Context` and its parameters; it gives a `Finding` and knows nothing
of points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from grader.checks import comparison, documentation, launching, reception, services, traffic
from grader.checks.finding import Context, missing_artifact, runs_elsewhere, undecided
from grader.evidence.recorded import Span, clock_step_s
from grader.references import Parameters
from grader.result import Finding, Outcome


@dataclass(frozen=True)
class Check:
    """A check: its parameters' model and its function, which finds the file of its artifact to be there.

    Attributes
    ----------
    by_endpoints : bool
        Whether it can be passed without all messages of its topics.
    by_clock : bool
        Whether what it finds wrong may be so since the system's clock was set at some time in the session, or in the
        window of the check.
    """

    parameters: type[Parameters]
    find: Callable[[Context, Any], Finding]
    by_endpoints: bool = False
    by_clock: bool = False

    def judge(self, context: Context, p: BaseModel) -> Finding:
        """Judge one session or submission.

        The file of its artifact must be there. Nothing is decided by a clock that was set in the check's window, nor
        lost by one that was set in its session; nor where nothing was found since the program needs what is missing
        where it is graded.
        """
        artifact = getattr(p, "artifact", None)
        if (missing := missing_artifact(context, artifact)) is not None:
            return missing
        finding = self.find(context, p)
        if context.recorded is None:
            return finding
        if artifact is not None and self.by_endpoints and finding.outcome is Outcome.FAILED:
            finding = runs_elsewhere(context, artifact, finding.expected) or finding
        record, window = context.session.record, getattr(p, "window", None)
        span = context.session.window(window) if window else Span(record.started_ns, record.ended_ns)
        lost = finding.outcome in (Outcome.FAILED, Outcome.PARTIAL)
        if self.by_clock and (lost or window) and span is not None and (step_s := clock_step_s(record, span)):
            return undecided(finding, f"The machine's clock was set by {step_s * 1e3:.1f} ms while this was measured.")
        return finding


REGISTRY: dict[str, Check] = {
    # A node that publishes.
    "topic_published": Check(traffic.TopicPublished, traffic.topic_published, by_endpoints=True),
    "topic_rate": Check(traffic.TopicRate, traffic.topic_rate, by_clock=True),
    "topic_jitter": Check(traffic.TopicJitter, traffic.topic_jitter, by_clock=True),
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

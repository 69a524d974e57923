"""Checks of a subscribing node: its subscriptions, reports on messages and final statistics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pydantic import Field

from grader.checks.base import (
    Context,
    Part,
    credit_of,
    cut_off,
    excused,
    failed,
    graded,
    inconclusive,
    of_parts,
    passed,
    unclear,
    unexplained,
)
from grader.checks.endpoints import (
    OfEndpoint,
    OfferedProfile,
    QosWanted,
    claim_of,
    claimed_at,
    clash,
    qos_as_wanted,
    student_endpoints,
    unheard,
)
from grader.evidence import bounds
from grader.evidence.recorded import Integers
from grader.evidence.text.printed import Report, reports
from grader.lab import references as ref
from grader.lab.references import Parameters, Patterns, Share
from grader.lab.steps.publish import PublishResult, PublishStep
from grader.recording.session import Endpoint, ProcessRun, StepRun
from grader.result import Finding, Outcome


class WantedTopic(Parameters):
    """A topic to which the node subscribes."""

    topic: ref.RosName
    type: ref.MessageType


class TopicsSubscribed(OfEndpoint):
    """A node subscribes to topics, with compatible types and QoS. It needs all topics, so the worst one decides."""

    artifact: ref.Artifact
    topics: tuple[WantedTopic, ...] = Field(min_length=1)
    offered: OfferedProfile = OfferedProfile.model_construct()
    incompatible_costs: Share = Field(
        0.6, description="Share of the credit that a profile which gets nothing costs."
    )
    reliability: ref.Reliability | None = Field(
        None, description="What the lab lets them request; another one is only noted."
    )
    rest: Share = Field(
        1.0,
        description="Share of the credit left to dependent checks if the node hears nothing as it is.",
    )
    launched_in: ref.SessionId | None = Field(
        None,
        description="Session of the launch file; if it gives the node the right topics, the rest earns all.",
    )
    launched_by: ref.Artifact | None = Field(
        None, description="The launch file of that session. A missing one repairs nothing."
    )

    def sought(self) -> Sequence[ref.Sought]:
        """Return the subscriptions."""
        return [ref.Sought("subscription", wanted.topic, wanted.type) for wanted in self.topics]


def topics_subscribed(context: Context, p: TopicsSubscribed) -> Finding:
    """Judge the subscriptions from discovery."""
    expected = ", ".join(f"{wanted.type} from {wanted.topic}" for wanted in p.topics)
    endpoints = {}
    nodes = []
    for wanted in p.topics:
        found = student_endpoints(context, wanted.topic, "subscription")
        endpoints[wanted] = found
        nodes += [endpoint.node for endpoint in found]
    if not nodes:
        fallback = "The node subscribed to none of the topics, nor to any of a similar name."
        return unexplained(failed(expected, "no subscription in the graph", fallback))
    parts = [_judge_subscription(context, p, wanted, endpoints[wanted]) for wanted in endpoints]
    least = min(part.share for part in parts)
    parts = [replace(part, share=least) for part in parts]
    finding = of_parts(expected, parts, costs=p.node_faults(nodes), where=(context.location(),))
    if any(unheard(context, wanted.topic) for wanted in p.topics):
        return cut_off(finding)
    if least < 1:
        return _with_less_for_the_rest(context, p, finding)
    return finding


def _with_less_for_the_rest(context: Context, p: TopicsSubscribed, finding: Finding) -> Finding:
    """Let the dependent checks lose too, unless the launch file repairs the subscriptions."""
    if p.rest == 1 or _right_as_launched(context, p):
        return finding
    return replace(finding, passes_on=credit_of(p.rest))


def _right_as_launched(context: Context, p: TopicsSubscribed) -> bool:
    """Tell whether the launch file, by its remappings, gives a node subscriptions on all wanted topics.

    True as well if its session was not recorded, though the file is there.
    """
    if p.launched_in is None:
        return False
    launched = context.sessions.get(p.launched_in)
    if launched is None:
        return _has_file(context, p.launched_by)
    for wanted in p.topics:
        found = launched.endpoints_on(wanted.topic, "subscription", context.reference_nodes)
        fitting = [each for each in found if _is_heard(p, wanted, each)]
        if not fitting:
            return False
    return True


def _has_file(context: Context, artifact: str | None) -> bool:
    """Tell whether the file of an artifact is there; True if none is named."""
    if artifact is None:
        return True
    return context.path_of(artifact) is not None


def _is_heard(p: TopicsSubscribed, wanted: WantedTopic, endpoint: Endpoint) -> bool:
    """Tell whether a subscription has the wanted name and type, and a profile compatible with the offered one."""
    if (endpoint.topic, endpoint.type) != (wanted.topic, wanted.type):
        return False
    return clash(endpoint, p.offered) is None


def _judge_subscription(
    context: Context, p: TopicsSubscribed, wanted: WantedTopic, endpoints: Sequence[Endpoint]
) -> Part:
    if not endpoints:
        reason = f"There is no subscription on {wanted.topic}, nor on a similar name."
        return Part(1 - p.other_name_costs, f"nothing on {wanted.topic}", reason)
    used = context.session.used(wanted.topic)
    endpoint = _fitting(endpoints, wanted.type)
    costs = p.faults("topic", (wanted.topic, wanted.type), (used, endpoint.type), [endpoint.node])
    policy = clash(endpoint, p.offered) or unheard(context, wanted.topic)
    if policy is not None:
        arrives = "so no message would arrive from the lab's publisher."
        clashing = f"On {used} the two sides are incompatible in {policy}, {arrives}"
        costs.append((p.incompatible_costs, clashing))
    notes = []
    if _is_weaker(p, endpoints):
        best_effort = f"The subscription on {used} requests BEST_EFFORT"
        notes.append(f"{best_effort}; with RELIABLE a lost message would be sent again.")
    text = f"{endpoint.type} from {used} ({endpoint.qos.reliability}, {endpoint.qos.durability})"
    lost = max((cost for cost, _ in costs), default=0.0)
    reason = " ".join(words for _, words in costs)
    claim = claim_of(context, "subscription", wanted.topic)
    return Part(1 - lost, text, reason, where=claimed_at(claim), notes=tuple(notes))


def _fitting(endpoints: Sequence[Endpoint], wanted_type: str) -> Endpoint:
    """Return the first endpoint of the wanted type, or else the first one."""
    for endpoint in endpoints:
        if endpoint.type == wanted_type:
            return endpoint
    return endpoints[0]


def _is_weaker(p: TopicsSubscribed, endpoints: Sequence[Endpoint]) -> bool:
    """Tell whether a subscription requests best effort where the lab has reliable ones."""
    if p.reliability != "reliable":
        return False
    return any(endpoint.qos.reliability == "best_effort" for endpoint in endpoints)


class RequestedQos(QosWanted):
    """A subscription requests a QoS profile. History and depth come from the source and only advise."""


def requested_qos(context: Context, p: RequestedQos) -> Finding:
    """Judge reliability and durability from discovery; history and depth only advise."""
    return qos_as_wanted(context, p, "subscription", "requests")


class Alternative(Parameters):
    """A known way to get other numbers, and how much credit it leaves."""

    parameters: Mapping[str, Any]
    meaning: str
    credit: float = Field(0.0, ge=0, le=1)
    cause: str | None = Field(
        None,
        description="Name of the mistake. Its dearest check charges it; its other checks are excused.",
    )
    charged_by: tuple[ref.EarlierCheckId, ...] = Field(
        (), description="Where one of these checks took points, none are lost here."
    )

    def charge(self, context: Context, part: Part) -> Part:
        """Charge a part for this mistake, unless another check does."""
        return context.charge_part(part, self.cause, self.charged_by)

    def explains(self, context: Context, finding: Finding, least: float = 0.0) -> Finding:
        """State the credit of numbers that match this mistake, and name it.

        The share of right numbers is the least credit. A mistake that costs nothing is excused.
        """
        meant = f"Your numbers match {self.meaning}."
        reason = f"{finding.reason} {meant}".strip()
        share = max(self.credit, least)
        where = finding.where
        judged = graded(
            share, finding.expected, finding.measured, reason, where=where, notes=finding.notes
        )
        if judged.outcome is Outcome.PASSED:
            return excused(judged, meant)
        return context.charge(judged, self.cause, self.charged_by)


def lost_share(
    context: Context, runs: Iterable[ProcessRun], topics: Iterable[str], times_ns: Integers
) -> float:
    """Return the greatest share of messages that one of some processes may have lost.

    A process loses nothing while the queues of its subscriptions have room.

    Parameters
    ----------
    times_ns
        int64[n]: Source timestamps of the messages.
    """
    depth = min(_queue_depth(context, topic) for topic in topics)
    return bounds.lost_share(context.session, runs, depth, times_ns)


def _queue_depth(context: Context, topic: str) -> int:
    """Return the queue depth that the node gave for a subscription; 1 if it is not known."""
    claim = claim_of(context, "subscription", topic)
    if claim is None or claim.qos is None:
        return 1
    return claim.qos.depth


class Survives(Parameters):
    """A process is still alive after a step with difficult messages."""

    artifact: ref.Artifact
    step: ref.AnyStep
    until: ref.AnyStep | None = Field(
        None, description="A later step; what ends after that one's start has survived."
    )
    quiet: Patterns = Field(
        (), description="A report that cannot be made yet, before the later step starts."
    )
    quiet_credit: float = Field(
        0.5, ge=0, le=1, description="Credit of a node that makes it all the same."
    )


def survives(context: Context, p: Survives) -> Finding:
    """Judge whether the artifact's first process and its node outlived the step.

    A program that starts its node again does not pass.
    """
    expected = "the node goes on after these messages"
    step = context.session.step(p.step)
    processes = context.session.processes_of(p.artifact)
    if step is None or not processes or step.outcome == "failed":
        reason = "The recording does not show what the node did then."
        return inconclusive(expected, "the step was not reached", reason)
    first = processes[0]
    later = None
    if p.until is not None:
        later = context.session.step(p.until)
    until_ns = _tested_until_ns(processes, later)
    if _ended_by_itself(first, until_ns):
        measured = (
            f"it ended with status {first.exit_status} at {_at_s(context, first.exited_ns)} s"
        )
        return unexplained(failed(expected, measured, "The node ended."))
    if _never_matched(context, step):
        reason = "The subscription was not matched in time, so that the node may not have got what was sent."
        return unclear(expected, "it went on", reason)
    replaced_ns = _replaced_ns(context, step, until_ns)
    if replaced_ns is not None:
        measured = f"the program went on; its node ended before {_at_s(context, replaced_ns)} s"
        reason = "The node ended, and the program went on without it or started it again; messages are lost meanwhile."
        return unexplained(failed(expected, measured, reason))
    return _judge_early_reports(context, p, step, later)


def _at_s(context: Context, t_ns: int | None) -> str:
    """Return a time of the system clock as seconds since the session's start."""
    assert t_ns is not None
    return f"{context.session.since_start_s(t_ns):.2f}"


def _tested_until_ns(processes: Sequence[ProcessRun], later: StepRun | None) -> int:
    """Return the start of the second process or of a later step, before which the first must not end."""
    starts_ns = [run.started_ns for run in processes[1:2]]
    if later is not None:
        starts_ns.append(later.started_ns)
    return min(starts_ns, default=2**63)


def _ended_by_itself(run: ProcessRun, until_ns: int) -> bool:
    """Tell whether a process ended without an interrupt, up to a time."""
    if run.exited_ns is None or not run.ended_unasked:
        return False
    return run.exited_ns <= until_ns


def _judge_early_reports(
    context: Context, p: Survives, step: StepRun, later: StepRun | None
) -> Finding:
    """Judge whether a surviving node made reports before there was anything to compare."""
    expected = "the node goes on after these messages"
    early = _early_reports(context, p, step, later)
    if not early:
        return passed(expected, "it went on after them")
    when_s = context.session.since_start_s(early[0].t_ns)
    reason = f"At {when_s:.1f} s it reports {early[0].value:g}, when there is nothing yet to compare with."
    measured = f"it went on; early reports: {len(early)}"
    return graded(p.quiet_credit, f"{expected}, and reports nothing", measured, reason)


def _replaced_ns(context: Context, step: StepRun, until_ns: int) -> int | None:
    """Return when the subscriptions to a step's topic were gone, or when their node subscribed anew.

    None if they lasted.
    """
    topic = PublishStep.given(step).topic
    endpoints = student_endpoints(context, topic, "subscription")
    nodes = {endpoint.gid: endpoint.node for endpoint in endpoints}
    before: set[str] = set()
    for graph in context.session.record.graph:
        there = {endpoint.gid for endpoint in graph.endpoints if endpoint.gid in nodes}
        if graph.t_ns <= step.started_ns:
            before = there
        elif before and graph.t_ns < until_ns and _is_replaced(before, there, nodes):
            return graph.t_ns
    return None


def _is_replaced(before: set[str], there: set[str], nodes: Mapping[str, str]) -> bool:
    """Tell whether no endpoint of before is there, or a new endpoint of one of the same nodes."""
    if not there & before:
        return True
    names = {nodes[gid] for gid in before}
    return any(nodes[gid] in names for gid in there - before)


def _never_matched(context: Context, step: StepRun) -> bool:
    """Tell whether a step published to no subscription, though the student's are compatible."""
    if step.kind != PublishStep.kind or PublishResult.of(step).matched is not False:
        return False
    given = PublishStep.given(step)
    requests = student_endpoints(context, given.topic, "subscription")
    offered = OfferedProfile(durability="transient_local")
    for request in requests:
        if request.type != given.type or clash(request, offered) is not None:
            return False
    return bool(requests)


def _early_reports(
    context: Context, p: Survives, step: StepRun, later: StepRun | None
) -> list[Report]:
    """Return a node's reports on messages with which nothing could be compared yet."""
    if later is None:
        return []
    heard = reports(context.session, p.artifact, p.quiet)
    # A line that explains a missing report may hold the same word, and a number.
    lead_ins = {report.lead_in for report in heard if report.t_ns >= later.started_ns}
    early = []
    for report in heard:
        if step.started_ns <= report.t_ns < later.started_ns and report.lead_in in lead_ins:
            early.append(report)
    return early

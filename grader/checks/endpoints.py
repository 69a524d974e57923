"""Endpoints of the student's nodes: publishers, subscriptions and services by name, type, node and QoS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pydantic import Field

from grader.checks.base import Context, failed, graded
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.recording.session import Claim, Endpoint, Qos
from grader.result import Finding, Location


class OfferedProfile(Parameters):
    """The QoS with which the other side publishes in the lab's words."""

    reliability: ref.Reliability = "reliable"
    durability: ref.Durability = "volatile"


class OfNode(Parameters):
    """What the node is called, and what another name costs."""

    node: ref.RosName | None = Field(
        None, description="Fully qualified name that the node should have."
    )
    other_node_costs: Share = Field(
        0.2, description="Share of the credit that another node name costs."
    )

    def node_faults(self, nodes: Sequence[str]) -> list[tuple[float, str]]:
        """Return what another name of the node behind some endpoints costs; a namespace more is no mistake."""
        wanted = self.node
        if (
            wanted is None
            or not nodes
            or any(n.rsplit("/", 1)[-1] == wanted.rsplit("/", 1)[-1] for n in nodes)
        ):
            return []
        return [(self.other_node_costs, f"The node is named {nodes[0]}, not {wanted}.")]


class OfEndpoint(OfNode):
    """What it costs where an endpoint is there, but not as it is asked for."""

    other_name_costs: Share = Field(0.6, description="Share of the credit that another name costs.")
    other_type_costs: Share = Field(0.6, description="Share of the credit that another type costs.")

    def faults(
        self, kind: str, wanted: tuple[str, str], got: tuple[str, str], nodes: Sequence[str]
    ) -> list[tuple[float, str]]:
        """Return what is wrong with the name and type of a topic or service: the share that each costs, and a sentence.

        In the namespaces of its nodes lie relative names.
        """
        (name, its_type), (used, used_type) = wanted, got
        found = []
        if used != name:
            namespaces = (node.rpartition("/")[0] for node in nodes)
            space = next((n for n in namespaces if n and used == n + name), None)
            within = f" It is in its node's namespace, {space}." if space else ""
            reason = f"The {kind} is named {used}, not {name}; the other checks use {used}.{within}"
            found.append((self.other_name_costs, reason))
        if used_type != its_type:
            reason = f"The type of {used} is {used_type}, not {its_type}; endpoints of different types never connect."
            found.append((self.other_type_costs, reason))
        return found


def student_endpoints(context: Context, topic: str, kind: str) -> tuple[Endpoint, ...]:
    """Return the student's endpoints of a kind on a topic of the rubric's."""
    return context.session.endpoints_on(topic, kind, context.reference_nodes)


def clash(requested: Endpoint, offered: OfferedProfile | Qos) -> str | None:
    """Return the policy on which a subscription's request and an offer are incompatible, in words, or None.

    References
    ----------
    DDS 1.4, section 2.2.3: a request may not be stronger than the offer.
    """
    if requested.qos.reliability == "reliable" and offered.reliability == "best_effort":
        return "reliability (RELIABLE is requested, BEST_EFFORT offered)"
    if requested.qos.durability == "transient_local" and offered.durability == "volatile":
        return "durability (TRANSIENT_LOCAL is requested, VOLATILE offered)"
    if requested.qos.deadline_ns is not None:
        return "deadline (one is requested, none offered)"
    if requested.qos.liveliness.startswith("manual"):
        return "liveliness (MANUAL_BY_TOPIC is requested, AUTOMATIC offered)"
    return None


def unheard(context: Context, topic: str) -> str | None:
    """Return the policy for which none of the student's subscriptions hears the grader's own publishers, or None.

    None too where one side is not there.
    """
    offers = [
        e
        for e in context.session.endpoints_on(topic, "publisher")
        if e.node in context.reference_nodes
    ]
    requests = student_endpoints(context, topic, "subscription")
    found = [clash(requested, offer.qos) for requested in requests for offer in offers]
    return found[0] if found and all(found) else None


def claim_of(context: Context, kind: str, name: str) -> Claim | None:
    """Return the first call by which the student's node asked for an endpoint, by the tap."""
    return next(iter(context.session.claims_of(kind, name)), None)


def claimed_at(claim: Claim | None) -> tuple[Location, ...]:
    """Return the source line of a call, if it is the student's."""
    return (
        (Location(file=claim.file, line=claim.line),)
        if claim is not None and not claim.file.startswith("/")
        else ()
    )


class QosWanted(Parameters):
    """The QoS profile of an endpoint; what discovery does not carry is taken from the source, as advice only."""

    topic: ref.Topic
    reliability: ref.Reliability | None = None
    durability: ref.Durability | None = None
    history: ref.History | None = None
    depth: int | None = None


def qos_as_wanted(context: Context, p: QosWanted, kind: str, verb: str) -> Finding:
    """Judge reliability and durability of a topic's endpoints of a kind, which they offer or request, as the verb says.

    They count the same. History and depth only advise.
    """
    wanted = {
        k: v
        for k, v in (("reliability", p.reliability), ("durability", p.durability))
        if v is not None
    }
    expected = f"{verb} " + ", ".join(v.upper() for v in wanted.values())
    endpoints = student_endpoints(context, p.topic, kind)
    if not endpoints:
        return failed(expected, f"no {kind}", f"There is no {kind}.")
    # Which of several publishers sent what is not known; one that fits does not make up for another.
    unfit = [
        e.qos
        for e in endpoints
        if any(getattr(e.qos, name) != value for name, value in wanted.items())
    ]
    qos = unfit[0] if unfit else endpoints[0].qos
    wrong = [
        (name, getattr(qos, name)) for name, value in wanted.items() if getattr(qos, name) != value
    ]
    claim = claim_of(context, kind, p.topic)
    asked = claim.qos if claim is not None else None
    notes = []
    if asked is not None and p.depth is not None and asked.depth != p.depth:
        depth = "left to the middleware" if asked.history == "system_default" else asked.depth
        notes.append(f"The depth is {depth}; the lab asks for {p.depth}.")
    reason = " ".join(
        f"The {kind} {verb} {value.upper()} {name}, not {wanted[name].upper()}."
        for name, value in wrong
    )
    measured = f"{verb} {qos.reliability.upper()}, {qos.durability.upper()}"
    measured += f", depth {asked.depth} in the source" if asked is not None else ""
    where = (*claimed_at(claim), context.location(p.topic))
    finding = graded(
        1 - len(wrong) / max(1, len(wanted)), expected, measured, reason, where=where, notes=notes
    )
    return replace(
        finding,
        cut_off=bool(wrong) and kind == "subscription" and unheard(context, p.topic) is not None,
    )

"""Endpoints of the student's nodes: publishers, subscriptions and services by name, type, node and QoS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pydantic import Field

from grader.checks.base import Context, cut_off, failed, graded
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.recording.session import Claim, Endpoint
from grader.result import Finding, Location
from ros_bag.qos import Qos


class OfferedProfile(Parameters):
    """The QoS of the other side's publisher, in the lab's words."""

    reliability: ref.Reliability = "reliable"
    durability: ref.Durability = "volatile"


class OfNode(Parameters):
    """Name of the node, and the cost of another name."""

    node: ref.RosName | None = Field(
        None, description="Fully qualified name that the node should have."
    )
    other_node_costs: Share = Field(
        0.2, description="Share of the credit that another node name costs."
    )

    def node_faults(self, nodes: Sequence[str]) -> list[tuple[float, str]]:
        """Return the cost of another node name, with a sentence; a different namespace costs nothing.

        Parameters
        ----------
        nodes
            Nodes of the found endpoints.
        """
        wanted = self.node
        if wanted is None or not nodes:
            return []
        name = wanted.rsplit("/", 1)[-1]
        if any(node.rsplit("/", 1)[-1] == name for node in nodes):
            return []
        return [(self.other_node_costs, f"The node is named {nodes[0]}, not {wanted}.")]


class OfEndpoint(OfNode):
    """Costs of an endpoint with another name or type."""

    other_name_costs: Share = Field(0.6, description="Share of the credit that another name costs.")
    other_type_costs: Share = Field(0.6, description="Share of the credit that another type costs.")

    @property
    def other_domain_costs(self) -> float:
        """The cost of another name: in neither case do two programs of the lab connect."""
        return self.other_name_costs

    def faults(
        self, kind: str, wanted: tuple[str, str], got: tuple[str, str], nodes: Sequence[str]
    ) -> list[tuple[float, str]]:
        """Return the cost of a wrong name and of a wrong type, each with a sentence.

        Parameters
        ----------
        kind
            "topic" or "service".
        wanted, got
            Name and type.
        nodes
            Nodes of the found endpoints; relative names lie in their namespaces.
        """
        (name, its_type), (used, used_type) = wanted, got
        found = []
        if used != name:
            within = _in_namespace(name, used, nodes)
            reason = f"The {kind} is named {used}, not {name}; the other checks use {used}.{within}"
            found.append((self.other_name_costs, reason))
        if used_type != its_type:
            reason = f"The type of {used} is {used_type}, not {its_type}; endpoints of different types never connect."
            found.append((self.other_type_costs, reason))
        return found


def _in_namespace(name: str, used: str, nodes: Sequence[str]) -> str:
    """Say that a used name is the wanted one in its node's namespace; empty if it is not."""
    for node in nodes:
        namespace = node.rpartition("/")[0]
        if namespace and used == namespace + name:
            return f" It is in its node's namespace, {namespace}."
    return ""


def student_endpoints(context: Context, topic: str, kind: str) -> tuple[Endpoint, ...]:
    """Return the student's endpoints of a kind on a topic of the rubric's."""
    return context.session.endpoints_on(topic, kind, context.reference_nodes)


def clash(requested: Endpoint, offered: OfferedProfile | Qos) -> str | None:
    """Return the incompatible policy of a subscription's request and an offer, in words, or None.

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
    """Return the policy that keeps all of the student's subscriptions from the grader's own publishers.

    None if one hears one of them, or if one side is missing.
    """
    offers = []
    for endpoint in context.session.endpoints_on(topic, "publisher"):
        if endpoint.node in context.reference_nodes:
            offers.append(endpoint)
    first = None
    for requested in student_endpoints(context, topic, "subscription"):
        for offer in offers:
            policy = clash(requested, offer.qos)
            if not policy:
                return None
            first = first or policy
    return first


def claim_of(context: Context, kind: str, name: str) -> Claim | None:
    """Return the student's first call for an endpoint, as the tap noted it."""
    return next(iter(context.session.claims_of(kind, name)), None)


def claimed_at(claim: Claim | None) -> tuple[Location, ...]:
    """Return the source line of a call, if it is the student's."""
    if claim is None or claim.file.startswith("/"):
        return ()
    return (Location(file=claim.file, line=claim.line),)


class QosWanted(Parameters):
    """The QoS profile of an endpoint. History and depth come from the source and only advise."""

    topic: ref.Topic
    reliability: ref.Reliability | None = None
    durability: ref.Durability | None = None
    history: ref.History | None = None
    depth: int | None = None


def qos_as_wanted(context: Context, p: QosWanted, kind: str, verb: str) -> Finding:
    """Judge reliability and durability of a topic's endpoints of a kind.

    Both count the same. History and depth only advise.

    Parameters
    ----------
    kind, verb
        "publisher" and "offers", or "subscription" and "requests".
    """
    wanted = _wanted_policies(p)
    expected = f"{verb} " + ", ".join(value.upper() for value in wanted.values())
    endpoints = student_endpoints(context, p.topic, kind)
    if not endpoints:
        return failed(expected, f"no {kind}", f"There is no {kind}.")
    qos = _first_unfit(endpoints, wanted)
    wrong = [f"The {kind} {verb} {other}." for other in _other_policies(qos, wanted)]
    claim = claim_of(context, kind, p.topic)
    asked = None
    if claim is not None:
        asked = claim.qos
    measured = f"{verb} {qos.reliability.upper()}, {qos.durability.upper()}"
    if asked is not None:
        measured += f", depth {asked.depth} in the source"
    share = 1 - len(wrong) / max(1, len(wanted))
    where = (*claimed_at(claim), context.location(p.topic))
    finding = graded(
        share,
        expected,
        measured,
        " ".join(wrong),
        hint=_profile_hint(qos, wanted, claim),
        where=where,
        notes=_depth_notes(p, asked),
    )
    if not wrong or kind != "subscription":
        return finding
    if unheard(context, p.topic) is None:
        return finding
    return cut_off(finding)


def _wanted_policies(p: QosWanted) -> dict[str, str]:
    """Return the values of the judged policies that the lab gives."""
    wanted: dict[str, str] = {}
    if p.reliability is not None:
        wanted["reliability"] = p.reliability
    if p.durability is not None:
        wanted["durability"] = p.durability
    return wanted


def _first_unfit(endpoints: Sequence[Endpoint], wanted: Mapping[str, str]) -> Qos:
    """Return the QoS of the first endpoint with a wrong policy, or else of the first endpoint.

    One right endpoint does not make up for a wrong one, because the sender of a message is not known.
    """
    for endpoint in endpoints:
        for name, value in wanted.items():
            if getattr(endpoint.qos, name) != value:
                return endpoint.qos
    return endpoints[0].qos


def _other_policies(qos: Qos, wanted: Mapping[str, str]) -> list[str]:
    """Return each wrong policy, such as `BEST_EFFORT reliability, not RELIABLE`."""
    others = []
    for name, value in wanted.items():
        got = getattr(qos, name)
        if got != value:
            others.append(f"{got.upper()} {name}, not {value.upper()}")
    return others


def _profile_hint(qos: Qos, wanted: Mapping[str, str], claim: Claim | None) -> str:
    """Return the arguments of the profile that mend it, for a call whose line is known; else the rubric has a hint."""
    if claim is None or claim.file.startswith("/"):
        return ""
    arguments = []
    for name, value in wanted.items():
        if getattr(qos, name) != value:
            arguments.append(f"{name}={name.capitalize()}Policy.{value.upper()}")
    return f"In line {claim.line}, pass a QoSProfile with {' and '.join(arguments)}."


def _depth_notes(p: QosWanted, asked: Qos | None) -> list[str]:
    """Note a queue depth in the source that is not the lab's."""
    if asked is None or p.depth is None:
        return []
    if asked.depth == p.depth:
        return []
    depth = "left to the middleware" if asked.history == "system_default" else asked.depth
    return [f"The depth is {depth}; the lab asks for {p.depth}."]

"""Check of broadcast transforms: the tree of frames, its stamps and rates, and the poses of frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from grader.checks.base import (
    Context,
    Part,
    apart,
    failed,
    of_parts,
    quantise,
    ramp,
    unexplained,
    weighed,
)
from grader.checks.endpoints import OfNode, claim_of, claimed_at, student_endpoints
from grader.checks.fields import NumbersOf
from grader.checks.subscriber import Alternative
from grader.evidence import bounds
from grader.evidence.bounds import Delayed
from grader.evidence.cpu_delay import Span
from grader.evidence.near_miss import is_misspelt
from grader.evidence.recorded import Booleans, Floats, Integers, Recorded
from grader.evidence.transforms import (
    TF_MESSAGE,
    Broadcast,
    FrameTree,
    broadcasts,
    circle_in,
    inverse,
    parents_of,
    pose_of,
    poses_apart,
)
from grader.lab import references as ref
from grader.lab.references import Parameters, Share
from grader.result import Finding


class WantedFrame(Parameters):
    """A frame with its parent."""

    child: ref.GivenName = Field(description="Name of the frame, without a leading slash.")
    parent: str
    static: bool = Field(False, description="It is sent once, on the topic of static transforms.")
    rate_hz: float | None = Field(None, gt=0, description="How often it is sent.")


class WantedPose(Parameters):
    """The pose of a frame in another, by numbers or by an oracle."""

    exactly_one = ("xyz", "oracle")

    frame: ref.GivenName
    within: ref.GivenName = Field(description="The frame in which it lies.")
    xyz: tuple[float, float, float] | None = Field(None, description="Position in m.")
    rpy: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="Roll, pitch and yaw in rad, as in URDF."
    )
    oracle: ref.Loadable | None = Field(
        None,
        description="file.py:function(streams, parameters, seed); gives x, y, z, qx, qy, qz, qw at each times_ns.",
    )
    streams: Mapping[str, NumbersOf] = Field(
        default_factory=dict, description="Role that the oracle knows -> its numbers."
    )
    parameters: Mapping[str, Any] = Field(
        default_factory=dict, description="Passed on to the oracle."
    )
    alternatives: tuple[Alternative, ...] = Field(
        (), description="Known mistakes, by other parameters of the oracle."
    )
    at_s: tuple[float, ...] = Field(
        (), description="Times after the window opens; by default all that were sent."
    )
    tolerance_m: float = Field(0.01, gt=0)
    tolerance_deg: float = Field(1.0, gt=0)


class Weights(Parameters):
    """Weight of each part. A part without anything to judge has no weight."""

    frames: float = Field(3.0, ge=0, description="The wanted frames with their parents.")
    tree: float = Field(1.0, ge=0, description="One root, one parent for each frame, no circle.")
    values: float = Field(1.0, ge=0, description="Finite numbers, and quaternions of length 1.")
    stamps: float = Field(
        1.0, ge=0, description="Stamps of what moves: not zero, old or in the future."
    )
    static: float = Field(
        1.0, ge=0, description="What is static on its topic, latched, and nowhere else."
    )
    rates: float = Field(1.0, ge=0)
    poses: float = Field(3.0, ge=0)


class TransformTree(OfNode):
    """Transforms are broadcast: frames with parents, a sound tree, stamps, rates, and poses of frames."""

    process: ref.Process
    frames: tuple[WantedFrame, ...] = Field(min_length=1)
    poses: tuple[WantedPose, ...] = ()
    window: ref.Window | None = Field(
        None, description="Label of the observe step; else the whole session."
    )
    topic: ref.Topic = "/tf"
    static_topic: ref.Topic = "/tf_static"
    simulated: bool = Field(False, description="Stamps are of the time on /clock.")
    oldest_s: float = Field(0.1, gt=0, description="How old a stamp may be when it is published.")
    ahead_s: float = Field(0.02, ge=0, description="How far it may lie in the future then.")
    rate_within: Share = Field(
        0.1, description="Relative deviation of a rate up to which credit is full."
    )
    rate_beyond: Share = Field(0.5, description="Relative deviation from which there is none.")
    # tf2's BufferCore refuses quaternions with a squared length more than 0.01 off 1.
    unit_within: float = Field(
        0.005, gt=0, description="How far the length of a quaternion may be from 1."
    )
    known_credit: Share = Field(
        0.5, description="Credit of a part with a mistake that is known by name."
    )
    weights: Weights = Weights.model_construct()

    @model_validator(mode="after")
    def _has_a_window(self) -> TransformTree:
        if self.window is None and any(pose.at_s for pose in self.poses):
            raise ValueError("at_s needs a window")
        return self


def transform_tree(context: Context, p: TransformTree) -> Finding:
    """Judge all broadcast transforms, each part by its weight."""
    expected = _expected_frames(p)
    seen = _Seen(context.session, p, context)
    if not any(seen.edge(wanted) for wanted in p.frames):
        # A sound tree of other frames earns nothing.
        return unexplained(failed(expected, "none of these frames", _nothing(seen)))
    weights = p.weights.model_dump()
    parts: list[Part] = []
    for name, listed in _parts_by_group(seen).items():
        if listed and weights[name]:
            parts += weighed(listed, weights[name])
    source = claimed_at(claim_of(context, "publisher", p.topic))
    where = (*source, context.location(p.topic, seen.span))
    return of_parts(expected, parts, costs=p.node_faults(_senders(context, p)), where=where)


def _expected_frames(p: TransformTree) -> str:
    frames = []
    for wanted in p.frames:
        static = " (static)" if wanted.static else ""
        frames.append(f"{wanted.child} in {wanted.parent}{static}")
    expected = ", ".join(frames)
    if p.node:
        expected += f", from node {p.node}"
    return expected


def _senders(context: Context, p: TransformTree) -> list[str]:
    """Return the nodes that publish transforms."""
    nodes = []
    for topic in (p.topic, p.static_topic):
        nodes += [endpoint.node for endpoint in student_endpoints(context, topic, "publisher")]
    return nodes


def _parts_by_group(seen: _Seen) -> dict[str, list[Part]]:
    """Judge each part, under the name of its weight."""
    p = seen.p
    parts: dict[str, list[Part]] = {name: [] for name in type(p.weights).model_fields}
    for wanted in p.frames:
        edge = seen.edge(wanted)
        parts["frames"].append(_frame(seen, wanted))
        if edge is not None:
            parts["values"].append(_values(seen, edge))
        if not wanted.static:
            parts["stamps"].append(_stamps(seen, wanted))
        parts["static"].append(_static(seen, wanted))
        if wanted.rate_hz is not None:
            parts["rates"].append(_rate(seen, wanted, wanted.rate_hz))
    parts["tree"] = _tree(seen)
    parts["poses"] = [_pose(seen, pose) for pose in p.poses]
    return parts


def _nothing(seen: _Seen) -> str:
    """Describe the transforms that were sent in place of the wanted ones."""
    for topic in (seen.p.topic, seen.p.static_topic):
        kind = seen.session.stream(topic).topic_type
        if kind not in ("", TF_MESSAGE):
            return f"{topic} carries {kind}, not {TF_MESSAGE}."
    if not seen.edges:
        return f"No transform was sent on {seen.p.topic} or {seen.p.static_topic}."
    return f"None of the frames was sent, but {', '.join(sorted(seen.parents)[:_MOST_NAMED])}."


@dataclass(frozen=True)
class _Seen:
    """Broadcast transforms, with the corrections under which their other properties are judged."""

    session: Recorded
    p: TransformTree
    context: Context

    @cached_property
    def span(self) -> Span | None:
        if self.p.window:
            return self.session.window(self.p.window)
        return None

    @cached_property
    def edges(self) -> list[Broadcast]:
        """All broadcasts, static ones first; moving ones only within the window."""
        found = []
        for topic, static in ((self.p.static_topic, True), (self.p.topic, False)):
            for edge in broadcasts(self.session.stream(topic), static=static):
                span = None if edge.child in self.static else self.span
                inside = edge.within(span)
                if len(inside.stamps_ns):
                    found.append(inside)
        return found

    @cached_property
    def static(self) -> frozenset[str]:
        """The frames that must be static, which may have been sent before the window."""
        return frozenset(wanted.child for wanted in self.p.frames if wanted.static)

    @cached_property
    def parents(self) -> dict[str, list[str]]:
        """The parents of each frame, as they were sent."""
        return parents_of((edge.parent, edge.child) for edge in self.edges)

    def is_exchanged(self, wanted: WantedFrame) -> bool:
        """Tell whether a frame was sent as the parent of its parent."""
        if wanted.parent in self.parents.get(wanted.child, ()):
            return False
        return wanted.child in self.parents.get(wanted.parent, ())

    @cached_property
    def wanted(self) -> frozenset[str]:
        names: set[str] = set()
        for frame in self.p.frames:
            names.update((frame.child, frame.parent))
        return frozenset(names)

    @cached_property
    def misspelt(self) -> dict[str, str]:
        """The sent frame of a similar name, for each wanted frame that was not sent."""
        sent = {edge.child for edge in self.edges}
        others = sorted(sent - self.wanted)
        found = {}
        for frame in self.p.frames:
            if frame.child not in sent:
                near = [other for other in others if is_misspelt(frame.child, other)]
                if near:
                    found[frame.child] = near[0]
        return found

    def _named_right(self, edge: Broadcast) -> Broadcast:
        """Return a broadcast with the names that were meant."""
        child = edge.child
        for name, sent in self.misspelt.items():
            if sent == edge.child:
                child = name
                break
        return replace(edge, child=child, parent=self._parent_meant(child, edge.parent))

    def _parent_meant(self, child: str, parent: str) -> str:
        """Return the wanted parent of a frame if its name is similar to the sent one."""
        if parent in self.wanted:
            return parent
        for frame in self.p.frames:
            if frame.child == child and is_misspelt(frame.parent, parent):
                return frame.parent
        return parent

    @cached_property
    def put_right(self) -> list[Broadcast]:
        """All broadcasts, with exchanged and misspelt names corrected; the wanted ones are last."""
        exchanged = set()
        asked = set()
        for frame in self.p.frames:
            asked.add((frame.parent, frame.child))
            if self.is_exchanged(frame):
                exchanged.add((frame.child, frame.parent))
        right = []
        for edge in self.edges:
            if (edge.parent, edge.child) in exchanged:
                right.append(edge.exchanged())
            else:
                right.append(self._named_right(edge))
        return sorted(right, key=lambda edge: (edge.parent, edge.child) in asked)

    def edge(self, wanted: WantedFrame, *, static: bool | None = None) -> Broadcast | None:
        """Return the broadcast of a frame, if possible the one in the wanted parent."""
        fitting = []
        for edge in self.put_right:
            if edge.child == wanted.child and static in (None, edge.static):
                fitting.append(edge)
        for edge in fitting:
            if edge.parent == wanted.parent:
                return edge
        return fitting[0] if fitting else None

    @property
    def clock(self) -> Callable[[Integers], Integers]:
        """The function from times of the system clock to times of the stamps, both in ns."""
        ticks = self.session.numeric("/clock", "clock") if self.p.simulated else None
        if ticks is None:
            return lambda times_ns: times_ns
        begin_ns = int(ticks.source_ns[0])
        since_ns = ticks.source_ns - begin_ns
        shown_ns = np.round(ticks.values[:, 0] * 1e9)

        def simulated(times_ns: Integers) -> Integers:
            return np.interp(times_ns - begin_ns, since_ns, shown_ns).astype(np.int64)

        return simulated

    def delayed(self, start_ns: int, end_ns: int) -> Delayed:
        """Return the machine delay of the process within a span."""
        run = self.session.process(self.p.process)
        return bounds.delay_of(self.session, run, Span(start_ns, end_ns))

    def missing(self, wanted: WantedFrame) -> Part:
        """State that no transform of a frame arrived, and where it may have been lost."""
        topic = self.p.topic
        if not wanted.static:
            return Part(0.0, reason=f"No transform of the frame {wanted.child} arrived on {topic}.")
        reason = f"No transform of the frame {wanted.child} arrived."
        early = int(self.session.stream(topic).sequence.min(initial=2**32)) - 1
        if 0 < early < 2**31:
            sent = f"The first {early} messages on {topic} were sent before anybody listened"
            reason += f" {sent}: {_LATCH}"
        return Part(0.0, reason=reason, hint=_STATIC_HINT)


_LATCH = "what is sent once has to be latched."


# -- the tree --------------------------------------------------------------------------------------


def _frame(seen: _Seen, wanted: WantedFrame) -> Part:
    """Judge the parent and the name of a frame; a known mistake leaves part of the credit."""
    child = wanted.child
    parent = wanted.parent
    known = seen.p.known_credit
    edge = seen.edge(wanted)
    if seen.is_exchanged(wanted):
        reason = f"Parent and child are exchanged: {parent} was sent as a child of {child}."
        return Part(known, f"{parent} in {child}", reason, hint=_EXCHANGED_HINT)
    if edge is None:
        return seen.missing(wanted)
    sent = seen.misspelt.get(child)
    if sent is not None:
        reason = f"The frame is named {sent}, not {child}; all else was judged under the name that it has."
        return Part(0.0, f"{sent} in {seen.parents[sent][0]}", reason)
    if not _has_parent(seen, wanted):
        used = seen.parents[child][0]
        reason = f"The parent of {child} is {used}, not {parent}."
        return Part(0.0, f"{child} in {used}", reason)
    if edge.slashed:
        return Part(known, f"{child} in {parent}", _SLASH, hint=_SLASH_HINT)
    return Part(1.0, f"{child} in {parent}")


def _has_parent(seen: _Seen, wanted: WantedFrame) -> bool:
    """Tell whether a frame was sent in its parent.

    A misspelt parent counts if it is a wanted frame, because its own part charges its name.
    """
    sent = seen.parents.get(wanted.child, [])
    if wanted.parent in sent:
        return True
    is_charged = wanted.parent in (frame.child for frame in seen.p.frames)
    return is_charged and seen.misspelt.get(wanted.parent) in sent


_EXCHANGED_HINT = "header.frame_id is the parent, child_frame_id the child; the pose is that of the child in the parent."
_SLASH = "Frame names were sent with a leading slash, with which tf2 does not look them up."
_SLASH_HINT = "Write frame names without a slash: 'sensor', not '/sensor'."


def _tree(seen: _Seen) -> list[Part]:
    """Judge the tree as a whole: one parent a frame, no circle, one root.

    A missing frame costs its own part, and does not break the tree.
    """
    parents = parents_of((edge.parent, edge.child) for edge in seen.put_right)
    for wanted in seen.p.frames:
        parents.setdefault(wanted.child, [wanted.parent])
    found = []
    for child, names in parents.items():
        if len(names) > 1:
            named = ", ".join(names[:_MOST_NAMED])
            found.append(f"The frame {child} has {len(names)} parents: {named}.")
            break
    circle = circle_in(parents)
    if circle:
        found.append(f"The frames form a circle: {' → '.join(circle[:_MOST_NAMED])}.")
    roots = _roots(parents)
    if len(roots) > 1:
        named = ", ".join(roots[:_MOST_NAMED])
        found.append(f"There are {len(roots)} roots, not connected: {named}.")
    text = ""
    if len(roots) == 1:
        text = f"{len(parents)} frames below {roots[0]}"
    sound = [Part(1.0, text)] * (3 - len(found))
    return [*(Part(0.0, reason=reason) for reason in found), *sound]


def _roots(parents: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the frames without a parent."""
    names: set[str] = set()
    for each in parents.values():
        names.update(each)
    return sorted(names - parents.keys())


#: Greatest number of frames that are named.
_MOST_NAMED = 5


def _values(seen: _Seen, edge: Broadcast) -> Part:
    """Judge the numbers of a broadcast."""
    lengths = np.linalg.norm(edge.poses[:, 3:], axis=1)
    if not np.isfinite(edge.poses).all():
        return Part(0.0, reason=f"Transforms of {edge.child} hold numbers that are not finite.")
    if not lengths.all():
        reason = f"The rotation of {edge.child} is 0, 0, 0, 0, which is not a rotation."
        return Part(0.0, reason=reason, hint="A rotation by nothing is x = y = z = 0, w = 1.")
    worst = float(lengths[np.abs(lengths - 1).argmax()])
    if abs(worst - 1) > seen.p.unit_within:
        reason = f"The quaternion of {edge.child} has the length {worst:.4g}, not 1; it is not normalised."
        return Part(0.0, reason=reason, hint="Divide all four numbers by their length.")
    return Part(1.0)


def _static(seen: _Seen, wanted: WantedFrame) -> Part:
    """Judge the topic of a frame, and whether later nodes get the static ones."""
    child = wanted.child
    p = seen.p
    static = seen.edge(wanted, static=True)
    moving = seen.edge(wanted, static=False)
    if static is None and moving is None:
        return seen.missing(wanted)
    if not wanted.static:
        return _moves(p, child, static, moving)
    if static is None:
        return _not_on_static_topic(p, child, moving)
    if _is_volatile(seen):
        reason = (
            f"{p.static_topic} is offered VOLATILE: a node that starts later never gets {child}."
        )
        return Part(0.0, reason=reason, hint=_STATIC_HINT)
    if moving is None:
        return Part(1.0)
    again = f"{child} was sent on {p.static_topic} and again on {p.topic}; once on {p.static_topic} is enough."
    return Part(p.known_credit, reason=again)


def _moves(
    p: TransformTree, child: str, static: Broadcast | None, moving: Broadcast | None
) -> Part:
    """Judge the topics of a frame that moves."""
    if static is None:
        return Part(1.0)
    reason = f"{child} moves, and was sent on {p.static_topic}, where it is taken to stay for ever."
    return Part(p.known_credit if moving else 0.0, reason=reason)


def _not_on_static_topic(p: TransformTree, child: str, moving: Broadcast | None) -> Part:
    """Judge a static frame that was sent as a moving one."""
    if moving is not None and len(np.unique(moving.source_ns)) == 1:
        reason = f"{child} was sent once on {p.topic}, without being latched: a node that starts later never gets it."
        return Part(0.0, reason=reason, hint=_STATIC_HINT)
    reason = f"{child} was sent on {p.topic}, where it ages; what never moves belongs on {p.static_topic}."
    return Part(p.known_credit, reason=reason, hint=_STATIC_HINT)


def _is_volatile(seen: _Seen) -> bool:
    """Tell whether a publisher of static transforms is volatile.

    Listeners of tf2 request TRANSIENT_LOCAL and are incompatible with it, however often it sends.
    """
    endpoints = student_endpoints(seen.context, seen.p.static_topic, "publisher")
    return any(endpoint.qos.durability == "volatile" for endpoint in endpoints)


_STATIC_HINT = "Use tf2_ros.StaticTransformBroadcaster, or a publisher with durability TRANSIENT_LOCAL on /tf_static."


# -- time ------------------------------------------------------------------------------------------


def _stamps(seen: _Seen, wanted: WantedFrame) -> Part:
    """Judge the stamps of a moving frame; the machine delays may excuse old ones."""
    edge = seen.edge(wanted, static=False)
    if edge is None:
        return seen.missing(wanted)
    if not edge.stamps_ns.any():
        reason = f"The stamps of {wanted.child} are 0."
        return Part(0.0, reason=reason, hint="Set header.stamp to self.get_clock().now().to_msg().")
    p = seen.p
    ages_s = (seen.clock(edge.source_ns) - edge.stamps_ns) / 1e9
    old = ages_s > p.oldest_s
    ahead = ages_s < -p.ahead_s
    right = 1 - float((old | ahead).mean())
    share = quantise(right)
    if share == 1:
        return Part(1.0)
    best = quantise(right + _aged_by_delay(seen, edge, ages_s, old) / len(old))
    worst_s = float(ages_s[np.abs(ages_s).argmax()])
    which = "in the future" if worst_s < 0 else "old"
    reason = (
        f"Stamps of {wanted.child} are up to {abs(worst_s):.2f} s {which} when they are published."
    )
    doubt = "Not your fault: the grading computer delayed your program between a stamp and its publication."
    return Part(share, reason=reason, best=best, doubt=doubt if best > share else "")


def _aged_by_delay(seen: _Seen, edge: Broadcast, ages_s: Floats, old: Booleans) -> int:
    """Return the number of old stamps that became too old because the machine delayed the program."""
    aged = 0
    for place in np.flatnonzero(old)[:_MOST_DOUBTED]:
        sent_ns = int(edge.source_ns[place])
        age_s = float(ages_s[place])
        delayed = seen.delayed(sent_ns - round(age_s * 1e9), sent_ns)
        aged += int(bounds.arrival(age_s - seen.p.oldest_s, delayed).high)
    return aged


#: Greatest number of old stamps that the machine can have caused.
_MOST_DOUBTED = 200


def _rate(seen: _Seen, wanted: WantedFrame, rate_hz: float) -> Part:
    """Judge the rate of a frame, by the bounds that the machine delays leave."""
    edge = seen.edge(wanted, static=False)
    if edge is None:
        return seen.missing(wanted)
    times_ns = np.unique(edge.source_ns)
    span = seen.span or Span(int(times_ns[0]), int(times_ns[-1]))
    if len(times_ns) < 3 or span.duration_s <= 0:
        reason = f"{wanted.child} was sent {len(times_ns)} times only, too few for a rate."
        return Part(0.0, reason=reason)
    sent_hz = _measured_hz(times_ns, span)
    rate = bounds.count(sent_hz, seen.delayed(span.start_ns, span.end_ns))
    rate = replace(rate, high=rate.nearest(rate_hz))
    deviation_ns = float(np.std(np.diff(times_ns)))
    error_hz = 2 * deviation_ns / 1e9 * sent_hz / span.duration_s
    p = seen.p
    off = rate.widened(error_hz).off(rate_hz)
    share = off.credit(lambda off: quantise(ramp(off, p.rate_within, p.rate_beyond)))
    reason = ""
    if share.low < 1:
        reason = f"{wanted.child} is sent at {sent_hz:.1f} Hz, not {rate_hz:g} Hz."
    return Part.between(share, f"{wanted.child} at {sent_hz:.1f} Hz", reason)


def _measured_hz(times_ns: Integers, span: Span) -> float:
    """Return the rate between the first and the last time, lowered by a silence within the span."""
    count = len(times_ns)
    lasted_s = (times_ns[-1] - times_ns[0]) / 1e9
    between_hz = (count - 1) / lasted_s
    least_hz = (count - 1) / span.duration_s
    most_hz = (count + 1) / span.duration_s
    return float(min(max(between_hz, least_hz), most_hz))


# -- poses of frames -------------------------------------------------------------------------------

#: Share of matching poses from which a known mistake explains them.
_EXPLAINS = 0.9


def _pose(seen: _Seen, p: WantedPose) -> Part:
    """Judge the pose of a frame in another; a known mistake leaves part of the credit."""
    tree = _frame_tree(seen)
    times_ns = _pose_times_ns(seen, p, tree)
    poses = tree.pose(p.frame, p.within, times_ns)
    if poses is None or not _is_connected(p, times_ns, poses):
        then = " at the time that is looked at" if p.at_s else ""
        reason = f"Where {p.frame} lies in {p.within} was not tested: nothing connects them{then}."
        return Part(0.0, reason=reason)
    expected = _expected(seen, p, times_ns, {})
    if expected is None:
        reason = f"Where {p.frame} lies was not tested: nothing was recorded from which it follows."
        return Part(0.0, reason=reason)
    fits, off = _fit(p, poses, expected)
    share = quantise(float(fits.mean()))
    text = f"{p.frame} in {p.within} off by {off}"
    if share == 1:
        return Part(1.0, text)
    reason = f"{p.frame} in {p.within} is off by {off}; {p.tolerance_m:g} m and {p.tolerance_deg:g}° are allowed."
    part = Part(share, text, reason, best=share)
    if p.oracle is not None:
        part = replace(part, best=max(share, _undisturbed(seen, times_ns, fits)))
    sent = _SentPoses(seen, p, tree, times_ns, poses, expected)
    return _with_doubt(_with_mistake(part, sent))


def _is_connected(p: WantedPose, times_ns: Integers, poses: Floats) -> bool:
    """Return whether there is a pose to judge; at a given time, it may be unknown."""
    if not len(times_ns):
        return False
    return not p.at_s or bool(np.isfinite(poses).any())


def _frame_tree(seen: _Seen) -> FrameTree:
    """Return the tree of all broadcasts; the part of its topic charges a static frame sent as a moving one."""
    edges = []
    for edge in seen.put_right:
        static = edge.static or edge.child in seen.static
        edges.append(replace(edge, static=static))
    return FrameTree(edges)


def _pose_times_ns(seen: _Seen, p: WantedPose, tree: FrameTree) -> Integers:
    """Return the times of the judged poses: the given ones, or the times of all broadcasts."""
    if not p.at_s:
        return tree.times_ns(p.frame, p.within)
    start_ns: list[int] = []
    if seen.span is not None:
        start_ns = [seen.span.start_ns + round(at_s * 1e9) for at_s in p.at_s]
    return seen.clock(np.array(start_ns, dtype=np.int64))


def _with_mistake(part: Part, sent: _SentPoses) -> Part:
    """Return a part with the first known mistake that explains the poses, if there is one."""
    if part.share >= _EXPLAINS:
        return part
    for slip in _slips(sent):
        if slip.right.mean() >= _EXPLAINS:
            share = max(part.share, slip.credit)
            reason = f"{part.reason} {slip.meaning}".strip()
            slipped = replace(part, share=share, reason=reason, hint=slip.hint)
            if slip.known is None:
                return slipped
            return slip.known.charge(sent.seen.context, slipped)
    return part


def _with_doubt(part: Part) -> Part:
    """Return a part with a doubt, if the machine delays may have cost credit."""
    doubt = ""
    if part.most > part.share:
        doubt = "Not your fault: the grading computer delayed your program while it sent poses."
    return replace(part, best=part.most, doubt=doubt)


def _undisturbed(seen: _Seen, times_ns: Integers, fits: Booleans) -> float:
    """Return the share of right poses among those near which the machine did not delay the program.

    If these are too few, all other poses may have been right.
    """
    calm = np.array([_is_calm(seen, int(t_ns)) for t_ns in times_ns])
    possible = fits | ~calm
    if calm.sum() >= _FEWEST_CALM:
        possible = fits[calm]
    return quantise(float(possible.mean()))


def _is_calm(seen: _Seen, t_ns: int) -> bool:
    if seen.p.simulated:
        return True
    return seen.delayed(t_ns - _NEAR_NS, t_ns + _NEAR_NS).delay_s < _HARMLESS_S


#: Time about a pose that is searched for delays, in ns; longest harmless delay, in seconds; and number of undisturbed
#: poses that can stand for all.
_NEAR_NS, _HARMLESS_S, _FEWEST_CALM = 200_000_000, 0.01, 5


def _expected(
    seen: _Seen, p: WantedPose, times_ns: Integers, other: Mapping[str, Any]
) -> Floats | None:
    """Return the right poses, with other parameters of the oracle; None if a stream was not recorded."""
    if p.oracle is None:
        return np.repeat(pose_of(p.xyz or (), p.rpy), len(times_ns), axis=0)
    streams = {role: numbers.series(seen.session) for role, numbers in p.streams.items()}
    if None in streams.values():
        return None
    parameters = {**p.parameters, **other, "times_ns": times_ns}
    poses = seen.context.oracle(p.oracle)(streams, parameters, seen.session.record.seed)
    return np.asarray(poses, dtype=np.float64).reshape(-1, 7)


def _fit(p: WantedPose, poses: Floats, expected: Floats) -> tuple[Booleans, str]:
    """Return which poses are within the tolerances, and their median distances in words."""
    distance_m, angle = poses_apart(poses, expected)
    fits: Booleans = (distance_m <= p.tolerance_m) & (angle <= p.tolerance_deg)
    if not np.isfinite(distance_m + angle).any():
        return fits, "numbers that are not a pose"
    off_m = apart(float(np.nanmedian(distance_m)), p.tolerance_m, places=3)
    off_deg = apart(float(np.nanmedian(angle)), p.tolerance_deg, places=3)
    return fits, f"{off_m} m and {off_deg}°"


@dataclass(frozen=True)
class _SentPoses:
    """Sent poses of a frame beside the right ones, with all that a known mistake is computed from."""

    seen: _Seen
    p: WantedPose
    tree: FrameTree
    times_ns: Integers
    poses: Floats
    expected: Floats

    def matches(self, expected: Floats) -> Booleans:
        """Return which sent poses match other ones."""
        return _fit(self.p, self.poses, expected)[0]

    def right_if(self, poses: Floats) -> Booleans:
        """Return which poses, sent without a mistake, would be right."""
        return _fit(self.p, poses, self.expected)[0]


@dataclass(frozen=True)
class _Slip:
    """A known mistake."""

    #: bool[n]: Which poses it explains.
    right: Booleans
    #: Credit that it leaves.
    credit: float
    meaning: str
    hint: str
    #: The rubric's entry; None for a mistake known to every lab.
    known: Alternative | None = None


def _slips(sent: _SentPoses) -> Iterator[_Slip]:
    """Yield the known mistakes, and which of the poses each explains."""
    p = sent.p
    known = sent.seen.p.known_credit
    meaning = f"It is the inverse: where {p.within} lies in {p.frame}."
    yield _Slip(sent.right_if(inverse(sent.poses)), known, meaning, _INVERSE_HINT)
    for edges in _suspects(sent.tree, p):
        rolled = sent.tree.rolled(edges).pose(p.frame, p.within, sent.times_ns)
        if rolled is not None:
            yield _Slip(sent.right_if(rolled), known, _WXYZ, _WXYZ_HINT)
    if p.oracle is None:
        yield from _angle_slips(sent)
    for each in p.alternatives:
        other = _expected(sent.seen, p, sent.times_ns, each.parameters)
        if other is not None:
            meaning = f"Your poses match {each.meaning}."
            yield _Slip(sent.matches(other), each.credit, meaning, "", each)


def _angle_slips(sent: _SentPoses) -> Iterator[_Slip]:
    """Yield the mistakes in roll, pitch and yaw: degrees, and turns about the moving axes."""
    p = sent.p
    known = sent.seen.p.known_credit
    count = len(sent.times_ns)
    angles_deg = [float(np.degrees(angle)) for angle in p.rpy]
    degrees = pose_of(p.xyz or (), angles_deg)
    in_degrees = sent.matches(np.repeat(degrees, count, axis=0))
    yield _Slip(in_degrees, known, _DEGREES, "Use math.radians().")
    # Turns about moving axes are turns about fixed axes in the other order.
    opposite = [-angle for angle in p.rpy]
    turned = inverse(pose_of((0, 0, 0), opposite))
    moving = np.hstack((degrees[:, :3], turned[:, 3:]))
    about_moving = sent.matches(np.repeat(moving, count, axis=0))
    yield _Slip(about_moving, known, _MOVING_AXES, _MOVING_AXES_HINT)


_INVERSE_HINT = "Send the pose of the child as it is seen from the parent."
_DEGREES = "The angles are in degrees where radians are meant."
_MOVING_AXES = (
    "Roll, pitch and yaw are about the moving axes, where the parent's fixed ones are meant."
)
_MOVING_AXES_HINT = (
    "The quaternion is q(yaw)·q(pitch)·q(roll); for scipy the axes are called 'xyz', not 'XYZ'."
)
_WXYZ = "The quaternion is in the order w, x, y, z."
_WXYZ_HINT = (
    "ROS has x, y, z, w; transforms3d and others give w first: set each of the four by its name."
)


def _suspects(tree: FrameTree, p: WantedPose) -> Iterator[list[Broadcast]]:
    """Yield the broadcasts between two frames that may have another order of numbers: all, or one at a time."""
    edges: list[Broadcast] = []
    for way in tree.between(p.frame, p.within) or ():
        edges += way
    yield edges
    for edge in edges[:_MOST_SUSPECTED]:
        yield [edge]


#: Greatest number of broadcasts that are suspected one at a time.
_MOST_SUSPECTED = 10

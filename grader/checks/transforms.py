"""Check of the transforms that nodes broadcast: the tree of frames, its stamps and rates, and where frames lie."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from grader.checks.base import (
    Context,
    Part,
    apart,
    cpu_delay_doubt,
    failed,
    of_parts,
    quantise,
    ramp,
    unexplained,
    weighed,
    without_delay,
)
from grader.checks.endpoints import OfNode, claim_of, claimed_at, student_endpoints
from grader.checks.fields import NumbersOf
from grader.checks.subscriber import Alternative
from grader.evidence.cpu_delay import Span
from grader.evidence.near_miss import is_misspelt
from grader.evidence.recorded import Floats, Integers, Recorded
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
    """Where a frame lies in another, by numbers or by an oracle."""

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
    """What each part counts beside the others; those of which nothing is asked count nothing."""

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
    """Transforms are broadcast: frames with parents, a sound tree, stamps, rates, and where frames lie."""

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
    # tf2's BufferCore refuses quaternions whose squared length is more than 0.01 off 1.
    unit_within: float = Field(
        0.005, gt=0, description="How far the length of a quaternion may be from 1."
    )
    known_credit: Share = Field(
        0.5, description="Credit of a part with a mistake that is known by name."
    )
    weights: Weights = Weights()

    @model_validator(mode="after")
    def _has_a_window(self) -> TransformTree:
        if self.window is None and any(pose.at_s for pose in self.poses):
            raise ValueError("at_s needs a window")
        return self


def transform_tree(context: Context, p: TransformTree) -> Finding:
    """Judge all that was broadcast, each part by its weight."""
    expected = ", ".join(
        f"{f.child} in {f.parent}{' (static)' if f.static else ''}" for f in p.frames
    )
    expected += f", from node {p.node}" if p.node else ""
    seen = _Seen(context.session, p, context)
    if not any(seen.edge(wanted) for wanted in p.frames):
        # Then the tree and the numbers of others are no achievement.
        return unexplained(failed(expected, "none of these frames", _nothing(seen)))
    groups = {
        "frames": [_frame(seen, wanted) for wanted in p.frames],
        "tree": _tree(seen),
        "values": [
            _values(seen, edge) for wanted in p.frames if (edge := seen.edge(wanted)) is not None
        ],
        "stamps": [_stamps(seen, wanted) for wanted in p.frames if not wanted.static],
        "static": [_static(seen, wanted) for wanted in p.frames],
        "rates": [
            _rate(seen, wanted, wanted.rate_hz) for wanted in p.frames if wanted.rate_hz is not None
        ],
        "poses": [_pose(seen, pose) for pose in p.poses],
    }
    weights = p.weights.model_dump()
    parts = [
        part
        for name, listed in groups.items()
        if listed and weights[name]
        for part in weighed(listed, weights[name])
    ]
    where = (
        *claimed_at(claim_of(context, "publisher", p.topic)),
        context.location(p.topic, seen.span),
    )
    senders = (
        e.node
        for topic in (p.topic, p.static_topic)
        for e in student_endpoints(context, topic, "publisher")
    )
    return of_parts(expected, parts, costs=p.node_faults(list(senders)), where=where)


def _nothing(seen: _Seen) -> str:
    """Say what was sent in place of the wanted frames."""
    for topic in (seen.p.topic, seen.p.static_topic):
        if (kind := seen.session.stream(topic).topic_type) not in ("", TF_MESSAGE):
            return f"{topic} carries {kind}, not {TF_MESSAGE}."
    if not seen.edges:
        return f"No transform was sent on {seen.p.topic} or {seen.p.static_topic}."
    return f"None of the frames was sent, but {', '.join(sorted(seen.parents)[:_MOST_NAMED])}."


@dataclass(frozen=True)
class _Seen:
    """What was broadcast, as the check looks at it."""

    session: Recorded
    p: TransformTree
    context: Context

    @cached_property
    def span(self) -> Span | None:
        return self.session.window(self.p.window) if self.p.window else None

    @cached_property
    def edges(self) -> list[Broadcast]:
        """All that was sent, what moves within the window; what is static first."""
        of_topics = ((self.p.static_topic, True), (self.p.topic, False))
        sent = (
            edge
            for topic, static in of_topics
            for edge in broadcasts(self.session.stream(topic), static=static)
        )
        within = (each.within(None if each.child in self.static else self.span) for each in sent)
        return [edge for edge in within if len(edge.stamps_ns)]

    @cached_property
    def static(self) -> frozenset[str]:
        """The frames that are to be static, which may have been sent before the window."""
        return frozenset(wanted.child for wanted in self.p.frames if wanted.static)

    @cached_property
    def parents(self) -> dict[str, list[str]]:
        """The parents of each frame, as they were sent."""
        return parents_of((edge.parent, edge.child) for edge in self.edges)

    def is_exchanged(self, wanted: WantedFrame) -> bool:
        """Whether a frame was sent as the parent of its parent."""
        return wanted.parent not in self.parents.get(
            wanted.child, ()
        ) and wanted.child in self.parents.get(wanted.parent, ())

    @cached_property
    def wanted(self) -> frozenset[str]:
        return frozenset(name for frame in self.p.frames for name in (frame.child, frame.parent))

    @cached_property
    def misspelt(self) -> dict[str, str]:
        """The frame that was sent in place of each wanted one that was not, where its name is nearly that."""
        sent = {edge.child for edge in self.edges}
        others = sorted(sent - self.wanted)
        missing = [frame.child for frame in self.p.frames if frame.child not in sent]
        return {
            name: near[0]
            for name in missing
            if (near := [other for other in others if is_misspelt(name, other)])
        }

    def _named_right(self, edge: Broadcast) -> Broadcast:
        """Return what was sent with the names that were meant."""
        child = next(
            (name for name, sent in self.misspelt.items() if sent == edge.child), edge.child
        )
        parents = [
            f.parent
            for f in self.p.frames
            if f.child == child and is_misspelt(f.parent, edge.parent)
        ]
        parent = parents[0] if parents and edge.parent not in self.wanted else edge.parent
        return replace(edge, child=child, parent=parent)

    @cached_property
    def put_right(self) -> list[Broadcast]:
        """All that was sent, the wanted last, with the names right where they are exchanged or misspelt."""
        wrong = {(f.child, f.parent) for f in self.p.frames if self.is_exchanged(f)}
        right = [
            e.exchanged() if (e.parent, e.child) in wrong else self._named_right(e)
            for e in self.edges
        ]
        asked = {(f.parent, f.child) for f in self.p.frames}
        return sorted(right, key=lambda edge: (edge.parent, edge.child) in asked)

    def edge(self, wanted: WantedFrame, *, static: bool | None = None) -> Broadcast | None:
        """Return what was sent of a frame, in whatever parent."""
        fitting = [
            e for e in self.put_right if e.child == wanted.child and static in (None, e.static)
        ]
        return next(
            (e for e in fitting if e.parent == wanted.parent), fitting[0] if fitting else None
        )

    @property
    def clock(self) -> Callable[[Integers], Integers]:
        """What gives the time of the stamps, in ns, at times of the system clock."""
        ticks = self.session.numeric("/clock", "clock") if self.p.simulated else None
        if ticks is None:
            return lambda times_ns: times_ns
        begin_ns, shown_ns = int(ticks.source_ns[0]), np.round(ticks.values[:, 0] * 1e9)
        return lambda times_ns: np.interp(
            times_ns - begin_ns, ticks.source_ns - begin_ns, shown_ns
        ).astype(np.int64)

    def delay_s(self, start_ns: int, end_ns: int) -> float:
        """Return for how long the machine delayed the process."""
        run = self.session.process(self.p.process)
        return self.session.machine_delay_s(run, Span(start_ns, end_ns)) if run is not None else 0.0

    def missing(self, wanted: WantedFrame) -> Part:
        """State that nothing of a frame arrived, and where it may have been lost."""
        reason = f"No transform of the frame {wanted.child} arrived{'' if wanted.static else f' on {self.p.topic}'}."
        early = int(self.session.stream(self.p.topic).sequence.min(initial=2**32)) - 1
        if wanted.static and 0 < early < 2**31:
            reason += f" The first {early} messages on {self.p.topic} were sent before anybody listened: {_LATCH}"
        return Part(0.0, reason=reason, hint=_STATIC_HINT if wanted.static else "")


_LATCH = "what is sent once has to be latched."


# -- the tree --------------------------------------------------------------------------------------


def _frame(seen: _Seen, wanted: WantedFrame) -> Part:
    """Judge that a frame has its parent; another kind of mistake with its name costs only what is known of it."""
    child, parent, known = wanted.child, wanted.parent, seen.p.known_credit
    parents, edge = seen.parents.get(child, []), seen.edge(wanted)
    if seen.is_exchanged(wanted):
        reason = f"Parent and child are exchanged: {parent} was sent as a child of {child}."
        return Part(known, f"{parent} in {child}", reason, hint=_EXCHANGED_HINT)
    if edge is None:
        return seen.missing(wanted)
    if (sent := seen.misspelt.get(child)) is not None:
        reason = f"The frame is named {sent}, not {child}; all else was judged under the name that it has."
        return Part(0.0, f"{sent} in {seen.parents[sent][0]}", reason)
    # Where it is one of the wanted frames, the name of the parent is charged there.
    charged = parent in (frame.child for frame in seen.p.frames)
    if parent not in parents and not (charged and seen.misspelt.get(parent) in parents):
        return Part(
            0.0, f"{child} in {parents[0]}", f"The parent of {child} is {parents[0]}, not {parent}."
        )
    if edge.slashed:
        return Part(known, f"{child} in {parent}", _SLASH, hint=_SLASH_HINT)
    return Part(1.0, f"{child} in {parent}")


_EXCHANGED_HINT = "header.frame_id is the parent, child_frame_id the child; the pose is that of the child in the parent."
_SLASH = "Frame names were sent with a leading slash, with which tf2 does not look them up."
_SLASH_HINT = "Write frame names without a slash: 'sensor', not '/sensor'."


def _tree(seen: _Seen) -> list[Part]:
    """Judge the tree as a whole; what is missing of it has cost its own part, and breaks it nowhere else."""
    parents = parents_of((edge.parent, edge.child) for edge in seen.put_right)
    for wanted in seen.p.frames:
        parents.setdefault(wanted.child, [wanted.parent])
    several = next(((child, names) for child, names in parents.items() if len(names) > 1), None)
    circle = circle_in(parents)
    roots = sorted({name for names in parents.values() for name in names} - parents.keys())
    found = []
    if several is not None:
        found.append(
            f"The frame {several[0]} has {len(several[1])} parents: {', '.join(several[1][:_MOST_NAMED])}."
        )
    if circle:
        found.append(f"The frames form a circle: {' → '.join(circle[:_MOST_NAMED])}.")
    if len(roots) > 1:
        found.append(
            f"There are {len(roots)} roots, not connected: {', '.join(roots[:_MOST_NAMED])}."
        )
    sound = Part(1.0, f"{len(parents)} frames below {roots[0]}" if len(roots) == 1 else "")
    return [*(Part(0.0, reason=reason) for reason in found), *[sound] * (3 - len(found))]


#: Frames that are named.
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
    """Judge on which topic a frame was sent, and that the static ones reach whoever comes later."""
    child, known, p = wanted.child, seen.p.known_credit, seen.p
    static, moving = (seen.edge(wanted, static=kind) for kind in (True, False))
    if static is None and moving is None:
        return seen.missing(wanted)
    if not wanted.static:
        reason = (
            f"{child} moves, and was sent on {p.static_topic}, where it is taken to stay for ever."
        )
        return (
            Part(1.0)
            if moving is not None and static is None
            else Part(known if moving else 0.0, reason=reason)
        )
    if static is None:
        once = moving is not None and len(np.unique(moving.source_ns)) == 1
        reason = f"{child} was sent on {p.topic}, where it ages; what never moves belongs on {p.static_topic}."
        lost = f"{child} was sent once on {p.topic}, without being latched: a node that starts later never gets it."
        return Part(0.0 if once else known, reason=lost if once else reason, hint=_STATIC_HINT)
    offers = [
        e.qos.durability for e in student_endpoints(seen.context, p.static_topic, "publisher")
    ]
    if "volatile" in offers:
        # Listeners of tf2 request TRANSIENT_LOCAL, with which it is not compatible however often it is sent.
        reason = (
            f"{p.static_topic} is offered VOLATILE: a node that starts later never gets {child}."
        )
        return Part(0.0, reason=reason, hint=_STATIC_HINT)
    again = f"{child} was sent on {p.static_topic} and again on {p.topic}; once on {p.static_topic} is enough."
    return Part(1.0) if moving is None else Part(known, reason=again)


_STATIC_HINT = "Use tf2_ros.StaticTransformBroadcaster, or a publisher with durability TRANSIENT_LOCAL on /tf_static."


# -- time ------------------------------------------------------------------------------------------


def _stamps(seen: _Seen, wanted: WantedFrame) -> Part:
    """Judge the stamps of a frame that moves; one that is old since the machine delayed the program is not."""
    edge, p = seen.edge(wanted, static=False), seen.p
    if edge is None:
        return seen.missing(wanted)
    if not edge.stamps_ns.any():
        reason = f"The stamps of {wanted.child} are 0."
        return Part(0.0, reason=reason, hint="Set header.stamp to self.get_clock().now().to_msg().")
    ages_s = (seen.clock(edge.source_ns) - edge.stamps_ns) / 1e9
    old, ahead = ages_s > p.oldest_s, ages_s < -p.ahead_s
    worst_s = float(ages_s[np.abs(ages_s).argmax()])
    share = quantise(1 - float((old | ahead).mean()))
    # Those that got old before they were published, since the machine delayed the program for so long.
    aged = [(int(edge.source_ns[n]), float(ages_s[n])) for n in np.flatnonzero(old)[:_MOST_DOUBTED]]
    excused = sum(
        seen.delay_s(sent_ns - round(s * 1e9), sent_ns) >= s - p.oldest_s for sent_ns, s in aged
    )
    best = quantise(1 - float((old | ahead).mean()) + excused / len(old))
    which = "in the future" if worst_s < 0 else "old"
    reason = (
        f"Stamps of {wanted.child} are up to {abs(worst_s):.2f} s {which} when they are published."
    )
    doubt = "Not your fault: the grading computer delayed your program between a stamp and its publication."
    return (
        Part(1.0)
        if share == 1
        else Part(share, reason=reason, best=best, doubt=doubt if best > share else "")
    )


#: Of more stamps that are old, not all can be the machine's doing.
_MOST_DOUBTED = 200


def _rate(seen: _Seen, wanted: WantedFrame, rate_hz: float) -> Part:
    """Judge how often a frame was sent, by the bounds that the machine's delays leave open."""
    edge, p = seen.edge(wanted, static=False), seen.p
    if edge is None:
        return seen.missing(wanted)
    times_ns = np.unique(edge.source_ns)
    span = seen.span or Span(int(times_ns[0]), int(times_ns[-1]))
    if len(times_ns) < 3 or span.duration_s <= 0:
        return Part(
            0.0, reason=f"{wanted.child} was sent {len(times_ns)} times only, too few for a rate."
        )
    between_hz = (len(times_ns) - 1) / ((times_ns[-1] - times_ns[0]) / 1e9)
    # Where it falls silent within the window, that is its rate too.
    least, most = ((len(times_ns) + k) / span.duration_s for k in (-1, 1))
    low_hz = float(min(max(between_hz, least), most))
    delay_s = seen.delay_s(span.start_ns, span.end_ns)
    high_hz = max(low_hz, min(rate_hz, without_delay(low_hz, delay_s, span.duration_s)))
    error_hz = 2 * float(np.std(np.diff(times_ns))) / 1e9 * low_hz / span.duration_s
    bounds_hz = (low_hz - error_hz, high_hz + error_hz)
    nearest_hz = min(max(rate_hz, bounds_hz[0]), bounds_hz[1])
    furthest, nearest = (
        max(abs(hz / rate_hz - 1) for hz in bounds_hz),
        abs(nearest_hz / rate_hz - 1),
    )
    share, best = (quantise(ramp(off, p.rate_within, p.rate_beyond)) for off in (furthest, nearest))
    reason = f"{wanted.child} is sent at {low_hz:.1f} Hz, not {rate_hz:g} Hz." if share < 1 else ""
    doubt = cpu_delay_doubt(delay_s, span.duration_s) if best > share and delay_s else ""
    return Part(share, f"{wanted.child} at {low_hz:.1f} Hz", reason, best=best, doubt=doubt)


# -- where frames lie ------------------------------------------------------------------------------

#: From this share of poses that fit, something explains them.
_EXPLAINS = 0.9


def _pose(seen: _Seen, p: WantedPose) -> Part:
    """Judge where a frame lies in another; a mistake with a name leaves part of the credit."""
    # What should be static, and was sent as if it moved, has cost its part.
    tree = FrameTree(
        replace(edge, static=edge.static or edge.child in seen.static) for edge in seen.put_right
    )
    times_ns = tree.times_ns(p.frame, p.within)
    if p.at_s:
        start_ns = (
            [seen.span.start_ns + round(s * 1e9) for s in p.at_s] if seen.span is not None else []
        )
        times_ns = seen.clock(np.array(start_ns, dtype=np.int64))
    poses = tree.pose(p.frame, p.within, times_ns)
    if poses is None or not len(times_ns) or (p.at_s and not np.isfinite(poses).any()):
        then = " at the time that is looked at" if p.at_s else ""
        return Part(
            0.0,
            reason=f"Where {p.frame} lies in {p.within} was not tested: nothing connects them{then}.",
        )
    expected = _expected(seen, p, times_ns, {})
    if expected is None:
        return Part(
            0.0,
            reason=f"Where {p.frame} lies was not tested: nothing was recorded from which it follows.",
        )
    fits, off = _fit(p, poses, expected)
    share = quantise(float(fits.mean()))
    best = max(
        share, _undisturbed(seen, times_ns, fits) if p.oracle is not None and share < 1 else 0.0
    )
    text = f"{p.frame} in {p.within} off by {off}"
    if share == 1:
        return Part(1.0, text)
    reason = f"{p.frame} in {p.within} is off by {off}; {p.tolerance_m:g} m and {p.tolerance_deg:g}° are allowed."
    slips = _slips(seen, p, tree, times_ns, poses) if share < _EXPLAINS else ()
    explaining = (
        (known, meaning, hint) for right, known, meaning, hint in slips if right.mean() >= _EXPLAINS
    )
    known, meaning, hint = next(explaining, (0.0, "", ""))
    credit = max(share, known)
    doubt = (
        "Not your fault: the grading computer delayed your program while it sent poses."
        if best > credit
        else ""
    )
    return Part(
        credit, text, f"{reason} {meaning}".strip(), best=max(credit, best), doubt=doubt, hint=hint
    )


def _undisturbed(seen: _Seen, times_ns: Integers, fits: NDArray[np.bool_]) -> float:
    """Return the share of right poses among those about which the machine did not delay the program.

    With too few of these, all others may have been right.
    """
    near = ((int(t) - _NEAR_NS, int(t) + _NEAR_NS) for t in times_ns)
    calm = np.array([seen.p.simulated or seen.delay_s(*span) < _HARMLESS_S for span in near])
    return quantise(float((fits[calm] if calm.sum() >= _FEWEST_CALM else fits | ~calm).mean()))


#: So near to a pose, a delay of the program may have changed it, if it is longer than that of any timer; and how many
#: other poses can stand for all.
_NEAR_NS, _HARMLESS_S, _FEWEST_CALM = 200_000_000, 0.01, 5


def _expected(
    seen: _Seen, p: WantedPose, times_ns: Integers, other: Mapping[str, Any]
) -> Floats | None:
    """Return the poses as they are to be, with other parameters of the oracle; None without what they rest on."""
    if p.oracle is None:
        return np.repeat(pose_of(p.xyz or (), p.rpy), len(times_ns), axis=0)
    streams = {role: of.series(seen.session) for role, of in p.streams.items()}
    if None in streams.values():
        return None
    parameters = {**p.parameters, **other, "times_ns": times_ns}
    poses = seen.context.oracle(p.oracle)(streams, parameters, seen.session.record.seed)
    return np.asarray(poses, dtype=np.float64).reshape(-1, 7)


def _fit(p: WantedPose, poses: Floats, expected: Floats) -> tuple[NDArray[np.bool_], str]:
    """Return which poses are within the tolerances, and how far off they usually are."""
    distance_m, angle = poses_apart(poses, expected)
    fits: NDArray[np.bool_] = (distance_m <= p.tolerance_m) & (angle <= p.tolerance_deg)
    if not np.isfinite(distance_m + angle).any():
        return fits, "numbers that are not a pose"
    shown = (
        apart(float(np.nanmedian(off)), limit, places=3)
        for off, limit in ((distance_m, p.tolerance_m), (angle, p.tolerance_deg))
    )
    return fits, "{} m and {}°".format(*shown)


def _slips(
    seen: _Seen, p: WantedPose, tree: FrameTree, times_ns: Integers, poses: Floats
) -> Iterator[tuple[NDArray[np.bool_], float, str, str]]:
    """Give the known mistakes: which of the poses each explains, the credit that it leaves, its name, how to fix it."""
    expected, known = _expected(seen, p, times_ns, {}), seen.p.known_credit
    assert expected is not None
    yield (
        _fit(p, inverse(poses), expected)[0],
        known,
        f"It is the inverse: where {p.within} lies in {p.frame}.",
        _INVERSE_HINT,
    )
    for edges in _suspects(tree, p):
        if (rolled := tree.rolled(edges).pose(p.frame, p.within, times_ns)) is not None:
            yield _fit(p, rolled, expected)[0], known, _WXYZ, _WXYZ_HINT
    if p.oracle is None:
        degrees = pose_of(p.xyz or (), [float(np.degrees(a)) for a in p.rpy])
        # Turns about moving axes are those about fixed ones in the other order.
        moving = np.hstack(
            (degrees[:, :3], inverse(pose_of((0, 0, 0), [-a for a in p.rpy]))[:, 3:])
        )
        for pose, name, hint in (
            (degrees, _DEGREES, "Use math.radians()."),
            (moving, _MOVING_AXES, _MOVING_AXES_HINT),
        ):
            yield _fit(p, poses, np.repeat(pose, len(times_ns), axis=0))[0], known, name, hint
    for each in p.alternatives:
        if (other := _expected(seen, p, times_ns, each.parameters)) is not None:
            yield (
                _fit(p, poses, other)[0],
                each.left(seen.context),
                f"Your poses match {each.meaning}.",
                "",
            )


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
    """Give what may have been sent with another order of numbers: all between the frames, or one of not too many."""
    edges = [edge for way in tree.between(p.frame, p.within) or () for edge in way]
    yield edges
    yield from ([edge] for edge in edges[:_MOST_SUSPECTED])


_MOST_SUSPECTED = 10

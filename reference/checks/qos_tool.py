"""Checks of a tool that compares QoS profiles: its end, its traffic and its profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pydantic import BaseModel, Field

from grader.own_checks import (
    Artifact,
    Context,
    Delayed,
    Durability,
    ExitLabel,
    Finding,
    History,
    Line,
    Location,
    Outcome,
    Part,
    Pattern,
    Qos,
    Reliability,
    Run,
    Share,
    Topic,
    apart,
    check,
    graded,
    inconclusive,
    of_parts,
    quantise,
    search,
    unclear,
    undecided,
    unexplained,
    without_delay,
)


class EndsByItself(BaseModel):
    """A process ends by itself in time, without an error, after printing its results."""

    artifact: Artifact
    step: ExitLabel = Field(description="Label of the wait_exit step.")
    least_s: float
    most_s: float
    output: Pattern = Field(description="Regular expression that its output matches.")
    half_credit: Share = Field(
        0.5,
        description="Credit for results without an end in time, or an end in time without results.",
    )


@check(commands=("python3 {artifact}",), by_endpoints=True)
def ends_by_itself(context: Context, p: EndsByItself) -> Finding:
    """Judge the end of the artifact's process: half for ending well, half for its results."""
    expected = f"ends by itself after {p.least_s:g} to {p.most_s:g} s, with its results printed"
    runs = context.runs(p.artifact)
    if not runs:
        return inconclusive(expected, "not started", "The recording does not show the program.")
    run = runs[-1]
    printed = _without_tracebacks(run.lines)
    has_results = search(p.output, printed) is not None
    if not has_results and run.ended_by == "interrupt":
        flaky = run.flaky_end()
        if flaky:
            return unclear(expected, "no results", flaky)
    if run.interrupted_s is not None or run.ended_by != "itself":
        return _had_to_be_stopped(p, run, expected, has_results)
    started_s, ended_s = context.life(run)
    ran_s = ended_s - started_s
    ended = f"ended after {apart(ran_s, p.least_s, places=1)} s"
    measured = f"{ended} with status {run.exit_status}"
    if has_results:
        return _ended_with_results(p, run, expected, ran_s, ended)
    measured += ", no results"
    if run.exit_status == 0 and ran_s >= p.least_s:
        return _ended_without_results(p, expected, measured, bool(printed.strip()))
    early = graded(0.0, expected, measured, "It ended without results.")
    return unexplained(early)


def _had_to_be_stopped(
    p: EndsByItself, run: Run, expected: str, has_results: bool
) -> Finding:
    """State that a process was still running when it was stopped."""
    stopped_s = 0.0
    if run.interrupted_s is not None:
        stopped_s = run.interrupted_s - run.started_s
    reason = f"It was still running after {stopped_s:.0f} s and had to be stopped."
    hint = "End rclpy.spin after 10 s: count the time in a timer, or spin_once in a loop."
    share = 0.0
    if has_results:
        share = p.half_credit
    return graded(share, expected, "had to be stopped", reason, hint=hint)


def _ended_with_results(
    p: EndsByItself, run: Run, expected: str, ran_s: float, ended: str
) -> Finding:
    """Judge the time at which a process with results ended, and note its exit status."""
    notes = []
    if run.exit_status != 0:
        notes.append(
            "It does not end with exit status 0; stop executors and threads before rclpy.shutdown()."
        )
    share = 1.0
    if ran_s < p.least_s:
        share = p.half_credit
    measured = f"{ended} with status {run.exit_status}"
    reason = f"It {ended}, which is too early."
    return graded(share, expected, measured, reason, notes=notes)


def _ended_without_results(
    p: EndsByItself, expected: str, measured: str, has_printed: bool
) -> Finding:
    """State that a process ended in time, but that its output holds no results."""
    share = 0.0
    reason = "It ended in time, and printed nothing."
    if has_printed:
        reason = "It ended in time, but nothing that it printed could be read as results."
        share = p.half_credit
    hint = "Print the results before the program ends, with print() or the logger."
    return graded(share, expected, measured, reason, hint=hint)


def _without_tracebacks(output: Sequence[Line]) -> str:
    """Return the output without tracebacks, because they quote the source."""
    kept: list[str] = []
    # Streams in the middle of a traceback; lines of other streams may stand between its lines.
    quoting: set[str] = set()
    for line in output:
        begins = line.text.startswith("Traceback (most recent call last)")
        if begins:
            quoting.add(line.stream)
        elif line.stream not in quoting:
            kept.append(line.text)
        elif not line.text.startswith(" "):
            # The last line of a traceback is its message, which is not indented.
            quoting.remove(line.stream)
    return "\n".join(kept)


class TopicsCarryTraffic(BaseModel):
    """Messages are published and received on each topic; each is a part."""

    topics: tuple[Topic, ...] = Field(min_length=1)
    least_messages: int = 1
    other_name_costs: Share = Field(
        0.5, description="Share of a topic's credit that another name costs."
    )
    unheard_credit: Share = Field(
        1.0, description="Credit of a topic from which no subscription of its own can hear."
    )


@check(commands=("ros2 topic hz {topic}", "ros2 topic info -v {topic}"), by_endpoints=True)
def topics_carry_traffic(context: Context, p: TopicsCarryTraffic) -> Finding:
    """Judge the number of messages by the publishers' sequence numbers.

    Too few messages earn their share of a topic, and another name costs a part of it.
    """
    delay = Delayed(0.0, 0.0)
    for run in context.runs():
        if run.role == "student":
            started_s, ended_s = context.life(run)
            delayed = context.delayed(run, started_s, ended_s)
            delay = max(delay, delayed)
    expected = f"at least {p.least_messages} messages on each of {', '.join(p.topics)}"
    parts = []
    for topic in p.topics:
        part = _judge_traffic(context, p, topic, delay)
        parts.append(part)
    return of_parts(expected, parts, doubt=delay.why)


def _judge_traffic(context: Context, p: TopicsCarryTraffic, topic: str, delay: Delayed) -> Part:
    """Judge the number of messages on one topic."""
    used = context.used(topic)
    count = _written(context, topic)
    hint = ""
    undelayed = without_delay(count, delay.delay_s, delay.length_s)
    reasons = []
    heard = 1.0
    unheard = ""
    if count:
        unheard = context.unheard(topic)
    if unheard:
        heard = p.unheard_credit
        reasons.append(unheard)
        if "incompatible" in unheard:
            hint = "Give publisher and subscription of a profile the same QoSProfile; then messages arrive."
    if count < p.least_messages:
        reasons.append(f"Too few messages arrived on {topic}.")
    cost = 0.0
    if count and used != topic:
        cost = p.other_name_costs
        reasons.append(f"{topic} is named {used}; the other checks use that name.")
    share = max(0.0, _share_of(count, p) - cost)
    best = max(0.0, _share_of(undelayed, p) - cost)
    text = f"{used} {count} published"
    return Part(share * heard, text, " ".join(reasons), best * heard, hint=hint)


def _share_of(count: float, p: TopicsCarryTraffic) -> float:
    share = quantise(count / p.least_messages)
    return min(1.0, share)


def _written(context: Context, topic: str) -> int:
    """Return the number of messages written to a topic."""
    messages = context.messages(topic)
    return int(messages.sequence.max(initial=0))


class WantedProfile(BaseModel, frozen=True):
    """The QoS profile of a topic's publisher and subscription."""

    topic: Topic
    reliability: Reliability
    durability: Durability
    history: History
    depth: int


class QosProfiles(BaseModel):
    """Publisher and subscription of each topic have the profile; every policy of every profile is a part."""

    artifact: Artifact
    profiles: tuple[WantedProfile, ...] = Field(min_length=1)
    one_sided_credit: Share = Field(
        0.5, description="Most of a profile's credit where a side of its topic is lacking."
    )
    unmatched_credit: Share = Field(
        1.0, description="Most of a profile's credit where its two sides cannot be connected."
    )
    alike_credit: Share = Field(
        1.0, description="Most of the credit where all profiles are one and the same."
    )
    least_matched: Share = Field(
        0.0,
        description="Least share of profiles whose sides can be connected; with fewer of them, nothing is compared.",
    )
    swapped_credit: Share = Field(
        1.0,
        description="Most of a profile's credit where its topic has another's reliability, and the other its own.",
    )


_POLICIES = ("reliability", "durability", "history", "depth")


@dataclass(frozen=True)
class _Side:
    """One side of a topic: its QoS in the graph, and the QoS that the program passed to rclpy."""

    kind: str
    seen: tuple[Qos, ...]
    asked: Qos | None
    where: tuple[Location, ...]

    @classmethod
    def of(cls, context: Context, kind: str, topic: str) -> _Side:
        seen = tuple(endpoint.qos for endpoint in context.endpoints(topic, kind))
        claim = context.claim(kind, topic)
        if claim is None:
            return cls(kind, seen, None, ())
        return cls(kind, seen, claim.qos, claim.where)

    def values(self, policy: str) -> list[str | int | None]:
        """Return the values of a policy: from the graph, or for history and depth from the program."""
        if policy in ("reliability", "durability"):
            return [getattr(qos, policy) for qos in self.seen]
        if self.asked is None:
            return []
        return [getattr(self.asked, policy)]

    def wrong(self, wanted: WantedProfile) -> str:
        """Say which policies have other values than wanted."""
        clauses = []
        for policy in _POLICIES:
            right = getattr(wanted, policy)
            for value in self.values(policy):
                if value != right:
                    clauses.append(f"{policy} {value}, not {right}")
        return ", and ".join(clauses)

    def __str__(self) -> str:
        if not self.seen:
            return "nothing"
        history = "history unknown"
        if self.asked is not None:
            history = f"{self.asked.history} {self.asked.depth}"
        first = self.seen[0]
        return f"{first.reliability}, {history}, {first.durability}"


#: Both sides of each topic.
_Sides = Mapping[WantedProfile, Sequence[_Side]]


@check(
    commands=("ros2 topic info -v {topic}",),
    by_endpoints=True,
    seeks=("publisher", "subscription"),
)
def qos_profiles(context: Context, p: QosProfiles) -> Finding:
    """Judge reliability and durability from discovery, history and depth from the calls of rclpy."""
    sides = {}
    parts = []
    for wanted in p.profiles:
        publisher = _Side.of(context, "publisher", wanted.topic)
        subscription = _Side.of(context, "subscription", wanted.topic)
        sides[wanted] = (publisher, subscription)
        parts.append(_judge_profile(wanted, sides[wanted], p.one_sided_credit))
    parts = _less_for_useless(context, p, sides, parts)
    if _all_alike(sides):
        reason = "All topics have one and the same profile, so that nothing is compared."
        parts = _limited(parts, p.alike_credit, reason)
    expected = "; ".join(map(_shown_profile, p.profiles))
    finding = of_parts(expected, parts, where=(context.location(),))
    unknown = _without_history(sides)
    if unknown is None or finding.outcome is not Outcome.PASSED:
        return finding
    reason = f"The recording does not show the history and depth of {unknown}."
    return undecided(finding, reason, retry=False)


def _less_for_useless(
    context: Context, p: QosProfiles, sides: _Sides, parts: Sequence[Part]
) -> list[Part]:
    """Return the parts, with less credit for unmatched and swapped profiles, and with none at all if these are many."""
    swapped = _swapped(p, sides)
    less = []
    useful = 0
    for (wanted, both), part in zip(sides.items(), parts, strict=True):
        unheard = ""
        if both[1].seen:
            unheard = context.unheard(wanted.topic)
        if unheard:
            most = min(part.share, p.unmatched_credit)
            less.append(replace(part, share=most))
        elif wanted in swapped:
            most = min(part.share, p.swapped_credit)
            less.append(replace(part, share=most))
        else:
            useful += 1
            less.append(part)
    count = len(less)
    if useful >= p.least_matched * count:
        return less
    if swapped:
        topics = ", ".join(wanted.topic for wanted in swapped)
        reason = f"The reliabilities of {topics} are swapped, so that each name stands for the opposite."
        reason = f"{reason} {less[0].reason}".strip()
        limited = _limited(less, p.swapped_credit, "")
        return [replace(limited[0], reason=reason), *limited[1:]]
    reason = f"Messages can arrive on {useful} of {count} topics, which is too few to compare."
    return _limited(less, 0.0, reason)


def _swapped(p: QosProfiles, sides: _Sides) -> list[WantedProfile]:
    """Return the profiles with the other reliability on both sides, if there are such ones of either reliability."""
    if p.swapped_credit == 1:
        return []
    found = []
    for wanted, both in sides.items():
        values = both[0].values("reliability") + both[1].values("reliability")
        if values and wanted.reliability not in values:
            found.append(wanted)
    for wanted in found[1:]:
        if wanted.reliability != found[0].reliability:
            return found
    return []


def _limited(parts: list[Part], share: float, reason: str) -> list[Part]:
    """Return the parts, each with a share if all have more together."""
    total = sum(part.share for part in parts)
    if total <= share * len(parts):
        return parts
    limited = [replace(part, share=share) for part in parts]
    first = limited[0]
    both = f"{reason} {first.reason}"
    limited[0] = replace(first, reason=both.strip())
    return limited


def _shown_profile(wanted: WantedProfile) -> str:
    queue = f"{wanted.history} {wanted.depth}"
    return f"{wanted.topic}: {wanted.reliability}, {queue}, {wanted.durability}"


def _all_alike(sides: _Sides) -> bool:
    """Tell whether all sides of several topics have the same profile."""
    shown: set[str] = set()
    for both in sides.values():
        for side in both:
            if side.seen:
                shown.add(str(side))
    return len(sides) > 1 and len(shown) == 1


def _without_history(sides: _Sides) -> str | None:
    """Return the first side without a known history and depth, in words."""
    for wanted, both in sides.items():
        for side in both:
            if side.seen and side.asked is None:
                return f"the {side.kind} on {wanted.topic}"
    return None


def _judge_profile(wanted: WantedProfile, sides: Sequence[_Side], one_sided_credit: float) -> Part:
    """Judge a topic: each policy counts the same."""
    missing = [side.kind for side in sides if not side.seen]
    reasons = []
    if missing:
        reasons.append(f"There is no {' and no '.join(missing)} on {wanted.topic}.")
    credits = (1.0, one_sided_credit, 0.0)
    share = _right_policies(wanted, sides) * credits[len(missing)]
    where: list[Location] = []
    if len(missing) < len(sides):
        wrong, charged = _wrong_policies(wanted, sides)
        reasons += wrong
        for side in charged:
            where += side.where
    text = f"{wanted.topic}: {_shown_sides(sides)}"
    return Part(share, text, " ".join(reasons), where=tuple(where))


def _right_policies(wanted: WantedProfile, sides: Sequence[_Side]) -> float:
    """Return the share of right values, each policy counted alike."""
    right = 0.0
    for policy in _POLICIES:
        right += _right_share(wanted, sides, policy)
    return right / len(_POLICIES)


def _right_share(wanted: WantedProfile, sides: Sequence[_Side], policy: str) -> float:
    """Return the share of right values of a policy; all of it if none is known."""
    values: list[str | int | None] = []
    for side in sides:
        values += side.values(policy)
    if not values:
        return 1.0
    right = values.count(getattr(wanted, policy))
    return right / len(values)


def _wrong_policies(wanted: WantedProfile, sides: Sequence[_Side]) -> tuple[list[str], list[_Side]]:
    """Return a sentence for each side with wrong policies, and these sides.

    One sentence is enough if both sides have the same.
    """
    texts = [side.wrong(wanted) for side in sides]
    if len(set(texts)) == 1:
        if not texts[0]:
            return [], []
        return [f"{wanted.topic} has {texts[0]}."], [sides[0]]
    sentences = []
    charged = []
    for side, text in zip(sides, texts, strict=True):
        if text:
            sentences.append(f"The {side.kind} on {wanted.topic} has {text}.")
            charged.append(side)
    return sentences, charged


def _shown_sides(sides: Sequence[_Side]) -> str:
    """Return the profile of both sides, once if they are the same."""
    shown = [str(side) for side in sides]
    if len(set(shown)) == 1:
        return shown[0]
    named = [f"{side.kind} {side}" for side in sides]
    return " / ".join(named)

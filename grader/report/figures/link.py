"""QoS profiles on a link with losses and delays: shares that arrive, latencies, and late joiners."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic import Field

from grader.checks.endpoints import clash
from grader.evidence.recorded import Floats, Recorded
from grader.evidence.text.result_rows import LINE_LIMIT, lines_naming
from grader.lab import references as ref
from grader.lab.steps.link import Crossing, LinkedTopic, LinkResult
from grader.recording.session import Endpoint
from grader.report.escape import line
from grader.report.figures.svg import (
    NARROW,
    RIGHT,
    Canvas,
    Figure,
    FigureKind,
    Frame,
    Range,
    duration,
    short,
)
from ros_bag.qos import Qos

#: Heights of a row, of a profile's head, and of the picture's head, in px.
_ROW, _HEAD, _TOP = 21, 34, 22
#: Marks of a topic's latencies, evenly from the shortest to the longest.
_MARKS = 50
#: Shortest latency on the logarithmic axis, in s.
_LOWEST_S = 1e-4
#: Delay of 95 % of the packets beyond the link's own delay, in ms, that shows a busy machine. It is 1 ms if idle.
_BUSY_MS = 3.0
#: Characters of a printed line.
_PRINTED = 120
_LONGEST_NAME = 40


# -- the facts ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outcome:
    """A topic's crossing of the link, in numbers."""

    #: Share of packets that the link lost, and share of messages that arrived.
    loss: float
    share: float
    #: float64[n]: Latencies in ascending order.
    latencies_s: Floats
    in_order: bool
    #: Number of subscriptions that joined after the last message, and number of these that received a message.
    late: int
    served: int

    @classmethod
    def of(cls, crossing: Crossing) -> Outcome:
        """Count a recorded crossing."""
        numbers = []
        latencies_us = []
        for number, latency_us in crossing.received:
            numbers.append(number)
            latencies_us.append(latency_us)
        share = len(set(numbers)) / crossing.sent
        latencies_s = np.sort(np.array(latencies_us, dtype=float)) / 1e6
        in_order = numbers == sorted(numbers)
        served = sum(bool(received) for received in crossing.late)
        return cls(crossing.loss, share, latencies_s, in_order, len(crossing.late), served)

    @property
    def median_s(self) -> float | None:
        """Median of the latencies; None if nothing arrived."""
        if not len(self.latencies_s):
            return None
        return float(np.median(self.latencies_s))

    @property
    def slow_s(self) -> float | None:
        """Time after which 95 % of the received messages had arrived; None if nothing arrived."""
        if not len(self.latencies_s):
            return None
        return float(np.quantile(self.latencies_s, 0.95))


@dataclass(frozen=True)
class Profile:
    """A topic of the link under its name in the lab."""

    name: str
    offered: str
    requested: str
    #: Reason why nothing can arrive, or why the topic was not carried.
    problem: str
    outcomes: Sequence[Outcome]
    #: Line about the profile that the student's program printed.
    printed: str


@dataclass(frozen=True)
class LinkTable:
    """Contents of the page's table."""

    profiles: Sequence[Profile]
    #: Id of the check that found the student's explanation.
    explained_by: str | None
    #: Reason why there is no picture.
    problem: str | None = ""

    @property
    def losses(self) -> list[float]:
        """Shares of packets that the link lost, one per crossing."""
        for profile in self.profiles:
            if profile.outcomes:
                return [outcome.loss for outcome in profile.outcomes]
        return []


class Link(FigureKind):
    """The student's QoS profiles on a link with losses and delays, as measured by a step of the kind `link`."""

    step: ref.LinkLabel
    names: dict[str, ref.Topic] = Field(
        default_factory=dict,
        description="Name in the lab -> topic; other topics are shown by their own names.",
    )
    artifact: ref.Artifact | None = Field(
        None, description="Program that prints a line about each name; the last one is shown."
    )
    explained_by: ref.CheckId | None = Field(
        None, description="Check that looked for the student's explanation."
    )

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw the share that arrived and the latencies for each topic and loss, or list the reasons against it."""
        step = recorded.step(self.step)
        if step is None or not step.result:
            return None
        result = LinkResult.of(step)
        profiles = self._profiles(result.topics, recorded)
        content = LinkTable(profiles, self.explained_by, result.problem)
        shown = [profile for profile in profiles if profile.outcomes]
        if not shown:
            return Figure(table="link", content=content)
        chart = _LinkChart(result, shown)
        return Figure(chart.caption, chart.paint, _KEY, table="link", content=content)

    def _profiles(self, topics: Sequence[LinkedTopic], recorded: Recorded) -> list[Profile]:
        names = {topic: name for name, topic in self.names.items()}
        printed = []
        if self.artifact:
            printed = [each.text[:LINE_LIMIT] for each in recorded.output_of(self.artifact)]
        return [_profile(topic, names.get(topic.name, topic.name), printed) for topic in topics]


_KEY = (
    ("median", "half of what arrived had arrived by then"),
    ("call-accepted", "a subscription that joined after the last message, and got one"),
    ("missed", "one that got none"),
)


def percent(share: float) -> str:
    """Write a share with three digits, enough to show one message in some hundred: `99.7 %`."""
    return f"{short(100 * share)} %"


def _profile(topic: LinkedTopic, name: str, printed: Sequence[str]) -> Profile:
    outcomes = [Outcome.of(crossing) for crossing in topic.crossings if crossing.sent]
    offered = _words(topic.offered)
    requested = _words(topic.requested)
    claim = _last_line_naming(name, printed)
    return Profile(name, offered, requested, _problem(topic), outcomes, claim)


def _last_line_naming(name: str, printed: Sequence[str]) -> str:
    """Return the last printed line with a name, or else with a similar one; empty if there is none."""
    places = lines_naming(printed, name, loosely=False)
    if not places:
        places = lines_naming(printed, name, loosely=True)
    if not places:
        return ""
    return line(printed[places[-1]], _PRINTED)


def _words(qos: Qos | None) -> str:
    """Write a profile: `reliable, keep last 10, volatile`."""
    if qos is None:
        return ""
    if qos.history == "unknown":
        depth = "history unknown, 10 used"
    else:
        depth = f"{qos.history} {qos.depth or ''}".strip()
    words = ", ".join((qos.reliability, depth, qos.durability))
    return words.replace("_", " ")


def _problem(topic: LinkedTopic) -> str:
    """Return the reason why nothing can arrive on a topic; empty if something can."""
    if topic.offered is None or topic.requested is None:
        missing = []
        if topic.offered is None:
            missing.append("publisher")
        if topic.requested is None:
            missing.append("subscription")
        return f"There is no {' and no '.join(missing)} on {topic.topic}."
    subscription = Endpoint("subscription", topic.topic, topic.type, "", "", "", topic.requested)
    policy = clash(subscription, topic.offered)
    if not policy:
        return ""
    return f"The two sides are incompatible in {policy}: nothing can arrive."


# -- the picture -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _LinkChart:
    """Outcomes of some profiles, one row per loss."""

    result: LinkResult
    profiles: Sequence[Profile]

    @cached_property
    def outcomes(self) -> list[Outcome]:
        """Outcomes of all profiles."""
        outcomes: list[Outcome] = []
        for profile in self.profiles:
            outcomes += profile.outcomes
        return outcomes

    @property
    def caption(self) -> str:
        worst = max(outcome.loss for outcome in self.profiles[0].outcomes)
        arrived = "; ".join(_arrived(profile, worst) for profile in self.profiles)
        order = "Not all of it arrived in order."
        if all(outcome.in_order for outcome in self.outcomes):
            order = "All of it arrived in order."
        late = f"{short(self.result.delay_ms)} ms late, each way"
        return (
            f"Where {percent(worst)} of the packets are lost, this much arrives: {arrived}. {order} "
            "These are your profiles, measured by the grader: messages of your topics' types, "
            "between two programs of its own. "
            f"The link is {self.result.means}: it loses packets at random, and the others are "
            f"{late}.{self._busy}"
        )

    @property
    def _busy(self) -> str:
        """Sentence about a busy machine; empty if it was not busy."""
        if self.result.late_ms <= _BUSY_MS:
            return ""
        return (
            f" The grading computer was busy meanwhile: packets were up to {short(self.result.late_ms)} ms "
            "later still, and short queues lost messages to that too."
        )

    def paint(self, canvas: Canvas) -> None:
        if canvas.width > NARROW:
            shares = Frame(canvas, 74, 0, 400, 0, Range(0, 1), Range(0, 1))
            delays = Frame(canvas, 460, 0, 820, 0, self._logarithms(), Range(0, 1))
        else:
            shares = Frame(canvas, 40, 0, 150, 0, Range(0, 1), Range(0, 1))
            delays = Frame(canvas, 196, 0, 336, 0, self._logarithms(), Range(0, 1))
        columns = _Columns(canvas, shares, delays)
        height = _HEAD * len(self.profiles) + _ROW * len(self.outcomes)
        columns.paint_heads(_TOP + height + 4)
        top = float(_TOP)
        for profile in self.profiles:
            top = columns.paint_profile(profile, top)
        canvas.height = _TOP + height + 44

    def _logarithms(self) -> Range:
        """Return the logarithms of all latencies in s, or of 1 ms to 1 s if nothing arrived."""
        latencies_s = np.concatenate([outcome.latencies_s for outcome in self.outcomes])
        if len(latencies_s):
            known = np.log10(np.clip(latencies_s, _LOWEST_S, None))
        else:
            known = np.array([-3.0, 0.0])
        return Range(float(known.min()) - 0.1, float(known.max()) + 0.1)


def _arrived(profile: Profile, loss: float) -> str:
    """Write how much arrived at a loss: `telemetry 93 %, half of it within 20 ms`."""
    outcome = next(each for each in profile.outcomes if each.loss == loss)
    arrived = f"{line(profile.name, _LONGEST_NAME)} {percent(outcome.share)}"
    if outcome.median_s is not None:
        arrived += f", half of it within {duration(outcome.median_s)}"
    return arrived


@dataclass(frozen=True)
class _Columns:
    """The columns of the picture: shares that arrived, latencies, and late joiners."""

    canvas: Canvas
    shares: Frame
    delays: Frame

    @property
    def wide(self) -> bool:
        return self.canvas.width > NARROW

    @property
    def right(self) -> float:
        """Right end of the last column in px."""
        return self.canvas.width - RIGHT

    def paint_heads(self, bottom: int) -> None:
        """Draw the heads of the columns, and the axis of the latencies."""
        canvas, delays = self.canvas, self.delays
        latency, late = "after", "late"
        if self.wide:
            latency, late = "time until it arrived", "late joiners"
        canvas.text(self.shares.left, 13, "arrived", "start", "label")
        canvas.text(delays.left, 13, latency, "start", "label")
        canvas.text(self.right, 13, late, "end", "label")
        delays.log_axis(_TOP, bottom, dense=self.wide)
        canvas.text(delays.middle, bottom + 34, "logarithmic", class_="tick")

    def paint_profile(self, profile: Profile, top: float) -> float:
        """Draw a profile's outcomes, one row each, and return the lower end in px."""
        name = line(profile.name, _LONGEST_NAME)
        self.canvas.text(4, top + 22, name, "start", "label")
        if self.wide:
            self.canvas.text(self.shares.left + 90, top + 22, profile.offered, "start", "tick")
        top += _HEAD
        for outcome in profile.outcomes:
            middle = top + _ROW / 2
            self._paint_share(outcome, middle)
            self._paint_latencies(outcome, middle)
            self._paint_late_joiners(outcome, middle)
            top += _ROW
        return top

    def _paint_share(self, outcome: Outcome, middle: float) -> None:
        canvas, shares = self.canvas, self.shares
        loss = percent(outcome.loss)
        if self.wide:
            loss += " lost"
        canvas.text(shares.left - 8, middle + 4, loss, "end")
        canvas.rect(shares.left, middle - 6, shares.right - shares.left, 12, "track")
        arrived = shares.px(outcome.share) - shares.left
        canvas.rect(shares.left, middle - 6, arrived, 12, "bar")
        canvas.text(shares.right + 6, middle + 4, percent(outcome.share), "start", "label")

    def _paint_latencies(self, outcome: Outcome, middle: float) -> None:
        """Draw a mark for some of the latencies, and their median."""
        if outcome.median_s is None:
            self.canvas.text(self.delays.left, middle + 4, "nothing arrived", "start", "label")
            return
        marks = min(_MARKS, len(outcome.latencies_s))
        marked_s = np.quantile(outcome.latencies_s, np.linspace(0, 1, marks))
        places = [self._place(latency_s) for latency_s in marked_s]
        # Each mark relative to the previous one, because this halves the text.
        moves = [f"m{right - left:.1f}-10v10" for left, right in itertools.pairwise(places)]
        steps = f"M{places[0]:.1f} {middle - 5:.1f}v10{''.join(moves)}"
        self.canvas.path(steps, "ticks")
        median = self._place(outcome.median_s)
        self.canvas.vertical(median, middle - 8, middle + 8, "median")

    def _place(self, latency_s: float) -> float:
        """Return the position of a latency on the logarithmic axis in px."""
        return self.delays.px(math.log10(max(_LOWEST_S, latency_s)))

    def _paint_late_joiners(self, outcome: Outcome, middle: float) -> None:
        """Draw a dot for each late joiner, first those that received a message."""
        x = self.right - 5 - 11 * (outcome.late - 1)
        for number in range(outcome.late):
            style = "call-accepted" if number < outcome.served else "missed"
            self.canvas.dot(x, middle, 4, style)
            x += 11

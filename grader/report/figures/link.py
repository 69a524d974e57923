"""What QoS profiles do on a link that loses and delays: what arrives, when, and what those get who join late."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from pydantic import Field

from grader.checks.endpoints import clash
from grader.evidence.recorded import Floats, Recorded
from grader.evidence.text.result_rows import LINE_LIMIT, lines_naming
from grader.lab import references as ref
from grader.recording.link import Crossing, LinkedTopic, LinkResult
from grader.recording.record import from_plain
from grader.recording.session import Endpoint, Qos
from grader.report.escape import line
from grader.report.figures import svg
from grader.report.figures.svg import Figure, FigureKind, Frame

_ROW, _HEAD, _TOP = 21, 34, 22
#: So many of a topic's latencies are marked, evenly from the soonest to the latest.
_MARKS = 50
_LOWEST_S = 1e-4
#: On an idle machine 95 % of the packets are passed on within 1 ms of when they are to be.
_BUSY_MS = 3.0
_PRINTED = 120


@dataclass(frozen=True)
class Outcome:
    """A topic's crossing in numbers; latencies in s, by size."""

    loss: float
    share: float
    latencies_s: Floats
    in_order: bool
    #: Subscriptions that joined after the last message, and how many of them got at least one.
    late: int
    served: int

    @classmethod
    def of(cls, crossing: Crossing) -> Outcome:
        """Return the outcome of what was recorded."""
        numbers = [number for number, _ in crossing.received]
        latencies = (
            np.sort(np.array([latency_us for _, latency_us in crossing.received], dtype=float))
            / 1e6
        )
        served = sum(bool(got) for got in crossing.late)
        in_order = numbers == sorted(numbers)
        return cls(
            crossing.loss,
            len(set(numbers)) / crossing.sent,
            latencies,
            in_order,
            len(crossing.late),
            served,
        )

    @property
    def median_s(self) -> float | None:
        """Of the latencies; None where nothing arrived."""
        return float(np.median(self.latencies_s)) if len(self.latencies_s) else None

    @property
    def slow_s(self) -> float | None:
        """Within which 95 % of what arrived had arrived."""
        return float(np.quantile(self.latencies_s, 0.95)) if len(self.latencies_s) else None


@dataclass(frozen=True)
class Profile:
    """A topic of the link under the name by which the lab calls it."""

    name: str
    offered: str
    requested: str
    #: Why nothing can arrive, or was carried.
    problem: str
    outcomes: Sequence[Outcome]
    #: What the student's program printed about it.
    printed: str


@dataclass(frozen=True)
class LinkTable:
    """What the page's table shows, and where the student explains it, by the check that found that."""

    profiles: Sequence[Profile]
    explained_by: str | None
    #: Why there is no picture.
    problem: str = ""

    @property
    def losses(self) -> list[float]:
        """The shares of packets that were lost."""
        return [
            outcome.loss for outcome in next((p.outcomes for p in self.profiles if p.outcomes), ())
        ]


class Link(FigureKind):
    """What the student's QoS profiles do on a link that loses and delays, as a step of the kind `link` found it."""

    step: ref.LinkLabel
    names: dict[str, ref.Topic] = Field(
        default_factory=dict,
        description="Name by which the lab calls a topic -> topic; by default all by their own.",
    )
    artifact: ref.Artifact | None = Field(
        None, description="Program whose printed line about each name is shown."
    )
    explained_by: ref.CheckId | None = Field(
        None, description="Check that looked for where the student explains it."
    )

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw for each topic and loss what arrived, and how late; or say why there is nothing to see."""
        step = recorded.step(self.step)
        if step is None or not step.result:
            return None
        result = from_plain(LinkResult, step.result)
        names = {topic: name for name, topic in self.names.items()}
        printed = (
            [each.text[:LINE_LIMIT] for each in recorded.output_of(self.artifact)]
            if self.artifact
            else []
        )
        profiles = [
            _profile(topic, names.get(topic.name, topic.name), printed) for topic in result.topics
        ]
        content = LinkTable(profiles, self.explained_by, result.problem)
        shown = [profile for profile in profiles if profile.outcomes]
        if not shown:
            return Figure(table="link", content=content)
        return Figure(
            _caption(result, shown),
            lambda width: _paint(shown, width),
            _KEY,
            table="link",
            content=content,
        )


_KEY = (
    ("median", "half of what arrived had arrived by then"),
    ("call-accepted", "a subscription that joined after the last message, and got one"),
    ("missed", "one that got none"),
)


def percent(share: float) -> str:
    """Write a share with three digits, so that one message of some hundred is seen."""
    return f"{svg.short(100 * share)} %"


def _profile(topic: LinkedTopic, name: str, printed: Sequence[str]) -> Profile:
    places = next(
        (
            found
            for loosely in (False, True)
            if (found := lines_naming(printed, name, loosely=loosely))
        ),
        [],
    )
    outcomes = [Outcome.of(crossing) for crossing in topic.crossings if crossing.sent]
    said = line(printed[places[-1]], _PRINTED) if places else ""
    return Profile(
        name, _words(topic.offered), _words(topic.requested), _problem(topic), outcomes, said
    )


def _words(qos: Qos | None) -> str:
    if qos is None:
        return ""
    depth = (
        "history unknown, 10 used"
        if qos.history == "unknown"
        else f"{qos.history} {qos.depth or ''}".strip()
    )
    return ", ".join((qos.reliability, depth, qos.durability)).replace("_", " ")


def _problem(topic: LinkedTopic) -> str:
    if topic.offered is None or topic.requested is None:
        sides = {"publisher": topic.offered, "subscription": topic.requested}
        return f"There is no {' and no '.join(kind for kind, qos in sides.items() if qos is None)} on {topic.topic}."
    policy = clash(
        Endpoint("subscription", topic.topic, topic.type, "", "", "", topic.requested),
        topic.offered,
    )
    return f"The two sides are incompatible in {policy}: nothing can arrive." if policy else ""


def _caption(result: LinkResult, shown: Sequence[Profile]) -> str:
    worst = max(outcome.loss for outcome in shown[0].outcomes)
    arrived = []
    for profile in shown:
        outcome = next(each for each in profile.outcomes if each.loss == worst)
        half = (
            f", half of it within {svg.duration(outcome.median_s)}"
            if outcome.median_s is not None
            else ""
        )
        arrived.append(f"{line(profile.name, 40)} {percent(outcome.share)}{half}")
    ordered = all(outcome.in_order for profile in shown for outcome in profile.outcomes)
    busy = (
        f" The grading computer was busy meanwhile: packets were up to {svg.short(result.late_ms)} ms later still, and "
        "short queues lost messages to that too."
    )
    return (
        f"Where {percent(worst)} of the packets are lost, this much arrives: {'; '.join(arrived)}. "
        f"{'All of it arrived in order. ' if ordered else 'Not all of it arrived in order. '}"
        "These are your profiles, measured by the grader: messages of your topics' types, between two programs of its "
        f"own. The link is {result.means}: it loses packets at random, and the others are "
        f"{svg.short(result.delay_ms)} ms late, each way.{busy if result.late_ms > _BUSY_MS else ''}"
    )


def _paint(shown: Sequence[Profile], width: int) -> tuple[float, list[Markup]]:
    wide = width > svg.NARROW
    bars = Frame(*((74, 0, 400, 0) if wide else (40, 0, 150, 0)), (0, 1), (0, 1))
    every = np.concatenate(
        [outcome.latencies_s for profile in shown for outcome in profile.outcomes]
    )
    known = np.log10(np.clip(every, _LOWEST_S, None)) if len(every) else np.array([-3.0, 0.0])
    bounds = (float(known.min()) - 0.1, float(known.max()) + 0.1)
    delays = Frame(*((460, 0, 820, 0) if wide else (196, 0, 336, 0)), bounds, (0, 1))
    rows = sum(_HEAD + _ROW * len(profile.outcomes) for profile in shown)
    bottom = _TOP + rows + 4
    parts = [
        svg.text(bars.left, 13, "arrived", "start", "label"),
        svg.text(delays.left, 13, "time until it arrived" if wide else "after", "start", "label"),
        svg.text(width - svg.RIGHT, 13, "late joiners" if wide else "late", "end", "label"),
        *delays.log_axis(_TOP, bottom, dense=wide),
        svg.text((delays.left + delays.right) / 2, bottom + 34, "logarithmic", class_="tick"),
    ]
    top = float(_TOP)
    for profile in shown:
        parts.append(svg.text(4, top + 22, line(profile.name, 40), "start", "label"))
        if wide:
            parts.append(svg.text(bars.left + 90, top + 22, profile.offered, "start", "tick"))
        top += _HEAD
        for outcome in profile.outcomes:
            parts += _row(outcome, top + _ROW / 2, bars, delays, width)
            top += _ROW
    return bottom + 40, parts


def _row(outcome: Outcome, middle: float, bars: Frame, delays: Frame, width: int) -> list[Markup]:
    """Return what of a topic arrived, a mark for some of its latencies, and whom of the late joiners it reached."""
    wide = width > svg.NARROW
    share_x = bars.px(outcome.share)
    parts = [
        svg.text(
            bars.left - 8, middle + 4, f"{percent(outcome.loss)}{' lost' if wide else ''}", "end"
        ),
        svg.rect(bars.left, middle - 6, bars.right - bars.left, 12, "track"),
        svg.rect(bars.left, middle - 6, share_x - bars.left, 12, "bar"),
        svg.text(bars.right + 6, middle + 4, percent(outcome.share), "start", "label"),
    ]
    if outcome.median_s is not None:
        marked = np.quantile(
            outcome.latencies_s, np.linspace(0, 1, min(_MARKS, len(outcome.latencies_s)))
        )
        places = [delays.px(math.log10(max(_LOWEST_S, value))) for value in marked]
        half = delays.px(math.log10(max(_LOWEST_S, outcome.median_s)))
        # Each from the one before it, which halves the text.
        moves = "".join(f"m{right - left:.1f}-10v10" for left, right in itertools.pairwise(places))
        path = f"M{places[0]:.1f} {middle - 5:.1f}v10{moves}"
        parts += [
            svg.tag("path", d=path, class_="ticks"),
            svg.rule(half, middle - 8, half, middle + 8, "median"),
        ]
    else:
        parts.append(svg.text(delays.left, middle + 4, "nothing arrived", "start", "label"))
    for number in range(outcome.late):
        x = width - svg.RIGHT - 5 - 11 * (outcome.late - 1 - number)
        style = "call-accepted" if number < outcome.served else "missed"
        parts.append(svg.tag("circle", cx=x, cy=middle, r=4, class_=style))
    return parts

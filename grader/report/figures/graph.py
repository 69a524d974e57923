"""What a session's graph held: the calls of a service, and endpoints with their QoS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from grader.evidence.recorded import Recorded
from grader.lab import references as ref
from grader.recording.session import Endpoint, asked_for, completed
from grader.report.escape import line
from grader.report.figures.svg import (
    SINCE,
    Figure,
    FigureKind,
    duration,
    frame_in,
    padded,
    rule,
    tag,
    text,
)
from grader.report.views import fields, literal

_MOST_ENDPOINTS = 16


@dataclass(frozen=True)
class Call:
    """One call of a service; `response` is None where none came in time."""

    start_s: float
    latency_s: float
    response: Any

    @classmethod
    def of(cls, recorded: Recorded, call: Mapping[str, Any]) -> Call:
        """Return one of a step's."""
        start_s, latency_s = (
            recorded.since_start_s(call["started_ns"]),
            (call["ended_ns"] - call["started_ns"]) / 1e9,
        )
        return cls(start_s, latency_s, call["response"])

    @property
    def key(self) -> tuple[str, str]:
        """Style class of its mark and what it means: the first truth value says whether the service did as asked."""
        if self.response is None:
            return "call-silent", "no answer in time"
        values = self.response.values() if isinstance(self.response, Mapping) else ()
        accepted = next((value for value in values if isinstance(value, bool)), None)
        if accepted is None:
            return "call-accepted", "answered"
        return ("call-accepted" if accepted else "call-refused"), f"answered: {literal(accepted)}"

    def mark(self, x: float, y: float) -> Markup:
        """Return its mark."""
        style, _ = self.key
        if style == "call-accepted":
            return tag("circle", cx=x, cy=y, r=4, class_=style)
        silent, refused = (
            f"M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8",
            f"M{x:.1f} {y - 5:.1f}l5 5l-5 5l-5 -5z",
        )
        return tag("path", d=silent if self.response is None else refused, class_=style)


class Calls(FigureKind):
    """All calls of a service, and when parameters were set between them."""

    service: ref.Topic

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw each call at its time, as high as it took long; below them stand requests and answers."""
        record, service = recorded.record, recorded.used(self.service)
        groups = []
        for step in record.steps:
            if (
                step.kind == "call"
                and step.result.get("service") == service
                and step.result.get("calls")
            ):
                group = [Call.of(recorded, call) for call in step.result["calls"]]
                groups.append(
                    (step.label or "call", fields(step.parameters.get("request", {})), group)
                )
        calls = [call for _, _, group in groups for call in group]
        if not calls:
            return None
        answered = [call.latency_s for call in calls if call.response is not None]
        slowest = max(answered or [call.latency_s for call in calls])
        start, end = (
            min(call.start_s for call in calls),
            max(call.start_s + call.latency_s for call in calls),
        )
        marks = [
            (
                at_s,
                ", ".join(
                    f"{k} = {literal(v)}" for k, v in step.parameters.get("values", {}).items()
                ),
            )
            for step in record.steps
            if step.kind == "set_parameters"
            and step.outcome == "done"
            and start <= (at_s := recorded.since_start_s(step.ended_ns)) <= end
        ]
        scale, unit = (1.0, "s") if slowest >= 1 else (1e3, "ms")

        def paint(width: int) -> tuple[float, list[Markup]]:
            x = padded([call.start_s for call in calls], 0.04, 0.02)
            frame = frame_in(width, 260, x, (0, slowest * 1.15 or 1e-3), top=52)
            parts = [
                *frame.y_axis(4, scale),
                text(4, 16, f"time until the answer, {unit}", "start", "label"),
            ]
            for n, (at_s, words) in enumerate(marks):
                at, top = frame.px(at_s), frame.top - 6 - 14 * (n % 2)
                parts.append(rule(at, top, at, frame.bottom, "mark"))
                aside, gap = ("end", -3) if at > width * 0.6 else ("start", 3)
                parts.append(text(at + gap, top - 2, line(words, 30), aside, "note"))
            for call in calls:
                at, high = frame.px(call.start_s), frame.py(min(call.latency_s, slowest))
                parts += [rule(at, frame.bottom, at, high, "stem"), call.mark(at, high)]
            return 260, parts + frame.x_axis(SINCE)

        silent = len(calls) - len(answered)
        caption = f"{len(calls)} calls of {line(service, 60)}; "
        caption += (
            f"the slowest answer took {duration(slowest)}." if answered else "none was answered."
        )
        caption += f" {silent} got no answer in time." if silent and answered else ""
        key = tuple(sorted({call.key for call in calls}, reverse=True))
        return Figure(caption, paint, key, table="calls_table", content=groups)


class QosTable(FigureKind):
    """The QoS profiles of some topics' endpoints."""

    topics: tuple[ref.Topic, ...]

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """List them: reliability and durability come from discovery, history and depth from the source."""
        rows = [
            _qos_row(endpoint, recorded)
            for topic in self.topics
            for kind in ("publisher", "subscription")
            for endpoint in recorded.endpoints_on(topic, kind)[:_MOST_ENDPOINTS]
        ]
        return Figure(table="qos", content=rows) if rows else None


def _qos_row(endpoint: Endpoint, recorded: Recorded) -> dict[str, Any]:
    claim = asked_for(endpoint, recorded.record.claims)
    inside = claim is not None and claim.file and not claim.file.startswith("/")
    return {
        "topic": endpoint.topic,
        "kind": endpoint.kind,
        "qos": completed(endpoint.qos, claim),
        "where": f"{claim.file}:{claim.line}" if claim is not None and inside else "",
        "messages": len(recorded.bag.stream(endpoint.topic)),
    }

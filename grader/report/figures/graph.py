"""The graph of a session: calls of a service, and endpoints with their QoS profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from grader.evidence.recorded import Recorded
from grader.lab import references as ref
from grader.lab.steps import CallStep, SetParametersStep
from grader.lab.steps.call import CallRecord, CallResult
from grader.lab.steps.words import fields, literal
from grader.recording.session import Claim, Endpoint, StepRun, asked_for, completed
from grader.report.escape import line
from grader.report.figures.svg import (
    SINCE,
    Canvas,
    Figure,
    FigureKind,
    Frame,
    Range,
    duration,
    padded,
)
from ros_bag.qos import Qos

_MOST_ENDPOINTS = 16
_HEIGHT = 208
#: Height of a line of words above the calls, and the number of such lines, because near words would overlap.
_WORDS_HEIGHT = 14
_MOST_HEIGHTS = 4
#: Style class of the marks of accepted calls.
_ACCEPTED = "call-accepted"


# -- calls -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Call:
    """One call of a service; `response` is None if there was no answer in time."""

    start_s: float
    latency_s: float
    response: Any

    @classmethod
    def of(cls, recorded: Recorded, call: CallRecord) -> Call:
        """Read a call from the result of a step."""
        latency_s = (call.ended_ns - call.started_ns) / 1e9
        return cls(recorded.since_start_s(call.started_ns), latency_s, call.response)

    @property
    def end_s(self) -> float:
        """Time of the answer, or of giving up."""
        return self.start_s + self.latency_s

    @property
    def accepted(self) -> bool | None:
        """First truth value in the response; None if it has none."""
        if isinstance(self.response, Mapping):
            for value in self.response.values():
                if isinstance(value, bool):
                    return value
        return None

    @property
    def key(self) -> tuple[str, str]:
        """Style class of the call's mark, and its meaning."""
        if self.response is None:
            return "call-silent", "no answer in time"
        if self.accepted is None:
            return _ACCEPTED, "answered"
        style = _ACCEPTED if self.accepted else "call-refused"
        return style, f"answered: {literal(self.accepted)}"

    def paint(self, canvas: Canvas, x: float, y: float) -> None:
        """Draw a diamond if the service refused, and a cross if it did not answer."""
        style, _ = self.key
        if style == "call-silent":
            canvas.path(f"M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8", style)
        else:
            canvas.path(f"M{x:.1f} {y - 5:.1f}l5 5l-5 5l-5 -5z", style)


class CallGroup(NamedTuple):
    """The calls of one step, as the page's table lists them."""

    label: str
    request: str
    calls: Sequence[Call]


@dataclass(frozen=True)
class _SetParameters:
    """Parameters that were set between calls."""

    at_s: float
    words: str


class Calls(FigureKind):
    """All calls of a service, and when parameters were set between them."""

    service: ref.Topic

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw each call as high as it took long; a table lists requests and answers."""
        service = recorded.used(self.service)
        groups = _groups_of(recorded, service)
        calls = [call for group in groups for call in group.calls]
        if not calls:
            return None
        chart = _CallChart(service, calls, _parameters_set(recorded, calls))
        kinds = {call.key for call in calls}
        key = tuple(sorted(kinds, reverse=True))
        return Figure(chart.caption, chart.paint, key, table="calls_table", content=groups)


def _groups_of(recorded: Recorded, service: str) -> list[CallGroup]:
    """Return the calls of a service, step by step."""
    groups = []
    for step in recorded.record.steps:
        if step.kind != CallStep.kind:
            continue
        result = CallResult.of(step)
        if result.service == service and result.calls:
            calls = [Call.of(recorded, call) for call in result.calls]
            request = fields(CallStep.given(step).request)
            groups.append(CallGroup(step.label or "call", request, calls))
    return groups


def _parameters_set(recorded: Recorded, calls: Sequence[Call]) -> list[_SetParameters]:
    """Return the parameters that were set between the first call and the last answer."""
    start_s = min(call.start_s for call in calls)
    end_s = max(call.end_s for call in calls)
    found = []
    for step in recorded.record.steps:
        if step.kind != "set_parameters" or step.outcome != "done":
            continue
        at_s = recorded.since_start_s(step.ended_ns)
        if start_s <= at_s <= end_s:
            found.append(_SetParameters(at_s, _assignments(step)))
    return found


def _assignments(step: StepRun) -> str:
    """Write the parameters that a step sets: `max_speed = 1.5, mode = 'fast'`."""
    values = SetParametersStep.given(step).values
    written = [f"{name} = {literal(value)}" for name, value in values.items()]
    return ", ".join(written)


@dataclass(frozen=True)
class _CallChart:
    """Calls of a service over time."""

    service: str
    calls: Sequence[Call]
    parameters: Sequence[_SetParameters]

    @cached_property
    def answered(self) -> Sequence[Call]:
        """Calls with an answer."""
        return [call for call in self.calls if call.response is not None]

    @cached_property
    def slowest_s(self) -> float:
        """Latency of the slowest answer; if there is none, of the longest wait."""
        return max(call.latency_s for call in self.answered or self.calls)

    @property
    def caption(self) -> str:
        calls = f"{len(self.calls)} calls of {line(self.service, 60)}"
        if not self.answered:
            return f"{calls}; none was answered."
        caption = f"{calls}; the slowest answer took {duration(self.slowest_s)}."
        silent = len(self.calls) - len(self.answered)
        if silent:
            caption += f" {silent} got no answer in time."
        return caption

    def paint(self, canvas: Canvas) -> None:
        scale, unit = 1e3, "ms"
        if self.slowest_s >= 1:
            scale, unit = 1.0, "s"
        x = padded([call.start_s for call in self.calls], 0.04, 0.02)
        y = Range(0, self.slowest_s * 1.15 or 1e-3)
        heights = min(len(self.parameters), _MOST_HEIGHTS)
        above = 24 + _WORDS_HEIGHT * heights
        frame = canvas.frame(_HEIGHT + above, x, y, top=above)
        frame.y_axis(4, scale)
        canvas.text(4, 16, f"time until the answer, {unit}", "start", "label")
        self._paint_parameters(frame, heights)
        self._paint_calls(frame)
        frame.x_axis(SINCE)

    def _paint_parameters(self, frame: Frame, heights: int) -> None:
        """Draw a line for each time when parameters were set, with its words at one of several heights by turns."""
        canvas = frame.canvas
        for n, parameters in enumerate(self.parameters):
            x = frame.px(parameters.at_s)
            top = frame.top - 6 - _WORDS_HEIGHT * (n % heights)
            canvas.vertical(x, top, frame.bottom, "mark")
            words = line(parameters.words, 30)
            if x > canvas.width * 0.6:
                canvas.text(x - 3, top - 2, words, "end", "note")
            else:
                canvas.text(x + 3, top - 2, words, "start", "note")

    def _paint_calls(self, frame: Frame) -> None:
        """Draw a stem for each call, with a dot if the service accepted, or the mark of another answer."""
        stems = ""
        accepted = []
        others = []
        for call in self.calls:
            x = frame.px(call.start_s)
            y = frame.py(min(call.latency_s, self.slowest_s))
            stems += f"M{x:.1f} {frame.bottom:.0f}V{y:.1f}"
            style, _ = call.key
            if style == _ACCEPTED:
                accepted.append((x, y))
            else:
                others.append((call, x, y))
        frame.canvas.path(stems, "stem")
        if accepted:
            frame.canvas.dots(accepted, 4, f"dots {_ACCEPTED}")
        for call, x, y in others:
            call.paint(frame.canvas, x, y)


# -- endpoints ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class QosRow:
    """An endpoint in the page's table."""

    topic: str
    #: `publisher` or `subscription`.
    kind: str
    qos: Qos
    #: Place in the submission that asks for the endpoint, such as `node.py:31`.
    where: str
    #: Number of recorded messages on the topic.
    messages: int


class QosTable(FigureKind):
    """The QoS profiles of some topics' endpoints."""

    topics: tuple[ref.Topic, ...]

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """List the endpoints: reliability and durability come from discovery, history and depth from the source."""
        rows = []
        for topic in self.topics:
            for kind in ("publisher", "subscription"):
                endpoints = recorded.endpoints_on(topic, kind)
                rows += [_qos_row(endpoint, recorded) for endpoint in endpoints[:_MOST_ENDPOINTS]]
        if not rows:
            return None
        return Figure(table="qos", content=rows)


def _qos_row(endpoint: Endpoint, recorded: Recorded) -> QosRow:
    claim = asked_for(endpoint, recorded.record.claims)
    qos = completed(endpoint.qos, claim)
    messages = recorded.bag.stream(endpoint.topic).recorded
    return QosRow(endpoint.topic, endpoint.kind, qos, _place(claim), messages)


def _place(claim: Claim | None) -> str:
    """Return file and line of a claim; empty for a file outside the submission."""
    if claim is None or not claim.file:
        return ""
    if claim.file.startswith("/"):
        return ""
    return f"{claim.file}:{claim.line}"

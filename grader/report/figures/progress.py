"""Requests over time: an action's goals, and the states of a lifecycle node."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grader.evidence.recorded import Recorded
from grader.lab import references as ref
from grader.lab.steps.change_state import ChangeStateResult, ChangeStateStep
from grader.lab.steps.send_goal import GoalRecord, SendGoalResult, SendGoalStep
from grader.lab.steps.words import fields
from grader.recording.session import StepRun
from grader.report.escape import line
from grader.report.figures.svg import (
    MOST_POINTS,
    SINCE,
    Canvas,
    Figure,
    FigureKind,
    Frame,
    Range,
    padded,
)

_MOST_ROWS = 16
#: Heights of a row and of its bar in px.
_ROW, _BAR = 46, 14
#: Width of a letter in px.
_LETTER = 7


@dataclass(frozen=True)
class _Span:
    """A time with a beginning and an end, drawn as a bar."""

    begin_s: float
    end_s: float
    words: str
    style: str


@dataclass(frozen=True)
class _Mark:
    """A moment with its words, drawn as a vertical line."""

    at_s: float
    words: str


@dataclass(frozen=True)
class _Row:
    """A row of the picture under its title."""

    title: str
    spans: Sequence[_Span]
    #: Times of messages in s, drawn as dots.
    messages_s: Sequence[float] = ()
    marks: Sequence[_Mark] = ()

    def paint(self, frame: Frame, top: float) -> None:
        canvas = frame.canvas
        title = line(self.title, canvas.width // 8)
        canvas.text(frame.left, top - 6, title, "start", "label")
        for span in self.spans:
            _paint_span(span, frame, top)
        for at_s in self.messages_s:
            canvas.dot(frame.px(at_s), top + _BAR + 5, 1.6, "dot")
        for mark in self.marks:
            _paint_mark(mark, frame, top)


def _paint_span(span: _Span, frame: Frame, top: float) -> None:
    canvas = frame.canvas
    left = frame.px(span.begin_s)
    width = max(2.0, frame.px(span.end_s) - left)
    canvas.rect(left, top, width, _BAR, span.style)
    # The caption repeats words that do not fit into their bar.
    if width > _LETTER * len(span.words):
        canvas.text(left + width / 2, top + 11, span.words, class_="note")


def _paint_mark(mark: _Mark, frame: Frame, top: float) -> None:
    canvas = frame.canvas
    x = frame.px(mark.at_s)
    canvas.vertical(x, top - 3, top + _BAR + 3, "mark")
    if x > canvas.width * 0.7:
        canvas.text(x - 4, top + 11, mark.words, "end", "note")
    else:
        canvas.text(x + 4, top + 11, mark.words, "start", "note")


@dataclass(frozen=True)
class _Chart:
    """Rows over one axis of time."""

    rows: Sequence[_Row]

    @property
    def range(self) -> Range:
        """Time from the first beginning to the last end, in s."""
        ends_s = []
        for row in self.rows:
            for span in row.spans:
                ends_s += [span.begin_s, span.end_s]
        return padded(ends_s, 0.02, 0.05)

    def paint(self, canvas: Canvas) -> None:
        height = _ROW * len(self.rows) + 60
        frame = canvas.frame(height, self.range, Range(0, 1), top=10)
        frame.x_axis(SINCE)
        for n, row in enumerate(self.rows):
            row.paint(frame, 28 + _ROW * n)


# -- goals -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Goal:
    """A goal that was sent, and the step that sent it."""

    step: StepRun
    record: GoalRecord

    @property
    def accepted(self) -> bool | None:
        """True if the server accepted the goal; None if there was no answer."""
        return self.record.accepted

    @property
    def end_ns(self) -> int:
        """Time at which the goal ended or was rejected, or waiting ended."""
        ended_ns = self.record.ended_ns
        if not ended_ns and self.accepted is False:
            ended_ns = self.record.answered_ns
        return ended_ns or self.step.ended_ns

    @property
    def title(self) -> str:
        """Label of the step with the goal's status and result."""
        label = self.step.label or "goal"
        if self.accepted is None:
            return f"{label}: no answer"
        if not self.accepted:
            return f"{label}: rejected"
        title = f"{label}: {self.record.status}"
        if self.record.result:
            title += f", {fields(self.record.result)}"
        return title

    def row(self, recorded: Recorded) -> _Row:
        begin_s = recorded.since_start_s(self.record.sent_ns)
        end_s = recorded.since_start_s(self.end_ns)
        style = "call-accepted faint" if self.accepted else "call-refused"
        span = _Span(begin_s, end_s, "", style)
        feedback_s = [recorded.since_start_s(each.t_ns) for each in self.record.feedback]
        marks = []
        cancel = self.record.cancel
        if cancel is not None:
            marks.append(_Mark(recorded.since_start_s(cancel.sent_ns), "cancel"))
        return _Row(self.title, [span], _thinned(feedback_s), marks)


class Goals(FigureKind):
    """The goals of an action, each with its answer, its feedback and its end."""

    action: ref.RosName

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw each goal as a bar from sending to its end, with a dot for each feedback."""
        goals = self._goals(recorded)
        if not goals:
            return None
        accepted = 0
        feedback = 0
        for goal in goals:
            accepted += goal.accepted is True
            feedback += goal.record.feedback_count
        caption = f"{len(goals)} goals, {accepted} accepted, with {feedback} messages of feedback, a dot each."
        chart = _Chart([goal.row(recorded) for goal in goals])
        return Figure(caption, chart.paint)

    def _goals(self, recorded: Recorded) -> list[_Goal]:
        """Return the goals that steps sent to the action."""
        goals = []
        for step in recorded.record.steps:
            if step.kind != SendGoalStep.kind:
                continue
            if SendGoalStep.given(step).action == self.action:
                goals += [_Goal(step, record) for record in SendGoalResult.of(step).goals]
        return goals[:_MOST_ROWS]


# -- states ------------------------------------------------------------------------------------


class States(FigureKind):
    """The states of a lifecycle node over time, and when it published on a topic."""

    topic: ref.Topic

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw a bar for each state that transitions show, and a dot for each message."""
        steps = []
        for step in recorded.record.steps:
            if step.kind == "change_state" and step.outcome == "done":
                steps.append(step)
        if not steps:
            return None
        sent_ns = np.sort(recorded.stream(self.topic).source_ns)
        times_s = recorded.seconds(sent_ns).tolist()
        messages = f"messages on {recorded.used(self.topic)}"
        chart = _Chart(
            [_Row(f"states, and {messages}", _spans(recorded, steps), _thinned(times_s))]
        )
        caption = f"{_transitions(steps)}. {len(times_s)} {messages}, a dot each."
        return Figure(caption, chart.paint)


def _spans(recorded: Recorded, steps: Sequence[StepRun]) -> list[_Span]:
    """Return the states before, between and after transitions."""
    changes = [ChangeStateResult.of(step) for step in steps]
    begins_ns = [recorded.record.started_ns]
    ends_ns = []
    states = [str(changes[0].before)]
    for change in changes:
        ends_ns.append(change.called_ns)
        begins_ns.append(change.answered_ns)
        states.append(str(change.after))
    ends_ns.append(recorded.record.ended_ns)
    spans = []
    for begin_ns, end_ns, state in zip(begins_ns, ends_ns, states, strict=True):
        begin_s, end_s = recorded.since_start_s(begin_ns), recorded.since_start_s(end_ns)
        style = "call-accepted faint" if state == "active" else "box"
        spans.append(_Span(begin_s, end_s, state, style))
    return spans


def _transitions(steps: Sequence[StepRun]) -> str:
    """Write transitions with their results: `configure → inactive, activate → active`."""
    texts = []
    for step in steps:
        transition = ChangeStateStep.given(step).transition
        texts.append(f"{transition} → {ChangeStateResult.of(step).after}")
    return ", ".join(texts)


def _thinned(times_s: Sequence[float]) -> Sequence[float]:
    """Return at most `MOST_POINTS` of the times, evenly chosen."""
    step = math.ceil(len(times_s) / MOST_POINTS)
    return times_s[:: max(1, step)]

"""What became of requests over time: an action's goals, and the states of a lifecycle node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from grader.evidence.recorded import Recorded
from grader.lab import references as ref
from grader.report.escape import line
from grader.report.figures.svg import (
    MOST_POINTS,
    SINCE,
    Figure,
    FigureKind,
    frame_in,
    padded,
    rect,
    rule,
    tag,
    text,
)
from grader.report.views import fields

_MOST_ROWS = 16
_ROW, _BAR = 46, 14


@dataclass(frozen=True)
class _Row:
    """A line of the picture: what stands above it, spans with their words and style, and moments."""

    title: str
    spans: Sequence[tuple[float, float, str, str]]
    dots: Sequence[float] = ()
    marks: Sequence[tuple[float, str]] = ()

    @property
    def times(self) -> list[float]:
        return [at for begin, end, *_ in self.spans for at in (begin, end)]


def _figure(rows: Sequence[_Row], caption: str) -> Figure:
    x = padded([at for row in rows for at in row.times], 0.02, 0.05)

    def paint(width: int) -> tuple[float, list[Markup]]:
        height = _ROW * len(rows) + 60
        frame = frame_in(width, height, x, (0, 1), top=10)
        parts = frame.x_axis(SINCE)
        for n, row in enumerate(rows):
            top = 28 + _ROW * n
            parts.append(text(frame.left, top - 6, line(row.title, width // 8), "start", "label"))
            for begin, end, words, style in row.spans:
                left, wide = frame.px(begin), max(2.0, frame.px(end) - frame.px(begin))
                parts.append(rect(left, top, wide, _BAR, style))
                # What has no room in its span is said in the caption.
                if wide > 7 * len(words):
                    parts.append(text(left + wide / 2, top + 11, words, class_="note"))
            parts += [
                tag("circle", cx=frame.px(at), cy=top + _BAR + 5, r=1.6, class_="dot")
                for at in row.dots
            ]
            for at, words in row.marks:
                aside = ("end", -4) if frame.px(at) > width * 0.7 else ("start", 4)
                parts += [
                    rule(frame.px(at), top - 3, frame.px(at), top + _BAR + 3, "mark"),
                    text(frame.px(at) + aside[1], top + 11, words, aside[0], "note"),
                ]
        return height, parts

    return Figure(caption, paint)


class Goals(FigureKind):
    """The goals of an action, each with its answer, its feedback and its end."""

    action: ref.RosName

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw a row for each goal: from when it was sent until it ended, with a dot for each feedback."""
        steps = [
            s
            for s in recorded.record.steps
            if s.kind == "send_goal" and s.parameters["action"] == self.action
        ]
        sent = [(step, goal) for step in steps for goal in step.result.get("goals", ())][
            :_MOST_ROWS
        ]
        if not sent:
            return None
        rows = [
            self._row(recorded, step.label or "goal", step.ended_ns, goal) for step, goal in sent
        ]
        accepted = sum(goal["accepted"] is True for _, goal in sent)
        feedback = sum(goal["feedback_count"] for _, goal in sent)
        caption = f"{len(sent)} goals, {accepted} accepted, with {feedback} messages of feedback, a dot each."
        return _figure(rows, caption)

    def _row(self, recorded: Recorded, label: str, waited_ns: int, goal: Mapping[str, Any]) -> _Row:
        since = recorded.since_start_s
        ended_ns = (
            goal["ended_ns"]
            or (goal["answered_ns"] if goal["accepted"] is False else None)
            or waited_ns
        )
        status = {True: str(goal["status"]), False: "rejected", None: "no answer"}[goal["accepted"]]
        result = f", {fields(goal['result'])}" if goal["accepted"] and goal["result"] else ""
        style = "call-accepted faint" if goal["accepted"] else "call-refused"
        dots = [since(each["t_ns"]) for each in goal["feedback"]]
        cancel = goal["cancel"]
        marks = [(since(cancel["sent_ns"]), "cancel")] if cancel is not None else []
        return _Row(
            f"{label}: {status}{result}",
            [(since(goal["sent_ns"]), since(ended_ns), "", style)],
            _thinned(dots),
            marks,
        )


class States(FigureKind):
    """The states of a lifecycle node over time, and when it published on a topic."""

    topic: ref.Topic

    def draw(self, recorded: Recorded, lab_folder: Path) -> Figure | None:
        """Draw a span for each state that transitions show, and a dot for each message."""
        steps = [
            s for s in recorded.record.steps if s.kind == "change_state" and s.outcome == "done"
        ]
        if not steps:
            return None
        since, record = recorded.since_start_s, recorded.record
        begins = [record.started_ns, *(step.result["answered_ns"] for step in steps)]
        ends = [*(step.result["called_ns"] for step in steps), record.ended_ns]
        states = [str(steps[0].result["before"]), *(str(step.result["after"]) for step in steps)]
        spans = [
            (since(begin), since(end), state, "call-accepted faint" if state == "active" else "box")
            for begin, end, state in zip(begins, ends, states, strict=True)
        ]
        times = recorded.seconds(np.sort(recorded.stream(self.topic).source_ns))
        asked = ", ".join(
            f"{step.parameters['transition']} → {step.result['after']}" for step in steps
        )
        row = _Row(
            f"states, and messages on {recorded.used(self.topic)}", spans, _thinned(times.tolist())
        )
        return _figure(
            [row], f"{asked}. {len(times)} messages on {recorded.used(self.topic)}, a dot each."
        )


def _thinned(times: Sequence[float]) -> Sequence[float]:
    return times[:: -(-len(times) // MOST_POINTS) or 1]

"""Pictures as SVG: well-formed, described in words, and drawn within their frame."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import pytest

from grader.evidence.figures import (
    Call,
    CallGroup,
    Calls,
    Distribution,
    Intervals,
    Latency,
    Line,
    Mark,
    Plateau,
    Rate,
    Reports,
    Series,
)
from grader.report import charts
from grader.report.charts import Chart, duration

EVIL = "/a<script>alert('x')</script>\x1b[31m\u202e"
EDGES = tuple(0.008 + n * 0.0001 for n in range(41))
INTERVALS = Intervals("Title", "s", EVIL, 0.01, EDGES, (5,) * 40, 1, 2, 0.01, 0.009, 0.011)
RATE = Rate("Title", "s", EVIL, 100.0, (0.0, 0.5, 1.0), (99.0, 101.0))
SERIES = Series(
    "Title",
    "s",
    "data",
    "rad",
    (
        Line("command", EVIL, 0, (0.0, 1.0), (-1.0, 1.0)),
        Line("state", "/b", 0, (0.5, 1.0), (0.0, 0.0)),
        Line("command", EVIL, 1, (0.0, 1.0), (2.0, 2.0)),
    ),
    3,
)
REPORTS = Reports("Title", "s", "node", "rad", (0.0, 1.0), (0.1, 1e9), 2, (Plateau(0.0, 1.0, 0.1),))
CALLS = Calls(
    "Title",
    "s",
    EVIL,
    (
        CallGroup(
            "a",
            EVIL,
            (Call(0.0, 0.001, EVIL, True), Call(0.1, 0.002, "x", False), Call(0.2, 3.0, None, None)),
        ),
    ),
    (Mark(0.05, EVIL),),
)
LATENCY = Latency("Title", "s", (Distribution(EVIL, 3, 1e-4, 2e-4, 3e-4, 4e-4, 5e-4, 0.01, (1e-4, 3e-4, -1.0)),))
ALL: list[tuple[Callable[..., Chart], Any]] = [
    (charts.intervals_chart, INTERVALS),
    (charts.rate_chart, RATE),
    (charts.series_chart, SERIES),
    (charts.reports_chart, REPORTS),
    (charts.calls_chart, CALLS),
    (charts.latency_chart, LATENCY),
]


@pytest.mark.parametrize(("paint", "figure"), ALL)
def test_each_form_is_a_described_image(paint: Callable[..., Chart], figure: Any) -> None:
    """Both forms parse as XML, have the role of an image, and are labelled by their title and description."""
    chart = paint(figure, "fig-1")
    for form in (chart.wide, chart.narrow):
        if form is None:
            continue
        root = ET.fromstring(str(form))
        assert root.get("role") == "img"
        assert root.get("viewBox")
        names = (root.get("aria-labelledby") or "").split()
        assert [child.get("id") for child in root[:2]] == names
        assert [child.tag for child in root[:2]] == ["title", "desc"]
        assert (root[0].text, root[1].text) == ("Title", chart.caption)


@pytest.mark.parametrize(("paint", "figure"), ALL)
def test_names_of_students_stay_text(paint: Callable[..., Chart], figure: Any) -> None:
    """Topic names and answers can neither become elements nor carry control characters."""
    chart = paint(figure, "fig-1")
    for form in (chart.wide, chart.narrow or chart.wide):
        assert "<script" not in form
        assert "\x1b" not in form
        assert "\u202e" not in form


@pytest.mark.parametrize(("paint", "figure"), ALL)
def test_marks_lie_within_the_frame(paint: Callable[..., Chart], figure: Any) -> None:
    """No coordinate is lost beyond the picture, and none is not a number."""
    chart = paint(figure, "fig-1")
    for form in (chart.wide, chart.narrow or chart.wide):
        assert "nan" not in form
        assert "inf" not in form
        width, height = map(float, re.findall(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', form)[0])
        for axis, limit in (("x", width), ("y", height)):
            numbers = re.findall(rf'(?<![a-z]){axis}[12]?="(-?[\d.]+)"', form)
            assert all(-1 <= float(n) <= limit + 1 for n in numbers)


def test_outliers_do_not_flatten_the_rest() -> None:
    """A report of a billion is left out of the picture, and the caption says so."""
    chart = charts.reports_chart(REPORTS, "f")
    assert "1 lie far outside" in chart.caption
    assert chart.wide.count("<circle") == 1


def test_kinds_of_answers_differ_by_shape() -> None:
    """Accepted, refused and unanswered calls have marks of their own, explained in the key."""
    chart = charts.calls_chart(CALLS, "f")
    assert {style for style, _ in chart.key} == {"call-accepted", "call-refused", "call-silent"}
    assert all(style in chart.wide for style, _ in chart.key)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.01, "10 ms"), (0.0001234, "123 µs"), (1.5, "1.5 s"), (0.0, "0 s"), (12.3456, "12.3 s")],
)
def test_durations_have_the_unit_that_suits(seconds: float, text: str) -> None:
    """Short times are written in ms or µs, with three digits."""
    assert duration(seconds) == text

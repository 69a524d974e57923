"""The figure of a bad link: its forms for a desk and a phone, and its text without a recording."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from grader.lab.steps.link import Crossing, LinkedTopic, LinkResult
from grader.recording.session import OutputLine, ProcessRun, StepRun
from grader.report.figures.link import LinkTable
from grader.report.figures.svg import NARROW, WIDE, Figure
from ros_bag.qos import Qos
from tests.report.test_figures import FLOATS, drawn, labels, marks, picture, recorded, shown

BEST_EFFORT = Qos("best_effort", "volatile", "keep_last", 1)
LATCHED = Qos("reliable", "transient_local", "keep_last", 10)
SETTINGS: dict[str, Any] = {"step": "link", "names": {"fast": "/fast"}, "artifact": "tool"}


def crossing(loss: float, sent: int, received: list[list[int]], late: int = 0) -> Crossing:
    """Return a crossing with the last message at some of four late joiners."""
    return Crossing(loss, sent, received, [[sent]] * late + [[]] * (4 - late))


def figure_of(tmp_path: Path, result: LinkResult, *output: str) -> Figure:
    """Draw the figure of a session with this result of a link."""
    step = StepRun("link", {"topics": ["/fast", "/safe"]}, "link", result=asdict(result))
    run = ProcessRun(
        "tool", "student", [], "tool", output=[OutputLine(0, "stdout", line) for line in output]
    )
    return shown("link", recorded(tmp_path, {}, steps=[step], processes=[run]), **SETTINGS)


def two_profiles() -> LinkResult:
    """Return the crossings of a lossy and a safe profile: three of four, soon, and all, some late."""
    lossy = [crossing(0.3, 4, [[1, 10_000], [3, 12_000], [4, 11_000]])]
    safe = [crossing(0.3, 4, [[1, 10_000], [2, 90_000], [3, 80_000], [4, 70_000]], late=3)]
    topics = [
        LinkedTopic("/fast", "/fast", FLOATS, BEST_EFFORT, BEST_EFFORT, lossy),
        LinkedTopic("/safe", "/safest", FLOATS, LATCHED, LATCHED, safe),
    ]
    return LinkResult(topics=topics, delay_ms=10.0, means="a relay")


def content(figure: Figure) -> LinkTable:
    """Return the contents of the page's table."""
    assert isinstance(figure.content, LinkTable)
    return figure.content


def numbers_of(figure: Figure, style: str, attribute: str) -> list[float]:
    """Return an attribute of all marks in a style."""
    return [float(mark.get(attribute) or 0) for mark in marks(figure, style)]


def test_what_arrived_and_how_late_is_drawn(tmp_path: Path) -> None:
    """The figure has a bar as long as the share, a mark for each message, the median, and the reached late joiners."""
    figure = figure_of(tmp_path, two_profiles())
    shares = zip(
        numbers_of(figure, "bar", "width"), numbers_of(figure, "track", "width"), strict=True
    )
    assert [round(bar / track, 2) for bar, track in shares] == [0.75, 1.0]
    assert [(mark.get("d") or "").count("v10") for mark in marks(figure, "ticks")] == [3, 4]
    early, late = numbers_of(figure, "median", "x1")
    assert early < late
    assert (len(marks(figure, "call-accepted")), len(marks(figure, "missed"))) == (3, 5)
    assert {"75 %", "100 %", "30 % lost", "fast", "/safe"} <= set(labels(figure))
    assert (
        "fast 75 %, half of it within 11 ms; /safe 100 %, half of it within 75 ms" in figure.caption
    )
    assert "All of it arrived in order." in figure.caption
    assert "nan" not in f"{figure.svg('f', WIDE)} {figure.svg('f', NARROW)}"


def test_a_busy_machine_is_named(tmp_path: Path) -> None:
    """The machine's own delay is not attributed to the profiles."""
    result = two_profiles()
    assert "busy" not in figure_of(tmp_path / "idle", result).caption
    result.late_ms = 14.2
    assert "The grading computer was busy meanwhile: packets were up to 14.2 ms later" in (
        figure_of(tmp_path / "busy", result).caption
    )


def test_what_overtook_is_said(tmp_path: Path) -> None:
    """Messages that are taken in another order than they were sent are no order."""
    result = two_profiles()
    result.topics[0].crossings[0].received.reverse()
    assert "Not all of it arrived in order." in figure_of(tmp_path, result).caption


def test_the_programs_own_line_stands_beside(tmp_path: Path) -> None:
    """The line with the profile's name comes last; its latency is that on a link without losses."""
    figure = figure_of(
        tmp_path,
        two_profiles(),
        "fast: starting",
        "fast      : 1001 msgs, avg latency: 0.49ms",
        "end",
    )
    assert [profile.printed for profile in content(figure).profiles] == [
        "fast : 1001 msgs, avg latency: 0.49ms",
        "",
    ]


def test_incompatible_sides_are_shown_as_that(tmp_path: Path) -> None:
    """No message arrives, and the table names the policy with different values on the two sides."""
    result = two_profiles()
    result.topics[0].requested = LATCHED
    result.topics[0].crossings = [crossing(0.3, 4, [])]
    figure = figure_of(tmp_path, result)
    (profile, _) = content(figure).profiles
    policy = "reliability (RELIABLE is requested, BEST_EFFORT offered)"
    assert profile.problem == f"The two sides are incompatible in {policy}: nothing can arrive."
    assert "nothing arrived" in labels(figure)
    assert "fast 0 %;" in figure.caption


def test_a_topic_with_one_side_says_so(tmp_path: Path) -> None:
    """A topic with one side does not cross the link; the others are shown."""
    result = two_profiles()
    result.topics[0] = LinkedTopic("/fast", "/fast", FLOATS, BEST_EFFORT)
    figure = figure_of(tmp_path, result)
    assert content(figure).profiles[0].problem == "There is no subscription on /fast."
    assert "fast" not in labels(figure)


def test_without_a_link_the_reason_is_said(tmp_path: Path) -> None:
    """There is no picture then; in a recording from before there was such a step, there is nothing."""
    figure = figure_of(
        tmp_path / "without", LinkResult(problem="this machine gives a session no networks")
    )
    assert figure.paint is None
    assert content(figure).problem == "this machine gives a session no networks"
    assert drawn("link", recorded(tmp_path / "before", {}), **SETTINGS) is None


def test_thousands_of_messages_do_not_make_a_page_heavy(tmp_path: Path) -> None:
    """There are as many marks as an eye can distinguish, with the soonest and the latest message among them."""
    received = [[n + 1, 10_000 + 100 * n] for n in range(5000)]
    result = LinkResult(
        topics=[
            LinkedTopic("/fast", "/fast", FLOATS, LATCHED, LATCHED, [crossing(0.3, 5000, received)])
        ]
    )
    figure = figure_of(tmp_path, result)
    (path,) = (mark.get("d") or "" for mark in marks(figure, "ticks"))
    assert path.count("v10") == 50
    assert len(str(figure.svg("f", WIDE))) < 3000
    assert picture(figure).tag == "svg"

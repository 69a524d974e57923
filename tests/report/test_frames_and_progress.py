"""Figures of frames, of an action's goals and of a lifecycle node's states, drawn from recordings made by hand."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from grader.report.figures.frames import Frames
from grader.report.figures.kinds import FIGURES
from grader.report.figures.svg import NARROW, WIDE, Figure
from tests.synthetic import Session, at, evenly

TF = "tf2_msgs/msg/TFMessage"
TIMES = evenly(10, 2.0)
ACTION = {"action": "/go"}


def transform(
    parent: str, child: str, time_s: float, x: float = 1.0, w: float = 1.0
) -> dict[str, Any]:
    """Give a transform as a message has it."""
    stamp = {"sec": at(time_s) // 10**9, "nanosec": at(time_s) % 10**9}
    pose = {"translation": {"x": x}, "rotation": {"w": w}}
    return {
        "header": {"frame_id": parent, "stamp": stamp},
        "child_frame_id": child,
        "transform": pose,
    }


def frames(
    folder: Path, *edges: tuple[str, str], static: tuple[str, str] | None = None, x: float = 1.0
) -> Session:
    """Record frames that are sent ten times a second, and one that is sent once."""
    session = Session(folder)
    listed = []
    for time_s in TIMES:
        listed.append({"transforms": [transform(*edge, time_s, x) for edge in edges]})
    session.typed("/tf", TF, listed, TIMES)
    if static is not None:
        session.typed("/tf_static", TF, [{"transforms": [transform(*static, 0.9, x)]}], [0.9])
    return session


def goal(
    sent_s: float, ended_s: float | None, *, accepted: bool | None = True, **other: Any
) -> dict[str, Any]:
    """Return the record of a goal."""
    if accepted:
        feedback = [{"t_ns": at(sent_s + 0.1 * n), "values": {}} for n in range(4)]
    else:
        feedback = []
    return {
        **{
            "sent_ns": at(sent_s),
            "answered_ns": at(sent_s + 0.01),
            "accepted": accepted,
            "cancel": None,
        },
        **{
            "status": "succeeded",
            "ended_ns": None if ended_s is None else at(ended_s),
            "result": {"reached": 2},
        },
        **{"feedback": feedback, "feedback_count": len(feedback)},
        **other,
    }


def shown(kind: str, session: Session, **settings: Any) -> Figure:
    """Draw a figure, and check that its forms are well-formed and lie in their frames."""
    figure = FIGURES[kind](**settings).draw(session.recorded(), Path())
    assert figure is not None
    for width in (WIDE, NARROW):
        form = ET.fromstring(str(figure.svg("f", width)))
        height = float((form.get("viewBox") or "").split()[3])
        for element in form.iter("polyline"):
            points = []
            for point in (element.get("points") or "").split():
                points.append(tuple(map(float, point.split(","))))
            for x, y in points:
                assert 0 <= x <= width
                assert 0 <= y <= height
    return figure


def words(figure: Figure) -> list[str]:
    """Return the texts in a picture, one by one."""
    form = ET.fromstring(str(figure.svg("f", WIDE)))
    return [" ".join("".join(element.itertext()).split()) for element in form.iter("text")]


def drawn(figure: Figure, style: str) -> list[ET.Element]:
    """Give the marks of a style."""
    found = []
    for e in ET.fromstring(str(figure.svg("f", WIDE))).iter():
        if style in (e.get("class") or "").split():
            found.append(e)
    return found


@pytest.mark.parametrize(
    ("kind", "settings"), [("frames", {}), ("goals", ACTION), ("states", {"topic": "/x"})]
)
def test_nothing_recorded_is_no_figure(tmp_path: Path, kind: str, settings: dict[str, Any]) -> None:
    """Neither transforms nor goals nor transitions."""
    assert FIGURES[kind](**settings).draw(Session(tmp_path).recorded(), Path()) is None


def test_frames_are_a_tree_and_axes_in_space(tmp_path: Path) -> None:
    """Each stands below its parent with how it was sent, and has three axes."""
    figure = shown(
        "frames", frames(tmp_path, ("base", "arm"), ("arm", "hand"), static=("hand", "eye"))
    )
    assert words(figure)[:4] == ["base", "arm 10 Hz", "hand 10 Hz", "eye static"]
    assert [len(drawn(figure, f"line-{n}")) for n in range(3)] == [4, 4, 4]
    assert "3 frames below 1 root," in figure.caption


def test_names_of_frames_at_one_place_can_be_read(tmp_path: Path) -> None:
    """Names stand one below the other, also in the form for a phone."""
    figure = shown(
        "frames", frames(tmp_path, ("base", "arm"), ("base", "hand"), ("base", "eye"), x=0.0)
    )
    for width in (WIDE, NARROW):
        form = ET.fromstring(str(figure.svg("f", width)))
        lines = sorted(
            float(e.get("y") or 0) for e in form.iter("text") if "note" in (e.get("class") or "")
        )
        assert len(lines) == 4
        assert min(below - above for above, below in pairwise(lines)) >= 12


def test_names_at_one_place_are_drawn_wherever_that_is(tmp_path: Path) -> None:
    """A baseline plus the height of a line, minus that baseline, is less than the height now and then."""
    session = Session(tmp_path)
    edges = [(("base", "far"), 1.0), *((("base", child), 0.0) for child in ("arm", "hand"))]
    for number in range(40):
        listed = [transform(*edge, 1.0, x * (1 + number / 7)) for edge, x in edges]
        lifted = {"translation": {"z": number / 9}, "rotation": {"w": 1.0}}
        listed.append({**transform("base", "lifted", 1.0), "transform": lifted})
        session.typed(f"/tf{number}", TF, [{"transforms": listed}], [1.0])
    recorded = session.recorded()
    for number in range(40):
        figure = Frames(topic=f"/tf{number}").draw(recorded, Path())
        assert figure is not None
        assert [figure.svg("f", width).count(">hand<") for width in (WIDE, NARROW)] == [2, 2]


def test_one_frame_is_one(tmp_path: Path) -> None:
    """The caption counts in plain English."""
    assert shown("frames", frames(tmp_path, ("base", "arm"))).caption.startswith(
        "1 frame below 1 root,"
    )


def test_frames_lie_where_they_were_sent(tmp_path: Path) -> None:
    """One that lies twice as far along x is twice as far from its parent in the picture."""
    figure = shown("frames", frames(tmp_path, ("base", "arm"), ("arm", "hand")))
    ways = [e for e in drawn(figure, "stem") if e.tag.endswith("polyline")]
    ends = []
    for way in ways:
        ends.append([tuple(map(float, p.split(","))) for p in (way.get("points") or "").split()])
    lengths = [math.dist(*pair) for pair in ends]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.01)
    assert ends[0][1] == pytest.approx(ends[1][0])


@pytest.mark.parametrize(
    ("edges", "roots"),
    [
        ([("a", "b"), ("c", "d")], 2),
        ([("a", "b"), ("b", "c"), ("c", "b")], 1),
        ([(f"f{n}", f"f{n + 1}") for n in range(60)], 1),
    ],
)
def test_odd_trees_are_drawn_as_far_as_there_is_room(
    tmp_path: Path, edges: list[tuple[str, str]], roots: int
) -> None:
    """Two roots, a circle beside one, and a chain that has no end."""
    session = frames(tmp_path, *edges)
    figure = FIGURES["frames"]().draw(session.recorded(), Path())
    if figure is not None:  # All of a circle that has no root is no tree.
        assert f"{roots} root" in figure.caption
        assert len(drawn(figure, "line-0")) <= 24


def test_numbers_that_are_no_pose_are_left_out(tmp_path: Path) -> None:
    """The frame stands in the tree, and nowhere in space."""
    figure = shown("frames", frames(tmp_path, ("base", "arm"), static=("arm", "eye"), x=math.nan))
    assert words(figure)[:3] == ["base", "arm 10 Hz", "eye static"]
    assert len(drawn(figure, "line-0")) == 1


def test_a_goal_is_a_row_with_its_answer_and_feedback(tmp_path: Path) -> None:
    """Rejected, carried out with its result, cancelled, and one that nobody answered."""
    session = Session(tmp_path)
    cancelled = goal(5, 6, status="canceled", cancel={"sent_ns": at(5.9)})
    for label, one in (
        ("far", goal(2, None, accepted=False)),
        ("near", goal(3, 4)),
        ("stopped", cancelled),
        ("silent", goal(7, None, accepted=None)),
    ):
        session.step("send_goal", label, goals=[one], parameters={"action": "/go"})
    session.step("send_goal", "other", goals=[goal(8, 9)], parameters={"action": "/elsewhere"})
    figure = shown("goals", session, **ACTION)
    titles = [text for text in words(figure) if ": " in text]
    assert titles == [
        "far: rejected",
        "near: succeeded, reached: 2",
        "stopped: canceled, reached: 2",
        "silent: no answer",
    ]
    assert "cancel" in words(figure)
    assert len(drawn(figure, "dot")) == 8
    assert figure.caption.startswith("4 goals, 2 accepted, with 8 messages")


def test_states_stand_over_the_messages(tmp_path: Path) -> None:
    """A span for each state between two transitions, and a dot for each message."""
    session = Session(tmp_path)
    session.typed("/x", "std_msgs/msg/Float64", [{}] * 5, [11, 12, 13, 14, 15])
    for n, (asked, before, after) in enumerate(
        [("configure", "unconfigured", "inactive"), ("activate", "inactive", "active")], 1
    ):
        times: dict[str, Any] = {"called_ns": at(5.0 * n), "answered_ns": at(5.0 * n + 0.1)}
        session.step(
            "change_state",
            asked,
            parameters={"transition": asked},
            before=before,
            after=after,
            **times,
        )
    figure = shown("states", session, topic="/x")
    assert [text for text in words(figure) if text in ("unconfigured", "inactive", "active")] == [
        "unconfigured",
        "inactive",
        "active",
    ]
    assert len(drawn(figure, "dot")) == 5
    assert "activate → active. 5 messages" in figure.caption

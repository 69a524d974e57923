"""The layout for Foxglove: the numbers of a recording as plots, and its log."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from grader.evidence.recorded import Recorded
from grader.judging import rubrics
from grader.report.foxglove import layout_of
from grader.result_folder import LAYOUT_FILE, RECORDINGS
from tests.regraded import judge_results
from tests.synthetic import Session

KEPT = Path(__file__).resolve().parents[1] / "recordings"


def layout(recorded: Recorded) -> dict[str, Any]:
    """Return the layout of a recording."""
    read: dict[str, Any] = json.loads(layout_of(recorded))
    return read


def lines_of(read: dict[str, Any]) -> dict[str, list[str]]:
    """Return the message paths of each plot, by its title."""
    plots = (panel for name, panel in read["configById"].items() if name.startswith("Plot!"))
    found = {}
    for plot in plots:
        found[plot["foxglovePanelTitle"]] = [path["value"] for path in plot["paths"]]
    return found


def leaves(tree: Any) -> Iterator[str]:
    """Give the panels of a tree in their order."""
    if isinstance(tree, str):
        yield tree
    else:
        assert tree["direction"] == "column"
        yield from (*leaves(tree["first"]), *leaves(tree["second"]))


def test_the_numbers_of_each_topic_are_lines() -> None:
    """Seven joints are seven lines; the clock and every node's topics are none; each panel is in the tree, once."""
    read = layout(Recorded.open(KEPT / "solution/launch"))
    joints = [f"[{n}]" for n in range(7)]
    assert lines_of(read) == {
        topic: [f"{topic}.data{joint}" for joint in joints]
        for topic in ("/joint_commands", "/joint_states")
    }
    assert list(leaves(read["layout"])) == ["Plot!1", "Plot!2", "RosOut!log"]
    assert set(read["configById"]) == {"Plot!1", "Plot!2", "RosOut!log"}


def test_numbers_in_parts_of_a_message_are_found(tmp_path: Path) -> None:
    """Time stamps are no quantity, texts none either."""
    session = Session(tmp_path).typed("/imu", "sensor_msgs/msg/Imu", [{}], [1.0])
    session.typed(
        "/joints", "sensor_msgs/msg/JointState", [{"name": ["a"], "position": [0.5]}], [1.0]
    )
    found = lines_of(layout(session.recorded()))
    assert found["/joints"] == ["/joints.position[0]"]
    assert found["/imu"][:2] == ["/imu.orientation.x", "/imu.orientation.y"]
    assert len(found["/imu"]) == 8


def test_without_numbers_there_is_the_log(tmp_path: Path) -> None:
    """Then it is the only panel, and the tree its name; a message that is damaged is passed over."""
    session = Session(tmp_path).texts("/said", ["x"], [1.0])
    session.raw("/bad", "std_msgs/msg/Float64", "float64 data\n", [b"\x00"], [1.0])
    assert layout(session.recorded())["layout"] == "RosOut!log"


def test_it_lies_beside_each_recording(tmp_path: Path) -> None:
    """Judging writes it, and judging again writes the same bytes."""
    shutil.copytree(KEPT / "six_joints", tmp_path / RECORDINGS)
    rubric = rubrics.read_rubric(None)
    judge_results(tmp_path, rubric)
    files = [tmp_path / RECORDINGS / name / LAYOUT_FILE for name in ("launch", "publisher")]
    before = [file.read_bytes() for file in files]
    judge_results(tmp_path, rubric)
    assert [file.read_bytes() for file in files] == before
    assert b"/joint_commands.data[5]" in before[1]
    assert b"/joint_commands.data[6]" not in before[1]

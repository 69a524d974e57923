"""Recordings of action servers with one mistake each: right, wrong and in between, judged without ROS."""

from __future__ import annotations

import tarfile
from decimal import Decimal
from pathlib import Path

import pytest

from tests.labs.fibonacci.defects import DEFECTS, FOLDER
from tests.labs.fibonacci.record import judged


@pytest.mark.parametrize("name", DEFECTS)
def test_each_mistake_costs_what_it_is_worth_and_has_a_name(name: str, tmp_path: Path) -> None:
    """Each mistake loses the expected points in the expected checks, with its name in the texts.

    Nothing is undecided.
    """
    with tarfile.open(FOLDER / "recordings" / f"{name}.tar.xz") as archive:
        archive.extractall(tmp_path)
    result = judged(tmp_path)
    lost = {
        check.id: check.possible - check.earned
        for check in result.checks
        if check.earned < check.possible
    }
    assert lost == {check: Decimal(points) for check, points in DEFECTS[name].lost}
    assert result.score.undecided == 0
    assert result.problems == ()
    losing = [check for check in result.checks if check.id in lost]
    assert not losing or DEFECTS[name].words in f"{losing[0].reason} {losing[0].hint}"
    if name == "accepts_all":
        goals = [command for command in losing[0].commands if "send_goal" in command]
        assert (
            goals[1]
            == """ros2 action send_goal -f /fibonacci test_msgs/action/Fibonacci '{"order": -1}'"""
        )


def test_what_a_reader_of_bags_needs_is_in_the_recording(tmp_path: Path) -> None:
    """Feedback and status of every goal, with their definitions: also where the action is not installed."""
    from grader.evidence.recorded import Recorded

    with tarfile.open(FOLDER / "recordings" / "solution.tar.xz") as archive:
        archive.extractall(tmp_path)
    recorded = Recorded.open(tmp_path / "server")
    sequences = recorded.stream("/fibonacci/_action/feedback").field("feedback.sequence")
    assert list(sequences[3]) == [0, 1, 1, 2, 3, 5]
    statuses = recorded.stream("/fibonacci/_action/status").field("status_list")
    assert {one.status for listed in statuses for one in listed} >= {4, 5, 6}

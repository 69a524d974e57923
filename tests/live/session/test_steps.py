"""The actions of steps: each kind has one."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from grader.lab.steps import STEPS
from grader.live.ros_node import steps as of_director
from grader.live.session import steps as of_session


def test_each_step_has_an_action() -> None:
    """The session begins each step, and leaves none to the director which that does not know."""
    assert set(of_session.ACTIONS) == set(STEPS.values())
    left = {model for model, act in of_session.ACTIONS.items() if act is of_session.by_director}
    assert left <= set(of_director.ACTIONS)

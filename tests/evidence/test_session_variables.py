"""Variables of a session with other values in a submission."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from grader.evidence.session_variables import Asked, asked_in, is_sessions, set_in
from grader.recording.session import SESSION_VARIABLE, Claim
from launch_plan.format import SCHEMA
from tests.synthetic import Session, submission

RMW = "RMW_IMPLEMENTATION"


def test_the_sessions_variables_are_told_by_their_names() -> None:
    """A program's own variables keep the values that a launch file gives."""
    kept = ["ROS_DOMAIN_ID", RMW, "FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_DISCOVERY_SERVER"]
    assert all(map(is_sessions, kept))
    assert not any(map(is_sessions, ["ROS_NAMESPACE", "RCUTILS_COLORIZED_OUTPUT", "MY_ROBOT"]))


@pytest.mark.parametrize(
    "statement",
    [
        "os.environ['X'] = 'y'",
        "os.environ.update({'X': 'y'})",
        "os.environ.update(X='y')",
        "SetEnvironmentVariable('X', 'y')",
        "SetEnvironmentVariable(name='X', value='y')",
        "Node(package='p', executable='e', additional_env={'X': 'y'})",
    ],
)
def test_each_way_to_set_a_variable_is_found(statement: str) -> None:
    """The line and the value come from the text."""
    assert list(set_in(ast.parse(f"\n{statement}"), "X")) == [(2, "y")]


def test_a_default_sets_no_variable_of_the_session() -> None:
    """Each session gives its programs the values of these variables."""
    assert not list(set_in(ast.parse("os.environ.setdefault('X', 'y')"), "X"))


@pytest.mark.parametrize(
    "statement", ["os.environ['Z'] = 'X'", "print(os.environ['X'])", "f('X', 'y')"]
)
def test_a_variable_that_is_read_is_not_set(statement: str) -> None:
    """Another variable, and reading one, are no such places."""
    assert not list(set_in(ast.parse(statement), "X"))


def test_a_claim_is_placed_where_the_source_sets_the_variable(tmp_path: Path) -> None:
    """The tap sees the call of rclpy.init; the source shows the assignment before it."""
    record = submission({"it.py": "import os\nos.environ['ROS_DOMAIN_ID'] = '30'\n"})
    made = Session(tmp_path).process()
    claim = Claim("it", SESSION_VARIABLE, "ROS_DOMAIN_ID", file="it.py", line=9, value="30")
    made.record.claims.append(claim)
    (asked,) = asked_in(made.recorded(), record)
    assert asked == Asked("ROS_DOMAIN_ID", "30", "it.py", 2)
    assert (asked.place, asked.is_other_domain) == ("it.py, line 2", True)


def test_a_line_outside_the_submission_is_not_shown(tmp_path: Path) -> None:
    """The wrapper of a program is no file of the student."""
    made = Session(tmp_path).process()
    claim = Claim("it", SESSION_VARIABLE, RMW, file="/tmp/wrapper", line=9, value="rmw_x")
    made.record.claims.append(claim)
    (asked,) = asked_in(made.recorded(), submission())
    assert asked == Asked(RMW, "rmw_x")
    assert asked.place == "The submission"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("<launch>\n  <set_env name='RMW_IMPLEMENTATION' value='rmw_x'/>\n</launch>", 2),
        ("launch:\n# RMW_IMPLEMENTATION\n- set_env: {name: RMW_IMPLEMENTATION, value: rmw_x}", 3),
    ],
)
def test_a_launch_file_is_named_with_its_line(tmp_path: Path, text: str, line: int) -> None:
    """A comment sets nothing; a process that was not started asks for nothing."""
    suffix = "xml" if text.startswith("<") else "yaml"
    made = Session(tmp_path).process("talk-1")
    env = {RMW: "rmw_x", "MINE": "1"}
    processes = [{"id": f"talk-{n}", "path": "/talk", "env": env} for n in (1, 2)]
    made.record.plan = {"schema": SCHEMA, "outcome": "ok", "processes": processes}
    found = asked_in(made.recorded(), submission({f"it.launch.{suffix}": text}))
    assert found == [Asked(RMW, "rmw_x", f"it.launch.{suffix}", line)]


@pytest.mark.parametrize("value", ["", "0", " 0 "])
def test_the_default_domain_is_the_labs(value: str) -> None:
    """Nobody loses points for the domain that every terminal has."""
    assert not Asked("ROS_DOMAIN_ID", value).is_other_domain

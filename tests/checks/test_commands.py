"""Commands with which students see a fault by themselves."""

from __future__ import annotations

import dataclasses
import shlex
from decimal import Decimal

import pytest

from grader.checks.commands import commands_of
from grader.judging.rubrics import read_rubric
from grader.lab.lab_code import is_own
from grader.lab.rubric import Rubric
from grader.recording.submission import (
    ArtifactFact,
    BuildFact,
    PackageFact,
    SubmissionRecord,
)
from grader.result import Finding, Outcome

HANDED_IN = SubmissionRecord(
    "ann",
    artifacts=[
        ArtifactFact("launch", "robot_launch.py", "launch/my robot_launch.py", "name"),
        ArtifactFact("subscriber", "joint_subscriber.py", "joint_subscriber.py", "name"),
    ],
)


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the rubric that comes with the grader."""
    return read_rubric(None)


def shown(
    rubric: Rubric, kind: str, used: dict[str, str] | None = None, reason: str = ""
) -> list[str]:
    """Return the commands for the first check of a kind."""
    names = (kind, f":{kind}")
    spec = next(spec for spec in rubric.checks() if spec.check.endswith(names))
    return list(
        commands_of(
            spec, rubric, HANDED_IN, used or {}, Finding(Outcome.FAILED, Decimal(0), reason=reason)
        )
    )


def test_a_command_has_the_values_of_the_check_and_of_its_steps(rubric: Rubric) -> None:
    """Topics stand in the check's parameters, requests in the step that it names."""
    assert shown(rubric, "topic_rate") == ["ros2 topic hz /joint_commands"]
    call = "ros2 service call /robot/enable std_srvs/srv/SetBool '{\"data\": true}'"
    assert shown(rubric, "call_answered") == [call]
    assert shown(rubric, "call_gated") == [
        "ros2 param set /robot_mode_service safety_enabled false",
        call,
    ]
    assert shown(rubric, "survives")[0].startswith(
        "ros2 topic pub -r 100.0 /joint_states std_msgs/msg/Float64MultiArray "
    )
    replay = "ros2 bag play recordings/subscriber --topics /joint_commands /joint_states"
    assert shown(rubric, "reported_series") == ["python3 joint_subscriber.py", replay]
    launched = "ros2 launch 'launch/my robot_launch.py'"
    assert shown(rubric, "launch_nodes") == [launched, "ros2 node list"]
    named = shown(rubric, "launch_parameters", reason="/robot_mode_service has no parameter.")
    assert named == [launched, "ros2 param dump /robot_mode_service"]
    assert shown(rubric, "launch_arguments") == [
        "ros2 launch 'launch/my robot_launch.py' --show-args"
    ]


def test_names_are_those_that_the_student_uses(rubric: Rubric) -> None:
    """A name is quoted, whatever it is; of several topics those are named that the reason names."""
    assert shown(rubric, "topic_rate", {"/joint_commands": "/a;b"}) == ["ros2 topic hz '/a;b'"]
    assert len(shown(rubric, "qos_profiles")) == 4
    named = shown(rubric, "qos_profiles", reason="/test_reliable has depth 1.")
    assert named == ["ros2 topic info -v /test_reliable"]


def test_every_kind_of_the_lab_can_be_written(rubric: Rubric) -> None:
    """Templates name only parameters of their checks. Every kind but one has a command."""
    for spec in rubric.checks():
        failed = Finding(Outcome.FAILED, Decimal(0))
        whole = dataclasses.replace(
            HANDED_IN, artifacts=[ArtifactFact(n, n, n, "name") for n in rubric.artifacts]
        )
        commands = commands_of(spec, rubric, whole, {}, failed)
        assert all(shlex.split(command)[0] in ("ros2", "python3") for command in commands)
        if is_own(spec.check):
            continue
        has_some = spec.session is not None and spec.check != "launch_together"
        assert bool(commands) == has_some, spec.check


def test_a_launch_file_of_a_package_is_started_by_the_package(rubric: Rubric) -> None:
    """By its path, `ros2 launch` finds no executable of a package that is not built."""
    path = "launch/my robot_launch.py"
    package = PackageFact("arm", "", "ament_python", shared={"share/arm/robot_launch.py": path})
    built = dataclasses.replace(
        HANDED_IN, packages=[package], builds=[BuildFact("arm", "", "built")]
    )
    spec = next(spec for spec in rubric.checks() if spec.check == "launch_loads")
    finding = Finding(Outcome.FAILED, Decimal(0))
    (command,) = commands_of(spec, rubric, built, {}, finding)
    build = "colcon build && . install/setup.bash"
    assert command == f"{build} && ros2 launch arm 'my robot_launch.py'"


def test_a_silent_publisher_is_shown_by_its_messages(rubric: Rubric) -> None:
    """The list of topics holds the publisher, as it should."""
    spec = next(spec for spec in rubric.checks() if spec.check == "topic_published")
    silent = Finding(Outcome.PARTIAL, Decimal("0.2"), is_silent=True)
    assert commands_of(spec, rubric, HANDED_IN, {}, silent) == ("ros2 topic echo /joint_commands",)


def test_a_program_that_ended_is_run(rubric: Rubric) -> None:
    """Its traceback is the fault, and the graph shows nothing of it."""
    spec = next(spec for spec in rubric.checks() if spec.check == "topics_subscribed")
    ended = Finding(Outcome.FAILED, Decimal(0), decided_by="explained")
    commands = commands_of(spec, rubric, HANDED_IN, {}, ended)
    assert commands == ("python3 joint_subscriber.py", "ros2 node info /joint_state_subscriber")


def test_a_file_that_was_not_handed_in_has_no_command(rubric: Rubric) -> None:
    """There is nothing to run beside `ros2 topic list`."""
    absent = ArtifactFact("publisher", "joint_publisher.py", None, "name")
    nothing = dataclasses.replace(HANDED_IN, artifacts=[*HANDED_IN.artifacts, absent])
    spec = next(spec for spec in rubric.checks() if spec.check == "topic_published")
    finding = Finding(Outcome.FAILED, Decimal(0), reason="There is no joint_publisher.py.")
    assert commands_of(spec, rubric, nothing, {}, finding) == ()
    assert commands_of(spec, rubric, HANDED_IN, {}, finding) != ()

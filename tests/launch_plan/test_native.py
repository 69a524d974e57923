"""Evaluation by the real `launch`, as the script does it on a ROS machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from grader.errors import PlatformError
from grader.live.sandbox.environment import find_native_launch
from grader.live.sandbox.installation import wheels_of
from launch_plan.plan import Plan

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))

from tests.launch_plan.evaluations import (  # noqa: E402
    INSIDE,
    environment,
    make_package,
    needs_the_original,
    original_environment,
)


def make_prefix(folder: Path) -> Path:
    """Make an ament prefix with the executables of the solution's launch file."""
    return make_package(
        folder, "physical_ai_textbook", "joint_publisher", "joint_subscriber", "robot_service"
    )


def evaluate(root: Path, file: str, prefix: Path, *, native: bool, **arguments: str) -> Plan:
    """Evaluate a launch file; natively with the original on the path."""
    read, write_end = os.pipe()
    request = {
        "file": str(root / file),
        "arguments": arguments,
        "root": str(root),
        "native": native,
    }
    done = subprocess.run(
        [sys.executable, str(INSIDE / "evaluate.py"), str(write_end)],
        input=json.dumps(request),
        capture_output=True,
        text=True,
        pass_fds=[write_end],
        env=original_environment(prefix) if native else environment(prefix),
        timeout=30,
        check=False,
    )
    os.close(write_end)
    with os.fdopen(read) as result:
        text = result.read()
    assert text.strip(), done.stderr
    return Plan.from_plain(json.loads(text))


def essence(plan: Plan) -> list[Any]:
    """Return the parts of a plan that both ways of evaluating must agree on."""
    nodes = []
    for p in plan.processes:
        nodes.append((p.id, p.kind, p.package, p.runs, p.called, p.full_name, p.when))
    arguments = [(a.name, a.default, a.description) for a in plan.arguments]
    return [plan.outcome, nodes, arguments, dict(plan.configurations)]


@needs_the_original
@pytest.mark.parametrize("arguments", [{}, {"use_sim": "false", "control_rate": "50.0"}])
def test_both_ways_give_the_same_plan(arguments: dict[str, str], tmp_path: Path) -> None:
    """The solution's launch file has the same nodes and arguments."""
    prefix = make_prefix(tmp_path / "prefix")
    root = ROOT / "reference/solution"
    ours, native = (
        evaluate(root, "robot_launch.py", prefix, native=n, **arguments) for n in (False, True)
    )
    assert len(native.processes) == 3
    assert essence(native) == essence(ours)


@needs_the_original
def test_parameters_are_read_off_the_command_line(tmp_path: Path) -> None:
    """A parameter file of the submission is given by its path, and its values are in the plan."""
    prefix = make_prefix(tmp_path / "prefix")
    (tmp_path / "p.yaml").write_text("/**:\n  ros__parameters:\n    rate: 2.5\n")
    (tmp_path / "x_launch.py").write_text(
        "import os\nfrom launch import LaunchDescription\nfrom launch_ros.actions import Node\n"
        "def generate_launch_description():\n"
        "    file = os.path.join(os.path.dirname(__file__), 'p.yaml')\n"
        "    return LaunchDescription([Node(package='physical_ai_textbook', executable='robot_service', name='n',\n"
        "        namespace='/a', parameters=[file], remappings=[('x', 'y')])])\n"
    )
    (process,) = evaluate(tmp_path, "x_launch.py", prefix, native=True).processes
    assert process.full_name == "/a/n"
    assert process.remappings == (("x", "y"),)
    assert process.effective_parameters() == {"rate": 2.5}
    assert process.parameters[0].content == {"/**": {"ros__parameters": {"rate": 2.5}}}


@needs_the_original
def test_timers_and_handlers_are_played(tmp_path: Path) -> None:
    """A process that waits for a time, or for another process, says so."""
    (tmp_path / "x_launch.py").write_text(
        "from launch import LaunchDescription\n"
        "from launch.actions import ExecuteProcess, RegisterEventHandler, TimerAction\n"
        "from launch.event_handlers import OnProcessExit\n"
        "def generate_launch_description():\n"
        "    first, second = ExecuteProcess(cmd=['true'], name='a'), ExecuteProcess(cmd=['true'], name='b')\n"
        "    handler = OnProcessExit(target_action=first, on_exit=[second])\n"
        "    return LaunchDescription([first, RegisterEventHandler(handler),\n"
        "        TimerAction(period=2.0, actions=[ExecuteProcess(cmd=['true'], name='c')])])\n"
    )
    plan = evaluate(tmp_path, "x_launch.py", tmp_path, native=True)
    assert plan.problem is None
    assert {p.id.split("-")[0]: p.when for p in plan.processes} == {
        "a": None,
        "b": {"on_exit_of": plan.processes[0].id},
        "c": {"after_s": 2.0},
    }


@needs_the_original
@pytest.mark.parametrize(
    ("text", "kind", "line"),
    [
        ("x = (\n", "syntax_error", 1),
        ("import not_there_at_all\n", "missing_module", 1),
        ("from launch import LaunchDescription\nraise ValueError('so')\n", "exception", 2),
    ],
)
def test_problems_are_at_the_students_line(text: str, kind: str, line: int, tmp_path: Path) -> None:
    """An exception of the file itself names the file and the line."""
    (tmp_path / "x_launch.py").write_text(text)
    problem = evaluate(tmp_path, "x_launch.py", tmp_path, native=True).problem
    assert problem is not None
    assert (problem.kind, problem.file, problem.line) == (kind, "x_launch.py", line)


def test_what_is_not_there_is_an_error_only_if_asked_for() -> None:
    """`native` fails with a remedy where the real launch cannot be imported; `auto` takes the stand-in."""
    installation = wheels_of(Path(sys.executable))
    try:
        __import__("launch_ros")
    except ImportError:
        pass
    else:
        pytest.skip("this machine has the real launch")
    assert find_native_launch(installation, "auto") is None
    assert find_native_launch(installation, "standin") is None
    with pytest.raises(PlatformError) as caught:
        find_native_launch(installation, "native")
    assert caught.value.exit_status == 5
    assert "launch" in caught.value.problem
    assert caught.value.remedy


@needs_the_original
def test_what_follows_an_end_and_what_is_loaded_is_noted(tmp_path: Path) -> None:
    """`on_exit`, nodes for a container, and files written while reading are in the plan."""
    (tmp_path / "x_launch.py").write_text(
        "import tempfile\n"
        "from launch import LaunchDescription\n"
        "from launch.actions import ExecuteProcess, LogInfo\n"
        "from launch_ros.actions import LoadComposableNodes\n"
        "from launch_ros.descriptions import ComposableNode\n"
        "def generate_launch_description():\n"
        "    with tempfile.NamedTemporaryFile('w', suffix='.txt', delete=False) as file:\n"
        "        file.write('made')\n"
        "    node = ComposableNode(package='p', plugin='p::N', name='n')\n"
        "    return LaunchDescription([ExecuteProcess(cmd=['cat', file.name], on_exit=[LogInfo(msg='gone')]),\n"
        "        LoadComposableNodes(target_container='/c', composable_node_descriptions=[node])])\n"
    )
    plan = evaluate(tmp_path, "x_launch.py", tmp_path, native=True)
    (process,) = plan.processes
    assert [(log.message, log.when) for log in plan.logs] == [("gone", {"on_exit_of": process.id})]
    assert plan.loaded_components[0]["container"] == "/c"
    assert plan.loaded_components[0]["components"][0]["plugin"] == "p::N"
    assert list(process.parameter_files.values()) == ["made"]
    assert process.argv == ("{parameters}/" + next(iter(process.parameter_files)),)
    assert process.line == 10


@needs_the_original
def test_a_released_package_that_is_not_there_is_not_assessable(tmp_path: Path) -> None:
    """A ROS machine may lack a package too, which is not the student's fault."""
    (tmp_path / "x_launch.py").write_text(
        "from ament_index_python.packages import get_package_share_directory as share\nshare('nav2_bringup')\n"
    )
    plan = evaluate(tmp_path, "x_launch.py", tmp_path, native=True)
    assert plan.outcome == "not_assessable"
    assert plan.problem is not None
    assert (plan.problem.kind, plan.problem.line) == ("missing_package", 2)


@needs_the_original
def test_a_list_is_no_reason_for_a_warning(tmp_path: Path) -> None:
    """The tuple that `launch_ros` writes for a list is read by nodes as a list."""
    prefix = make_prefix(tmp_path / "prefix")
    (tmp_path / "x_launch.py").write_text(
        "from launch import LaunchDescription\nfrom launch_ros.actions import Node\n"
        "def generate_launch_description():\n"
        "    return LaunchDescription([Node(package='physical_ai_textbook', executable='robot_service', name='n',\n"
        "        namespace='/a', parameters=[{'gains': [1.5, 2.5]}])])\n"
    )
    plan = evaluate(tmp_path, "x_launch.py", prefix, native=True)
    assert plan.processes[0].effective_parameters() == {"gains": [1.5, 2.5]}
    assert plan.warnings == ()

"""`evaluate` and `python -m launch_plan`: a launch file goes in, a plan comes out, whatever the file does."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from launch_plan.__main__ import main
from launch_plan.evaluation import evaluate
from launch_plan.format import LEFT_OUT, PROCESS_LIMIT
from launch_plan.plan import Plan
from launch_plan.text import moment
from tests.launch_plan.evaluations import make_package

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="launch files are for Linux")

LAUNCH_FILE = """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, TimerAction
from launch.substitutions import LaunchConfiguration
def generate_launch_description():
    later = ExecuteProcess(cmd=['sleep', LaunchConfiguration('pause')])
    return LaunchDescription([
        DeclareLaunchArgument('pause', default_value='5'),
        ExecuteProcess(cmd=['true'], name='first'),
        TimerAction(period=2.0, actions=[later]),
    ])
"""


@pytest.fixture
def launch_file(tmp_path: Path) -> Path:
    """Give a launch file with an argument, a process and a timer."""
    file = tmp_path / "wait.launch.py"
    file.write_text(LAUNCH_FILE, encoding="utf-8")
    return file


def test_a_plan_has_arguments_processes_and_moments(launch_file: Path) -> None:
    """Arguments given replace the defaults."""
    plan = evaluate(launch_file, {"pause": "7"})
    assert plan.problem is None
    assert [argument.name for argument in plan.arguments] == ["pause"]
    first, later = plan.processes
    assert (first.id, first.when, first.file) == ("first-1", None, "wait.launch.py")
    assert (later.argv, later.when) == (("7",), {"after_s": 2.0})


def test_a_plan_has_as_many_processes_as_a_session_can_start(tmp_path: Path) -> None:
    """One process more than the limit is a mistake of the launch file, which names the limit."""
    file = tmp_path / "many.launch.py"
    text = """\
from launch import LaunchDescription
from launch.actions import ExecuteProcess
def generate_launch_description():
    return LaunchDescription([ExecuteProcess(cmd=['true']) for _ in range(COUNT)])
"""
    file.write_text(text.replace("COUNT", str(PROCESS_LIMIT)), encoding="utf-8")
    assert len(evaluate(file).processes) == PROCESS_LIMIT
    file.write_text(text.replace("COUNT", str(PROCESS_LIMIT + 1)), encoding="utf-8")
    problem = evaluate(file).problem
    assert problem is not None
    assert f"more than {PROCESS_LIMIT} processes" in problem.message


def test_paths_are_relative_to_the_root(launch_file: Path) -> None:
    """A caller may name a folder above the file."""
    plan = evaluate(launch_file, root=launch_file.parents[1])
    assert plan.processes[0].file == f"{launch_file.parent.name}/wait.launch.py"


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("import time\ntime.sleep(60)\n", "too_slow"),
        ("import os\nprint('bye', flush=True)\nos._exit(3)\n", "no_plan"),
        ("x = (\n", "syntax_error"),
    ],
)
def test_any_file_gives_a_plan(text: str, kind: str, tmp_path: Path) -> None:
    """A file that hangs, exits or does not parse has a problem, in bounded time."""
    file = tmp_path / "bad.launch.py"
    file.write_text(text, encoding="utf-8")
    began_s = time.monotonic()
    problem = evaluate(file, timeout_s=1.0 if kind == "too_slow" else 20.0).problem
    assert problem is not None
    assert (problem.kind, problem.file) == (kind, "bad.launch.py")
    assert ("it said: bye" in problem.message) == (kind == "no_plan")
    assert time.monotonic() - began_s < 30


def test_a_missing_file_is_a_problem(tmp_path: Path) -> None:
    """Neither the file nor its folder need exist."""
    problem = evaluate(tmp_path / "nowhere/x.launch.py").problem
    assert problem is not None
    assert problem.kind in ("file_not_found", "include_not_found")


def test_what_a_file_started_ends_with_the_evaluation(tmp_path: Path) -> None:
    """A process that a launch file starts by itself is killed."""
    file = tmp_path / "starts.launch.py"
    file.write_text(
        "import subprocess\nfrom launch import LaunchDescription\n"
        f"child = subprocess.Popen(['sleep', '60'])\nopen({str(tmp_path / 'pid')!r}, 'w').write(str(child.pid))\n"
        "def generate_launch_description():\n    return LaunchDescription([])\n",
        encoding="utf-8",
    )
    assert evaluate(file).outcome == "ok"
    with suppress(ProcessLookupError):
        process_fd = os.pidfd_open(int((tmp_path / "pid").read_text()))
        assert select.select([process_fd], [], [], 20.0)[0] == [process_fd]
        os.close(process_fd)


def test_the_command_prints_a_plan(launch_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The text names each process with its moment; JSON is a plan that can be read again."""
    assert main([str(launch_file), "pause:=9"]) == 0
    text = capsys.readouterr().out
    assert "process first-1: at once" in text
    assert "process sleep-2: 2 s after the launch" in text
    assert "sleep 9" in text
    assert main([str(launch_file), "--json"]) == 0
    assert Plan.from_plain(json.loads(capsys.readouterr().out)).outcome == "ok"


def test_the_command_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A mistake in the launch file has its line and a remedy; a malformed argument is refused."""
    (tmp_path / "bad.launch.py").write_text("x = (\n", encoding="utf-8")
    assert main([str(tmp_path / "bad.launch.py")]) == 1
    assert "bad.launch.py:1: syntax error" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["x.launch.py", "pause=9"])
    assert "'pause=9' is not of the form name:=value" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("when", "said"),
    [
        (None, "at once"),
        ({"after_s": 2.5}, "2.5 s after the launch"),
        ({"on_exit_of": "arm-1"}, "after the exit of arm-1"),
        ({"after_s": 1.0, "since": {"on_start_of": "arm-1"}}, "1 s after the start of arm-1"),
        ({"on_shutdown": True}, "after the shutdown"),
    ],
)
def test_moments_are_said_in_words(when: dict[str, object] | None, said: str) -> None:
    """Each kind of moment has its words."""
    assert moment(when) == said


def test_a_reader_of_plans_loads_neither_grader_nor_ros_nor_the_evaluation() -> None:
    """The package is importable alone, and its plans without the code that starts processes."""
    program = (
        "import sys, launch_plan.plan\n"
        "print(*sorted({'grader', 'rclpy', 'launch_plan.evaluation'} & sys.modules.keys()))\n"
        "import launch_plan.__main__, launch_plan.inside.executor\n"
        "print(*sorted({'grader', 'rclpy'} & sys.modules.keys()))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


def test_executables_that_were_left_out_are_not_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link in place of a missing program is found, and not named among the installed ones."""
    prefix = make_package(tmp_path / "prefix", "arm", "talker")
    (prefix / "lib/arm/listener").symlink_to(LEFT_OUT)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    file = tmp_path / "one.launch.py"
    text = """
from launch import LaunchDescription
from launch_ros.actions import Node
def generate_launch_description():
    return LaunchDescription([Node(package='arm', executable='NAME')])
"""
    file.write_text(text.replace("NAME", "listener"), encoding="utf-8")
    assert evaluate(file).problem is None
    file.write_text(text.replace("NAME", "listeners"), encoding="utf-8")
    problem = evaluate(file).problem
    assert problem is not None
    assert problem.message.endswith("The package installs: talker")

"""Files of a plan are placed, mistakes are repaired, and waiting for a core is not counted."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from confine.isolation import Isolation, Level
from confine.namespaces import Form
from grader.judging.rubrics import read_rubric
from grader.live.process.process import RunningProcess
from grader.live.sandbox.installation import wheels_of
from grader.live.sandbox.room import INTERFACES, PARAMETERS, StudentRoom
from grader.live.session.launch_runner import LaunchRunner, _run_until, with_places
from grader.live.session.plan import SessionPlan
from grader.live.session.stage import stage
from grader.live.session.student_sandbox import StudentSandbox
from grader.recording.session import ProcessRun, SessionRecord
from grader.recording.submission import ArtifactFact, FileFact, SubmissionRecord
from grader.submission.packages.colcon import find_packages
from launch_plan.plan import Plan, Problem, Process

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")


def test_a_plans_own_files_are_placed_in_one_pass() -> None:
    """Each file that the plan brings is found under its whole name, however many files and texts there are."""
    names = {f"arm_{n}.yaml" for n in range(2000)}
    texts = [
        "{parameters}/arm_1.yaml:{parameters}/arm_12.yaml.",
        "{parameters}/else.yaml",
        *["x" * 20] * 100_000,
    ]
    began_s = time.process_time()
    placed = [with_places(text, names, "/p") for text in texts]
    assert time.process_time() - began_s < 5.0
    assert placed[:3] == ["/p/arm_1.yaml:/p/arm_12.yaml.", "{parameters}/else.yaml", "x" * 20]


#: The grader's own wheels.
ROS = wheels_of(Path(sys.executable))
_COMPUTES = "import time\nwhile time.process_time() < float({s}):\n    pass"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cpu_s", "most", "outcome"), [(0.5, 100, "done"), (60, 100, "failed"), (60, 2, "timeout")]
)
def test_waits_for_a_core_are_not_a_launch_files_time(
    cpu_s: float, most: float, outcome: str
) -> None:
    """A launch file has its whole CPU time, even if other processes keep it from the core.

    More CPU time than allowed fails; after too long a wait for a core the outcome is open.
    """
    core = str(min(os.sched_getaffinity(0)))

    async def run() -> str:
        command = ["taskset", "--cpu-list", core, sys.executable, "-c", _COMPUTES.format(s=cpu_s)]
        started = await RunningProcess.start(
            ProcessRun("it", "student", []), command, environment={}
        )
        # Reading Python from the disk is neither computing nor waiting for a core: there is time for that besides.
        found = await _run_until(started, 1.5, most)
        await started.kill()
        return found

    spins = ["taskset", "--cpu-list", core, sys.executable, "-c", "while True: pass"]
    with ExitStack() as others:
        for _ in range(4):  # each a group of its own to the scheduler, as the program is
            others.callback(
                others.enter_context(subprocess.Popen(spins, start_new_session=True)).kill
            )
        assert asyncio.run(run()) == outcome


@pytest.fixture
def runner(tmp_path: Path) -> LaunchRunner:
    """Give the runner of a staged package with a program and a launch file of a thousand keywords."""
    files = {
        "package.xml": "<package><name>arm_lab</name><export><build_type>ament_python</build_type></export></package>",
        "setup.py": "from setuptools import setup\n"
        "setup(entry_points={'console_scripts': ['talk = arm_lab.talk:main']}, "
        "data_files=[('share/arm_lab/launch', ['robot.launch.py'])])\n",
        "arm_lab/talk.py": "def main():\n    pass\n",
        "robot.launch.py": "Node(a=1)\n" * 1000,
    }
    record = SubmissionRecord(
        "ann", files=[FileFact(path, len(text), "") for path, text in files.items()]
    )
    for path, text in files.items():
        (tmp_path / "sub" / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "sub" / path).write_text(text, encoding="utf-8")
    record.texts, record.packages = files, find_packages(files, list(files))
    record.artifacts = [ArtifactFact("publisher", "arm_lab/talk.py", "arm_lab/talk.py", "name")]
    programs = stage(
        tmp_path / "sub", record, read_rubric(None), tmp_path / "staged", sys.executable
    )
    scratch = tmp_path / "scratch"
    plan = SessionPlan(
        SessionRecord("launch"), [], tmp_path, scratch, tmp_path / "staged", programs, {}, {}, [],
        Isolation(Level.NO_CGROUP, Form.ROOT), ROS, 0, 0, 60.0,
    )  # fmt: skip
    sandbox = StudentSandbox(plan)
    sandbox.workspace.mkdir(parents=True)
    sandbox.copy_workspace(plan.staged, sandbox.workspace)
    return LaunchRunner(sandbox)


def test_what_it_writes_for_its_nodes_can_be_read_whatever_the_umask_is(
    tmp_path: Path, runner: LaunchRunner
) -> None:
    """Where the grader is root, the student's user is another."""
    (tmp_path / "room").mkdir()
    room, before = StudentRoom.below(tmp_path / "room", ROS), os.umask(0o077)
    try:
        room.make(tmp_path / "room")
        runner._sandbox.parameters = room.tools[PARAMETERS]
        runner._write_files(
            Plan(outcome="ok", parameter_files={"arm.yaml": "a: 1", "arm.sh": "#!/bin/sh"})
        )
    finally:
        os.umask(before)
    made = [
        room.tools[PARAMETERS],
        room.tools[INTERFACES],
        *sorted(room.tools[PARAMETERS].iterdir()),
    ]
    assert [path.stat().st_mode & 0o777 for path in made] == [0o755, 0o755, 0o755, 0o644]


def _lacking(name: str) -> Problem:
    return Problem("unknown_executable", f"executable '{name}' not found in package 'arm_lab'")


def _not_installed(folder: str) -> Problem:
    return Problem(
        "file_not_found",
        "'robot.launch.py' does not exist",
        remedy=f"data_files: ('{folder}', [...])",
    )


def _misnamed(meant: str) -> Problem:
    return Problem(
        "unknown_keyword", "no keyword 'a'", "robot.launch.py", remedy=f"Write '{meant}=' instead."
    )


@pytest.mark.parametrize(
    ("problem", "repaired"),
    [
        pytest.param(_lacking("talkk"), True, id="likely executable"),
        pytest.param(_lacking("é" * 200), False, id="executable of 400 bytes"),
        pytest.param(Problem("unknown_package", "package 'arms' not found"), True, id="package"),
        pytest.param(
            Problem("unknown_package", f"package '{'é' * 200}' not found"),
            False,
            id="package of 400 bytes",
        ),
        pytest.param(
            Problem("unknown_package", "package '.artifacts' not found"),
            False,
            id="folder of the stage's",
        ),
        pytest.param(_not_installed("share/arm_lab/more"), True, id="file"),
        pytest.param(
            _not_installed("share/arm_lab/launch/robot.launch.py"), False, id="file as folder"
        ),
        pytest.param(_not_installed("share" + "/a" * 4000), False, id="folder that none can make"),
        pytest.param(_misnamed("name"), True, id="keyword"),
        pytest.param(_misnamed("b" * 3_000_000), False, id="keyword of megabytes"),
    ],
)
def test_what_cannot_be_repaired_leaves_all_as_it_was(
    runner: LaunchRunner, problem: Problem, repaired: bool
) -> None:
    """Whatever a plan asks for, nothing is raised that would end the session, and nothing grows without bound."""
    workspace = runner._sandbox.workspace
    before = {path: path.read_bytes() for path in workspace.rglob("*") if path.is_file()}
    assert (runner._repair(problem, {}, {}, set()) is not None) == repaired
    after = {path: path.read_bytes() for path in workspace.rglob("*") if path.is_file()}
    assert (after != before) == repaired
    assert sum(map(len, after.values())) < 100_000


def test_among_many_names_the_meant_one_is_soon_found(runner: LaunchRunner) -> None:
    """Ten thousand configurations of sixty letters are not all compared."""
    known = {f"{'a' * 55}{n:05}": "1" for n in range(10_000)}
    began_s = time.process_time()
    assert runner._repair(Problem("undefined_configuration", f"'{'a' * 60}'"), known, {}, set())
    assert time.process_time() - began_s < 3.0


def test_a_launched_process_has_the_sessions_own_variables(runner: LaunchRunner) -> None:
    """Other variables of the launch file reach it."""
    env = {"ROS_DOMAIN_ID": "30", "RMW_IMPLEMENTATION": "rmw_x", "ROBOT": "arm"}
    assert runner._environment(Process("talk-1", "/talk", env=env)) == {"ROBOT": "arm"}


def test_a_prefix_that_cannot_run_here_is_left_out(runner: LaunchRunner) -> None:
    """A terminal, a debugger and a missing program are left out; a program that is here runs."""
    prefixes = {
        "a": ("no_such_terminal", "-e"),
        "b": ("env", "gdb", "-ex", "run", "--args"),
        "c": ("/usr/bin/xterm", "-e"),
        "d": ("env", "ROBOT=arm"),
        "e": (),
    }
    processes = tuple(Process(id_, "/talk", prefix=words) for id_, words in prefixes.items())
    left_out = runner._prefixes_left_out(Plan("ok", processes=processes))
    assert left_out == {
        "a": "no_such_terminal -e",
        "b": "env gdb -ex run --args",
        "c": "/usr/bin/xterm -e",
    }

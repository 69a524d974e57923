"""Launch files that misbehave while they are read: the grader goes on, and nothing outside changes."""

from __future__ import annotations

import hashlib
import os
import secrets
import shutil
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from grader import pipeline
from grader.judging import rubrics
from grader.live.sandbox.probing import probe_isolation
from grader.live.session.runner import Progress
from grader.result import CheckResult, Outcome, Result
from grader.submission.artifacts import read_submission_folder
from tests.live.shared_server import scheduler
from tests.live.small_lab import Watch, until
from tests.regraded import judge_results
from tests.thorough import EVERY_ATTACK, part

pytestmark = pytest.mark.live

ROOT = Path(__file__).parents[2]
CRITERION = "launch"
#: An argument that marks the processes left behind by a case of this test, and of no other.
MARK = f"{10**6 + os.getpid()}.{secrets.randbelow(10**6):06}"
#: Ends within this time, whatever the launch file does: some go on for a million seconds. One evaluation may take 10 s,
#: the rest are the sessions; a busy machine may need three of them.
BOUND_S = 300.0


@dataclass(frozen=True)
class Misdeed:
    """Misbehaviour of a launch file while it is read, and the expected finding."""

    name: str
    code: str
    outcome: Outcome = Outcome.FAILED
    reason_has: str = ""
    check: str = "launch.loads"


MISDEEDS = [
    Misdeed("loops", "while True:\n    pass", reason_has="still busy after 10 s"),
    Misdeed(
        "prints_without_end",
        "while True:\n    print('x' * 1000)",
        reason_has="at the limit of output",
    ),
    Misdeed(
        "forks_without_end",
        "import os, time\nfor _ in range(400):\n    try:\n        os.fork()\n    except OSError:\n        pass\n"
        "time.sleep(1e6)",
        reason_has="still busy after 10 s",
    ),
    Misdeed(
        "leaves_a_daemon",
        "import os, subprocess\n"
        f"subprocess.Popen(['setsid', 'sleep', '{MARK}'], start_new_session=True, close_fds=False)\n"
        "if os.fork() == 0:\n    os.setsid()\n    if os.fork() == 0:\n"
        f"        os.execvp('sleep', ['sleep', '{MARK}'])\n    os._exit(0)",
        Outcome.PASSED,
    ),
    Misdeed(
        "writes_files_floods_its_output_and_waits_for_a_thread",
        "import os, pathlib, threading, time\n"
        "for folder in ('.', '..', '../..', '/ws', '/ws/install/lib', '/tmp', '/', '/launching', '/parameters'):\n"
        "    try:\n        (pathlib.Path(folder) / 'planted_by_launch').write_text('x')\n"
        "    except OSError:\n        pass\n"
        "for _ in range(50):\n    os.write(1, b'x' * 2**20)\n"
        "threading.Thread(target=lambda: time.sleep(1e6)).start()",
        Outcome.PASSED,
    ),
    Misdeed(
        "floods_the_result",
        "import os, sys\nfd = int(sys.orig_argv[-1])\nfor _ in range(50):\n    os.write(fd, b'x' * 2**20)",
        reason_has="no description that can be read",
    ),
    Misdeed("exits_at_once", "import os\nos._exit(0)", reason_has="ended by it (with status 0)"),
    Misdeed("raises_system_exit", "raise SystemExit(3)", reason_has="ends the whole program"),
    Misdeed(
        "kills_its_parent",
        "import os, signal\nfor pid in (os.getppid(), -1):\n    try:\n        os.kill(pid, signal.SIGKILL)\n"
        "    except OSError:\n        pass",
        Outcome.PASSED,
    ),
    Misdeed(
        "kills_itself", "import os\nos.kill(os.getpid(), 9)", reason_has="ended by it (by signal 9)"
    ),
    Misdeed(
        "deletes_everything",
        "import shutil\nfor folder in ('/ws/src', '/ws/install', '/tmp', '/home/student', '/etc'):\n"
        "    shutil.rmtree(folder, ignore_errors=True)\n",
        reason_has="not found",
        check="launch.nodes",
    ),
    Misdeed(
        "plants_links",
        "import os, shutil\nshutil.rmtree('/ws/install/lib')\n"
        "os.symlink('/etc', '/ws/install/lib')\nos.symlink('/etc', '/ws/parameters')\nraise RuntimeError('done')",
        reason_has="RuntimeError: done",
    ),
    Misdeed("recurses", "def again():\n    again()\nagain()", reason_has="RecursionError"),
    Misdeed("takes_memory", "hoard = bytearray(2**36)", reason_has="MemoryError"),
]
#: A third of them in every run, others for each commit.
TRIED = part(MISDEEDS, 7, EVERY_ATTACK)


def submission_of(misdeed: Misdeed, folder: Path) -> Path:
    """Lay out the solution with a launch file that misbehaves before its proper description."""
    submission = folder / misdeed.name
    shutil.copytree(
        ROOT / "reference/solution", submission, ignore=shutil.ignore_patterns("__pycache__")
    )
    launch = submission / "robot_launch.py"
    docstring, rest = launch.read_text().split('"""\n', 1)
    launch.write_text(f'{docstring}"""\n\n{misdeed.code}\n\n{rest}')
    return submission


def state_of(folder: Path) -> dict[str, str]:
    """Digest every file below a folder."""
    files = (p for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts)
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def processes_with(words: str) -> set[str]:
    """Process ids of this machine with some words in their command lines."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            if words in path.read_bytes().replace(b"\0", b" ").decode("utf-8", "replace"):
                found.add(path.parent.name)
    return found


def record_and_judge(
    submission: Path,
    results: Path,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    scope: pipeline.Scope = pipeline.Scope.ALL,
) -> Result:
    """Record the launch session alone, and judge it."""
    rubric = rubrics.read_rubric(None)
    record = read_submission_folder(submission, rubric)
    record.sessions = [CRITERION]
    options = pipeline.Options(Path(sys.executable), [CRITERION], scope, jobs=1)
    pipeline.Grading(
        submission, record, rubric, results, options, on_progress, scheduler=scheduler(jobs=1)
    ).record()
    return judge_results(results, rubric)


def checks_of(result: Result) -> dict[str, CheckResult]:
    """Return the checks of the launch criterion by their ids."""
    found = {}
    for criterion in result.criteria:
        if criterion.id == CRITERION:
            for c in criterion.checks:
                found[c.id] = c
    return found


def require_finding(misdeed: Misdeed, result: Result) -> None:
    """Fail unless the result has the expected finding about the launch file."""
    judged = checks_of(result)[misdeed.check]
    said = f"{judged.reason} | {judged.measured} | {result.problems}"
    assert judged.outcome is misdeed.outcome, said
    assert misdeed.reason_has in judged.reason, said
    if misdeed.outcome is Outcome.FAILED:
        assert judged.hint
        assert result.score.undecided == 0, said
    else:
        # Points left undecided by a busy machine are not lost.
        found = {check.outcome for check in checks_of(result).values()}
        assert found <= {Outcome.PASSED, Outcome.INCONCLUSIVE}, said


@pytest.mark.parametrize("misdeed", TRIED, ids=lambda misdeed: misdeed.name)
def test_a_launch_file_that_misbehaves_is_contained(misdeed: Misdeed, tmp_path: Path) -> None:
    """The session ends in time with a finding, nothing goes on running, and nothing outside has changed."""
    isolation = probe_isolation(Path(sys.executable))
    if not isolation.namespaces:
        pytest.skip(f"no sandboxes here: {isolation.remedy}")
    submission = submission_of(misdeed, tmp_path / "submissions")
    watched = [submission, ROOT / "launch_plan", ROOT / "reference"]
    before = [state_of(folder) for folder in watched]
    began = time.monotonic()
    watch = Watch()
    result = record_and_judge(submission, tmp_path / "results", watch.look)
    took_s = time.monotonic() - began
    assert took_s < BOUND_S
    require_finding(misdeed, result)
    watch.until_all_ended()
    until(lambda: not processes_with(MARK))
    assert [state_of(folder) for folder in watched] == before
    assert not list(tmp_path.rglob("planted_by_launch"))
    assert not Path("/tmp/planted_by_launch").exists()
    assert not Path("/etc/robot_mode_service_1.yaml").exists()


def test_a_node_in_a_container_is_left_undecided(tmp_path: Path) -> None:
    """A container of components is not run here: its node is neither there nor missing, and nothing runs twice."""
    submission = tmp_path / "contained"
    shutil.copytree(
        ROOT / "reference/solution", submission, ignore=shutil.ignore_patterns("__pycache__")
    )
    (submission / "robot_launch.py").write_text(
        "from launch import LaunchDescription\n"
        "from launch_ros.actions import ComposableNodeContainer, Node\n"
        "from launch_ros.descriptions import ComposableNode\n"
        "def generate_launch_description():\n"
        "    inside = ComposableNode(package='lab', plugin='lab::RobotService', name='robot_mode_service')\n"
        "    return LaunchDescription([\n"
        "        Node(package='physical_ai_textbook', executable='joint_publisher', name='joint_command_publisher'),\n"
        "        ComposableNodeContainer(package='rclcpp_components', executable='component_container', name='c',\n"
        "                                namespace='', composable_node_descriptions=[inside]),\n"
        "    ])\n"
    )
    judged = checks_of(
        record_and_judge(submission, tmp_path / "results", scope=pipeline.Scope.ONCE)
    )
    nodes = judged["launch.nodes"]
    assert judged["launch.loads"].outcome is Outcome.PASSED
    assert nodes.outcome is Outcome.INCONCLUSIVE
    assert "container" in nodes.reason

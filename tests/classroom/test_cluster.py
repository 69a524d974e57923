"""A class on a Dask cluster on loopback: the same results as here, also when a worker is lost."""

from __future__ import annotations

import asyncio
import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("distributed")

sys.path.append(str(Path(__file__).parents[2]))

from confine.isolation import Level
from grader.classroom.cluster import Bundle, grade_bundle, packed, same_installation
from grader.classroom.cluster import Cluster as Network
from grader.classroom.fingerprint import engine_sha256
from grader.classroom.job import Ending, Job
from grader.errors import GraderError
from grader.judging.rubrics import read_rubric
from grader.live.sandbox.course_ros import installation_at
from grader.live.sandbox.probing import probe_isolation
from grader.pipeline import Options
from grader.submission.extraction import Intake, SubmissionSource
from tests.classroom.small_class import ASTRAY, CRASHES, SLEEPS, Family, SmallClass, make_class
from tests.live.small_lab import TALKER, below, command_of, until

pytestmark = pytest.mark.live


@dataclass(frozen=True)
class Cluster:
    """A scheduler with two workers.

    Attributes
    ----------
    address : Path
        The file that the scheduler wrote.
    """

    address: Path
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]

    def grading(self) -> subprocess.Popen[bytes] | None:
        """Return a worker with a running student's node."""
        for worker in self.workers:
            if any("/ws/install" in command_of(pid) for pid in below(worker.pid)):
                return worker
        return None


@contextmanager
def running(command: list[str], folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process until the context ends, with its output in a file."""
    environment = {**os.environ, "TMPDIR": str(folder), "DASK_DISTRIBUTED__DASHBOARD__LINK": ""}
    with (
        (folder / "said").open("ab") as said,
        subprocess.Popen(command, stdout=said, stderr=said, cwd=folder, env=environment) as process,
    ):
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """Start a scheduler and two workers, each for one submission at a time."""
    isolation = probe_isolation(Path(sys.executable))
    if not isolation.level.at_least(Level.NO_CGROUP):
        pytest.skip(f"no sandboxes here: {isolation.remedy}")
    folder = tmp_path / "cluster"
    folder.mkdir()
    file = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    scheduler = [
        "scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--no-dashboard",
        "--scheduler-file",
        str(file),
    ]
    worker = [
        "worker",
        "--scheduler-file",
        str(file),
        "--nthreads",
        "1",
        "--no-nanny",
        "--no-dashboard",
    ]
    with ExitStack() as stack:
        started = stack.enter_context(running([*dask, *scheduler], folder))
        until(lambda: is_whole(file), 60)
        workers = []
        for name in ("one", "other"):
            workers.append(
                stack.enter_context(
                    running(
                        [*dask, *worker, "--name", name, "--local-directory", str(folder / name)],
                        folder,
                    )
                )
            )
        yield Cluster(file, started, workers)


def is_whole(file: Path) -> bool:
    """Say if a file of JSON is there and written to its end."""
    try:
        return bool(json.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return False


def graded_here(folder: Path, small: SmallClass) -> SmallClass:
    """Grade the same class on this machine."""
    folder.mkdir()
    here = SmallClass(folder)
    (folder / "lab").symlink_to(small.rubric.parent)
    (folder / "submissions").symlink_to(small.submissions)
    assert here.grade("--seed", "7")[0] == 0
    return here


def require_same_when_judged_here(small: SmallClass) -> None:
    """Fail unless the files from the network are whole: judged again here, to the same bytes."""
    names = list(small.outcomes())
    before = {name: small.files_of(name) for name in names}
    folders = [str(small.results / name) for name in names]
    command = [sys.executable, "-m", "grader.cli", "regrade", *folders]
    command += ["--rubric", str(small.rubric)]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0
    assert {name: small.files_of(name) for name in names} == before


def test_a_lost_worker_changes_no_result(tmp_path: Path, cluster: Cluster) -> None:
    """With a worker killed in the midst of a session, all submissions have the points that they have here.

    The workers use a named installation of ROS, which they find in the same folder.
    """
    small = make_class(tmp_path, {"ann": TALKER, "bob": ASTRAY, "cem": CRASHES})
    (small.submissions / "ann" / "link.py").symlink_to("/etc/passwd")
    there = ("--scheduler", str(cluster.address), "--seed", "7", "--ros", sys.prefix)
    with small.start(*there) as process:
        worker = until(cluster.grading, 120)
        family = Family(worker.pid)
        family.look()
        worker.kill()
        output, errors = process.communicate(timeout=240)
    assert (process.returncode, errors) == (0, "")
    assert "3 graded, mean" in output
    until(lambda: not family.left(), 10)
    here = graded_here(tmp_path / "here", small)
    assert small.outcomes() == here.outcomes()
    assert len(small.outcomes()) == 3
    assert any("link.py" in line for line in small.result("ann")["provenance"]["left_out"])
    require_same_when_judged_here(small)
    assert "students' ROS" in small.result("ann")["provenance"]["versions"]
    status, output, _ = small.grade(*there)
    assert (status, "3 graded, 3 of them as before" in output) == (0, True)


def test_a_lost_scheduler_is_told_and_the_run_continues_without_it(
    tmp_path: Path, cluster: Cluster
) -> None:
    """Submissions under way and waiting are not graded, with that reason; the same command grades them here."""
    names = ("ann", "bob", "cem", "dan", "eve")
    small = make_class(tmp_path, dict.fromkeys(names, TALKER))
    with small.start("--scheduler", str(cluster.address)) as process:
        until(lambda: small.graded() and cluster.grading(), 120)
        cluster.scheduler.kill()
        output, errors = process.communicate(timeout=120)
    kept = small.graded()
    reason = "not graded: the connection to the scheduler was lost"
    lost = {name for name in names if f"{name}: {reason}" in output}
    assert lost == set(names) - set(kept), output + errors
    assert process.returncode != 0
    status, output, _ = small.grade()
    assert status == 0
    assert f"5 graded, {len(kept)} of them as before" in output


def test_problems_come_back_and_ctrl_c_ends(tmp_path: Path, cluster: Cluster) -> None:
    """A refusal by a worker is reported like one on this machine.

    At Ctrl-C the command ends at once and keeps finished gradings.
    """
    small = make_class(tmp_path, {"ann": TALKER, "bob": None, "cem": "print()\n", "dan": SLEEPS})
    (small.submissions / "cem" / "talker.py").rename(small.submissions / "cem" / "notes.txt")
    with small.start("--scheduler", str(cluster.address)) as process:
        until(lambda: small.graded() == ["ann"] and cluster.grading(), 120)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.splitlines()[0] == "grade: interrupted; 1 of 4 submissions are graded and kept."
    assert len(errors.splitlines()) == 2
    assert "bob: not graded: the submission is empty" in output
    assert "cem: not graded: nothing in it looks like a submission" in output


def test_another_grader_is_refused() -> None:
    """A worker with another version of the grader grades nothing, and names the remedy."""
    source = SubmissionSource.of(Path(__file__))
    job = Job(source, Path("results"), read_rubric(None), Options(Path(sys.executable)))
    bundle = pickle.dumps(Bundle("another", job, b"", b"", own_interpreter=True))
    ending, _, results = grade_bundle(bundle)
    assert isinstance(ending, GraderError)
    assert (ending.exit_status, results) == (5, b"")
    assert "Install the same version" in ending.remedy


def test_another_installation_of_ros_is_refused() -> None:
    """A worker with another version of rclpy, or with other packages, grades nothing."""
    installation = installation_at(Path(sys.prefix))
    contents = installation.contents()
    assert same_installation(installation, contents) == installation
    options = Options(installation.interpreter, ros=installation)
    job = Job(
        Intake(Path(), SubmissionSource.of(Path(__file__))),
        Path("results"),
        read_rubric(None),
        options,
    )
    nothing = packed({})
    sent = Bundle(engine_sha256(), job, nothing, nothing, False, ["7.0.0", *contents[1:]])
    ending, _, results = grade_bundle(pickle.dumps(sent))
    assert isinstance(ending, GraderError)
    assert (ending.exit_status, results) == (5, b"")
    assert "installation of ROS differs" in ending.problem


def test_a_scheduler_that_is_not_there(tmp_path: Path) -> None:
    """An address where nobody answers, or that is none, ends with 5 and a remedy, and nothing is graded."""
    small = make_class(tmp_path, {"ann": TALKER})
    for address in ("tcp://127.0.0.1:9", "nonsense://x"):
        status, _, errors = small.grade("--scheduler", address)
        assert status == 5
        assert "the scheduler cannot be reached" in errors
        assert "Check --scheduler" in errors
    assert small.graded() == []


def test_no_submission_waits_for_a_lost_scheduler(tmp_path: Path) -> None:
    """Submissions that had waited for a worker end like those under way, with the same reason and remedy."""
    from distributed import Client, Scheduler

    connect: Any = Client
    source = SubmissionSource.of(Path(__file__))
    job = Job(source, tmp_path, read_rubric(None), Options(Path(sys.executable)))

    async def graded_without_scheduler(threads: int) -> tuple[Ending, Level]:
        async with Scheduler(dashboard=False, port=0, host="127.0.0.1") as scheduler:
            client = await connect(scheduler.address, asynchronous=True, timeout=1)
        waiting = Network(client, threads)
        return await asyncio.wait_for(waiting.grade(job, lambda progress: None), 30)

    for threads in (0, 1):
        ending, level = asyncio.run(graded_without_scheduler(threads))
        assert isinstance(ending, GraderError)
        assert str(ending) == "the connection to the scheduler was lost"
        assert "Start a scheduler again" in ending.remedy
        assert level is Level.NONE


def test_a_missing_file_of_a_scheduler_is_named(tmp_path: Path) -> None:
    """A file that no scheduler has written yet ends with 5, and is not taken for an address."""
    small = make_class(tmp_path, {"ann": TALKER})
    status, _, errors = small.grade("--scheduler", "scheduler.json")
    assert status == 5
    assert "scheduler.json: there is no such file of a scheduler" in errors

"""The judging side of the pipeline: regrading, with and without ROS, and files replaced in one step."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from decimal import Decimal
from functools import partial
from pathlib import Path

import pytest

from grader import pipeline, result_folder
from grader.errors import GraderError, RubricError
from grader.json_text import json_text
from grader.judging import attempts, judgement, rubrics
from grader.judging.judge import judge, open_recordings
from grader.lab.kept_lab import lab_folder
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric
from grader.live.sandbox import environment
from grader.recording.session import SESSION_FILE, read_session, write_session
from grader.recording.submission import ArtifactFact, SubmissionRecord
from grader.result import RESULT_SCHEMA
from tests.regraded import regraded

pytestmark = pytest.mark.usefixtures("judged_before")

ROOT = Path(__file__).resolve().parents[1]
SHIPPED = lab_folder() / "rubric.yaml"


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return rubrics.read_rubric(None)


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Lay out a results folder with the solution's recordings."""
    folder = tmp_path / "results/solution"
    shutil.copytree(ROOT / "tests/recordings/solution", folder / result_folder.RECORDINGS)
    shutil.copy(SHIPPED, folder / result_folder.RECORDINGS / result_folder.RUBRIC_COPY)
    return folder


def written(results: Path) -> dict[str, bytes]:
    """Give the files that judging writes."""
    found = {}
    for name in (result_folder.RESULT_FILE, result_folder.REPORT_FILE):
        found[name] = (results / name).read_bytes()
    return found


def test_regrading_twice_gives_equal_bytes(results: Path) -> None:
    """Result and report are the same each time."""
    regraded(results)
    first = written(results)
    regraded(results)
    assert written(results) == first


WITHOUT_ROS = """
import sys
from collections.abc import Sequence

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"rclpy", "std_msgs", "std_srvs", "rcl_interfaces", "rpyutils", "launch",
                                      "ament_index_python", "rosidl_parser", "rosidl_runtime_py"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
from grader.cli import main
sys.exit(main(["regrade", sys.argv[1]]))
"""


@pytest.mark.slow
def test_without_ros_regrading_gives_the_same_bytes(results: Path, tmp_path: Path) -> None:
    """On a machine without ROS 2, in an empty environment, result and report are the same."""
    regraded(results)
    here = written(results)
    other = tmp_path / "elsewhere/solution"
    shutil.copytree(results, other)
    for name in here:
        (other / name).unlink()
    environment = {
        "PYTHONPATH": str(ROOT),
        "PYTHONHASHSEED": "7",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
    }
    command = [sys.executable, "-c", WITHOUT_ROS, str(other)]
    run = subprocess.run(
        command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert written(other) == here


@pytest.mark.slow
def test_another_rubric_changes_the_points(results: Path) -> None:
    """A corrected rubric judges old recordings anew, and the provenance tells which it was."""
    before = regraded(results)
    text = SHIPPED.read_text(encoding="utf-8").replace(
        "rate_hz: 100, full_within", "rate_hz: 50, full_within"
    )
    mended = results.parent / "mended.yaml"
    mended.write_text(text, encoding="utf-8")
    after = regraded(results, mended)
    assert before.score.earned - after.score.earned == Decimal("6.5")
    assert before.provenance["rubric_sha256"] != after.provenance["rubric_sha256"]
    kept = (results / result_folder.RECORDINGS / result_folder.RUBRIC_COPY).read_text(
        encoding="utf-8"
    )
    assert kept == SHIPPED.read_text(encoding="utf-8")


def test_a_broken_rubric_leaves_the_old_result(results: Path) -> None:
    """A rubric that cannot be read leaves all earlier files unchanged."""
    regraded(results)
    before = written(results)
    broken = results.parent / "broken.yaml"
    broken.write_text("lab: {}\n", encoding="utf-8")
    with pytest.raises(RubricError):
        regraded(results, broken)
    assert written(results) == before


def test_results_are_replaced_in_one_step(results: Path) -> None:
    """A reader of the old file keeps the whole of it, and nothing half-written is left."""
    regraded(results)
    (results / result_folder.RESULT_FILE).write_text("old")
    with (results / result_folder.RESULT_FILE).open() as old:
        regraded(results)
        assert old.read() == "old"
    assert json.loads((results / result_folder.RESULT_FILE).read_text())["score"]["earned"] == 100
    assert sorted(path.name for path in results.iterdir()) == sorted(
        [result_folder.RECORDINGS, result_folder.RESULT_FILE, result_folder.REPORT_FILE]
    )


def test_files_have_unix_line_ends(results: Path) -> None:
    """Results are the same bytes on every system."""
    regraded(results)
    assert b"\r" not in written(results)[result_folder.RESULT_FILE]


# -- which sessions run ----------------------------------------------------------------------------


def submission(*artifacts: str) -> SubmissionRecord:
    """Give a submission with these artifacts."""
    names = ("publisher", "subscriber", "service", "launch", "qos")
    facts = [ArtifactFact(name, name, name if name in artifacts else None) for name in names]
    return SubmissionRecord("ann", artifacts=facts)


def options(sessions: list[str] | None) -> pipeline.Options:
    """Give options that choose sessions."""
    return pipeline.Options(Path(sys.executable), sessions)


def test_sessions_without_their_file_do_not_run(rubric: Rubric) -> None:
    """Only sessions of submitted files are started."""
    assert pipeline.chosen_sessions(rubric, options(None), submission("publisher", "qos")) == [
        "publisher",
        "qos",
    ]
    assert pipeline.chosen_sessions(rubric, options(["qos", "launch"]), submission("qos")) == [
        "qos"
    ]
    assert pipeline.chosen_sessions(rubric, options([]), submission("qos")) == []


def test_unknown_sessions_are_refused(rubric: Rubric) -> None:
    """A session that the rubric does not have is an error that names those it has."""
    with pytest.raises(GraderError, match="there is no session 'x'") as caught:
        pipeline.chosen_sessions(rubric, options(["x"]), submission())
    assert "publisher, subscriber" in caught.value.remedy


def test_what_no_other_run_can_decide_is_not_run_again(results: Path, rubric: Rubric) -> None:
    """A launch file that the grader cannot evaluate leaves points undecided, and its session as it is."""
    path = results / result_folder.RECORDINGS / "launch/session.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    for step in record["steps"]:
        if step["kind"] == "plan":
            problem = {"kind": "module", "message": "needs xacro", "module": "xacro"}
            step["result"]["plan"] |= {"outcome": "not_assessable", "problem": problem}
    path.write_text(json.dumps(record), encoding="utf-8")
    result = judge(open_recordings(results / result_folder.RECORDINGS, rubric), rubric)
    assert result.score.undecided == 15
    assert attempts.undecided_sessions(result, list(rubric.sessions)) == []


def test_versions_name_what_a_recording_depends_on() -> None:
    """Grader, interpreter, kernel and middleware are named, installed or not."""
    assert {"grader", "python", "kernel", "ros-jazzy-rclpy", "mcap"} <= set(environment.versions())


@pytest.mark.parametrize(("again", "kept"), [("invalidated", 1), ("sound", 2)])
def test_a_recording_that_leaves_more_undecided_does_not_take_the_place_of_another(
    results: Path, rubric: Rubric, again: str, kept: int
) -> None:
    """On a machine that is busier the second time, the first recording counts; else the second does."""
    recordings, retry = results / result_folder.RECORDINGS, results / "retry"
    judged = partial(judgement.judge_bounded, recordings, rubric, Overrides())
    before = judged()
    second = dataclasses.replace(
        read_session(recordings / "publisher"), attempt=2, complete=again == "sound"
    )
    shutil.copytree(recordings / "publisher", retry / "publisher")
    write_session(retry / "publisher", second)
    after = attempts.keep_better(recordings, retry, ["publisher"], before, judged)
    assert after.result.score == before.result.score
    assert read_session(recordings / "publisher").attempt == kept
    assert read_session(recordings / "publisher").times_recorded == 2
    assert not list(retry.iterdir())


def test_a_session_is_recorded_again_until_its_checks_are_decided(
    results: Path, rubric: Rubric
) -> None:
    """The first retry that decides the checks counts.

    The replaced recording is gone, and nothing is recorded again.
    """
    recordings, sound = results / result_folder.RECORDINGS, results / "sound"
    shutil.copytree(recordings / "publisher", sound)
    write_session(
        recordings / "publisher", dataclasses.replace(read_session(sound), complete=False)
    )
    asked = []

    def record(
        sessions: Sequence[str], folder: Path, attempt: int, disturbed: frozenset[str]
    ) -> None:
        asked.append((list(sessions), attempt))
        shutil.copytree(sound, folder / "publisher")

    judged = partial(judgement.judge_bounded, recordings, rubric, Overrides())
    result = attempts.retry_undecided(recordings, list(rubric.sessions), record, judged).result
    assert asked == [(["publisher"], 2)]
    assert result.score.earned == 100
    assert sorted(path.name for path in results.iterdir()) == [result_folder.RECORDINGS, "sound"]


def test_sessions_are_read_only_before_a_retry(results: Path, rubric: Rubric) -> None:
    """The number of attempts in the recordings matters only if something is undecided."""
    recordings = results / result_folder.RECORDINGS
    judged = judgement.judge_bounded(recordings, rubric, Overrides())
    assert judged.result.score.undecided == 0
    (recordings / "publisher" / SESSION_FILE).write_text("unreadable", encoding="utf-8")

    def record(*_arguments: object) -> None:
        raise AssertionError

    sessions = list(rubric.sessions)
    assert attempts.retry_undecided(recordings, sessions, record, lambda: judged) is judged


def test_the_result_of_the_submission_before_is_found(tmp_path: Path) -> None:
    """The newest result of another submission is found.

    A regraded one keeps its earlier comparison.
    """

    def keep(path: Path, of: str) -> str:
        path.parent.mkdir(parents=True, exist_ok=True)
        score = {"earned": 1, "possible": 1, "undecided": 0}
        plain = {"submission": "ada", "lab": "Lab", "score": score, "criteria": []}
        provenance = {"submission_sha256": of} if of else {}
        path.write_text(
            json_text({"schema": RESULT_SCHEMA, **plain, "provenance": provenance}),
            encoding="utf-8",
        )
        return path.read_text(encoding="utf-8")

    assert pipeline.earlier_results(tmp_path) == ()
    last = keep(tmp_path / result_folder.RESULT_FILE, "second")
    first = keep(tmp_path / result_folder.RECORDINGS / result_folder.EARLIER_FILE, "first")
    texts = pipeline.earlier_results(tmp_path)
    assert texts == (last, first)
    assert pipeline.result_before(texts, "third") == last
    assert pipeline.result_before(texts, "second") == first
    assert pipeline.result_before(texts[1:], "first") is None
    assert pipeline.result_before(["{", keep(tmp_path / "unknown.json", "")], "third") is None

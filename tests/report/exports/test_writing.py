"""Exports as files: links of a submission are not followed, and running gradings are."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from grader.errors import GraderError
from grader.files import replace_file
from grader.judging.rubrics import read_rubric
from grader.lab.kept_lab import lab_folder
from grader.live.session.runner import Progress
from grader.live_exports import LiveExports
from grader.report.exports import EXPORTS
from grader.report.exports.writing import ExportTarget, write_exports
from grader.result_folder import RECORDINGS, RUBRIC_COPY
from tests.regraded import judge_results
from tests.report.exports.sample_results import every_outcome, read

SOLUTION = Path(__file__).resolve().parents[2] / "recordings/solution"
#: By when another process must have written a file; it takes a second.
DEADLINE_S = 300.0


def written(path: Path, exports: LiveExports, after: Callable[[], None] = lambda: None) -> str:
    """Wait for a file, and return its text; files appear whole. Do something again and again meanwhile."""
    end = time.monotonic() + DEADLINE_S
    while not path.exists():
        assert time.monotonic() < end, f"{path.name} was not written"
        after()
        # The process yields to all others, and on a busy machine would take minutes; where we may, we hurry it.
        with suppress(OSError):
            os.sched_setscheduler(exports._child.pid, os.SCHED_OTHER, os.sched_param(0))  # type: ignore[union-attr]
        time.sleep(0.05)
    return path.read_text(encoding="utf-8")


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Give the results folder of a grading without a recorded session."""
    folder = tmp_path / "ann"
    recorded = [path.name for path in SOLUTION.iterdir() if path.is_dir()]
    shutil.copytree(SOLUTION, folder / RECORDINGS, ignore=shutil.ignore_patterns(*recorded))
    shutil.copy(lab_folder() / "rubric.yaml", folder / RECORDINGS / RUBRIC_COPY)
    return folder


@pytest.mark.parametrize("text", ["junit", "junit=", "gradescope=a=b.json"])
def test_targets_are_read(text: str, tmp_path: Path) -> None:
    """A name alone means the form's own file; only the first equals sign parts name and file."""
    target = ExportTarget.parse(text)
    name, _, file = text.partition("=")
    assert target.path(tmp_path) == (Path(file) if file else tmp_path / EXPORTS[name].file_name)
    assert ExportTarget.parse(str(target)) == target


@pytest.mark.parametrize("text", ["", "=x", "JUNIT", "junit=/dev/stdout", "junit=/proc/self/fd/1"])
def test_what_is_no_target_is_refused(text: str) -> None:
    """No other name is taken, and no device is replaced by a file."""
    with pytest.raises(ValueError):
        ExportTarget.parse(text)


def test_links_are_replaced_and_not_followed(tmp_path: Path) -> None:
    """A submission that laid out a link under the file's name has nothing written through it."""
    victim = tmp_path / "victim"
    victim.write_text("mine", encoding="utf-8")
    (tmp_path / "out.json").symlink_to(victim)
    (tmp_path / "pipe.json").symlink_to(tmp_path / "nowhere")
    for name in ("out.json", "pipe.json"):
        replace_file(tmp_path / name, "new ü")
        assert not (tmp_path / name).is_symlink()
        assert (tmp_path / name).read_text(encoding="utf-8") == "new ü"
    assert victim.read_text(encoding="utf-8") == "mine"


def test_a_pipe_is_replaced_and_not_waited_for(tmp_path: Path) -> None:
    """A named pipe under the file's name does not block the grader."""
    os.mkfifo(tmp_path / "out.json")
    replace_file(tmp_path / "out.json", "x")
    assert (tmp_path / "out.json").is_file()


def test_a_file_has_the_usual_rights(tmp_path: Path) -> None:
    """Other users may read it where the user's mask says so, since another step of the job reads it."""
    before = os.umask(0o022)
    try:
        replace_file(tmp_path / "out.json", "x")
    finally:
        os.umask(before)
    assert (tmp_path / "out.json").stat().st_mode & 0o777 == 0o644


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    """If a folder has the name, it stays, and so does no half of a file."""
    (tmp_path / "out.json" / "x").mkdir(parents=True)
    with pytest.raises(OSError):
        replace_file(tmp_path / "out.json", "x")
    assert [path.name for path in tmp_path.iterdir()] == ["out.json"]


def test_files_are_reported(tmp_path: Path) -> None:
    """Each file that was written is returned."""
    targets = [ExportTarget("junit"), ExportTarget("gradescope", str(tmp_path / "g.json"))]
    assert write_exports(targets, read(every_outcome()), tmp_path) == [
        tmp_path / "junit.xml",
        tmp_path / "g.json",
    ]


# -- while a submission is being graded ------------------------------------------------------------


def test_a_running_grading_is_followed(
    results: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """An export is written at the begin and the end of each session, and with the result."""
    # The working folder may be a submission: none of its files may be taken for a module of the grader's.
    (tmp_path / "json.py").write_text("raise SystemExit('taken for a module')", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "g.json"
    told: list[Progress] = []
    with LiveExports([ExportTarget("gradescope", str(file))], results) as exports:
        follow = exports.follow(told.append)
        begun = Progress("service", "starting")
        follow(begun)
        assert "Not yet run: the session 'service'" in written(file, exports)
        file.unlink()
        shutil.copytree(SOLUTION / "service", results / RECORDINGS / "service")
        follow(Progress("service", "recorded", ended=True))
        text = written(
            file, exports, lambda: follow(Progress("qos", "observe", 1, 2))
        )  # Other sessions go on.
        assert "Not yet run: the session 'qos'" in text
        assert "Not yet run: the session 'service'" not in text
    assert told[0] is begun
    exports.write(judge_results(results, read_rubric(None)))
    assert "Not yet run" not in file.read_text(encoding="utf-8")
    assert not list(tmp_path.glob(".*partial"))


def test_an_earlier_grading_is_not_taken_for_this_one(results: Path) -> None:
    """Its export is removed, and a session that is left out, before anything has begun, brings it not back."""
    old = results / "junit.xml"
    old.write_text("old", encoding="utf-8")
    with LiveExports([ExportTarget("junit")], results) as exports:
        assert not old.exists()
        exports.follow(lambda progress: None)(Progress("service", "left out", ended=True))
        assert exports._child is None
    assert not old.exists()


def test_what_cannot_be_exported_is_said_at_once(
    results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not after the submission has been graded."""
    with pytest.raises(GraderError, match="no such folder"):
        LiveExports([ExportTarget("junit", str(results / "none" / "x.xml"))], results)
    monkeypatch.delenv("CLASSROOM", raising=False)
    with pytest.raises(GraderError, match="CLASSROOM"):
        LiveExports([ExportTarget("classroom50")], results)


def test_without_exports_nothing_is_started(results: Path) -> None:
    """The progress is passed on as it is."""
    with LiveExports([], results) as exports:
        assert exports.follow(print) is print

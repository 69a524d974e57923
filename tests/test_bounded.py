"""Work in processes of its own: results, ends, and leftovers."""

from __future__ import annotations

import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from grader import result_folder
from grader.bounded import Bound, in_process, in_processes
from grader.classroom.regrade import recorded_in, regrade
from grader.errors import BoundError, RecordingError
from grader.judging import judgement, rubrics
from grader.lab.rubric import Rubric, load_rubric
from grader.result import to_json
from tests.regraded import judge_results, regraded

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("judged_before")]

ROOT = Path(__file__).resolve().parents[1]
SMALL = Bound(what="work", cpu_s=1.0, wall_s=60.0, memory_bytes=256 * 1024**2)


def _spin() -> None:
    while True:
        pass


def _end_itself() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _fail() -> None:
    raise RecordingError("it is damaged", location="here", remedy="Mend it.")


def test_what_work_returns_comes_back() -> None:
    """The value is the same, however large; the process was another."""
    assert in_process(lambda: ("x" * 10**6, os.getpid() != os.getppid()), SMALL) == (
        "x" * 10**6,
        True,
    )
    assert in_process(os.getpid, SMALL) != os.getpid()


def test_what_work_raises_is_raised() -> None:
    """An error arrives with where it came up and its remedy, and with a trace as its cause."""
    with pytest.raises(RecordingError) as caught:
        in_process(_fail, SMALL)
    assert (caught.value.problem, caught.value.location, caught.value.remedy) == (
        "it is damaged",
        "here",
        "Mend it.",
    )
    assert "in _fail" in str(caught.value.__cause__)


@pytest.mark.parametrize(
    ("work", "bound", "words"),
    [
        (_spin, SMALL, "more than 1 s of CPU time"),
        (lambda: time.sleep(60), dataclasses.replace(SMALL, wall_s=3.0), "longer than 3 s"),
        (lambda: len(bytearray(2**30)), SMALL, "more than 0.25 GiB of memory"),
        (_end_itself, SMALL, "status -9"),
    ],
)
def test_work_beyond_its_bound_is_ended(
    work: Callable[[], object], bound: Bound, words: str
) -> None:
    """Computing, waiting and memory are bounded, each with its words, and no process stays behind."""
    with pytest.raises(BoundError, match=words):
        in_process(work, bound)
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


def test_one_that_does_not_end_does_not_keep_the_others() -> None:
    """Each of several pieces of work has its own bound; nothing of an abandoned one is left over."""
    works: dict[str, Callable[[], object]] = {
        "spins": _spin,
        "first": lambda: 1,
        "second": lambda: 2,
    }
    outcomes = list(in_processes(works, SMALL, at_a_time=2))
    assert outcomes[:2] == [("first", 1), ("second", 2)]
    assert isinstance(outcomes[2][1], BoundError)
    for outcome in in_processes({"first": lambda: 1, "spins": _spin}, SMALL, at_a_time=2):
        assert outcome == ("first", 1)
        break
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


@pytest.fixture
def endless(tmp_path: Path) -> Rubric:
    """Give the lab's rubric, with an oracle that never ends."""
    shutil.copytree(ROOT / "reference", tmp_path / "lab/reference")
    oracles = tmp_path / "lab/reference/oracles.py"
    oracles.write_text(
        oracles.read_text(encoding="utf-8") + "while True:\n    pass\n", encoding="utf-8"
    )
    shutil.copy(ROOT / "rubric.yaml", tmp_path / "lab")
    return load_rubric(tmp_path / "lab/rubric.yaml", rubrics.rubric_kinds())


def test_judging_without_end_leaves_open_the_sessions_that_it_needs(
    endless: Rubric, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Judging is given up in time; all else is judged, the limit is named, and the recordings stay."""
    bound = dataclasses.replace(judgement.JUDGING_BOUND, cpu_s=2.0)
    monkeypatch.setattr(judgement, "JUDGING_BOUND", bound)
    monkeypatch.setattr(judgement, "SPARING_BOUND", bound)
    results = tmp_path / "results/ann"
    recordings = results / result_folder.RECORDINGS
    shutil.copytree(ROOT / "tests/recordings/solution", recordings)
    shutil.copy(ROOT / "rubric.yaml", recordings / result_folder.RUBRIC_COPY)
    before = judge_results(results, rubrics.read_rubric(None))
    judged = judge_results(results, endless)
    assert judged.score.earned < before.score.earned
    assert judged.score.earned + judged.score.undecided == before.score.earned
    assert "(limit: judging)" in to_json(judged)
    assert regraded(results).score == before.score


def test_a_class_is_judged_but_for_the_one_that_breaks(tmp_path: Path) -> None:
    """Only the submission with a failed judging is named as not judged."""
    for name in ("ann", "bob"):
        folder = tmp_path / name / result_folder.RECORDINGS
        shutil.copytree(ROOT / "tests/recordings/solution", folder)
        shutil.copy(ROOT / "rubric.yaml", folder / result_folder.RUBRIC_COPY)
    shutil.rmtree(tmp_path / "bob/recordings/publisher")
    (tmp_path / "bob/recordings/publisher").mkdir()
    (tmp_path / "bob/recordings/publisher/session.json").write_text("{", encoding="utf-8")
    found = regrade(recorded_in(tmp_path), pages=False)
    assert list(found.changes) == ["ann"]
    assert list(found.failed) == ["bob"]


_KILLED = """
import os, signal, time
from grader.bounded import Bound, in_process

def work():
    os.write(1, b"works\\n")
    time.sleep(60)
    os.write(1, b"it lives")

in_process(work, Bound(what="work", cpu_s=1.0, wall_s=90.0, memory_bytes=2**28))
"""


def test_work_ends_with_the_process_that_asked_for_it() -> None:
    """A killed process leaves no child behind, which would hold shared things, such as a slot of the machine."""
    with subprocess.Popen([sys.executable, "-c", _KILLED], stdout=subprocess.PIPE) as asking:
        assert asking.stdout is not None
        assert asking.stdout.readline() == b"works\n"
        asking.kill()
        # Ends with the last process that can write there.
        assert asking.stdout.read() == b""

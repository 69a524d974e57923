"""`grade similarity`: common code in a class is printed, kept, and shown on the class page.

It costs no points.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from grader.classroom.similarity import read_similarity
from grader.cli import main
from grader.cohort.entries import entries_in
from grader.cohort.statistics import summarise
from grader.errors import RecordingError
from grader.judging.rubrics import read_rubric
from grader.recording.submission import SubmissionRecord, write_submission
from grader.report.class_page import render
from grader.result_folder import RECORDINGS, SIMILARITY_FILE

ROOT = Path(__file__).resolve().parents[2]
OWN = (ROOT / "fixtures/correct_single_module/submission/lab0901/lab0901.py").read_text(
    encoding="utf-8"
)
EVIL = "<script>alert(1)</script>\x1b[31m{{ 7*7 }}"


def hand_in(results: Path, name: str, **texts: str) -> None:
    """Lay down the recorded files of a submission."""
    folder = results / name / RECORDINGS
    folder.mkdir(parents=True)
    lab = str(ROOT)
    record = SubmissionRecord(
        name, sha256=name, texts={f"{k}.py": t for k, t in texts.items()}, lab_folder=lab
    )
    write_submission(folder, record)


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Give a class of four, two of them with the same program under other names."""
    solution = {}
    for path in (ROOT / "reference/solution").glob("*.py"):
        solution[path.stem] = path.read_text(encoding="utf-8")
    hand_in(tmp_path, "ada", node=OWN)
    hand_in(
        tmp_path,
        "bob",
        other=f"# {EVIL}\n" + OWN.replace("self.t", "self.zeit").replace("errors", "fehler"),
    )
    hand_in(tmp_path, "cleo", **solution)
    hand_in(tmp_path, "dan", **solution)
    return tmp_path


def run(results: Path, *options: str) -> int:
    """Run the command by the lab's own rubric."""
    return main(["similarity", str(results), "--lab", str(ROOT / "rubric.yaml"), *options])


def test_the_pair_is_printed_and_kept(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A copy with other names is found; a submission of the solution has nothing of its own."""
    assert run(results) == 0
    printed = capsys.readouterr().out
    assert "ada bob 100% and 100%" in " ".join(printed.split())
    assert "Of 4 submissions, 1 pair shares code" in printed
    assert "\x1b[31m" not in printed
    found = read_similarity(results)
    assert found is not None
    assert [pair.names for pair in found.pairs] == [("ada", "bob")]
    assert [Path(folder).name for folder in found.common] == ["handout", "solution"]


def test_what_else_was_given_does_not_count(
    results: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """`--common` names more code that all were given."""
    given = tmp_path_factory.mktemp("given")
    (given / "template.py").write_text(OWN, encoding="utf-8")
    assert run(results, "--common", str(given)) == 0
    found = read_similarity(results)
    assert found is not None
    assert found.pairs == ()


def test_the_class_page_shows_the_lines_as_text(results: Path) -> None:
    """Students' lines stand side by side, never as markup; equal facts give equal pages."""
    run(results)
    rubric = read_rubric(None)
    summary = summarise(entries_in(results), rubric)
    found = read_similarity(results)
    page = render(summary, found)
    assert page == render(summary, read_similarity(results))
    assert "JointCommandPublisher" in page
    assert "self.zeit" in page
    assert "<script>alert" not in page
    assert "Code in common" not in render(summary)


def test_files_that_cannot_be_read_are_named(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A damaged record costs nobody else the comparison; a damaged similarity.json is an error with a way on."""
    (results / "cleo" / RECORDINGS / "submission.json").write_text("{", encoding="utf-8")
    assert run(results) == 0
    assert "cleo: Not compared" in capsys.readouterr().out
    (results / SIMILARITY_FILE).write_text("[]", encoding="utf-8")
    with pytest.raises(RecordingError):
        read_similarity(results)


def test_one_submission_is_no_class(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One submission, or a missing folder, is refused with a remedy."""
    hand_in(tmp_path, "ada", node=OWN)
    assert run(tmp_path) == 3
    assert "fewer than two submissions" in capsys.readouterr().err
    hand_in(tmp_path, "bob", node=OWN)
    assert run(tmp_path, "--common", str(tmp_path / "nowhere")) == 3

"""`grade regrade`: one submission at once, a class only with --apply, and the files after both."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import pytest

from grader.cli import main
from grader.judging.rubrics import read_rubric
from grader.lab.kept_lab import lab_folder
from grader.result_folder import (
    AUDIT_FILE,
    CHANGES_FILE,
    EXPORTED,
    HISTORY,
    RECORDINGS,
    RESULT_FILE,
    RUBRIC_COPY,
)
from tests.regraded import judge_results

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("judged_before")]

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = lab_folder() / "rubric.yaml"
WHY = "reason: it was so, who: J. Smith, when: 2026-11-21"


def add(results: Path, name: str) -> Path:
    """Add a submission with kept recordings to a class."""
    folder = results / name
    shutil.copytree(ROOT / "tests/recordings/wrong_topic", folder / RECORDINGS)
    shutil.copy(SHIPPED, folder / RECORDINGS / RUBRIC_COPY)
    path = folder / RECORDINGS / "submission.json"
    path.write_text(json.dumps({**json.loads(path.read_text(encoding="utf-8")), "name": name}))
    return folder


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Lay out a class of two with their results, once."""
    folder = tmp_path_factory.mktemp("judged")
    for name in ("ann", "bob"):
        judge_results(add(folder, name), read_rubric(None))
    return folder


@pytest.fixture
def results(judged: Path, tmp_path: Path) -> Path:
    """Give a copy of the class of two."""
    return Path(shutil.copytree(judged, tmp_path / "results"))


@pytest.fixture
def stricter(tmp_path: Path) -> Path:
    """Write a rubric that asks for another rate."""
    text = SHIPPED.read_text(encoding="utf-8").replace(
        "rate_hz: 100, full_within", "rate_hz: 50, full_within"
    )
    (tmp_path / "new.yaml").write_text(text, encoding="utf-8")
    return tmp_path / "new.yaml"


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """Run the command in this process; returns exit status, output with single spaces, and errors."""
    try:
        status = main(["regrade", *map(str, arguments)])
    except SystemExit as end:  # argparse
        status = int(end.code or 0)
    captured = capsys.readouterr()
    return status, " ".join(captured.out.split()), captured.err


def points(folder: Path) -> float:
    """Give a submission's final points."""
    return float(json.loads((folder / RESULT_FILE).read_text())["score"]["final"])


# -- a class ---------------------------------------------------------------------------------------


def test_a_class_is_only_looked_at(
    results: Path, stricter: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Changes in a class are printed and written, but no result is; the status tells a script."""
    before = {}
    for p in results.rglob("*"):
        if p.is_file() and p.name != CHANGES_FILE:
            before[p] = p.read_bytes()
    status, output, errors = run(capsys, results, "--rubric", stricter)
    assert (status, errors) == (1, "")
    assert "ann 16 → 9.5 −6.5" in output
    assert "Commands arrive at 100 Hz passed → failed 6.5 → 0 −6.5" in output
    assert "No result is written yet; --apply writes them." in output
    assert "bob,total" in (results / CHANGES_FILE).read_text(encoding="utf-8-sig")
    assert {p: p.read_bytes() for p in before} == before
    assert not (results / AUDIT_FILE).exists()


def test_a_class_without_changes(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where nothing would change, that is said, and the status is 0."""
    status, output, _ = run(capsys, results)
    assert status == 0
    assert "No points change; 2 submissions judged." in output
    assert "--apply" not in output


def test_applying_writes_and_notes(
    results: Path, stricter: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With --apply the results are written, the old ones kept, and the trail says when."""
    status, output, _ = run(capsys, results, "--rubric", stricter, "--apply", "-j", "1")
    assert status == 0
    assert "The results are written." in output
    assert [points(results / name) for name in ("ann", "bob")] == [9.5, 9.5]
    lines = [json.loads(line) for line in (results / AUDIT_FILE).read_text().splitlines()]
    assert [(line["submission"], line["final"]) for line in lines] == [
        ("ann", [16, 9.5]),
        ("bob", [16, 9.5]),
    ]
    for line in lines:
        assert line["at"].endswith("+00:00")
    assert len(list((results / HISTORY).rglob("*.json"))) == 2


def test_the_class_page_follows(
    results: Path, stricter: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With --apply a class page is written again; none is begun."""
    run(capsys, results, "--rubric", stricter, "--apply")
    assert not (results / "index.html").exists()
    (results / "index.html").write_text("old")
    assert run(capsys, results, "--apply")[0] == 0
    assert (results / "index.html").read_text() == "old"
    assert run(capsys, results, "--rubric", SHIPPED, "--apply")[0] == 0
    assert "16" in (results / "index.html").read_text()


@pytest.mark.parametrize(("answer", "final"), [("y", 9.5), ("n", 16), ("", 16)])
def test_a_change_is_shown_applied_and_reported_in_one(
    answer: str,
    final: float,
    results: Path,
    stricter: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """--ask shows the changes, then asks; after a yes, results, class page and mails are written."""
    (results / "index.html").write_text("old")
    (results / "class-list.csv").write_text(
        "name,email\nann,ann@uni.example\nbob,bob@uni.example\n", encoding="utf-8"
    )
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{answer}\n" if answer else ""))
    status, output, errors = run(capsys, results, "--rubric", stricter, "--ask", "--mail")
    assert "Write these results? [y/N]" in output
    assert [points(results / name) for name in ("ann", "bob")] == [final, final]
    mails = results / EXPORTED / "mail.mbox"
    assert mails.exists() == (answer == "y"), errors
    assert ((results / "index.html").read_text() == "old") == (answer != "y")
    if answer == "y":
        assert status == 0
        assert "To: ann <ann@uni.example>" in mails.read_text(encoding="utf-8")
    else:
        assert (status, "No result is written yet" in output) == (1, True)


def test_a_limit_is_for_final_points(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--fail-under compares final points, decisions included."""
    assert run(capsys, results, "--fail-under", "16")[0] == 0
    assert run(capsys, results, "--fail-under", "16.1")[0] == 1
    (results / "overrides.yaml").write_text(
        f"overrides:\n  - {{submission: '*', bonus: 0.1, {WHY}}}\n"
    )
    assert run(capsys, results, "--fail-under", "16.1", "--apply")[0] == 0


def test_one_that_cannot_be_judged(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The others are judged if one cannot be, and the status is that one's."""
    (results / "ann" / RECORDINGS / "publisher/session.json").write_text("{")
    status, output, errors = run(capsys, results)
    assert status == 6
    assert "1 submission judged" in output
    assert "ann" in errors


def test_a_class_by_a_rubric_of_an_older_version(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The failed submissions are counted, and named with their one cause and the remedy."""
    for folder in ("ann", "bob"):
        kept = results / folder / RECORDINGS / RUBRIC_COPY
        kept.write_text(
            kept.read_text(encoding="utf-8").replace("check: topic_rate", "check: topic_speed")
        )
    status, output, errors = run(capsys, results)
    assert (status, output) == (4, "2 of 2 could not be judged, for the reasons below.")
    assert errors.count("topic_speed") == 1
    assert errors.startswith("grade: ann, bob: ")
    assert "`--rubric rubric.yaml` judges by the present rubric." in errors
    assert not (results / CHANGES_FILE).exists()


def test_decisions_that_do_nothing_are_reported(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A name that nobody has is a note, not a mistake."""
    (results / "overrides.yaml").write_text(
        f"overrides:\n  - {{submission: abn, bonus: 1, {WHY}}}\n"
    )
    status, output, _ = run(capsys, results)
    assert status == 0
    assert "Note: overrides.yaml:2: there is no submission 'abn'; did you mean 'ann'?" in output


def test_broken_decisions_end_with_4(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All mistakes of a file of overrides are printed with their lines."""
    (results / "overrides.yaml").write_text("overrides:\n  - {submission: ann, bonus: 1}\n")
    for folder in (results, results / "ann"):
        status, _, errors = run(capsys, folder)
        assert status == 4
        assert errors.count("overrides.yaml:2: ") == 3


# -- one submission --------------------------------------------------------------------------------


def test_a_single_submission_is_written_at_once(
    results: Path, stricter: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A submission is judged, printed and written at once, with its changes.

    Its old result is kept beside the class.
    """
    status, output, _ = run(capsys, results / "ann", "--rubric", stricter)
    assert status == 0
    assert "ann 16 → 9.5 −6.5" in output
    assert [points(results / name) for name in ("ann", "bob")] == [9.5, 16]
    (line,) = (json.loads(line) for line in (results / AUDIT_FILE).read_text().splitlines())
    assert (line["submission"], line["final"]) == ("ann", [16, 9.5])
    assert json.loads((results / line["kept"]).read_text())["score"]["final"] == 16


def test_a_single_submission_without_changes_leaves_no_trace(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Judged again to the same, there is nothing to note."""
    status, output, _ = run(capsys, results / "ann")
    assert status == 0
    assert "→ 16" not in output
    assert not (results / AUDIT_FILE).exists()


def test_decisions_beside_the_class_hold_for_a_single_one(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """overrides.yaml of the class is applied, and the limit is for the final points."""
    text = f"overrides:\n  - {{submission: ann, check: publisher.reliable, excused: true, {WHY}}}\n"
    (results / "overrides.yaml").write_text(text)
    status, output, _ = run(capsys, results / "ann", "--fail-under", "20")
    assert status == 0
    assert "excused" in output
    assert points(results / "ann") == 20


def test_another_file_of_decisions(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """--overrides names another file."""
    (tmp_path / "mine.yaml").write_text(f"overrides:\n  - {{submission: ann, bonus: 1, {WHY}}}\n")
    run(capsys, results / "ann", "--overrides", tmp_path / "mine.yaml")
    assert points(results / "ann") == 17


@pytest.mark.parametrize("option", [["--apply"], ["-j", "2"], ["--ask"], ["--mail", "--apply"]])
def test_what_is_for_a_class(
    results: Path, option: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """--apply, --ask, --mail and --jobs with a single submission are wrong usage; so is --mail alone."""
    status, _, errors = run(capsys, results / "ann", *option)
    assert (status, "usage: grade regrade" in errors) == (2, True)
    status, _, errors = run(capsys, results, "--mail")
    assert (status, "--mail needs --apply or --ask" in errors) == (2, True)


def test_the_help_shows_what_can_be_decided(capsys: pytest.CaptureFixture[str]) -> None:
    """An example of each sort of entry, and the exit statuses."""
    status, output, _ = run(capsys, "--help")
    assert status == 0
    for word in (
        "overrides.yaml",
        "excused: true",
        "extension: 2 days",
        "--apply",
        "audit.jsonl",
    ):
        assert word in output

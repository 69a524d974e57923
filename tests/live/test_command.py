"""The real `grade` command on the sample submission: files, score and exit statuses."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from tests.live.sample import ALICE, ROOT, Graded, grade
from tests.plain_results import checks_of

pytestmark = pytest.mark.live

POINTS = ("earned", "possible", "undecided")
#: Keys of `result.json` that scripts rely on.
KEYS = {
    "schema",
    "submission",
    "lab",
    "score",
    "criteria",
    "advisories",
    "problems",
    "provenance",
}
#: Keys of a check in `result.json`.
CHECK_KEYS = {
    *POINTS,
    "id",
    "title",
    "outcome",
    "expected",
    "measured",
    "reason",
    "hint",
    "where",
}


@pytest.mark.smoke
def test_the_sample_is_graded(alice: Graded) -> None:
    """The sample submission gets a believable score; the command says so and ends with 0."""
    assert alice.exit_status == 0, alice.errors
    assert "Traceback" not in alice.errors
    result = json.loads((alice.folder / "result.json").read_text(encoding="utf-8"))
    assert result["score"]["possible"] == 100
    # Points left undecided by a busy machine are not lost.
    assert result["score"]["earned"] < 90
    assert result["score"]["earned"] + result["score"]["undecided"] > 80, result["problems"]
    assert f"{result['score']['earned']:g}" in alice.output
    if not result["score"]["undecided"]:
        assert f"{result['score']['earned']:g} / 100" in (ROOT / "docs/start.md").read_text()
    assert "report.html" in alice.output


def test_all_files_are_written(alice: Graded) -> None:
    """Report, result and a recording for each session lie in the results folder, and nothing else."""
    assert sorted(p.name for p in alice.folder.iterdir()) == [
        "recordings",
        "report.html",
        "result.json",
    ]
    recordings = alice.folder / "recordings"
    sessions = {"publisher", "subscriber", "service", "launch", "qos"}
    assert {p.name for p in recordings.iterdir()} == {
        *sessions,
        "submission.json",
        "rubric.yaml",
        "rubric.files",
    }
    for session in sessions:
        names = {p.name for p in (recordings / session).iterdir()}
        assert names == {"metadata.yaml", f"{session}.mcap", "session.json", "foxglove.json"}


def test_the_result_keeps_its_contract(alice: Graded) -> None:
    """`result.json` has the keys that scripts rely on, and its points add up."""
    result = json.loads((alice.folder / "result.json").read_text(encoding="utf-8"))
    assert set(result) >= KEYS
    assert result["submission"] == "alice"
    assert set(result["score"]) == {*POINTS, "final"}
    for criterion in result["criteria"]:
        assert {"id", "title", *POINTS, "checks"} <= set(criterion)
        require_sum(criterion, criterion["checks"])
    require_sum(result["score"], result["criteria"])
    require_explained(checks_of(result))


def require_sum(whole: dict[str, Any], parts: list[dict[str, Any]]) -> None:
    """Fail unless the points of the parts add up to the whole's."""
    for key in POINTS:
        assert sum(part[key] for part in parts) == pytest.approx(whole[key])


def require_explained(checks: list[dict[str, Any]]) -> None:
    """Fail unless each check has its keys, and each loss of points its explanation."""
    for check in checks:
        assert set(check) >= CHECK_KEYS
    lost = [check for check in checks if check["earned"] + check["undecided"] < check["possible"]]
    assert lost
    for check in lost:
        assert all((check["reason"], check["expected"], check["measured"]))


def test_regrading_gives_the_same_bytes(alice: Graded, tmp_path: Path) -> None:
    """`grade regrade` judges the recordings again and changes no byte; `--fail-under` sets the exit status."""
    files = [alice.folder / "result.json", alice.folder / "report.html"]
    before = [path.read_bytes() for path in files]
    earned = json.loads(before[0])["score"]["earned"]
    run = grade("regrade", alice.folder, "--fail-under", f"{earned}", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert [path.read_bytes() for path in files] == before
    assert (
        grade("regrade", alice.folder, "--fail-under", f"{earned + 0.1}", cwd=tmp_path).returncode
        == 1
    )


def test_one_session_can_be_chosen(tmp_path: Path) -> None:
    """`--sessions` restricts grading to one session; `-o`, `--fail-under` and `--timings` work with it."""
    arguments = ("--sessions", "publisher", "-o", tmp_path / "out", "--fail-under", "99")
    run = grade(ALICE, *arguments, "--timings", cwd=tmp_path)
    assert run.returncode == 1, run.stderr
    cpu = re.search(r"student's processes ([\d.]+) s, the grader's ([\d.]+) s", run.stdout)
    assert cpu is not None, run.stdout
    assert min(map(float, cpu.groups())) > 0
    result = json.loads((tmp_path / "out" / "alice" / "result.json").read_text(encoding="utf-8"))
    recordings = tmp_path / "out" / "alice" / "recordings"
    assert [p.parent.name for p in recordings.glob("*/session.json")] == ["publisher"]
    judged = {check["id"].split(".")[0] for check in checks_of(result)}
    assert "publisher" in judged
    assert not {"subscriber", "service"} & judged
    assert not (tmp_path / "results").exists()


def test_a_mistake_on_the_command_line_is_reported(tmp_path: Path) -> None:
    """A wrong path or session ends with the status of its kind, with a remedy and without a traceback."""
    for arguments, status in (((tmp_path / "nobody",), 3), ((ALICE, "--sessions", "nonsense"), 2)):
        run = grade(*arguments, cwd=tmp_path)
        assert run.returncode == status
        assert run.stderr.startswith("grade: ")
        assert "Traceback" not in run.stderr
    assert list(tmp_path.iterdir()) == [] or not list(tmp_path.rglob("result.json"))

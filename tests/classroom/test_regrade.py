"""A class judged again: the same bytes as one by one, nothing written before it is wanted, and the trail."""

from __future__ import annotations

import hashlib
import json
import shutil
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader import result_folder
from grader.classroom.audit import note_replaced
from grader.classroom.regrade import LoadedRubrics, Regrade, is_class, recorded_in, regrade
from grader.errors import RecordingError, RubricError
from grader.judging import rubrics
from grader.lab.kept_lab import lab_folder
from grader.result_folder import AUDIT_FILE, HISTORY
from tests.regraded import judge_results, regraded

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("judged_before")]

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = lab_folder() / "rubric.yaml"
NAMES = ("alice", "bob")
WHY = "reason: it was so, who: J. Smith, when: 2026-11-21"


def add(results: Path, name: str, recording: str = "missing_service_file", **facts: Any) -> Path:
    """Add a submission with kept recordings to a class."""
    folder = results / name
    shutil.copytree(ROOT / "tests/recordings" / recording, folder / result_folder.RECORDINGS)
    shutil.copy(SHIPPED, folder / result_folder.RECORDINGS / result_folder.RUBRIC_COPY)
    path = folder / result_folder.RECORDINGS / "submission.json"
    path.write_text(
        json.dumps({**json.loads(path.read_text(encoding="utf-8")), "name": name, **facts})
    )
    return folder


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Lay out a class of two with their results, once."""
    folder = tmp_path_factory.mktemp("judged")
    for name in NAMES:
        judge_results(add(folder, name), rubrics.read_rubric(None))
    return folder


@pytest.fixture
def results(judged: Path, tmp_path: Path) -> Path:
    """Give a copy of the class of two."""
    return Path(shutil.copytree(judged, tmp_path / "results"))


@pytest.fixture
def stricter(tmp_path: Path) -> Path:
    """Write a rubric that asks for another rate."""
    return rewritten(tmp_path, "rate_hz: 100, full_within", "rate_hz: 50, full_within")


def rewritten(folder: Path, old: str, new: str) -> Path:
    """Write the lab's rubric with a change."""
    text = SHIPPED.read_text(encoding="utf-8")
    assert old in text
    (folder / "new.yaml").write_text(text.replace(old, new), encoding="utf-8")
    return folder / "new.yaml"


def rejudge(results: Path, rubric: Path | None, overrides: Path | None, **how: Any) -> Regrade:
    """Judge all that was recorded again."""
    return regrade(recorded_in(results), rubric, overrides, **how)


def files(results: Path) -> dict[str, bytes]:
    """Give all files of a class by their paths."""
    found = {}
    for p in sorted(results.rglob("*")):
        if p.is_file():
            found[str(p.relative_to(results))] = p.read_bytes()
    return found


def trail(results: Path) -> list[dict[str, Any]]:
    """Give the lines of the trail."""
    path = results / AUDIT_FILE
    if path.exists():
        return [json.loads(line) for line in path.read_text().splitlines()]
    return []


def test_several_calls_share_a_rubric(results: Path) -> None:
    """`grade regrade results/alice results/bob` loads the copy of their rubric once."""
    loaded: LoadedRubrics = {}
    used = []
    for name in NAMES:
        found = regrade([results / name], pages=False, loaded=loaded)
        used.append(found.judged[name].rubric)
    assert used[0] is used[1]


# -- which folders ---------------------------------------------------------------------------------


def test_a_class_is_a_folder_of_recorded_submissions(results: Path) -> None:
    """A submission's own folder is no class, and neither is one without recordings."""
    assert is_class(results)
    assert not is_class(results / "alice")
    assert not is_class(results / "alice" / result_folder.RECORDINGS)
    assert not is_class(results.parent / "none")
    (results / "history").mkdir()
    (results / ".partial" / result_folder.RECORDINGS).mkdir(parents=True)
    assert [folder.name for folder in recorded_in(results)] == list(NAMES)


def test_nothing_to_judge(tmp_path: Path) -> None:
    """A folder without recordings is an error with a remedy."""
    with pytest.raises(RecordingError, match="no recordings"):
        rejudge(tmp_path, None, None, pages=False)


# -- what would change -----------------------------------------------------------------------------


def test_a_look_writes_nothing(results: Path, stricter: Path) -> None:
    """Before it is applied, all files are as they were, and the changes are known."""
    before = files(results)
    found = rejudge(results, stricter, None, pages=False)
    assert files(results) == before
    assert {name: changes.difference for name, changes in found.changes.items()} == dict.fromkeys(
        NAMES, Decimal("-6.5")
    )
    assert found.failed == {}


def test_the_same_rubric_changes_nothing(results: Path) -> None:
    """Judged by the rubric that it was recorded with, each is as it was."""
    found = rejudge(results, None, None, pages=False)
    for changes in found.changes.values():
        assert not changes.matters
        assert not changes.words


def test_applying_writes_what_single_regrading_writes(results: Path, stricter: Path) -> None:
    """Results and reports equal byte for byte the ones of judging each submission by itself."""
    found = rejudge(results, stricter, None, pages=True)
    found.apply()
    as_class = files(results)
    for name in NAMES:
        regraded(results / name, stricter)
    assert files(results) == as_class


def test_processes_side_by_side_find_the_same(results: Path, stricter: Path) -> None:
    """The changes are the same from one process and from several, in the order of names."""
    for number in range(2):
        add(results, f"d{number}", "wrong_topic")
    alone = rejudge(results, stricter, None, pages=False, jobs=1)
    judged: list[str] = []
    together = rejudge(results, stricter, None, pages=False, jobs=2, on_judged=judged.append)
    assert together == alone
    assert list(together.changes) == sorted(judged)
    assert len(judged) == 4


def test_one_that_cannot_be_judged_does_not_stop_the_others(results: Path, stricter: Path) -> None:
    """A damaged recording keeps its old result, and is told with its exit status."""
    old = (results / "bob" / result_folder.RESULT_FILE).read_bytes()
    (results / "bob" / result_folder.RECORDINGS / "publisher/session.json").write_text("{")
    found = rejudge(results, stricter, None, pages=True)
    found.apply()
    assert list(found.changes) == ["alice"]
    assert {name: failed.exit_status for name, failed in found.failed.items()} == {"bob": 6}
    assert (results / "bob" / result_folder.RESULT_FILE).read_bytes() == old


def test_one_without_its_rubric_needs_another(results: Path, stricter: Path) -> None:
    """Recordings without a copy of the rubric cannot be judged by it, but by one that is given."""
    (results / "bob" / result_folder.RECORDINGS / result_folder.RUBRIC_COPY).unlink()
    assert list(rejudge(results, None, None, pages=False).failed) == ["bob"]
    assert rejudge(results, stricter, None, pages=False).failed == {}


def test_each_is_judged_by_its_own_rubric(results: Path, stricter: Path) -> None:
    """Where the copies differ, each folder's counts."""
    shutil.copy(stricter, results / "bob" / result_folder.RECORDINGS / result_folder.RUBRIC_COPY)
    found = rejudge(results, None, None, pages=False)
    assert {name: changes.difference for name, changes in found.changes.items()} == {
        "alice": 0,
        "bob": Decimal("-6.5"),
    }


def test_results_remember_the_rubric_that_was_applied(results: Path, stricter: Path) -> None:
    """An applied rubric holds for the next judgement without a rubric.

    The first rubric has to be applied again to end this.
    """
    rejudge(results, stricter, None, pages=True).apply()
    again = rejudge(results, None, None, pages=False)
    for changes in again.changes.values():
        assert not changes.matters
        assert not changes.words
    rejudge(results, SHIPPED, None, pages=True).apply()
    assert not [
        path for path in files(results) if path.endswith(f"alice/{result_folder.RUBRIC_COPY}")
    ]


def test_a_broken_rubric_is_reported_before_anything_is_judged(
    results: Path, tmp_path: Path
) -> None:
    """All its mistakes are known, and no file has changed."""
    before = files(results)
    broken = rewritten(tmp_path, "check: topic_rate", "check: topic_rat")
    with pytest.raises(RubricError):
        rejudge(results, broken, None, pages=True)
    assert files(results) == before


def test_an_interruption_changes_nothing(results: Path, stricter: Path) -> None:
    """Ctrl-C on the way leaves all files as they were."""
    before = files(results)

    def interrupt(name: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rejudge(results, stricter, None, pages=True, on_judged=interrupt)
    assert files(results) == before


# -- overrides -------------------------------------------------------------------------------------


def test_decisions_survive_every_regrade(results: Path, stricter: Path) -> None:
    """Overrides beside the results are applied whichever rubric judges, one by one and as a class."""
    (results / "overrides.yaml").write_text(
        f"overrides:\n  - {{submission: bob, bonus: 2.5, {WHY}}}\n"
    )
    for rubric in (None, stricter):
        found = rejudge(results, rubric, None, pages=True)
        found.apply()
        plain = json.loads((results / "bob" / result_folder.RESULT_FILE).read_text())
        assert plain["score"]["final"] == plain["score"]["earned"] + 2.5
        assert [a["kind"] for a in plain["adjustments"]] == ["bonus"]
        alone = regraded(results / "bob", rubric)
        assert alone.final == found.changes["bob"].after
    assert (
        json.loads((results / "alice" / result_folder.RESULT_FILE).read_text())["adjustments"] == []
    )


def test_another_file_of_decisions(results: Path, tmp_path: Path) -> None:
    """The file that is given counts, not the one beside the results."""
    (results / "overrides.yaml").write_text(
        f"overrides:\n  - {{submission: bob, bonus: 2.5, {WHY}}}\n"
    )
    (tmp_path / "mine.yaml").write_text(f"overrides:\n  - {{submission: alice, bonus: 1, {WHY}}}\n")
    found = rejudge(results, None, tmp_path / "mine.yaml", pages=False)
    assert {
        name: changes.difference for name, changes in found.changes.items() if changes.matters
    } == {"alice": 1}


def test_decisions_under_another_name_are_not_passed_over(results: Path) -> None:
    """A file called overrides.yml is told, unless there is the right one, or it is given."""
    text = f"overrides:\n  - {{submission: bob, bonus: 2.5, {WHY}}}\n"
    (results / "overrides.yml").write_text(text)
    with pytest.raises(RubricError, match=r"is called overrides\.yaml"):
        rejudge(results, None, None, pages=False)
    assert (
        rejudge(results, None, results / "overrides.yml", pages=False).changes["bob"].difference
        == 2.5
    )
    (results / "overrides.yaml").write_text("overrides: []")
    assert not rejudge(results, None, None, pages=False).changes["bob"].matters


def test_decisions_that_do_nothing_are_reported(results: Path) -> None:
    """A name that nobody has, and a time where none matters."""
    text = f"overrides:\n  - {{submission: bbo, bonus: 1, {WHY}}}\n  - {{submission: bob, extension: 1 day, {WHY}}}\n"
    (results / "overrides.yaml").write_text(text)
    remarks = rejudge(results, None, None, pages=False).remarks()
    assert remarks[:1] == ["overrides.yaml:2: there is no submission 'bbo'; did you mean 'bob'?"]
    assert remarks[1].startswith("overrides.yaml:3: ")


def test_broken_decisions_are_reported_before_anything_is_judged(results: Path) -> None:
    """A file of overrides with mistakes stops all."""
    (results / "overrides.yaml").write_text("overrides:\n  - {submission: bob, bonus: 1}\n")
    with pytest.raises(RubricError, match="3 mistakes"):
        rejudge(results, None, None, pages=False)


def test_lateness_by_the_recorded_time(tmp_path: Path) -> None:
    """The time of submission in the record is compared with the rubric's due date."""
    late = "policy:\n  late: {due: 2026-11-20T23:59:00+01:00, per_day: 10 %}\n\nlab:\n"
    rubric = rewritten(tmp_path, "lab:\n", late)
    results = tmp_path / "results"
    add(results, "alice", "wrong_topic", submitted_at="2026-11-20T22:59:00Z")
    add(results, "bob", "wrong_topic", submitted_at="2026-11-22T00:00:00+01:00")
    add(results, "carol", "wrong_topic")
    rejudge(results, rubric, None, pages=True).apply()
    found = {}
    for name in ("alice", "bob", "carol"):
        found[name] = json.loads((results / name / result_folder.RESULT_FILE).read_text())
    earned = found["alice"]["score"]["earned"]
    assert {name: plain["score"]["final"] for name, plain in found.items()} == {
        "alice": earned,
        "bob": round(earned * 0.8, 1),
        "carol": earned,
    }
    assert [a["points"] for a in found["carol"]["adjustments"]] == [0]


# -- the trail -------------------------------------------------------------------------------------


def test_each_replaced_result_is_kept_and_noted(results: Path, stricter: Path) -> None:
    """The old file lies under its hash, byte for byte, and the trail tells of the change.

    It has the time, the cause, and the old and new result.
    """
    old = {name: (results / name / result_folder.RESULT_FILE).read_bytes() for name in NAMES}
    (results / "overrides.yaml").write_text("overrides: []\n")
    before = datetime.now(UTC).replace(microsecond=0)
    rejudge(results, stricter, None, pages=True).apply()
    lines = trail(results)
    assert [line["submission"] for line in lines] == list(NAMES)
    for line in lines:
        name = line["submission"]
        assert (results / line["kept"]).read_bytes() == old[name]
        new = (results / name / result_folder.RESULT_FILE).read_bytes()
        assert line["result_sha256"] == [sha256(old[name]), sha256(new)]
        assert line["final"][0] - line["final"][1] == 6.5
        assert line["checks"]["publisher.rate"]["points"] == [6.5, 0]
        require_cause(line, stricter, before)


def sha256(content: bytes) -> str:
    """Return the SHA-256 of some bytes."""
    return hashlib.sha256(content).hexdigest()


def require_cause(line: dict[str, Any], rubric: Path, before: datetime) -> None:
    """Fail unless a line of the trail has the time, the command, and the hashes of its inputs."""
    assert before <= datetime.fromisoformat(line["at"]) <= datetime.now(UTC)
    assert line["command"] == "regrade"
    assert line["rubric_sha256"][1] == sha256(rubric.read_bytes())
    assert line["overrides_sha256"] == sha256(b"overrides: []\n")


def test_the_trail_only_grows(results: Path, stricter: Path) -> None:
    """Going back and forth adds lines, and keeps each old result once."""
    rejudge(results, stricter, None, pages=True).apply()
    first = (results / AUDIT_FILE).read_bytes()
    for rubric in (SHIPPED, stricter):
        rejudge(results, rubric, None, pages=True).apply()
    assert (results / AUDIT_FILE).read_bytes().startswith(first)
    assert len(trail(results)) == 6
    assert len(list((results / HISTORY / "alice").iterdir())) == 2


def test_what_stays_as_it_is_leaves_no_trace(results: Path) -> None:
    """Judging again without a difference adds nothing to the trail."""
    rejudge(results, None, None, pages=True).apply()
    assert trail(results) == []
    assert not (results / HISTORY).exists()


def test_the_first_result_with_a_decision_is_noted(tmp_path: Path) -> None:
    """A decision leaves a trace even where no result was there before; a first judgement alone does not."""
    results = tmp_path / "results"
    for name in ("alice", "bob"):
        add(results, name, "wrong_topic")
    (results / "overrides.yaml").write_text(
        f"overrides:\n  - {{submission: bob, bonus: 1, {WHY}}}\n"
    )
    rejudge(results, None, None, pages=True).apply()
    (line,) = trail(results)
    assert (line["submission"], line["final"][0], line["kept"]) == ("bob", None, None)
    assert line["result_sha256"][0] is None


def test_something_else_in_place_of_a_result(results: Path) -> None:
    """A damaged old file counts as none, and is not kept as a result."""
    note_replaced(results, "alice", "\x00{", "regrade", overrides_sha256="")
    assert trail(results) == []


def test_a_result_that_is_none_is_refused(results: Path) -> None:
    """The trail never notes a new result that cannot be read."""
    (results / "alice" / result_folder.RESULT_FILE).write_text("{}")
    with pytest.raises(RecordingError, match="not a result"):
        note_replaced(results, "alice", None, "regrade", overrides_sha256="")

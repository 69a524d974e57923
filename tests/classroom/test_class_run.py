"""A run over a class: its use of earlier recordings, and its entries for the class page."""

from __future__ import annotations

import io
import shutil
import sys
from dataclasses import replace
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path

import pytest
from rich.console import Console

from confine.isolation import Isolation, Level
from grader.classroom import fingerprint
from grader.classroom.class_run import ClassRun, _Task, entries_of
from grader.classroom.job import Row
from grader.classroom.journal import UNJUDGED, Journal
from grader.classroom.progress import RunProgress
from grader.classroom.scheduler import Machine
from grader.errors import GraderError
from grader.judging.rubrics import read_rubric
from grader.lab.kept_lab import lab_folder
from grader.lab.overrides import load_overrides
from grader.lab.policy import SubmissionTime
from grader.pipeline import Options
from grader.recording.submission import Identity, Person, read_submission, write_submission
from grader.result import Result, Score, to_json
from grader.result_folder import RECORDINGS, REPORT_FILE, RESULT_FILE, RUBRIC_COPY
from grader.submission.extraction import Piece, SubmissionSource, open_submission
from grader.submission.separation import with_earlier

KEPT = Path(__file__).resolve().parents[1] / "recordings/wrong_topic"
NOON = datetime(2026, 11, 21, 12, tzinfo=UTC)


def source(name: str) -> SubmissionSource:
    """Make the submission of a student with this name."""
    return SubmissionSource(name, (Piece(Path(name)),), f"id of {name}", NOON)


def result_named(name: str) -> Result:
    """Give the least result that there is."""
    return Result(name, "Lab 1", Score(Decimal(0), Decimal(0), Decimal(0)), ())


def result(folder: Path, name: str) -> None:
    """Write a result that tells its name."""
    (folder / name).mkdir()
    (folder / name / "result.json").write_text(to_json(result_named(name)), encoding="utf-8")


def test_all_who_are_known_are_reported_once(tmp_path: Path) -> None:
    """Submissions of this run and earlier ones are reported once each, in the order of names."""
    for name in ("ann", "cem", "old"):
        result(tmp_path, name)
    (tmp_path / ".unfinished").mkdir()
    rows = [
        Row(source("ann"), result_named("ann")),
        Row(source("bob"), GraderError("the submission is empty")),
        Row(source("cem"), GraderError("the disk is full")),
    ]
    entries = entries_of(tmp_path, rows)
    assert [entry.name for entry in entries] == ["ann", "bob", "cem", "old"]
    ann, bob, cem, old = entries
    assert (ann.result, ann.problem) == (result_named("ann"), "")
    assert (ann.student_id, ann.submitted_at) == ("id of ann", NOON)
    assert (bob.result, bob.problem, bob.student_id) == (
        None,
        "the submission is empty",
        "id of bob",
    )
    assert (cem.result, cem.problem) == (None, "the disk is full"), (
        "an earlier result is not this submission's"
    )
    assert (old.result, old.problem) == (result_named("old"), ""), (
        "whoever has a result has handed in"
    )


def test_the_time_that_an_archive_tells_is_kept(tmp_path: Path) -> None:
    """The time found while a submission was extracted stands in its record, and on the page."""
    results = tmp_path / "results"
    shutil.copytree(KEPT, results / "ann" / RECORDINGS)
    (results / "ann" / "result.json").write_text(to_json(result_named("ann")), encoding="utf-8")
    record = read_submission(results / "ann" / RECORDINGS)
    record.submitted_at, record.student_id = NOON.isoformat(), "7"
    write_submission(results / "ann" / RECORDINGS, record)
    row = Row(SubmissionSource("ann", (Piece(Path("ann.zip")),)), result_named("ann"))
    (entry,) = entries_of(results, [row])
    assert (entry.submitted_at, entry.student_id) == (NOON, "7")


def test_who_handed_in_is_told_to_recordings_that_hold_good(tmp_path: Path) -> None:
    """A class list of a later run is kept with the results; nothing is graded again for it."""
    results = tmp_path / "results"
    shutil.copytree(KEPT, results / "ann" / RECORDINGS)
    ann = replace(source("ann"), origin=read_submission(results / "ann" / RECORDINGS).source)
    listed = replace(
        ann,
        student_id="0012",
        identity=Identity((Person("Ann", "0012", "am12", "ann@uni.example"),)),
    )
    with Journal.open(results) as journal:
        run = ClassRun(
            read_rubric(None),
            Options(Path(sys.executable)),
            journal,
            Machine(1),
            RunProgress(Console(), 1),
        )
        run._state_intake(_Task(listed, "", SubmissionTime(NOON), "", ""))
        record = read_submission(results / "ann" / RECORDINGS)
        assert (record.student_id, record.identity) == ("0012", listed.identity)
        before = (results / "ann" / RECORDINGS / "submission.json").stat()
        run._state_intake(_Task(with_earlier(ann, results), "", SubmissionTime(NOON), "", ""))
        after = (results / "ann" / RECORDINGS / "submission.json").stat()
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns), (
        "a run without a list changed it"
    )


@pytest.mark.slow
def test_what_was_recorded_is_judged_again_where_that_suffices(tmp_path: Path) -> None:
    """Valid recordings are judged again after a new decision or the loss of a file; else kept."""
    submission_time, results = tmp_path / "ann", tmp_path / "results"
    shutil.copytree(lab_folder() / "reference/solution", submission_time)
    shutil.copytree(KEPT, results / "ann" / RECORDINGS)
    shutil.copy(lab_folder() / "rubric.yaml", results / "ann" / RECORDINGS / RUBRIC_COPY)
    decided = (
        "overrides: [{submission: wrong_topic, bonus: 1, reason: r, who: w, when: 2026-11-21}]"
    )
    (tmp_path / "overrides.yaml").write_text(decided, encoding="utf-8")
    rubric = read_rubric(None)
    options = Options(
        Path(sys.executable), overrides=load_overrides(tmp_path / "overrides.yaml", rubric)
    )
    lab, chosen = fingerprint.recording_sha256(rubric), fingerprint.options_sha256(options)
    key = fingerprint.sha256_of((fingerprint.engine_sha256(), lab, chosen))
    with open_submission(SubmissionSource.of(submission_time)) as intake:
        key = fingerprint.sha256_of((key, fingerprint.submission_sha256(intake)))

    def graded(journal: Journal) -> Row:
        display = RunProgress(Console(file=io.StringIO()), 1)
        run = ClassRun(rubric, options, journal, Machine(1), display)
        run.grade([SubmissionSource.of(submission_time)], Isolation(Level.FULL))
        (row,) = run.rows
        return row

    with Journal.open(results) as journal:
        journal.note("ann", key, UNJUDGED, "full")
        first = graded(journal)
        assert isinstance(first.ending, Result)
        assert (first.reused, first.ending.final) == (False, first.ending.score.earned + 1)
        text = (results / "ann" / RESULT_FILE).read_bytes()
        assert graded(journal).reused
        (results / "ann" / REPORT_FILE).unlink()
        assert not graded(journal).reused
        assert (results / "ann" / REPORT_FILE).is_file()
        assert (results / "ann" / RESULT_FILE).read_bytes() == text

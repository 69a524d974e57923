"""A folder of finished results, read back, and the additions of a class list."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from decimal import Decimal
from pathlib import Path

import pytest

from grader.cohort.entries import (
    NOTHING_SUBMITTED,
    ClassEntry,
    entries_in,
    report_link,
    with_roster,
)
from grader.recording.submission import SubmissionRecord, write_submission
from grader.result import Result, Score, to_json
from grader.submission.roster import Student


def result_named(name: str) -> Result:
    """Give the least result that there is."""
    return Result(name, "Lab 1", Score(Decimal(0), Decimal(0), Decimal(0)), ())


def finished(results: Path, name: str, text: str | None = None) -> Path:
    """Lay down a finished result."""
    folder = results / name
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(
        to_json(result_named(name)) if text is None else text, encoding="utf-8"
    )
    (folder / "report.html").write_text("<!DOCTYPE html>", encoding="utf-8")
    return folder


def test_results_are_read_by_name_with_their_links(tmp_path: Path) -> None:
    """Each folder is an entry; files beside them and folders that are no results are none."""
    for name in ("bob", "alice"):
        finished(tmp_path, name)
    (tmp_path / "index.html").write_text("old", encoding="utf-8")
    (tmp_path / "history").mkdir()
    finished(tmp_path, ".unfinished")
    assert entries_in(tmp_path) == [
        ClassEntry(name, result_named(name), "", f"{name}/report.html") for name in ("alice", "bob")
    ]
    assert entries_in(tmp_path / "missing") == []


@pytest.mark.parametrize(
    "text", ["", "{", "[1]", '"x"', "{}", '{"score": {"earned": "x"}}', "[" * 100_000, "\x00"]
)
def test_a_damaged_result_is_reported_and_hurts_no_other(text: str, tmp_path: Path) -> None:
    """A file that was cut off, or holds something else, leaves that submission ungraded."""
    finished(tmp_path, "alice", text)
    finished(tmp_path, "bob")
    alice, bob = entries_in(tmp_path)
    assert alice.result is None
    assert "result.json" in alice.problem
    assert bob.result == result_named("bob")


def test_recordings_without_a_result_are_not_graded(tmp_path: Path) -> None:
    """A grading that was interrupted is told, and has no link to a report that is not there."""
    (tmp_path / "alice/recordings").mkdir(parents=True)
    (entry,) = entries_in(tmp_path)
    assert (entry.result, entry.report) == (None, "")
    assert "interrupted" in entry.problem


def test_the_time_of_submission_comes_from_the_recordings(tmp_path: Path) -> None:
    """The time is read with its offset, and the student's id with it; a missing time is not known."""
    folder = finished(tmp_path, "alice")
    (folder / "recordings").mkdir()
    write_submission(
        folder / "recordings",
        SubmissionRecord("alice", submitted_at="2026-11-20T23:59:00+01:00", student_id="17"),
    )
    finished(tmp_path, "bob")
    alice, bob = entries_in(tmp_path)
    assert alice.submitted_at == datetime(2026, 11, 20, 23, 59, tzinfo=timezone(timedelta(hours=1)))
    assert bob.submitted_at is None
    assert (alice.student_id, bob.student_id) == ("17", None)


@pytest.mark.parametrize(
    "name", ["a b", "javascript:alert(1)", "a#b?c", "50%", "ü", '"><x', "a/b", "\udcff"]
)
def test_a_link_leads_into_the_folder_whatever_it_is_called(name: str) -> None:
    """Nothing in a name is a scheme, a query, a fragment or markup."""
    link = report_link(name)
    folder, _, file = link.rpartition("/")
    assert file == "report.html"
    for c in folder:
        assert c.isascii()
        assert c.isalnum() or c in "%._-~"


def test_a_class_list_gives_ids_times_and_who_is_missing() -> None:
    """Facts of the list are added, by name in any case or by id; a student without a result becomes an entry."""
    moment = datetime(2026, 11, 20, 10, tzinfo=UTC)
    listed = [Student("Alice", "0012", moment), Student("", "4711"), Student("zoe", "77")]
    earlier = datetime(2026, 11, 19, tzinfo=UTC)
    there = [
        ClassEntry("bob", None),
        ClassEntry("alice", None, submitted_at=earlier),
        ClassEntry("4711", None),
    ]
    entries = with_roster(there, listed)
    assert [(e.name, e.student_id, e.submitted_at, e.problem) for e in entries] == [
        ("4711", "4711", None, ""),
        ("alice", "0012", moment, ""),
        ("bob", None, None, ""),
        ("zoe", "77", None, NOTHING_SUBMITTED),
    ]


def test_a_class_list_that_knows_less_takes_nothing_away() -> None:
    """Facts of an entry stay if the list has none, and two lines of one name are one student."""
    moment = datetime(2026, 11, 19, tzinfo=UTC)
    known = ClassEntry("alice", None, submitted_at=moment, student_id="1")
    found = with_roster([known], [Student("alice"), Student("zoe"), Student("zoe")])[0]
    assert replace(found, identity=known.identity) == known
    assert len(with_roster([known], [Student("alice"), Student("zoe"), Student("zoe")])) == 2


def test_a_class_list_finds_who_came_in_a_download() -> None:
    """Folders that are called after name and id are found by either; two of one name are told apart by the id."""
    there = [
        ClassEntry("Zoë_O_Neil_17", None),
        ClassEntry("Ann_Bee_18", None),
        ClassEntry("Ann_Bee_19", None),
    ]
    listed = [
        Student("Zoë O'Neil", "17"),
        Student("Ann Bee", "19"),
        Student("ann bee", "18"),
        Student("Carl", "20"),
    ]
    found = {entry.name: entry.student_id for entry in with_roster(there, listed)}
    assert found == {"Zoë_O_Neil_17": "17", "Ann_Bee_18": "18", "Ann_Bee_19": "19", "Carl": "20"}


def test_nobody_gets_the_result_of_another_whose_name_is_written_alike() -> None:
    """Marks of vowels tell names apart, and names that differ by a stroke are taken as they are written, or not."""
    there = [ClassEntry(name, None) for name in ("ann_lee", "ann-lee", "काव", "bo_xu", "bo-xu")]
    listed = [Student("कीव", "1"), Student("Ann-Lee", "2"), Student("Bo Xu", "3")]
    found = {}
    for entry in with_roster(there, listed):
        if entry.student_id:
            found[entry.name] = entry.student_id
    assert found == {"कीव": "1", "ann-lee": "2", "Bo Xu": "3"}


def test_a_list_without_ids_names_those_of_a_download() -> None:
    """A folder that is named after name and number belongs to the name, even if the list has surnames first."""
    moment = datetime(2026, 11, 20, 10, tzinfo=UTC)
    there = [
        ClassEntry("Ann_Müller_11", None, "x", student_id="11"),
        ClassEntry("Bo_12", None, "x", student_id="12"),
    ]
    found = with_roster(there, [Student("Müller, Ann"), Student("Bo", None, moment)])
    assert [entry.name for entry in found] == ["Ann_Müller_11", "Bo_12"]
    assert found[1].submitted_at == moment


def test_a_list_with_namesakes_does_not_tell_whose_an_entry_is() -> None:
    """An entry that two students could be gets the id of neither."""
    listed = [Student("Bo", "100"), Student("Bo", "200")]
    assert with_roster([ClassEntry("Bo", None, "x")], listed)[0].student_id is None
    by_id = with_roster([ClassEntry("Bo_200", None, "x", student_id="200")], listed)
    assert [entry.name for entry in by_id] == ["Bo", "Bo_200"]

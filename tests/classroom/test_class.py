"""A class by the real command: kept whatever happens to the run, and no submission stops another."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from decimal import Decimal
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy")

sys.path.append(str(Path(__file__).parents[2]))

from confine.isolation import Level
from grader.classroom.journal import Journal
from grader.errors import PlatformError
from grader.judging.rubrics import read_rubric
from grader.live.sandbox.probing import probe_isolation
from grader.recording.session import read_session, write_session
from grader.result_folder import JOURNAL_FILE, RECORDINGS
from tests.classroom.small_class import ASTRAY, CRASHES, SLEEPS, Family, SmallClass, make_class
from tests.live.small_lab import FREE, TALKER, command_of, name_of, remains, until
from tests.regraded import judge_results
from tests.report.exports.importers import (
    User,
    moodle_feedback,
    moodle_grade_book,
    moodle_worksheet,
)
from tests.thorough import EVERY_ATTACK, part

pytestmark = pytest.mark.live
#: The bag of the only session.
BAG = f"{RECORDINGS}/only/only.mcap"


@pytest.fixture(scope="module", autouse=True)
def _confined() -> None:
    """Skip where no sandboxes can be made."""
    isolation = probe_isolation(Path(sys.executable))
    if not isolation.level.at_least(Level.NO_CGROUP):
        pytest.skip(f"no sandboxes here: {isolation.remedy}")


def earned(small: SmallClass) -> dict[str, object]:
    """Return the points of each submission that has some."""
    return {name: result[0]["earned"] for name, result in small.outcomes().items()}


def half_done(small: SmallClass, pid: int) -> Family:
    """Wait until one submission is graded and another one's node runs; returns the run's processes."""
    family = Family(pid)

    def seen() -> bool:
        family.look()
        if not bool(small.graded() and small.recording()):
            return False
        return any("/ws/install" in c for c in family.left())

    until(seen, 120)
    return family


def test_a_class_is_graded_once(tmp_path: Path) -> None:
    """Every submission is graded except an empty one; a second run grades only changed ones."""
    small = make_class(tmp_path, {"ann": TALKER, "bob": CRASHES, "eve": None})
    status, output, errors = small.grade()
    assert (status, errors) == (3, "")
    assert earned(small) == {"ann": 1, "bob": 0}
    assert "eve: not graded: the submission is empty" in output
    assert "2 graded, 1 not graded, mean 0.5 points" in output
    require_class_files(small.results)

    before = {name: small.files_of(name) for name in ("ann", "bob")}
    grade_changed(small, before)

    (small.results / "ann" / "report.html").unlink()
    kept = small.files_of("eve")
    assert small.grade()[0] == 0
    assert small.files_of("ann") == before["ann"], "the report was not made from what is there"
    assert small.files_of("eve") == kept


def require_class_files(results: Path) -> None:
    """Fail unless a class of two results has its folders, page, table and journal."""
    assert sorted(p.name for p in results.iterdir()) == [
        "ann",
        "bob",
        "grades.csv",
        "index.html",
        "journal.jsonl",
    ]
    assert "ann" in (results / "index.html").read_text(encoding="utf-8")
    assert len(list(csv.reader((results / "grades.csv").open(encoding="utf-8-sig")))) >= 4


def grade_changed(small: SmallClass, before: dict[str, dict[str, bytes]]) -> None:
    """Grade again after a changed and a new submission; only these are graded."""
    small.hand_in("bob", ASTRAY)
    small.hand_in("eve", TALKER)
    status, output, errors = small.grade("--fail-under", "0.9")
    assert (status, errors) == (1, "")
    assert "3 graded, 1 of them as before" in output
    assert 0 < small.result("bob")["score"]["earned"] < 1
    assert small.result("eve")["score"]["earned"] == 1
    assert small.files_of("ann") == before["ann"]
    assert small.files_of("bob") != before["bob"]
    assert remains(small.temporary) == []


def test_a_download_goes_back_to_where_it_came_from(tmp_path: Path) -> None:
    """A class goes from Moodle's download back into a file for Moodle.

    A class list counts for later runs, and grades nothing anew.
    """
    names = {
        "Änne Müller_11_assignsubmission_file": TALKER,
        "Bob O'Brien_12_assignsubmission_file": CRASHES,
    }
    small = make_class(tmp_path, names)
    assert small.grade()[0] == 0
    before = {name: small.files_of(name) for name in ("Änne_Müller_11", "Bob_O_Brien_12")}
    listed = tmp_path / "class.csv"
    listed.write_text(
        'name,student_id,email\n"Müller, Änne",0012,am@uni.example\nBob O\'Brien,0013,\n',
        encoding="utf-8",
    )
    require_kept_with_list(small, before, listed)

    forms = ["--to=moodle", "--to=feedback", "--to=mail"]
    done = subprocess.run(
        [sys.executable, "-m", "grader.cli", "export", str(small.results), *forms],
        capture_output=True,
        check=True,
        text=True,
    )
    moodle, feedback, mails = (
        Path(line.rpartition(": ")[0]).read_bytes() for line in done.stdout.splitlines()
    )
    require_grades(moodle)
    users = [User("11", "", "0012"), User("12", "", "0013")]
    reports = {}
    for user, name in zip(("11", "12"), before, strict=True):
        reports[user] = {"report.html": (small.results / name / "report.html").read_bytes()}
    assert moodle_feedback(feedback, users) == reports
    assert b"am@uni.example" in mails
    assert "no address is known that mail can be sent to: Bob_O_Brien_12" in done.stderr


def require_kept_with_list(
    small: SmallClass, before: dict[str, dict[str, bytes]], listed: Path
) -> None:
    """Fail unless a class list changes the submissions' records alone, and lasts for the next run."""
    assert "2 graded, 2 of them as before" in small.grade("--class-list", str(listed))[1]
    kept = {name: small.files_of(name) for name in before}
    assert "2 graded, 2 of them as before" in small.grade("--anonymous")[1]
    assert {name: small.files_of(name) for name in before} == kept
    for name, files in kept.items():
        changed = [path for path in files if files[path] != before[name][path]]
        assert changed == [f"{RECORDINGS}/submission.json"]


def require_grades(moodle: bytes) -> None:
    """Fail unless Moodle reads the right grades, as a grading worksheet and into its grade book."""
    users = [User("11", "", "0012"), User("12", "", "0013")]
    worksheet = moodle_worksheet(moodle, users, Decimal(1))
    assert {number: grade for number, (grade, _) in worksheet.items()} == {"11": 1, "12": 0}
    assert moodle_grade_book(moodle, users, "ID number", "student_id") == {"11": 1, "12": 0}


def test_exactly_what_is_undecided_is_run_again(tmp_path: Path) -> None:
    """With --undecided a session that left something open is recorded again, and nothing else is touched."""
    small = make_class(tmp_path, {"ann": TALKER, "bob": CRASHES})
    assert small.grade()[0] == 0
    leave_open(small, "ann")
    small.hand_in("cem", TALKER)
    before = small.files_of("bob")
    status, output, errors = small.grade("--undecided")
    assert (status, errors) == (0, "")
    assert "Not graded yet, and left out: cem. Grade them without --undecided." in output
    assert "2 graded, 1 of them as before, mean 0.5 points" in output
    assert earned(small) == {"ann": 1, "bob": 0}
    session = read_session(small.results / "ann" / RECORDINGS / "only")
    assert (session.attempt, session.problems) == (2, [])
    assert small.files_of("bob") == before
    assert not (small.results / "cem").exists()
    assert remains(small.temporary) == []
    again = small.files_of("ann")
    assert "2 graded, 2 of them as before" in small.grade("--undecided")[1], (
        "there is nothing to decide any more"
    )
    assert small.files_of("ann") == again


def test_undecided_sessions_are_found_after_the_rubric_changed(tmp_path: Path) -> None:
    """After a corrected hint, judged again or not, --undecided finds the open submissions."""
    small = make_class(tmp_path, {"ann": TALKER, "bob": CRASHES})
    assert small.grade()[0] == 0
    leave_open(small, "ann")
    bags = {name: small.files_of(name)[BAG] for name in ("ann", "bob")}
    small.rubric.write_text(small.rubric.read_text().replace("publishes", "is_published"))
    command = [sys.executable, "-m", "grader.cli", "regrade", str(small.results), "--apply"]
    subprocess.run([*command, "--rubric", str(small.rubric)], check=True, capture_output=True)
    status, output, errors = small.grade("--undecided")
    assert (status, errors) == (0, "")
    assert "left out" not in output
    assert "2 graded" in output
    assert small.result("ann")["score"]["undecided"] == 0
    assert small.files_of("ann")[BAG] != bags["ann"], "its session was not recorded again"
    assert small.files_of("bob")[BAG] == bags["bob"], "a decided session was recorded again"

    leave_open(small, "ann")
    small.rubric.write_text(small.rubric.read_text().replace("is_published", "publishes"))
    assert "left out" not in small.grade("--undecided")[1], "without `regrade` it is forgotten"
    assert small.result("ann")["criteria"][0]["checks"][0]["id"] == "publishes"
    assert small.result("ann")["score"]["undecided"] == 0


def test_a_submission_changed_since_is_not_called_ungraded(tmp_path: Path) -> None:
    """With --undecided, files handed in anew are named as changed, because they were graded before."""
    small = make_class(tmp_path, {"ann": TALKER, "eve": None})
    assert small.grade()[0] == 3
    small.hand_in("ann", ASTRAY)
    output = small.grade("--undecided")[1]
    assert "Not graded yet, and left out: eve." in output
    assert "Graded before, and left out: ann." in output


def test_a_class_without_sessions_is_graded(tmp_path: Path) -> None:
    """A lab of documents alone records nothing, and judges every submission of a class all the same."""
    small = make_class(tmp_path, {"ann": TALKER, "bob": CRASHES})
    plain = yaml.safe_load(small.rubric.read_text())
    plain["sessions"] = {}
    plain["criteria"][0]["checks"] = [{**FREE, "points": 1}]
    small.rubric.write_text(yaml.safe_dump(plain))
    status, output, errors = small.grade()
    assert (status, errors) == (0, "")
    assert "2 graded, mean" in output


def leave_open(small: SmallClass, name: str) -> None:
    """Give a graded submission a session that the machine disturbed."""
    folder = small.results / name
    session = read_session(folder / RECORDINGS / "only")
    session.problems = ["A reference node ended."]
    write_session(folder / RECORDINGS / "only", session)
    rubric = read_rubric(small.rubric)
    judge_results(folder, rubric)
    assert small.result(name)["score"]["undecided"] == 1
    with Journal.open(small.results) as journal:
        found = []
        for line in (small.results / JOURNAL_FILE).read_text().splitlines():
            found.append(json.loads(line))
        entry = next(line for line in found if line.get("graded") == name)
        journal.note(name, entry["key"], entry["policy"], entry["isolation"])


def test_a_killed_run_goes_on_where_it_stopped(tmp_path: Path) -> None:
    """After kill -9 with one graded and another half recorded, nothing of the run is left and the rest is graded."""
    small = make_class(tmp_path, {"ann": TALKER, "bob": SLEEPS, "cem": TALKER})
    with small.start("-j", "1") as process:
        family = half_done(small, process.pid)
        process.kill()
    assert small.graded() == ["ann"]
    until(lambda: not family.left(), 10)
    before = small.files_of("ann")
    small.hand_in("bob", ASTRAY)
    status, output, errors = small.grade("-j", "1")
    assert (status, errors) == (0, "")
    assert "3 graded, 1 of them as before" in output
    assert small.files_of("ann") == before
    assert sorted(small.outcomes()) == ["ann", "bob", "cem"]
    assert earned(small)["cem"] == 1
    assert remains(small.temporary) == []


@pytest.mark.parametrize("number", part([signal.SIGINT, signal.SIGTERM], 2, EVERY_ATTACK))
def test_a_run_that_is_asked_to_end_keeps_what_is_done(
    tmp_path: Path, number: signal.Signals
) -> None:
    """At Ctrl-C a run ends with the signal's status and keeps finished gradings.

    It names them, and leaves no process and no folder behind.
    """
    small = make_class(tmp_path, {"ann": TALKER, "bob": SLEEPS, "cem": TALKER})
    with small.start("-j", "1") as process:
        family = half_done(small, process.pid)
        process.send_signal(number)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert errors.splitlines() == [
        "grade: interrupted; 1 of 3 submissions are graded and kept.",
        "  Run the same command again to grade the others.",
    ]
    until(lambda: not family.left())
    assert small.graded() == ["ann"]
    assert not (small.results / "bob").exists()
    assert remains(small.temporary) == []


def test_a_second_run_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    """While a run is at work, another one in its results folder ends at once with a reason, and disturbs nothing."""
    small = make_class(tmp_path, {"ann": TALKER, "bob": TALKER})
    with small.start() as process:
        until(small.recording, 120)
        process.send_signal(signal.SIGSTOP)  # This grading lasts as long as the other one.
        try:
            status, _, errors = small.grade()
        finally:
            process.send_signal(signal.SIGCONT)
        assert status == 70
        assert "another run of grade is writing to this results folder" in errors
        _, first = process.communicate(timeout=120)
    assert (process.returncode, first) == (0, "")
    assert earned(small) == {"ann": 1, "bob": 1}


def test_a_class_of_one_is_graded_as_one_submission(tmp_path: Path) -> None:
    """One submission gets the detailed table, no journal and no class page, and is always graded anew."""
    small = make_class(tmp_path, {"ann": TALKER})
    status, output, _ = small.grade()
    assert status == 0
    assert "Report: " in output
    assert [path.name for path in small.results.iterdir()] == ["ann"]


NAMES = ("ann", "bob", "cem", "dan")
#: The process of a class run that is killed: part of its command line, and how its name begins.
VICTIMS = {
    "the server of all sandboxes": ("grader.live.session.fork_server", "python"),
    "the server of one grading's": ("grader.live.session.fork_server", "fork server"),
    "the process that grades all": ("grader.classroom.worker", "python"),
    "the process that grades one": ("grader.classroom.worker", "worker"),
}


def kill(family: Family, victim: str) -> set[int]:
    """Kill the processes of a run that are the victim; returns their ids."""
    program, name = VICTIMS[victim]
    family.look()
    found = {
        pid
        for pid, _ in family.members
        if program in command_of(pid) and name_of(pid).startswith(name)
    }
    for pid in found:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return found


@pytest.mark.parametrize("victim", part([*VICTIMS], 2, EVERY_ATTACK))
def test_a_process_that_is_killed_is_replaced(tmp_path: Path, victim: str) -> None:
    """A run goes on after any process of a session is killed, and grades the lost work again."""
    names = NAMES[:3]
    small = make_class(tmp_path, dict.fromkeys(names, TALKER))
    with small.start("-j", "2") as process:
        family = half_done(small, process.pid)
        assert kill(family, victim)
        output, errors = process.communicate(timeout=120)
    assert (process.returncode, errors) == (0, "")
    assert "3 graded" in output
    assert earned(small) == dict.fromkeys(names, 1)
    until(lambda: not family.left(), 10)
    assert remains(small.temporary) == []


def test_a_process_that_is_killed_each_time_ends_the_run(tmp_path: Path) -> None:
    """After three in a row the run says so for all that is left; the next run grades them."""
    small = make_class(tmp_path, dict.fromkeys(NAMES, SLEEPS))
    killed: set[int] = set()
    with small.start("-j", "1") as process:
        family = Family(process.pid)
        while process.poll() is None:
            family.look()
            if small.recording() and any("/ws/install" in c for c in family.left()):
                killed |= kill(family, "the server of all sandboxes")
            time.sleep(0.05)
        output, errors = process.communicate(timeout=60)
    assert len(killed) >= 3  # A fork that has not yet its own name is killed with the server.
    assert process.returncode == PlatformError.exit_status, errors
    assert output.count("killed 3 times in a row") >= 3, output
    for name in NAMES:
        small.hand_in(name, TALKER)
    assert small.grade()[0] == 0
    assert earned(small) == dict.fromkeys(NAMES, 1)

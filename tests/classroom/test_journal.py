"""The journal: submissions that count as graded, whatever moment a run ended at."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from grader.classroom.journal import OUTDATED, Journal
from grader.errors import GraderError
from grader.result_folder import JOURNAL_FILE, RECORDINGS, RESULT_FILE

KEPT = Path(__file__).parents[1] / "recordings" / "wrong_topic"


def fill(folder: Path, mark: str = "") -> None:
    """Write results into a folder, as a grading does."""
    shutil.copytree(KEPT, folder / RECORDINGS, dirs_exist_ok=True)
    (folder / RESULT_FILE).write_text(f'{{"mark": "{mark}"}}', encoding="utf-8")


def graded(results: Path, *names: str, key: str = "key") -> None:
    """Let a run grade submissions."""
    with Journal.open(results) as journal:
        for name in names:
            fill(results / name, name)
            journal.note(name, key, "policy", "full")


def held(results: Path, *names: str, key: str = "key") -> list[str]:
    """Return which of some submissions the next run need not grade."""
    with Journal.open(results) as journal:
        return [name for name in names if journal.holds(name, key)]


def test_what_is_graded_is_kept(tmp_path: Path) -> None:
    """A finished submission lies under its name, and the next run knows it, with its policy and confinement."""
    graded(tmp_path, "ann", "bob")
    assert held(tmp_path, "ann", "bob", "cem") == ["ann", "bob"]
    assert json.loads((tmp_path / "ann" / RESULT_FILE).read_text(encoding="utf-8")) == {
        "mark": "ann"
    }
    with Journal.open(tmp_path) as journal:
        entry = journal.holds("ann", "key")
        assert entry is not None
        assert (entry.policy, entry.isolation) == ("policy", "full")


def test_another_key_is_another_submission(tmp_path: Path) -> None:
    """A result under another key does not count."""
    graded(tmp_path, "ann")
    assert held(tmp_path, "ann", key="other") == []


@pytest.mark.parametrize("what", ["record", "bag", "all"])
def test_recordings_must_be_those_of_which_the_journal_speaks(tmp_path: Path, what: str) -> None:
    """A result is graded again after its recordings were renewed, damaged or removed."""
    graded(tmp_path, "ann")
    recordings = tmp_path / "ann" / RECORDINGS
    if what == "all":
        shutil.rmtree(recordings)
    else:
        name = "session.json" if what == "record" else "*.mcap"
        path = next(recordings.glob(f"*/{name}"))
        path.write_bytes(path.read_bytes() + b" ")
    assert held(tmp_path, "ann") == []


def test_a_result_that_was_judged_again_is_kept(tmp_path: Path) -> None:
    """A result rewritten by `grade regrade` from the same recordings needs no new grading."""
    graded(tmp_path, "ann")
    (tmp_path / "ann" / RESULT_FILE).write_text("{}", encoding="utf-8")
    assert held(tmp_path, "ann") == ["ann"]


def test_the_journal_may_end_anywhere(tmp_path: Path) -> None:
    """A journal cut off at any byte tells of submissions with whole lines, and can be continued."""
    graded(tmp_path, "ann", "bob")
    journal = tmp_path / JOURNAL_FILE
    content = journal.read_bytes()
    ends = [n + 1 for n, byte in enumerate(content) if byte == 10]
    for cut in {*range(0, len(content), 31), *ends, *(end - 1 for end in ends)}:
        journal.write_bytes(content[:cut])
        # A line without its end is as good as one with it, if it is whole.
        whole = sum(end <= cut + 1 for end in ends)
        assert held(tmp_path, "ann", "bob") == ["ann", "bob"][: max(0, whole - 1)], cut
        graded(tmp_path, "cem")
        assert "cem" in held(tmp_path, "cem")


def test_results_that_were_not_noted_do_not_count(tmp_path: Path) -> None:
    """A result in its place that a killed run did not note is graded again; earlier ones stay."""
    graded(tmp_path, "ann")
    fill(tmp_path / "cem")
    assert held(tmp_path, "ann", "cem") == ["ann"]


def test_afresh_counts_for_later_runs_too(tmp_path: Path) -> None:
    """An interrupted run that grades all again keeps only its own gradings, under a new seed."""
    graded(tmp_path, "ann", "bob")
    with Journal.open(tmp_path) as journal:
        seed = journal.run_seed
    with Journal.open(tmp_path, afresh=True) as journal:
        assert journal.run_seed != seed
        journal.note("bob", "key", "policy", "full")
        seed = journal.run_seed
    assert held(tmp_path, "ann", "bob") == ["bob"]
    with Journal.open(tmp_path) as journal:
        assert journal.run_seed == seed


def test_what_could_not_be_graded_is_tried_again(tmp_path: Path) -> None:
    """Its earlier results, which are of other files, are put aside where nothing takes them for present ones."""
    graded(tmp_path, "ann")
    with Journal.open(tmp_path) as journal:
        journal.abandon("ann", GraderError("the disk is full"))
        assert journal.holds("ann", "key") is None
    assert held(tmp_path, "ann") == []
    assert not (tmp_path / "ann").exists()
    assert (tmp_path / OUTDATED / "ann" / RESULT_FILE).is_file()
    lines = []
    for line in (tmp_path / JOURNAL_FILE).read_text(encoding="utf-8").splitlines():
        lines.append(json.loads(line))
    assert lines[-1]["not graded"] == "ann"
    assert lines[-1]["problem"] == "the disk is full"


def test_another_judgement_changes_the_policy_alone(tmp_path: Path) -> None:
    """After a new judgement the same recordings hold good, with the new policy."""
    graded(tmp_path, "ann")
    with Journal.open(tmp_path) as journal:
        journal.note("ann", "key", "newer", "full")
    with Journal.open(tmp_path) as journal:
        entry = journal.holds("ann", "key")
        assert entry is not None
        assert entry.policy == "newer"


def test_one_run_at_a_time(tmp_path: Path) -> None:
    """A second run in the same folder is refused while the first is at work, and not after."""
    with (
        Journal.open(tmp_path),
        pytest.raises(GraderError, match="another run"),
        Journal.open(tmp_path),
    ):
        pass
    assert held(tmp_path) == []


def test_a_journal_of_another_kind_counts_for_nothing(tmp_path: Path) -> None:
    """A journal of another version, or lines of anything else, are passed over."""
    graded(tmp_path, "ann")
    journal = tmp_path / JOURNAL_FILE
    text = journal.read_text(encoding="utf-8")
    journal.write_text(text.replace("journal/v1", "journal/v9"), encoding="utf-8")
    assert held(tmp_path, "ann") == []
    journal.write_text('[]\nnull\n"graded"\n{"graded": "ann"}\n' + text, encoding="utf-8")
    assert held(tmp_path, "ann") == ["ann"]


def test_each_line_is_on_the_disk_when_it_counts(tmp_path: Path) -> None:
    """The journal is written in whole lines, one for each event, and never rewritten."""
    graded(tmp_path, "ann")
    before = (tmp_path / JOURNAL_FILE).read_bytes()
    number = (tmp_path / JOURNAL_FILE).stat().st_ino
    graded(tmp_path, "bob")
    after = (tmp_path / JOURNAL_FILE).read_bytes()
    assert after.startswith(before)
    assert after.count(b"\n") == before.count(b"\n") + 1
    assert (tmp_path / JOURNAL_FILE).stat().st_ino == number

"""Results are replaced in one go or not at all."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from grader.files import UNFINISHED, atomic_replacement, replace_files, uninterrupted

PARTS = ("recordings", "report.html", "result.json")


def contents(folder: Path) -> dict[str, str]:
    """Give the texts of all files below a folder."""
    found = {}
    for p in folder.rglob("*"):
        if p.is_file():
            found[str(p.relative_to(folder))] = p.read_text(encoding="utf-8")
    return found


def make(folder: Path, text: str) -> None:
    """Make the parts of a result."""
    (folder / "recordings/session").mkdir(parents=True)
    for name in ("recordings/session/session.json", "report.html", "result.json"):
        (folder / name).write_text(text, encoding="utf-8")


def test_new_results_take_the_place_of_old_ones(tmp_path: Path) -> None:
    """All parts are replaced at once; other files stay, and nothing of the old parts or of the work is left."""
    make(tmp_path, "old")
    (tmp_path / "recordings/of_old.json").write_text("old", encoding="utf-8")
    (tmp_path / "junit.xml").write_text("export", encoding="utf-8")
    with atomic_replacement(tmp_path, PARTS) as new:
        assert contents(tmp_path)["result.json"] == "old"
        make(new, "new")
    names = ("recordings/session/session.json", "report.html", "result.json")
    assert contents(tmp_path) == {"junit.xml": "export", **dict.fromkeys(names, "new")}
    assert not (tmp_path / UNFINISHED).exists()


@pytest.mark.parametrize("problem", [KeyboardInterrupt, SystemExit, OSError])
def test_work_that_is_broken_off_leaves_the_old_results(
    tmp_path: Path, problem: type[BaseException]
) -> None:
    """Whatever ends it, and however far it was."""
    make(tmp_path, "old")
    before = contents(tmp_path)

    def work() -> None:
        with atomic_replacement(tmp_path, PARTS) as new:
            make(new, "new")
            raise problem

    with pytest.raises(problem):
        work()
    assert contents(tmp_path) == before


def test_work_that_is_broken_off_may_keep_what_is_whole(tmp_path: Path) -> None:
    """The new parts take their places, and nothing of the old ones stays beside them."""
    make(tmp_path, "old")

    def work() -> None:
        with atomic_replacement(tmp_path, PARTS, lambda new: (new / "recordings").is_dir()) as new:
            (new / "recordings").mkdir()
            (new / "recordings/submission.json").write_text("new", encoding="utf-8")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert contents(tmp_path) == {"recordings/submission.json": "new"}


def test_a_part_that_cannot_be_put_in_its_place_leaves_the_old_results(tmp_path: Path) -> None:
    """Parts that were already placed are taken back, and the recordings are not lost."""
    make(tmp_path, "old")
    before = contents(tmp_path)

    def work() -> None:
        with atomic_replacement(tmp_path, (*PARTS[:2], "none/of/these", PARTS[2])) as new:
            make(new, "new")
            (new / "none/of").mkdir(parents=True)
            (new / "none/of/these").write_text("new", encoding="utf-8")

    with pytest.raises(FileNotFoundError):
        work()
    assert contents(tmp_path) == before
    assert not (tmp_path / UNFINISHED).exists()


#: Is killed when the first of the new parts is to be put in its place.
KILLED = """
import os, sys
from pathlib import Path
from grader.files import atomic_replacement

def kill(event, about):
    if event == "os.rename" and str(about[0]).endswith("/recordings") and Path(about[0]).parent != results:
        os._exit(9)

results = Path(sys.argv[1])
with atomic_replacement(results, sys.argv[2:]) as new:
    for part in sys.argv[2:]:
        (new / part).write_text("new")
    sys.addaudithook(kill)
"""


def test_who_is_killed_between_two_parts_leaves_nothing_that_seems_whole(tmp_path: Path) -> None:
    """New recordings never lie beside an old result."""
    make(tmp_path, "old")
    run = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path), *PARTS], check=False)
    assert run.returncode == 9
    assert not (tmp_path / "result.json").exists()


def test_the_first_work_that_is_broken_off_leaves_no_folder(tmp_path: Path) -> None:
    """Nobody takes an empty folder for results."""

    def work() -> None:
        with atomic_replacement(tmp_path / "ann", PARTS):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_grader_left_is_not_mixed_in(tmp_path: Path) -> None:
    """Half results that lie beside are removed before new ones are made."""
    (tmp_path / UNFINISHED / "recordings").mkdir(parents=True)
    (tmp_path / UNFINISHED / "recordings/half.json").write_text("half", encoding="utf-8")
    with atomic_replacement(tmp_path, PARTS) as new:
        make(new, "new")
    assert set(contents(tmp_path).values()) == {"new"}


def test_files_that_belong_together_are_replaced_together(tmp_path: Path) -> None:
    """One that cannot be written leaves all of them as they were."""
    (tmp_path / "a").write_text("old", encoding="utf-8")
    with pytest.raises(OSError, match="nowhere"):
        replace_files({tmp_path / "a": "new", tmp_path / "nowhere/b": "new"})
    assert contents(tmp_path) == {"a": "old"}
    replace_files({tmp_path / "a": "new", tmp_path / "b": "new"})
    assert contents(tmp_path) == {"a": "new", "b": "new"}


def test_a_request_to_end_waits(tmp_path: Path) -> None:
    """Ctrl-C is heeded as soon as the files are in their places, also where one such work is within another."""
    done = []

    def work() -> None:
        with uninterrupted():
            with uninterrupted():
                os.kill(os.getpid(), signal.SIGINT)
                done.append("inner")
            done.append("outer")

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["inner", "outer"]
    assert signal.getsignal(signal.SIGINT) is before

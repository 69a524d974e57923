"""A word can be a command and a folder at once: the folder counts where an option of grading follows."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader import __version__
from grader.cli import main
from grader.commands import COMMANDS

pytestmark = pytest.mark.slow

#: A small lab, whose rubric is read quickly.
LAB = Path(__file__).resolve().parents[1] / "grader/doctor/lab"
#: Grading ends at once with it, and says which command it was.
UNKNOWN_SESSION = ["--sessions", "nosuch", "--lab", str(LAB)]


@pytest.fixture(autouse=True)
def working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a working folder that has a folder of each command's name."""
    for name in (*COMMANDS, "help", "version"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def errors_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """Run `grade`; returns exit status and errors."""
    try:
        status = main(list(arguments))
    except SystemExit as end:
        status = int(end.code or 0)
    return status, capsys.readouterr().err


@pytest.mark.parametrize("word", [*COMMANDS, "help", "version"])
def test_options_of_grading(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    """With one that the command does not have, the folder is graded."""
    status, errors = errors_of(capsys, word, "--one", *UNKNOWN_SESSION)
    assert (status, "there is no session 'nosuch'" in errors) == (2, True)
    assert (f"{word!r} is the folder here" in errors) == (word in COMMANDS)


@pytest.mark.parametrize("written", ["./{}", "{}/"])
@pytest.mark.parametrize("word", ["lab", "report"])
def test_a_path(word: str, written: str, capsys: pytest.CaptureFixture[str]) -> None:
    """With a separator it is a path, and nothing else."""
    status, errors = errors_of(capsys, written.format(word), *UNKNOWN_SESSION)
    assert (status, "there is no session 'nosuch'" in errors) == (2, True)
    assert "folder" not in errors


@pytest.mark.parametrize("arguments", [["report"], ["lab"], ["report", "review"]])
def test_the_word_alone(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """The word alone is the command, and the message says how to grade the folder."""
    _, errors = errors_of(capsys, *arguments)
    assert f"To grade the folder of this name: grade ./{arguments[0]}" in errors
    assert "session" not in errors


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["lab", "check", "my-lab"], "my-lab: there is no rubric.yaml in it"),
        (["report", "nowhere", "--anonymous"], "nowhere"),
        (["regrade", "nowhere"], "nowhere"),
    ],
)
def test_the_command(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Options that only the command has mean the command, without a word about the folder."""
    status, errors = errors_of(capsys, *arguments)
    assert status != 0
    assert said in errors
    assert "folder of this name" not in errors


def test_without_a_folder(working_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Options of grading do not make a folder that is missing."""
    (working_folder / "report").rmdir()
    status, errors = errors_of(capsys, "report", "--one")
    assert (status, "usage: grade report" in errors) == (2, True)
    assert "unrecognized arguments: --one" in errors or "RESULTS_DIR" in errors


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["help"], "usage: grade "),
        (["help", "regrade"], "usage: grade regrade"),
        (["help", "version"], "usage: grade "),
        (["version"], f"grade {__version__}"),
        (["lab", "--help"], "usage: grade lab"),
    ],
)
def test_help_and_version(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Help and version can also be asked for as words."""
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert not end.value.code
    assert said in capsys.readouterr().out


def test_help_with_something_else_is_no_submission(
    working_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`grade help nosuch` grades nothing: it says that there is no such command."""
    (working_folder / "help").rmdir()
    status, errors = errors_of(capsys, "help", "nosuch")
    assert (status, list(working_folder.glob("results"))) == (2, [])
    assert "there is no command 'nosuch'" in errors

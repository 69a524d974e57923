"""`grade play`: its messages where it cannot play."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from grader.cli import main
from grader.commands.play import isolated_environment
from grader.result_folder import RECORDINGS

KEPT = Path(__file__).resolve().parents[1] / "recordings" / "solution"


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Give results with two sessions."""
    for name in ("launch", "publisher"):
        shutil.copytree(KEPT / name, tmp_path / "alice" / RECORDINGS / name)
    return tmp_path / "alice"


def test_it_asks_for_one_of_several_sessions(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without a name, or with one that is not there, it names those that are."""
    assert main(["play", str(results)]) == 2
    assert "Name one session: launch, publisher." in capsys.readouterr().err
    assert main(["play", str(results), "lunch"]) == 2
    assert "there is no session 'lunch'" in capsys.readouterr().err


def test_a_folder_without_recordings_is_said_to_have_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Results of a class, or any other folder."""
    assert main(["play", str(tmp_path)]) == 6
    assert "there are no recordings in it" in capsys.readouterr().err


def test_a_recording_that_cannot_be_read_is_named(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its bag is missing."""
    (results / RECORDINGS / "launch" / "launch.mcap").unlink()
    assert main(["play", str(results), "launch"]) == 6
    assert "this recording cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize("rate", ["0", "-1", "inf", "nan"])
def test_a_rate_is_above_nothing(
    rate: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Other rates are a wrong usage."""
    with pytest.raises(SystemExit) as ended:
        main(["play", str(results), "launch", "--rate", rate])
    assert ended.value.code == 2
    assert "--rate must be a number above 0" in capsys.readouterr().err


def test_of_the_terminals_settings_those_outside_of_the_working_folder_count(
    tmp_path: Path,
) -> None:
    """A profile outside of the working folder stays, and so do full paths.

    Relative and empty paths, and paths in the folder, are dropped.
    """
    working, results, elsewhere = (tmp_path / name for name in ("here", "alice", "profiles"))
    for folder in (working, results, elsewhere):
        folder.mkdir()
        (folder / "x.xml").touch()
    (elsewhere / "link.xml").symlink_to(working / "x.xml")
    name = "FASTRTPS_DEFAULT_PROFILES_FILE"
    for given, stays in (
        (elsewhere / "x.xml", True),
        (elsewhere / "link.xml", False),
        (working / "x.xml", False),
        (results / "x.xml", False),
        ("x.xml", False),
    ):
        kept = isolated_environment(working, results, {name: str(given), "ROS_DOMAIN_ID": "7"})
        assert (name in kept) is stays, given
        assert kept["SKIP_DEFAULT_XML_FILE"] == "1"
        assert kept["ROS_DOMAIN_ID"] == "7"
    paths = {"PYTHONPATH": ":/opt/a:b", "LD_LIBRARY_PATH": "", "AMENT_PREFIX_PATH": ".:/opt/c:"}
    kept = isolated_environment(working, results, paths)
    assert kept["_GRADER_PLAY_PYTHONPATH"] == "/opt/a"
    assert kept["AMENT_PREFIX_PATH"] == "/opt/c"
    assert "LD_LIBRARY_PATH" not in kept

"""`grade open` opens the page that was meant; `grade try` needs an empty folder; paths are corrected."""

from __future__ import annotations

import json
import shlex
import sys
import time
import webbrowser
from pathlib import Path

import pytest

from grader.cli import main
from grader.lab.shipped_labs import sample_submission
from grader.result_folder import CLASS_PAGE, REPORT_FILE


@pytest.fixture
def opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give the file to which a browser writes the opened address."""
    file = tmp_path / "opened"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\nprintf %s "$1" > {shlex.quote(str(file))}\n', encoding="utf-8")
    browser.chmod(0o755)
    use_browser(monkeypatch, f"{browser} %s")
    return file


def use_browser(monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    """Set the browser of the user, as at the start of a process."""
    monkeypatch.setenv("BROWSER", command)
    monkeypatch.setattr(webbrowser, "_tryorder", None)
    monkeypatch.setattr(webbrowser, "_browsers", {})


def address_in(file: Path) -> str:
    """Return the address that the browser has written, as soon as it has."""
    end_s = time.monotonic() + 60
    while not file.is_file() or not file.read_text(encoding="utf-8"):
        assert time.monotonic() < end_s
        time.sleep(0.05)
    return file.read_text(encoding="utf-8")


def page(folder: Path, name: str) -> Path:
    """Write a page."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text("<p>", encoding="utf-8")
    return folder / name


def test_a_report(tmp_path: Path, opened: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The results of a submission open its report, and the path is printed."""
    report = page(tmp_path / "results/alice", REPORT_FILE)
    assert main(["open", str(report.parent)]) == 0
    assert address_in(opened) == report.as_uri()
    assert capsys.readouterr().out.strip() == str(report)


def test_a_class_and_a_single_one(tmp_path: Path, opened: Path) -> None:
    """A folder opens its class page; without one, the report of its only submission."""
    report = page(tmp_path / "results/alice", REPORT_FILE)
    assert main(["open", str(tmp_path / "results")]) == 0
    assert address_in(opened) == report.as_uri()
    opened.unlink()
    class_page = page(tmp_path / "results", CLASS_PAGE)
    assert main(["open", str(tmp_path / "results")]) == 0
    assert address_in(opened) == class_page.as_uri()


def test_a_misspelt_path_is_corrected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each command names the path that was meant."""
    page(tmp_path / "results/alice", REPORT_FILE)
    for command in (["open"], ["regrade"], ["appeal"], ["report"], ["export", "--to", "junit"]):
        more = ["some.check"] if command == ["appeal"] else []
        assert main([*command, str(tmp_path / "results/alcie"), *more]) != 0
        assert f"Did you mean {tmp_path / 'results/alice'}?" in capsys.readouterr().err


def test_several_reports_without_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command that writes the class page is named."""
    for name in ("ann", "bob"):
        page(tmp_path / "results" / name, REPORT_FILE)
    assert main(["open", str(tmp_path / "results")]) == 6
    assert "grade report" in capsys.readouterr().err


def test_no_browser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without a browser the path is printed, and the status is 1."""
    use_browser(monkeypatch, "/bin/false %s")
    report = page(tmp_path / "results/alice", REPORT_FILE)
    assert main(["open", str(report.parent)]) == 1
    assert str(report) in capsys.readouterr().out


def test_the_sample_needs_an_empty_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is written beside files of the user; the sample itself is there."""
    (tmp_path / "notes.txt").touch()
    assert main(["try", str(tmp_path)]) == 2
    assert "not empty" in capsys.readouterr().err
    assert [entry.name for entry in tmp_path.iterdir()] == ["notes.txt"]
    assert (sample_submission() / "README.md").is_file()


def test_a_failed_try_can_be_repeated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a package of the lab, the folder is left as it was, and the ways to the package are named."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert main(["try", str(tmp_path)]) == 5
    assert "uv tool install 'ros-lab-grader[mujoco]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_mistakes_of_a_lab_for_programs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`grade lab check --json` prints remarks of a sound lab, and the mistakes of another."""
    lab = tmp_path / "lab"
    assert main(["lab", "new", str(lab)]) == 0
    capsys.readouterr()
    assert main(["lab", "check", str(lab), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["mistakes"] == []
    assert found["remarks"][0]["kind"] == "in order"
    rubric = lab / "rubric.yaml"
    text = rubric.read_text(encoding="utf-8")
    rubric.write_text(text.replace("check: ", "check: no_", 1), encoding="utf-8")
    assert main(["lab", "check", str(lab), "--json"]) == 4
    assert "no_" in json.loads(capsys.readouterr().out)["mistakes"][1]

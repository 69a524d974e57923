"""The command line of a class, without a live graph."""

from __future__ import annotations

import io
import sys
from argparse import Namespace
from dataclasses import replace
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path

import pytest
from rich.console import Console

from grader.classroom.job import Row
from grader.cli import main
from grader.commands.grade import _print_discovery, _report_class
from grader.judging.rubrics import read_rubric
from grader.result import Result, Score
from grader.submission.discovery import Discovery
from grader.submission.extraction import SubmissionSource

ROOT = Path(__file__).parents[2]


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """Run the command in this process; returns exit status, output and errors."""
    try:
        status = main([str(argument) for argument in arguments])
    except SystemExit as end:  # argparse
        status = int(end.code or 0)
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, captured.out, captured.err


@pytest.mark.parametrize(
    "arguments",
    [
        ["--resume", "--afresh"],
        ["--one", "--each"],
        ["--scheduler"],
        ["--scheduler", "tcp://127.0.0.1:1", "--timings"],
        ["--scheduler", "tcp://127.0.0.1:1", "--export", "junit"],
    ],
)
def test_what_does_not_go_together(
    capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    """Contradictory options end with 2 and the usage."""
    status, _, errors = run(capsys, ROOT / "submissions/alice", *arguments)
    assert (status, "usage: grade" in errors) == (2, True)


def test_a_cluster_needs_its_software(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the extra is not installed, the command says how to install it."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    arguments = ("--scheduler", "tcp://127.0.0.1:1", "-o", tmp_path / "results")
    status, _, errors = run(capsys, ROOT / "submissions/alice", *arguments)
    assert status == 5
    assert "[cluster]" in errors


def told(found: Discovery) -> str:
    """Give the command's text about the found submissions."""
    console = Console(file=io.StringIO(), width=200)
    _print_discovery(found, console, is_class=True)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_who_is_marked_late_without_a_time_is_reported() -> None:
    """A system's mark is not lost where it alone tells that something was late."""
    late = SubmissionSource("bob", (), marked_late_by="Canvas")
    assert "add it with --class-list: bob\n" in told(Discovery((late, SubmissionSource("ann", ()))))
    assert told(Discovery((replace(late, submitted_at=datetime(2026, 3, 2, tzinfo=UTC)),))) == ""


def test_who_is_on_the_page_from_earlier_runs_is_reported(tmp_path: Path) -> None:
    """A submission that was renamed or withdrawn stays on the class page, and a line says so."""
    for name in ("ann", "old"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text("{}", encoding="utf-8")
    rows = [
        Row(
            SubmissionSource("ann", ()),
            Result("ann", "Lab 1", Score(Decimal(1), Decimal(1), Decimal(0)), ()),
        )
    ]
    console = Console(file=io.StringIO(), width=200)
    options = Namespace(output=tmp_path, class_list=None, anonymous=False)
    _report_class(rows, read_rubric(None), options, console)
    assert isinstance(console.file, io.StringIO)
    assert "The class page also has results of earlier runs: old." in console.file.getvalue()

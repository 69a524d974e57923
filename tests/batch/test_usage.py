"""The command line of a class, without a live graph."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from grader.cli import main

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
def test_what_does_not_go_together(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
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

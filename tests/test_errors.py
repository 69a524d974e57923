"""Errors name files as the user knows them."""

from __future__ import annotations

import ast
import os
from pathlib import Path

import pytest

from confine.scratch import scratch_prefix
from grader.errors import RubricError, described, without_temporary_names
from grader.files import atomic_replacement, replace_file
from tests.packages import modules

ROOT = Path(__file__).resolve().parents[1]
#: Calls that make a temporary folder, and beginnings of names that are known.
MAKERS = {"tempfile.TemporaryDirectory", "tempfile.mkdtemp", "tempfile.mkstemp"}
KNOWN = ("scratch_prefix()", "TEMPORARY", "'grade-doctor-'", "f'{prefix}intake-'", "'.new-'")
#: Stands for the grader's scratch folder in parameters, because its name differs between processes.
SCRATCH = "SCRATCH"


def _scratch() -> str:
    return f"/tmp/{scratch_prefix()}intake-abc123"


@pytest.mark.parametrize(
    ("text", "known"),
    [
        (f"{SCRATCH}/submission/a/b.py", "a/b.py"),
        (
            f"PermissionError: [Errno 13] no: '{SCRATCH}/plan'",
            "PermissionError: [Errno 13] no: 'plan'",
        ),
        (f"no room in {SCRATCH}", "no room in a temporary folder"),
        (f"no room in '{SCRATCH}/submission'", "no room in 'a temporary folder'"),
        (f"{SCRATCH}/workspace/x.py:3: wrong", "x.py:3: wrong"),
        (
            "results/ann/.unfinished/recordings/.qos.partial/x.mcap",
            "results/ann/recordings/qos/x.mcap",
        ),
        ("/tmp/grade-results-abc/ann/result.json", "/tmp/grade-results-abc/ann/result.json"),
        ("/home/me/grade-1-of-3/a.py", "/home/me/grade-1-of-3/a.py"),
        ("grade . --sessions qos", "grade . --sessions qos"),
    ],
)
def test_temporary_names_are_left_out(text: str, known: str) -> None:
    """A path within a temporary folder is one within the submission; folders of the user's stay as they are."""
    assert without_temporary_names(text.replace(SCRATCH, _scratch())) == known


def test_errors_hold_no_temporary_names() -> None:
    """Neither in the problem, nor where it is, nor in the remedy or a mistake."""
    folder = _scratch()
    mistakes = [f"{folder}/lab/rubric.yaml:3: x"]
    error = RubricError(folder, mistakes, location=folder, remedy=folder)
    texts = [error.problem, error.location, error.remedy, *error.mistakes]
    assert texts == ["a temporary folder"] * 3 + ["rubric.yaml:3: x"]


@pytest.mark.parametrize("place", ["gone/x.xml", "folder"])
def test_a_file_that_cannot_be_written_is_called_by_its_own_name(
    place: str, tmp_path: Path
) -> None:
    """The name under which it is written first is never said."""
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError) as failed:
        replace_file(tmp_path / place, "x")
    assert described(failed.value).location == str(tmp_path / place)
    assert "partial" not in str(failed.value.filename)


def test_a_result_that_cannot_be_written_is_called_by_its_own_name(tmp_path: Path) -> None:
    """The temporary folder is no part of its name."""
    with (
        pytest.raises(OSError, match="no space") as failed,
        atomic_replacement(tmp_path, ()) as new,
    ):
        raise OSError(28, "no space", str(new / "recordings/x.mcap"))
    assert described(failed.value).location == str(tmp_path / "recordings/x.mcap")


def test_all_temporary_folders_have_names_that_are_known() -> None:
    """A folder with another beginning of its name would show in messages."""
    bare = []
    for file in modules():
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in MAKERS:
                given = {key.arg: ast.unparse(key.value) for key in node.keywords}
                if not given.get("prefix", "").startswith(KNOWN):
                    bare.append(f"{file.name}{os.linesep}{ast.unparse(node)}")
    assert bare == []

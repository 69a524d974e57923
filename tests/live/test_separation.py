"""The real command in a student's repository, and on folders that call themselves somebody else's."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

ROOT = Path(__file__).parents[2]
GRADE = Path(sys.executable).parent / "grade"
SOLUTION = ROOT / "reference" / "solution"
#: The files alone are judged, so that no session runs.
QUICK = ("--sessions", "", "--require-isolation", "reduced")
OVERRIDES = "overrides:\n  - {submission: '*', bonus: 50, reason: All is well., who: An Instructor, when: 2026-01-01}\n"

pytestmark = pytest.mark.live


def grade(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command."""
    return subprocess.run(
        [str(GRADE), *map(str, arguments), *QUICK],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )


def lay_out(folder: Path, *, readme: bool = True) -> Path:
    """Lay out the solution's texts, with or without the file for a part of the points."""
    folder.mkdir(parents=True)
    for path in SOLUTION.glob("*.*"):
        if readme or path.name != "README.md":
            (folder / path.name).write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
    return folder


def score(results: Path, name: str) -> float:
    """Return the final points of a result."""
    found: float = json.loads((results / name / "result.json").read_text(encoding="utf-8"))[
        "score"
    ]["final"]
    return found


def test_a_repository_is_graded_in_its_own_folder(tmp_path: Path) -> None:
    """`grade . --one` writes to its results folder, again and again, and says that no overrides count there."""
    repository = lay_out(tmp_path / "alice")
    first = grade(".", "--one", cwd=repository)
    assert (first.returncode, first.stderr) == (0, "")
    plain = score(repository / "results", "alice")
    (repository / "results/overrides.yaml").write_text(OVERRIDES, encoding="utf-8")
    second = grade(".", "--one", "--export", "junit", cwd=repository)
    assert (second.returncode, second.stderr) == (0, "")
    assert (
        "results/overrides.yaml lies in the submission itself and does not count" in second.stdout
    )
    assert score(repository / "results", "alice") == plain
    again = subprocess.run(
        [str(GRADE), "regrade", "results/alice"],
        cwd=repository,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (again.returncode, "does not count" in again.stdout) == (0, True)
    assert score(repository / "results", "alice") == plain
    told = grade(".", "--one", "--overrides", "results/overrides.yaml", cwd=repository)
    assert (told.returncode, "does not count" in told.stdout) == (0, False)
    assert score(repository / "results", "alice") == plain + 50


@pytest.mark.parametrize("link", ["results", "results/alice", "results/alice/recordings"])
def test_nothing_is_written_through_a_link_of_a_submission(link: str, tmp_path: Path) -> None:
    """The command ends with 2 and names the link; the target of the link stays as it was."""
    repository, outside = lay_out(tmp_path / "alice"), tmp_path / "outside"
    (outside / "alice").mkdir(parents=True)
    (outside / "overrides.yaml").write_text(OVERRIDES, encoding="utf-8")
    (repository / link).parent.mkdir(parents=True, exist_ok=True)
    (repository / link).symlink_to(outside)
    run = grade(".", "--one", cwd=repository)
    assert (run.returncode, "the submission holds a link" in run.stderr) == (2, True)
    assert f"{link}: the submission" in run.stderr
    assert sorted(p.name for p in outside.rglob("*")) == ["alice", "overrides.yaml"]


def test_no_folder_replaces_the_results_of_others(tmp_path: Path) -> None:
    """Whatever lies in mallory's folder, bob's results stay until --replace is given; --one grades it as mallory's."""
    lay_out(tmp_path / "class/bob")
    mallory = lay_out(tmp_path / "class/mallory/bob", readme=False).parent
    lay_out(mallory / "eve", readme=False)
    assert grade("class/bob", cwd=tmp_path).returncode == 0
    right = score(tmp_path / "results", "bob")

    run = grade("class/mallory", cwd=tmp_path)
    assert run.returncode == 2
    assert f"made from {tmp_path / 'class/bob'}, and this is another submission" in run.stderr
    assert score(tmp_path / "results", "bob") == right
    assert score(tmp_path / "results", "eve") < right

    assert grade("class/mallory", "--one", cwd=tmp_path).returncode == 0
    assert score(tmp_path / "results", "mallory") < right
    single = grade("class/mallory/bob", cwd=tmp_path)
    assert (single.returncode, "--replace" in single.stderr) == (2, True)
    assert score(tmp_path / "results", "bob") == right
    assert grade("class/mallory/bob", "--replace", cwd=tmp_path).returncode == 0
    assert score(tmp_path / "results", "bob") < right

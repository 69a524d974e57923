"""Labs that are shipped with the grader are found by name, listed and copied."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from grader.cli import main
from grader.commands.arguments import rubric_path
from grader.errors import PlatformError
from grader.judging.rubrics import read_rubric
from grader.lab.kept_lab import lab_folder
from grader.lab.shipped_labs import copy_lab, require_extras, shipped_labs


def test_a_name_stands_for_a_lab(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A name is the shipped lab, also beside a folder of the same name, which a path still names."""
    shipped = shipped_labs()["09-02"] / "rubric.yaml"
    (tmp_path / "09-02").mkdir()
    monkeypatch.chdir(tmp_path)
    assert rubric_path("09-02") == shipped
    assert "./09-02" in capsys.readouterr().err
    assert rubric_path("./09-02") == Path("09-02/rubric.yaml")
    assert rubric_path("09-01") == lab_folder() / "rubric.yaml"
    assert capsys.readouterr().err == ""


def test_a_misspelt_name_is_corrected(capsys: pytest.CaptureFixture[str]) -> None:
    """`--lab scanfilter` and `lab copy` name the lab that was meant."""
    assert main(["--lab", "scanfilter", "ann"]) == 4
    assert "did you mean 'scan-filter'?" in capsys.readouterr().err
    assert main(["lab", "copy", "go-to-gaol", "mine"]) == 2
    assert "did you mean 'go-to-goal'?" in capsys.readouterr().err


def test_labs_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    """Each lab is a line with its title and points, and an entry in JSON."""
    assert main(["lab", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert main(["lab", "list", "--json"]) == 0
    labs = json.loads(capsys.readouterr().out)
    assert [lab["name"] for lab in labs] == list(shipped_labs())
    for lab, line in zip(labs, lines, strict=False):
        assert line.split(maxsplit=1)[0] == lab["name"]
        assert f"{lab['title']}, {lab['points']} points" in line


@pytest.mark.parametrize("name", ["09-01", "scan-filter"])
def test_a_copy_is_the_same_lab(name: str, tmp_path: Path) -> None:
    """A copy has the rubric, all files that it names, and the solution; an editor finds the schema beside it."""
    copy_lab(name, tmp_path)
    source = read_rubric(shipped_labs()[name] / "rubric.yaml")
    copy = read_rubric(tmp_path / "rubric.yaml")
    assert copy.lab == source.lab
    assert copy.lab.solution is not None
    assert (tmp_path / copy.lab.solution).is_dir()
    assert "schema=../" not in copy.text
    assert (tmp_path / "rubric.schema.json").is_file()
    assert not list(tmp_path.rglob("__pycache__"))


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder with files is left alone."""
    (tmp_path / "notes.txt").touch()
    assert main(["lab", "copy", "09-02", str(tmp_path)]) == 2
    assert "not empty" in capsys.readouterr().err


def test_a_missing_library_of_a_lab_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything runs, an error names the extra that the lab's programs need; other labs do without."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.setattr("sys.meta_path", [])
    with pytest.raises(PlatformError) as found:
        require_extras(read_rubric(None))
    assert "[mujoco]" in found.value.remedy
    require_extras(read_rubric(shipped_labs()["09-02"] / "rubric.yaml"))

"""The project's own workflows: valid by schema, without a known danger, few rights, and only targets of the Makefile.

They cannot run here; all that they do is a target of `make` or a command of `docker`.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.documentation import blocks
from tests.packages import ROOT

FOLDER = ROOT / ".github/workflows"
FILES = sorted(FOLDER.glob("*.yml"))
BIN = Path(sys.executable).parent
#: Publishers of the actions in use.
PUBLISHERS = {"actions", "pypa"}
#: Rights other than reading the repository, by job.
RIGHTS = {
    "docs.yml publish": {"pages": "write", "id-token": "write"},
    "image.yml push": {"packages": "write"},
    "release.yml publish": {"id-token": "write"},
}
named = pytest.mark.parametrize("file", FILES, ids=[file.name for file in FILES])


def read(file: Path) -> dict[str, Any]:
    """Read a workflow; `on` stays a word."""
    data = yaml.load(file.read_text(encoding="utf-8"), yaml.BaseLoader)
    assert isinstance(data, dict)
    return data


def steps(file: Path) -> list[dict[str, Any]]:
    """Return the steps of all jobs."""
    found = []
    for job in read(file)["jobs"].values():
        found += job["steps"]
    return found


def test_the_workflows_are_there() -> None:
    """Tests, nightly tests, site, image and release each have a workflow."""
    assert [file.stem for file in FILES] == ["ci", "docs", "image", "nightly", "release"]


@pytest.mark.parametrize(
    "schema", ["vendor.github-workflows", "custom.github-workflows-require-timeout"]
)
def test_the_schema_accepts_them(schema: str) -> None:
    """Each workflow satisfies the published schema, and each job has a timeout."""
    command = [BIN / "check-jsonschema", "--builtin-schema", schema, *FILES]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.fixture
def documented(tmp_path: Path) -> Path:
    """Give the workflow of the pages, for a job from the wheel alone."""
    (block,) = blocks(ROOT / "docs/ci.md", "yaml")[:1]
    assert block.title == ".github/workflows/grade.yml"
    file = tmp_path / block.title
    file.parent.mkdir(parents=True)
    file.write_text(block.text, encoding="utf-8")
    return file


def test_the_schema_accepts_the_documented_one(documented: Path) -> None:
    """The workflow of the pages satisfies the published schema too."""
    command = [BIN / "check-jsonschema", "--builtin-schema", "vendor.github-workflows", documented]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_linter_finds_no_danger(documented: Path) -> None:
    """Zizmor has nothing to say about the workflows, the action, the template for students and the documented one."""
    files = [*FILES, ROOT / "action.yml", ROOT / "ci/github-workflow.yml", documented]
    command = [BIN / "zizmor", "--offline", "--quiet", "-c", ROOT / ".github/zizmor.yml", *files]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_linter_can_find_a_danger(tmp_path: Path) -> None:
    """A branch's name inside a script is found, so the test above can fail."""
    text = (FOLDER / "release.yml").read_text(encoding="utf-8")
    wrong = tmp_path / "release.yml"
    wrong.write_text(text.replace('"$TAG"', '"${{ github.ref_name }}"'), encoding="utf-8")
    done = subprocess.run(
        [BIN / "zizmor", "--offline", "--quiet", wrong], check=False, capture_output=True
    )
    assert done.returncode != 0


@named
def test_rights_are_few(file: Path) -> None:
    """A workflow has no rights; a job reads the repository, and only a job that publishes has another right."""
    workflow = read(file)
    assert workflow["permissions"] == {}
    for name, job in workflow["jobs"].items():
        wanted = RIGHTS.get(f"{file.name} {name}", {"contents": "read"})
        assert job["permissions"] == wanted
    assert "secrets." not in file.read_text(encoding="utf-8")
    assert "pull_request_target" not in workflow["on"]


@named
def test_actions_are_pinned_and_credentials_not_kept(file: Path) -> None:
    """Each action has a version and a known publisher, and no checkout keeps the job's token."""
    for step in steps(file):
        if "uses" not in step:
            continue
        match = re.fullmatch(r"([\w-]+)/[\w-]+@v\d+(\.\d+\.\d+)?", step["uses"])
        assert match
        assert match[1] in PUBLISHERS
        if "checkout" in step["uses"]:
            assert step["with"] == {"persist-credentials": "false"}


@named
def test_scripts_use_targets_and_files_of_the_project(file: Path) -> None:
    """Each target of `make` is one of the Makefile, each tool is a file, and no expression is part of a script."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    said = set(
        read(file)["jobs"].get("all", {}).get("strategy", {}).get("matrix", {}).get("target", [])
    )
    for step in steps(file):
        script = step.get("run", "")
        assert "${{" not in script
        for words in re.findall(r"\bmake ((?:[a-z-]+ ?)+)", script):
            said |= set(words.split())
        for tool in re.findall(r"\btools/[\w-]+", script):
            assert (ROOT / tool).exists()
    assert said <= targets

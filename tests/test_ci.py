"""The files for CI systems: valid by the systems' own schemas, sound shell, and only options that `grade` has."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from grader.commands.export import make_parser as export_parser
from grader.commands.grade import make_parser as grade_parser

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ["ci/install.sh", "ci/github/grade.sh", "ci/gitlab/grade.sh", "ci/gradescope/setup.sh"]
SCRIPTS += ["ci/gradescope/run_autograder"]
#: Options of `grade` and `grade export` in scripts; options of other programs are excluded by name.
_OTHERS = {
    "--quiet",
    "--no-install-recommends",
    "--disable-pip-version-check",
    "--no-cache-dir",
    "--constraint",
}
_OTHERS |= {"--depth", "--branch", "--format", "--add-file"}


def read(path: str) -> dict[str, Any]:
    """Read a YAML file of the checkout; `on` stays a word."""
    data = yaml.load((ROOT / path).read_text(encoding="utf-8"), yaml.BaseLoader)
    assert isinstance(data, dict)
    return data


@pytest.mark.parametrize(
    ("schema", "file"),
    [
        ("vendor.github-actions", "action.yml"),
        ("vendor.github-workflows", "ci/github-workflow.yml"),
        ("custom.github-workflows-require-timeout", "ci/github-workflow.yml"),
        ("vendor.gitlab-ci", "ci/gitlab-ci.yml"),
    ],
)
def test_files_satisfy_the_systems_schemas(schema: str, file: str) -> None:
    """Each system accepts its file."""
    command = [
        sys.executable,
        "-m",
        "check_jsonschema",
        "--builtin-schema",
        schema,
        str(ROOT / file),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_schemas_refuse_what_is_wrong(tmp_path: Path) -> None:
    """A misspelt key is found, so the test above can fail."""
    wrong = tmp_path / "wrong.yml"
    wrong.write_text(
        (ROOT / "action.yml").read_text(encoding="utf-8").replace("using:", "use:"),
        encoding="utf-8",
    )
    command = [
        sys.executable,
        "-m",
        "check_jsonschema",
        "--builtin-schema",
        "vendor.github-actions",
        str(wrong),
    ]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 1


@pytest.mark.parametrize("script", SCRIPTS)
def test_shell_scripts_are_sound(script: str) -> None:
    """ShellCheck has nothing to say, and the file can be run."""
    shellcheck = Path(sys.executable).with_name("shellcheck")
    done = subprocess.run(
        [shellcheck, str(ROOT / script)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    assert (ROOT / script).stat().st_mode & 0o111


@pytest.mark.parametrize("file", ["Dockerfile", "Dockerfile.ros", ".dockerignore", "docs/ci.md"])
def test_all_that_an_installation_is_made_of_goes_along(file: str) -> None:
    """The image and Gradescope's archive have the files that the package's build includes."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    included = {*wheel["only-include"], *wheel["force-include"], *wheel["shared-data"]}
    included |= {project["project"]["readme"], *project["project"]["license-files"]}
    assert {"grader", "labs", "rubric.yaml", "reference"} <= included
    words = set(re.split(r"[\s!]+", (ROOT / file).read_text(encoding="utf-8")))
    assert included | {"constraints.txt"} <= words


@pytest.mark.parametrize("file", [*SCRIPTS, "ci/classroom50/autograder.py", "docs/ci.md"])
def test_every_option_is_one_of_the_command(file: str) -> None:
    """`grade` or `grade export` knows each option in the scripts and on the page."""
    known = set()
    for parser in (grade_parser(), export_parser()):
        for option in parser._option_string_actions:
            known.add(option)
    text = (ROOT / file).read_text(encoding="utf-8")
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)) - _OTHERS
    assert named <= known


def test_the_workflow_is_reported_little_and_trusted_less() -> None:
    """The workflow runs on the virtual machine, may only read, has no secrets, and leaves no credentials in the checkout."""
    workflow = read("ci/github-workflow.yml")
    assert workflow["permissions"] == {"contents": "read"}
    assert "pull_request_target" not in workflow["on"]
    job = workflow["jobs"]["grade"]
    assert "container" not in job
    assert "permissions" not in job
    assert int(job["timeout-minutes"]) <= 30
    assert job["steps"][0]["with"]["persist-credentials"] == "false"
    for file in ("action.yml", "ci/github-workflow.yml", "ci/gitlab-ci.yml"):
        text = (ROOT / file).read_text(encoding="utf-8")
        assert "secrets." not in text
        assert "TOKEN" not in text


def test_inputs_never_become_part_of_a_script() -> None:
    """Inputs are given as variables; the workflow uses inputs that the action has."""
    action = read("action.yml")
    for step in action["runs"]["steps"]:
        assert "${{" not in step.get("run", "")
    used = set(read("ci/github-workflow.yml")["jobs"]["grade"]["steps"][1]["with"])
    assert used <= set(action["inputs"])
    given = {name.upper().replace("-", "_") for name in action["inputs"]} - {"ARTIFACT"}
    assert given | {"RESULTS"} == set(action["runs"]["steps"][1]["env"])


def test_actions_are_pinned_by_version() -> None:
    """Every action that is used has a version."""
    steps = [
        *read("action.yml")["runs"]["steps"],
        *read("ci/github-workflow.yml")["jobs"]["grade"]["steps"],
    ]
    used = [step["uses"] for step in steps if "uses" in step]
    assert len(used) == 3
    assert all(re.fullmatch(r"[\w.-]+/[\w.-]+@v\d+", each) for each in used)


def test_gitlab_keeps_what_the_script_writes() -> None:
    """Artifacts and reports are files of the folder that the script leaves in the checkout."""
    artifacts = read("ci/gitlab-ci.yml")["grade"]["artifacts"]
    assert artifacts["when"] == "always"
    assert artifacts["paths"] == ["grade/"]
    assert artifacts["reports"] == {
        "junit": "grade/junit.xml",
        "codequality": "grade/codequality.json",
    }


def test_nothing_of_the_working_folder_is_imported() -> None:
    """Python starts isolated in each script, since the working folder of a job is a submission."""
    for script in SCRIPTS:
        text = (ROOT / script).read_text(encoding="utf-8")
        assert re.findall(r"python3?\"? (?!-I|python3)(?:-\S+|\")", text) == [], script

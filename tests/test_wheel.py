"""The wheel and the source archive: sound, the same at each build, and usable without a checkout."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from grader import __version__
from grader.extras import EXTRAS, PACKAGE
from tests.packages import ROOT
from tests.test_constraints import NO_ANSWER

BIN = Path(sys.executable).parent
#: A point in time for the build: 14 November 2023.
EPOCH = "1700000000"


def run(*command: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run a command, as if nothing of a checkout were known."""
    environment = {**os.environ, "SOURCE_DATE_EPOCH": EPOCH, "NO_COLOR": "1", "COLUMNS": "200"}
    environment.pop("PYTHONPATH", None)
    return subprocess.run(
        list(map(str, command)),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        cwd=cwd,
        env=environment,
    )


def build(source: Path, folder: Path, *targets: str) -> list[Path]:
    """Build wheel and source archive of a folder with the project."""
    kinds = [word for target in targets for word in ("-t", target)]
    done = run(sys.executable, "-m", "hatchling", "build", "-d", folder, *kinds, cwd=source)
    assert done.returncode == 0, done.stderr
    return sorted(folder.iterdir())


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Give the wheel and the source archive."""
    return build(ROOT, tmp_path_factory.mktemp("dist"), "wheel", "sdist")


@pytest.fixture(scope="module")
def wheel(built: list[Path]) -> Path:
    """Give the wheel."""
    return next(file for file in built if file.suffix == ".whl")


def test_extras_are_those_of_the_package() -> None:
    """Each extra for users brings a module that `grade` names when it is missing, and `all` has each."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    assert project["name"] == PACKAGE
    assert set(EXTRAS.values()) == set(extras) - {"all", "dev", "docs"}
    assert extras["all"] == [f"{PACKAGE}[{','.join(sorted(set(EXTRAS.values())))}]"]


def test_labs_and_sample_are_in_the_wheel(wheel: Path) -> None:
    """Each lab of the checkout is in the wheel with its solution; caches and results of trials are not."""
    names = zipfile.ZipFile(wheel).namelist()
    inside = "grader/shipped_lab/"
    for folder in sorted((ROOT / "labs").iterdir()):
        lab = f"{inside}labs/{folder.name}/"
        assert f"{lab}rubric.yaml" in names
        assert any(name.startswith(f"{lab}solution/") for name in names)
    assert f"{inside}rubric.yaml" in names
    assert f"{inside}submissions/alice/README.md" in names
    for package in ("confine", "grader", "launch_plan", "ros_bag"):
        assert f"{package}/py.typed" in names
    assert not [name for name in names if "/tried/" in name or "__pycache__" in name]


@pytest.mark.slow
def test_the_same_bytes_at_each_build(built: list[Path], tmp_path: Path) -> None:
    """A second build equals the first, and so does the wheel that is built from the source archive."""
    again = build(ROOT, tmp_path / "again", "wheel", "sdist")
    archive = next(file for file in built if file.suffix == ".gz")
    with tarfile.open(archive) as packed:
        packed.extractall(tmp_path / "source", filter="data")
    (source,) = (tmp_path / "source").iterdir()
    again += build(source, tmp_path / "of-archive", "wheel")
    hashes = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in built}
    assert len(again) == 3
    for file in again:
        assert hashlib.sha256(file.read_bytes()).hexdigest() == hashes[file.name]


@pytest.mark.slow
def test_tools_for_packages_have_nothing_to_say(built: list[Path], wheel: Path) -> None:
    """Twine and check-wheel-contents accept the files."""
    checked = run(BIN / "twine", "check", "--strict", *built)
    assert checked.returncode == 0, checked.stdout
    contents = run(BIN / "check-wheel-contents", wheel)
    assert contents.returncode == 0, contents.stdout


@pytest.fixture(scope="module")
def grade(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel into a new environment, without extras; give its command."""
    environment = tmp_path_factory.mktemp("fresh") / "venv"
    uv = BIN / "uv"
    made = run(uv, "venv", "--quiet", "--python", sys.executable, environment)
    assert made.returncode == 0, made.stderr
    constraints = ROOT / "constraints.txt"
    python = environment / "bin/python"
    into = ("--quiet", "--python", python, "--constraints", constraints)
    done = run(uv, "pip", "install", *into, wheel)
    if any(words in done.stderr for words in NO_ANSWER):
        pytest.skip("the package registry does not answer")
    assert done.returncode == 0, done.stderr
    return environment / "bin/grade"


@pytest.mark.slow
def test_the_installed_wheel_works_alone(grade: Path, tmp_path: Path) -> None:
    """Without a checkout, `grade` knows its version and its labs, and copies one that is in order."""
    assert run(grade, "--version", cwd=tmp_path).stdout.strip() == f"grade {__version__}"
    listed = run(grade, "lab", "list", "--json", cwd=tmp_path)
    assert listed.returncode == 0, listed.stderr
    names = [lab["name"] for lab in json.loads(listed.stdout)]
    assert names == ["09-01", *sorted(folder.name for folder in (ROOT / "labs").iterdir())]
    assert run(grade, "lab", "copy", "09-02", "mine", cwd=tmp_path).returncode == 0
    checked = run(grade, "lab", "check", "mine", cwd=tmp_path)
    assert checked.returncode == 0, checked.stderr


@pytest.mark.slow
def test_a_missing_extra_is_named(grade: Path, tmp_path: Path) -> None:
    """Without an extra, the commands that need it end with 5, and name it."""
    (tmp_path / "ann").mkdir()
    (tmp_path / "ann/joint_publisher.py").write_text("import rclpy\n", encoding="utf-8")
    no_arm = run(grade, "ann", cwd=tmp_path)
    assert (no_arm.returncode, f"{PACKAGE}[mujoco]" in no_arm.stderr) == (5, True)
    no_cluster = run(grade, "ann", "--scheduler", "tcp://127.0.0.1:9", cwd=tmp_path)
    assert (no_cluster.returncode, f"{PACKAGE}[cluster]" in no_cluster.stderr) == (5, True)
    tried = run(grade, "try", "first", cwd=tmp_path)
    assert (tried.returncode, f"{PACKAGE}[mujoco]" in tried.stderr) == (5, True)
    assert not (tmp_path / "first").exists()

"""Installation by `make`, read from its commands without running them."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.packages import ROOT


def commands(target: str, folder: Path) -> str:
    """Return the commands of a target for a missing virtual environment."""
    environment = folder / "environment"
    command = ["make", "--dry-run", f"VENV={environment}", f"{environment}/{target}"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.parametrize("target", [".installed", ".installed-dev"])
def test_uv_installs_and_pip_follows(target: str, tmp_path: Path) -> None:
    """Each installation tries uv with the pinned versions, then pip, and neither compiles tests of packages."""
    installed = re.findall(
        r"uv pip install.*-c constraints.txt -e (\S+) .*", commands(target, tmp_path)
    )
    followed = re.findall(
        r"\|\| \S+ -m pip install -qq --no-compile .*-c constraints.txt -e (\S+) ",
        commands(target, tmp_path),
    )
    assert installed == followed
    assert installed[0] == "'.[desk,mujoco,scipy]'"


def test_modules_are_compiled_without_tests_of_packages(tmp_path: Path) -> None:
    """The command for compiling compiles a module of a package, and no module of its tests."""
    (line,) = re.findall(r"(?<=-m compileall ).*(?= \S+/lib)", commands(".installed", tmp_path))
    package = tmp_path / "lib/arrays"
    (package / "tests").mkdir(parents=True)
    for name in ("sums.py", "tests/test_sums.py"):
        (package / name).write_text("TOTAL = 1\n", encoding="utf-8")
    words = [word.strip("'") for word in line.split()]
    subprocess.run([sys.executable, "-m", "compileall", *words, tmp_path / "lib"], check=True)
    compiled = [file.parent.parent.name for file in tmp_path.rglob("*.pyc")]
    assert compiled == ["arrays"]

"""The pinned versions can be installed with every version of Python that the package says it runs on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
UV = Path(sys.executable).with_name("uv")
PYTHONS = ("3.11", "3.12", "3.13")
#: Messages of uv about a registry that it does not reach.
NO_ANSWER = ("error sending request", "dns error", "Could not connect", "Network connectivity")


def resolve(python: str, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Resolve the pinned versions for a version of Python; the markers count as they do on it."""
    command = [UV, "pip", "compile", "--quiet", "--no-config", "--python-version", python]
    command += ["--constraints", ROOT / "constraints.txt", ROOT / "pyproject.toml", *options]
    command += ["--output-file", folder / "requirements.txt"]
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=300, check=False
    )
    if any(words in done.stderr for words in NO_ANSWER):
        pytest.skip("the package registry does not answer")
    return done


@pytest.mark.parametrize("python", PYTHONS)
def test_versions_resolve(python: str, tmp_path: Path) -> None:
    """Constraints resolve for each Python that the package names, with all extras."""
    done = resolve(python, tmp_path, "--all-extras")
    assert done.returncode == 0, done.stderr


def test_an_older_python_is_refused() -> None:
    """The package and `make` name the oldest Python that has such versions."""
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f'requires-python = ">={PYTHONS[0]}"' in project
    assert "sys.version_info < (3, 11)" in (ROOT / "Makefile").read_text(encoding="utf-8")
    assert "sys.version_info < (3, 11)" in (ROOT / "ci/install.sh").read_text(encoding="utf-8")

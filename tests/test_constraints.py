"""The pinned versions can be installed with every version of Python that the package says it runs on."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
UV = Path(sys.executable).with_name("uv")
PYTHONS = ("3.11", "3.12", "3.13")
#: Messages of uv about a registry that it does not reach.
NO_ANSWER = ("error sending request", "dns error", "Could not connect", "Network connectivity")


def resolve(python: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Resolve the pinned versions with all extras for a version of Python; the markers count as they do on it."""
    command = [UV, "pip", "compile", "--quiet", "--no-config", "--python-version", python]
    command += ["--constraints", ROOT / "constraints.txt", ROOT / "pyproject.toml", "--all-extras"]
    command += ["--output-file", folder / "requirements.txt"]
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=300, check=False
    )
    if any(words in done.stderr for words in NO_ANSWER):
        pytest.skip("the package registry does not answer")
    return done


@pytest.fixture(scope="module")
def resolved(
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, subprocess.CompletedProcess[str]]:
    """Resolve for all versions at once, because uv mostly waits for the registry."""
    folders = [tmp_path_factory.mktemp("resolved") for _ in PYTHONS]
    with ThreadPoolExecutor() as pool:
        return dict(zip(PYTHONS, pool.map(resolve, PYTHONS, folders), strict=True))


@pytest.mark.parametrize("python", PYTHONS)
def test_versions_resolve(
    python: str, resolved: dict[str, subprocess.CompletedProcess[str]]
) -> None:
    """Constraints resolve for each Python that the package names, with all extras."""
    assert resolved[python].returncode == 0, resolved[python].stderr


def test_an_older_python_is_refused() -> None:
    """The package and `make` name the oldest Python that has such versions."""
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f'requires-python = ">={PYTHONS[0]}"' in project
    assert "sys.version_info < (3, 11)" in (ROOT / "Makefile").read_text(encoding="utf-8")
    assert "sys.version_info < (3, 11)" in (ROOT / "ci/install.sh").read_text(encoding="utf-8")

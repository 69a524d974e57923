"""What of the machine an interpreter needs, and nothing beside it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from grader.live.sandbox.environment import (
    interpreter_links,
    interpreter_roots,
    student_environment,
)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """Make an installation of Python, of empty files; returns its program."""
    program = tmp_path / "opt/python/bin/python3.11"
    (tmp_path / "opt/python/lib/python3.11").mkdir(parents=True)
    program.parent.mkdir()
    program.touch()
    return program


def environment(folder: Path, program: Path) -> Path:
    """Make a virtual environment for a program."""
    (folder / "bin").mkdir(parents=True)
    (folder / "pyvenv.cfg").touch()
    (folder / "bin/python3").symlink_to(program)
    (folder / "bin/python").symlink_to("python3")
    return folder / "bin/python"


def test_an_environment_needs_itself_and_its_installation(tmp_path: Path, installed: Path) -> None:
    """Nothing is needed but these two folders."""
    python = environment(tmp_path / "venv", installed)
    assert interpreter_roots(python) == [tmp_path / "venv", tmp_path / "opt/python"]
    assert interpreter_links(python) == {}


def test_a_link_in_somebodys_home_does_not_open_the_home(tmp_path: Path, installed: Path) -> None:
    """The link itself is needed, and nothing else of the folder above it."""
    link = tmp_path / "home/bin/python3"
    link.parent.mkdir(parents=True)
    link.symlink_to(installed)
    python = environment(tmp_path / "venv", link)
    assert interpreter_roots(python) == [tmp_path / "venv", tmp_path / "opt/python"]
    assert interpreter_links(python) == {link: str(installed)}
    assert tmp_path / "home" not in interpreter_roots(link)
    assert interpreter_links(link) == {link: str(installed)}


def test_what_a_program_left_at_home_does_not_run_in_the_next(tmp_path: Path) -> None:
    """An interpreter outside of any virtual environment reads what lies in its user's home; a student's does not."""
    python = Path(
        sys.base_prefix, "bin", f"python{sys.version_info.major}.{sys.version_info.minor}"
    )
    environment = student_environment(python, str(tmp_path), "/ws", "/inside", 0)
    own = Path(
        tmp_path,
        ".local/lib",
        f"python{sys.version_info.major}.{sys.version_info.minor}",
        "site-packages",
    )
    own.mkdir(parents=True)
    Path(own, "left.pth").write_text("import os; os.write(1, b'it runs')\n")
    run = subprocess.run([python, "-c", "pass"], env=environment, capture_output=True, check=True)
    assert run.stdout == b""

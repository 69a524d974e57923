"""Folders and links that an interpreter needs, and nothing beside these."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from confine.interpreters import interpreter_links, interpreter_roots

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="programs are confined on Linux alone"
)


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
    """An environment needs only its own folder and its installation's."""
    python = environment(tmp_path / "venv", installed)
    assert interpreter_roots(python) == (tmp_path / "venv", tmp_path / "opt/python")
    assert interpreter_links(python) == {}


def test_a_link_in_somebodys_home_does_not_open_the_home(tmp_path: Path, installed: Path) -> None:
    """The link itself is needed, and nothing else of the folder above it."""
    link = tmp_path / "home/bin/python3"
    link.parent.mkdir(parents=True)
    link.symlink_to(installed)
    python = environment(tmp_path / "venv", link)
    assert interpreter_roots(python) == (tmp_path / "venv", tmp_path / "opt/python")
    assert interpreter_links(python) == {link: str(installed)}
    assert tmp_path / "home" not in interpreter_roots(link)
    assert interpreter_links(link) == {link: str(installed)}

"""Compiled templates are kept, and compiled anew once they are out of date."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from jinja2 import DictLoader, Environment

from grader.report.compiled_templates import CompiledTemplates


def rendered(folder: Path, text: str) -> str:
    """Return a page of a template, made by an environment of its own."""
    environment = Environment(
        loader=DictLoader({"page": text}), bytecode_cache=CompiledTemplates(folder)
    )
    return environment.get_template("page").render(name="ann")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder that does not exist yet, where Python may write bytecode."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    return tmp_path / "__pycache__"


def test_a_template_is_compiled_once(folder: Path) -> None:
    """The second environment reads the kept file, and writes none."""
    assert rendered(folder, "Hello {{ name }}") == "Hello ann"
    (kept,) = folder.iterdir()
    os.utime(kept, (1, 1))
    assert rendered(folder, "Hello {{ name }}") == "Hello ann"
    assert kept.stat().st_mtime == 1


def test_a_changed_template_is_compiled_anew(folder: Path) -> None:
    """A kept file of another text does not count."""
    rendered(folder, "Hello {{ name }}")
    assert rendered(folder, "Bye {{ name }}") == "Bye ann"
    assert rendered(folder, "Bye {{ name }}") == "Bye ann"


@pytest.mark.parametrize("size", [0, 3, 20, 60, 200])
def test_a_damaged_file_is_replaced(folder: Path, size: int) -> None:
    """A file that a full disk cut off is compiled anew."""
    rendered(folder, "Hello {{ name }}")
    (kept,) = folder.iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(whole[:size])
    assert rendered(folder, "Hello {{ name }}") == "Hello ann"
    assert kept.read_bytes() == whole


def test_without_a_folder_for_it_nothing_is_kept(tmp_path: Path) -> None:
    """A page does not depend on a place for compiled templates, as in an installation of another user."""
    file = tmp_path / "file"
    file.touch()
    assert rendered(file / "__pycache__", "Hello {{ name }}") == "Hello ann"


def test_nothing_is_kept_if_python_writes_no_bytecode(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`PYTHONDONTWRITEBYTECODE` holds for templates too."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert rendered(folder, "Hello {{ name }}") == "Hello ann"
    assert not folder.exists()

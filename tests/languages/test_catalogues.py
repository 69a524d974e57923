"""The catalogues: as extracted from the code, complete, and with the values of the English texts."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from grader.languages.catalogue import NAMES, read_catalogues
from grader.languages.template import Template
from tests.packages import ROOT

CATALOGUES = sorted([*ROOT.glob("grader/languages/*/*.po"), *ROOT.glob("reference/languages/*.po")])
OF_FILE = [str(path.relative_to(ROOT)) for path in CATALOGUES]


def test_there_are_catalogues_for_each_language() -> None:
    """Each language has the same catalogues."""
    by_language: dict[str, set[str]] = {}
    for path in ROOT.glob("grader/languages/*/*.po"):
        by_language.setdefault(path.parent.name, set()).add(path.name)
    assert by_language.keys() == NAMES.keys() - {"en"}
    assert len({frozenset(names) for names in by_language.values()}) == 1


def test_the_catalogues_are_as_extracted() -> None:
    """The extraction gives the same files again: no text is missing, and none is left of an earlier version."""
    command = [sys.executable, str(ROOT / "tools/write-catalogues"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.returncode == 0


@pytest.mark.parametrize("path", CATALOGUES, ids=OF_FILE)
def test_all_texts_are_translated(path: Path) -> None:
    """No entry is empty."""
    assert [m.english for m in read_catalogues([path]) if not m.translation] == []


@pytest.mark.parametrize("path", CATALOGUES, ids=OF_FILE)
def test_translations_have_the_same_values(path: Path) -> None:
    """Each inserted value, and each piece of code, stands once in the translation; blanks at its ends stand in neither."""
    wrong = []
    for message in read_catalogues([path]):
        if not message.translation:
            continue
        try:
            Template.of(message.english).translation(message.translation)
        except ValueError as problem:
            wrong.append(f"{message.english}: {problem}")
        if message.translation != message.translation.strip():
            wrong.append(f"{message.english}: blanks")
    assert wrong == []

"""The languages of a lab: read from catalogues, and kept in the user's cache until one of these changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader.judging import languages
from grader.judging.languages import in_lab, languages_of
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from grader.languages import language


@pytest.fixture
def rubric(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rubric:
    """Give a lab in a folder of its own, and an empty cache."""
    lab = read_rubric(None)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    languages._languages.cache_clear()
    return lab.model_copy(update={"folder": tmp_path / "lab"})


def write_catalogue(rubric: Rubric, tag: str, translation: str) -> None:
    """Write a catalogue of the lab with one message."""
    folder = rubric.folder / "languages"
    folder.mkdir(parents=True, exist_ok=True)
    text = f'msgid "the blue lamp"\nmsgstr "{translation}"\n'
    (folder / f"{tag}.po").write_text(text, encoding="utf-8")


def test_a_changed_catalogue_counts_at_once(rubric: Rubric) -> None:
    """Languages kept from the former catalogue do not count."""
    write_catalogue(rubric, "de", "die blaue Lampe")
    assert in_lab(rubric, "de").text("the blue lamp") == "die blaue Lampe"
    write_catalogue(rubric, "de", "die blaue Leuchte")
    assert in_lab(rubric, "de").text("the blue lamp") == "die blaue Leuchte"


def test_kept_languages_are_the_same(rubric: Rubric, monkeypatch: pytest.MonkeyPatch) -> None:
    """Languages from the cache translate as those from the catalogues do, and share their search."""
    text = "The rate is 98.4 Hz; no answer"
    read = languages_of(rubric, "de")
    languages._languages.cache_clear()
    # From here on, no language can be made.
    monkeypatch.setattr(language.Language, "__init__", None)
    kept = languages_of(rubric, "de")
    assert [each.tag for each in kept.others] == ["de", "es"]
    for before, after in zip(read.others, kept.others, strict=True):
        assert before is not after
        assert before.text(text) == after.text(text)
        assert before.of_scripts == after.of_scripts
    german, spanish = kept.others
    assert german.phrases is spanish.phrases


def test_the_languages_of_the_grader_have_the_same_messages() -> None:
    """Texts are sought once for both languages only with the same messages in the same order."""
    german, spanish = languages_of(read_rubric(None), "en").others
    assert german.phrases is spanish.phrases

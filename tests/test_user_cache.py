"""Slowly computed values are kept between commands, and a damaged cache costs only time."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader import user_cache
from grader.user_cache import computed, recalled


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_a_value_is_computed_once_for_each_key(tmp_path: Path) -> None:
    """Another key, and another kind, are other values."""
    times: list[str] = []

    def ask(kind: str, key: str) -> str:
        def compute() -> str:
            times.append(key)
            return f"{kind} {key}"

        return computed(kind, key, compute)

    answers = [ask("words", "a"), ask("words", "a"), ask("words", "b"), ask("numbers", "a")]
    assert answers == ["words a", "words a", "words b", "numbers a"]
    assert times == ["a", "b", "a"]


@pytest.mark.parametrize("content", [b"", b"\x80\x05.", b"cno_such_module\nname\n."])
def test_a_damaged_value_is_computed_again(tmp_path: Path, content: bytes) -> None:
    """The new value takes its place."""
    assert computed("words", 1, lambda: "one") == "one"
    (file,) = (tmp_path / "grade/words").iterdir()
    whole = file.read_bytes()
    file.write_bytes(content)
    assert computed("words", 1, lambda: "one") == "one"
    assert file.read_bytes() == whole


def test_without_a_folder_everything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cache that cannot be written is no mistake."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert computed("words", 1, lambda: "one") == "one"


def test_the_oldest_values_make_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kind has a limited number of values."""
    monkeypatch.setattr(user_cache, "_MOST", 4)
    for number in range(5):
        computed("numbers", number, str)
    assert len(list((tmp_path / "grade/numbers").iterdir())) == 3


def test_a_value_of_a_class_without_a_name_is_not_kept() -> None:
    """Nothing fails, and the value is computed each time."""

    class Inner:
        """A class without a name in a module."""

    assert isinstance(computed("kind", "key", Inner), Inner)
    assert recalled("kind", "key") is None

"""Text of students made fit to be shown."""

from __future__ import annotations

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.report.escape import line, shown


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("plain, Größe, 日本語\tα\n", "plain, Größe, 日本語\tα\n"),
        ("\x1b[31mred\x1b[0m", "red"),
        ("\x1b]0;title\x07rest", "rest"),
        ("\x9b2Jgone", "gone"),
        ("\x9da\x9d0;title\x07rest", "⟨U+009D⟩arest"),
        ("a\x00b\x08c", "a⟨U+0000⟩b⟨U+0008⟩c"),
        ("a\r\nb\rc", "a\nb⟨U+000D⟩c"),
        ("evil\u202etxt.exe", "evil⟨U+202E⟩txt.exe"),
        ("\u2066x\u2069\ufeff", "⟨U+2066⟩x⟨U+2069⟩⟨U+FEFF⟩"),
        ("\ud800", "⟨U+D800⟩"),
        ("\uffff", "⟨U+FFFF⟩"),
        ("z" + "\u0301" * 9 + "y", "z" + "\u0301" * 3 + "y"),
    ],
)
def test_what_steers_or_hides_becomes_visible(text: str, expected: str) -> None:
    """Terminal sequences go, other invisible characters are shown by number, ordinary text stays."""
    assert shown(text) == expected


def test_long_text_is_cut_and_says_so() -> None:
    """Neither a long text nor a long run of escapes comes through whole."""
    assert shown("x" * 10_000, 100) == "x" * 100 + " … (cut)"
    assert len(line("word " * 10_000, 80)) == 80
    assert line("word " * 10_000, 80).endswith("…")


@given(st.text(max_size=300))
def test_nothing_invisible_is_left(text: str) -> None:
    """Whatever comes in, no control, format or surrogate character but line end, tab and joiners goes out."""
    out = shown(text)
    out.encode()
    assert {unicodedata.category(c) for c in out if c not in "\n\t\u200c\u200d"}.isdisjoint(
        {"Cc", "Cf", "Cs", "Zl"}
    )
    assert "\n" not in line(text)

"""Python texts taken apart without running them."""

from __future__ import annotations

import io
import tokenize
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import grader
import launch_plan
from grader.evidence.text.syntax import SIZE_LIMIT, blank_out, normalise, spans, tree_of

PACKAGES = (Path(grader.__file__).parent, Path(launch_plan.__file__).parent)
SOURCES = sorted(path for package in PACKAGES for path in package.rglob("*.py"))


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_comments_agree_with_tokenize(path: Path) -> None:
    """Comments are found exactly where Python's own tokenizer finds them."""
    text = normalise(path.read_text(encoding="utf-8"))
    expected = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            expected.append((token.start[0], token.string))
    assert [
        (text.count("\n", 0, s.start()) + 1, s[0]) for s in spans(text) if s["comment"]
    ] == expected


def test_quotes_inside_strings_do_not_end_them() -> None:
    """Hashes in strings are no comments, quotes in comments are no strings."""
    text = "a = '# no' # yes\nb = \"it's\" # 'also\nc = '''\n# no\n''' # last\nd = r'\\' # no\n"
    assert [s[0] for s in spans(text) if s["comment"]] == [
        "# yes",
        "# 'also",
        "# last",
    ]


def test_an_open_string_ends_with_its_line() -> None:
    """A forgotten quote hides the rest of its line, not of the file."""
    text = "a = 'open # hidden\nb = 1 # seen\n"
    assert [s[0] for s in spans(text) if s["comment"]] == ["# seen"]


def test_blanking_keeps_the_lines() -> None:
    """Blanked text keeps its number of lines."""
    text = 'x = """a\nb\nc""" # d\ny = 1\n'
    blank = blank_out(text)
    assert blank.count("\n") == text.count("\n")
    assert "#" not in blank


@pytest.mark.parametrize(
    "text",
    [
        "x = 1\ndef f(:\n  pass\n",
        "def f():\npass\n",
        "if x:\n\ty = 1\n        z = 2\n",
        "x = (1,\n\n",
        "x = 1\ny = '\0'\n",
    ],
)
def test_what_python_refuses_has_no_tree(text: str) -> None:
    """No tree is invented for text that Python refuses."""
    assert tree_of(normalise(text)) is None


@pytest.mark.parametrize(
    "text",
    [
        "(" * 5000,
        "-" * 100_000 + "1",
        "x = " + "[" * 300 + "]" * 300,
        "a" + ".a" * 50_000,
        "9" * 6000,
        "if x:\n " * 300,
    ],
    ids=["brackets", "signs", "lists", "attributes", "digits", "blocks"],
)
def test_deep_nesting_is_survived(text: str) -> None:
    """Nesting beyond the parser's limit gives no tree and no exception."""
    assert tree_of(text) is not None or len(text) > 500


def test_normalising_makes_text_readable() -> None:
    """Marks, line ends, surrogates and excess length are dealt with."""
    assert normalise("\ufeffa\r\nb\rc") == "a\nb\nc"
    assert normalise("a\udcff") == "a?"
    assert len(normalise("x = 1\n" * SIZE_LIMIT)) <= SIZE_LIMIT


def test_python_warnings_are_kept_quiet(recwarn: pytest.WarningsRecorder) -> None:
    """A doubtful escape in student code is not the grader's warning."""
    tree = tree_of("x = '\\d'\n")
    assert tree is not None
    assert not recwarn.list


@given(st.text(max_size=400))
def test_any_text_is_taken_apart(text: str) -> None:
    """Spans are in order, inside the text, and never overlap."""
    whole = normalise(text)
    position = 0
    for span in spans(whole):
        assert position <= span.start() < span.end() <= len(whole)
        position = span.end()
    tree_of(whole)

"""The outline of READMEs in Markdown, reStructuredText and plain text."""

from __future__ import annotations

import textwrap

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.text.markup import code_spans, own_text, plain_text, read_markdown


def outline(text: str) -> list[tuple[str, int, list[tuple[str, int]]]]:
    """Titles, levels and kinds of blocks with their lines."""
    document = read_markdown(textwrap.dedent(text).lstrip("\n"))
    found = []
    for s in document:
        found.append((s.title, s.level, [(b.kind, b.line) for b in s.blocks]))
    return found


def test_markdown() -> None:
    """Headings, paragraphs, lists, tables and code keep their lines."""
    text = """
    Intro line.

    # Title #
    Some words
    over two lines.

    ## Parts
    - first
      continued
    - second
    1. third

    | a | b |
    |---|---|
    | c | d |

    ```bash
    # not a heading
    ros2 run x y
    ```
    Done.
    """
    assert outline(text) == [
        ("", 0, [("paragraph", 1)]),
        ("Title", 1, [("paragraph", 4)]),
        (
            "Parts",
            2,
            [
                ("item", 8),
                ("item", 10),
                ("item", 11),
                ("row", 13),
                ("row", 15),
                ("code", 18),
                ("paragraph", 21),
            ],
        ),
    ]


def test_restructured_text() -> None:
    """Underlined and overlined headings, code directives and literal blocks are read."""
    text = """
    =====
    Title
    =====

    Parts
    -----
    Words here.

    .. code-block:: bash

       ros2 run x y

    Run it so::

        python3 node.py

    .. image:: a.png
       :width: 3

    Deeper
    ~~~~~~
    More words.
    """
    assert outline(text) == [
        ("Title", 1, []),
        ("Parts", 2, [("paragraph", 7), ("code", 10), ("paragraph", 13), ("code", 15)]),
        ("Deeper", 3, [("paragraph", 22)]),
    ]


def test_plain_text_with_bold_and_html_headings() -> None:
    """A line in bold and an HTML heading are headings too."""
    assert outline(
        "**Publisher**\nSends things.\n\n<h2 align='center'>Service</h2>\nAnswers.\n"
    ) == [
        ("Publisher", 6, [("paragraph", 2)]),
        ("Service", 2, [("paragraph", 5)]),
    ]


def test_comments_and_front_matter_are_left_out() -> None:
    """Text hidden from a reader does not count, and line numbers stay."""
    text = "---\ntitle: x\n---\n<!-- a template\nof words -->\nReal words.\n"
    assert outline(text) == [("", 0, [("paragraph", 6)])]


def test_an_open_fence_runs_to_the_end() -> None:
    """A forgotten fence is no reason to fail."""
    (section,) = read_markdown("```\nros2 run a b\n")
    assert section.blocks[0].text.startswith("ros2 run a b")


def test_own_text_is_what_the_author_wrote() -> None:
    """Links, images, code and markup are taken out, words stay."""
    text = "**Bold** [name](http://a.b/c) ![pic](x.png) `code` https://x.y _it_ <b>tag</b> &amp; snake_case"
    assert own_text(text).split() == ["Bold", "name", "it", "tag", "&", "snake_case"]
    assert "code" in plain_text(text)
    assert code_spans("run `a b` or ``c``") == ["a b", "c"]


@pytest.mark.parametrize(
    "text", ["", "\n\n", "#", "```", "|", "---", "***", "- ", "> ", "=\n=", ".. x::", "<!--"]
)
def test_scraps_are_survived(text: str) -> None:
    """A README of one sign is a README."""
    assert len(read_markdown(text)) <= 1


MARKS = st.sampled_from(
    [
        "# ",
        "- ",
        "* ",
        "\n",
        "\n\n",
        "```",
        "|",
        "--",
        "==",
        "text ",
        "`",
        "**",
        "    ",
        "> ",
        "::",
        ".. code::",
    ]
)


@given(st.one_of(st.text(max_size=400), st.lists(MARKS, max_size=60).map("".join)))
def test_any_text_is_read(text: str) -> None:
    """No text raises, and blocks lie inside the document in order."""
    last = 0
    for block in (block for section in read_markdown(text) for block in section.blocks):
        assert last <= block.line <= text.count("\n") + text.count("\r") + 2
        last = block.line
    own_text(text)
    plain_text(text)

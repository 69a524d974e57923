"""Text of students in GitHub's Markdown is shown as it is, and does nothing; GitHub's own parser renders it here."""

from __future__ import annotations

import re

import pytest
from hypothesis import example, given

from grader.report.escape import line, markdown_text
from tests.report.rendered_markdown import MADE_ACTIVE, Page
from tests.report.untrusted_texts import MEGABYTE, hostile


def assert_inert(page: Page, around: set[str]) -> None:
    """Assert that nothing is there but text, code, and the elements around it, without attributes."""
    assert {tag for tag, _ in page.elements} <= {"code", *around}
    for _, attributes in page.elements:
        assert not attributes
    assert MADE_ACTIVE.search(page.prose) is None


@pytest.mark.parametrize(
    "before", ["", "- ", "> ", "# ", "word\n", "    word\n\n", "| not | a table\n"]
)
@given(hostile)
@example("1. x")
@example("---")
@example(":--|--:")
@example("a|b")
@example("$`x`$")
@example("&commat;me &#64;me")
def test_a_line_is_shown_as_it_is_and_does_nothing(before: str, text: str) -> None:
    """In a paragraph, a list, a quotation, a heading or after another line, only text and code come out of it."""
    page = Page(before + markdown_text(text))
    around = re.sub(r"^[-#>] ", "", before).replace("    ", "")
    assert "".join(page.text.split()) == "".join(f"{around}{line(text, 600)}".split())
    assert_inert(page, {"p", "ul", "li", "blockquote", "h1", "pre"})


@given(hostile, hostile)
@example("a|b", "\\|`")
def test_a_sandbox_of_a_table_is_shown_as_it_is(first: str, second: str) -> None:
    """The text neither leaves its cell nor adds a row, and only text and code are in it."""
    page = Page(f"| h | i |\n|---|---|\n| {markdown_text(first)} | {markdown_text(second)} |\n")
    assert [tag for tag, _ in page.elements if tag in ("tr", "td", "th")] == [
        "tr",
        "th",
        "th",
        "tr",
        "td",
        "td",
    ]
    assert "".join(page.text.split()) == "".join(f"hi{line(first, 600)}{line(second, 600)}".split())
    assert_inert(page, {"table", "thead", "tbody", "tr", "td", "th"})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Messages come at 90.7 Hz, 9.3% slower.", "Messages come at 90.7 Hz, 9.3% slower."),
        ("the node (see joint_publisher.py:31).", "the node (see `joint_publisher.py:31`)."),
        ("calls rclpy.shutdown()", "calls `rclpy.shutdown()`"),
        ("553 messages on /joint_commands", "553 messages on `/joint_commands`"),
        ("|error| <b> 2*3", "&#124;error&#124; &#60;b&#62; 2&#42;3"),
        ("a|b@c", "`a`&#124;`b@c`"),
        ("Größe 大小", "Größe 大小"),
        ("", ""),
    ],
)
def test_it_reads_well(text: str, expected: str) -> None:
    """Prose stays prose, and names are set as code."""
    assert markdown_text(text) == expected


def test_a_megabyte_is_cut() -> None:
    """The text is bounded, whatever a student wrote."""
    assert len(markdown_text(MEGABYTE)) < 5_000


@pytest.mark.parametrize(
    "text", ["a@b.example", "http://a.example", "<b>x</b>", "[a](http://b)", "`x`", "*x*", "@me"]
)
def test_the_parser_would_make_something_of_it(text: str) -> None:
    """Without the function, each of these is more than text, so that the tests above can fail."""
    page = Page(text)
    assert page.elements != [("p", ())] or MADE_ACTIVE.search(page.prose)

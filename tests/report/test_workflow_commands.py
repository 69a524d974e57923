"""No text of a student is a workflow command, and the runner reads the grader's own texts back unchanged."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from grader.report.escape import (
    command_data,
    command_property,
    line,
    shown,
    terminal_text,
    uncommanded,
)
from tests.report.runner_commands import bracket_command, colon_command
from tests.report.untrusted_texts import MEGABYTE, hostile


@pytest.mark.parametrize(
    "printed",
    [
        "::error::x",
        "  ::error file=a::x",
        "\u2003::ADD-MASK::x",
        "::a b=c,d=e::",
        "::stop-commands::tok",
    ],
)
def test_the_reader_of_commands_knows_commands(printed: str) -> None:
    """The reader in these tests finds the commands that the runner obeys."""
    assert colon_command(printed) is not None


def test_the_reader_of_brackets_knows_commands() -> None:
    """The old form is found anywhere in a line."""
    assert bracket_command("x ##[error]y") is not None
    assert bracket_command("x ##vso[task.setvariable variable=a]y") is not None
    assert bracket_command("x ##[ y") is None


@given(hostile, st.integers(2, 400))
@example("a ::error::b ##[error]c", 400)
@example(":::error::x::", 400)
@example("::error file=a.py,line=1::x", 400)
def test_printed_text_is_no_command_wherever_its_lines_are_broken(text: str, limit: int) -> None:
    """A table may break the text before any character; none of the lines begins or holds a command."""
    printed = terminal_text(text, limit)
    assert len(printed) <= limit
    assert bracket_command(printed) is None
    assert [n for n in range(len(printed)) if colon_command(printed[n:])] == []


@given(hostile, hostile)
@example("100%25 %0A::error::x\r\ny", "a,b:c%3A")
def test_a_command_with_hostile_texts_is_read_as_meant(data: str, value: str) -> None:
    """The runner reads one command with one property from it, and the texts as they are shown."""
    command = f"::warning title={command_property('t' + value)}::{command_data(data)}"
    assert len(command.splitlines()) == 1
    read = colon_command(command)
    assert read is not None
    assert (read.name, list(read.properties)) == ("warning", ["title"])
    assert read.properties["title"] == line("t" + value, 4000)
    assert read.data == uncommanded(shown(data))
    assert bracket_command(read.data) is None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("terminate called: std::bad_alloc", "terminate called: std::bad_alloc"),
        ("test_a.py::test_b", "test_a.py::test_b"),
        ("::error::x", ": :error::x"),
        ("##[group]", "## [group]"),
        ("### heading, a[1]", "### heading, a[1]"),
    ],
)
def test_ordinary_text_stays(text: str, expected: str) -> None:
    """Only text that could be a command is parted."""
    assert uncommanded(text) == expected


def test_a_megabyte_is_cut() -> None:
    """Neither a message nor a property grows with a student's text."""
    assert len(command_data(MEGABYTE)) < 20_000
    assert len(command_property(MEGABYTE, 200)) < 1_000

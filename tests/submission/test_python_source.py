"""Python files are parsed as Python does, within bounds that no human-written file exceeds."""

from __future__ import annotations

import ast

import pytest

from grader.submission.python_source import parse_python


@pytest.mark.parametrize(
    "text", ["x = 1", "f'{a} {b!r:>{width}}'", "x = '''\n{{\n'''", "F = rf'{a}'\n" * 500]
)
def test_a_file_is_parsed(text: str) -> None:
    """A text within bounds gives Python's own tree."""
    assert ast.dump(parse_python(text)) == ast.dump(ast.parse(text))


@pytest.mark.parametrize("quotes", ['"', "'", '"""', "'''"])
@pytest.mark.parametrize("prefix", ["f", "F", "rf", "fR"])
def test_a_string_of_countless_fields_is_refused(prefix: str, quotes: str) -> None:
    """Python takes time by the square of their number, so that it is not asked."""
    with pytest.raises(ValueError, match="fields"):
        parse_python(f"x = {prefix}{quotes}" + "{a}" * 3000 + quotes)


def test_braces_that_are_no_fields_do_no_harm() -> None:
    """A large table of dictionaries is within bounds."""
    assert parse_python("x = [" + "{1: 2}, " * 5000 + "]").body

"""Text of students in JSON can be read by strict parsers."""

from __future__ import annotations

import json
import re

from hypothesis import example, given
from hypothesis import strategies as st

from grader.json_text import json_text
from tests.report.untrusted_texts import MEGABYTE, hostile


@given(hostile)
@example("\ud83d\ude00 is a pair, \ud83d none, \ude00 none")
def test_any_text_comes_back_without_halves_of_pairs(text: str) -> None:
    """Whole characters come back unchanged; half a pair is shown by its number, and can be encoded."""
    written = json_text({"": [text], f"key {text}": 1})
    assert written.isascii()
    read = json.loads(written)[""][0]
    read.encode("utf-8")
    whole = text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")
    assert re.sub(r"⟨U\+D[89A-F][0-9A-F]{2}⟩", "\ufffd", read) == re.sub(
        r"⟨U\+D[89A-F][0-9A-F]{2}⟩", "\ufffd", whole
    )


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_numbers_that_json_lacks_become_null(number: float) -> None:
    """A strict parser reads every number that is written."""
    read = json.loads(json_text([number]), parse_constant=lambda word: word)
    assert read == [number] or (read == [None] and number - number != 0)


def test_a_megabyte_comes_back() -> None:
    """Long text is not cut: the file is the contract."""
    assert len(json.loads(json_text(MEGABYTE))) >= len(MEGABYTE)

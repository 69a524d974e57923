"""Entries of `overrides.yaml` are added and taken out, and all else stays as people wrote it."""

from __future__ import annotations

from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from grader.errors import RubricError
from grader.lab.overrides_text import with_entry, without_entry

ENTRY: dict[str, Any] = {
    "submission": ["alice", "1.10", "no", "0123"],
    "check": "publisher.rate",
    "set": 6,
    "comment": 'He said: "yes" # no',
    "reason": "no",
    "who": "Müller",
    "when": "2026-11-21",
}
WRITTEN = {
    "nothing": "",
    "a remark": "# only\n",
    "no list yet": "overrides:\n",
    "an empty list": "overrides: []   # none\n# yet\n",
    "a list without indent": "# head\noverrides:  # list\n- submission: a # one\n  set: 1\n# tail\n",
    "a list with indent": (
        "overrides:\n    - {submission: a, set: 1}\n    # before b\n    - submission: b\n      reason: |\n"
        "        long\n        text\n    # after\n"
    ),
    "no line's end": "overrides:",
}


def entries(text: str) -> list[Any]:
    """Give the entries that stand in a text."""
    return (yaml.safe_load(text) or {}).get("overrides") or []


@pytest.mark.parametrize("text", WRITTEN.values(), ids=WRITTEN)
def test_an_entry_is_added_at_the_end_and_taken_out(text: str) -> None:
    """Adding entries keeps all lines; taking the entries out again restores the meaning."""
    twice = with_entry(with_entry(text, ENTRY), {**ENTRY, "set": 5})
    assert entries(twice) == [*entries(text), {**ENTRY, "when": "2026-11-21"}, {**ENTRY, "set": 5}]
    kept = [line.replace("[] ", "").split() for line in text.splitlines()]
    assert [line.split() for line in twice.splitlines()][: len(kept)] == kept or not kept
    number = len(entries(text))
    back = without_entry(without_entry(twice, number), number)
    assert entries(back) == entries(text)


def test_the_comments_of_others_survive() -> None:
    """Also those right before and after an entry that is taken out."""
    text = WRITTEN["a list with indent"]
    assert (
        without_entry(text, 1)
        == "overrides:\n    - {submission: a, set: 1}\n    # before b\n    # after\n"
    )
    assert without_entry(text, 0).startswith("overrides:\n    # before b\n    - submission: b\n")


def test_a_list_in_one_line_is_left_as_it_is() -> None:
    """A list in one line is refused, with the form to write instead."""
    with pytest.raises(RubricError, match="no entry can be added"):
        with_entry("overrides: [{submission: a}]\n", ENTRY)


@given(
    st.text(st.characters(blacklist_categories=["Cs", "Cc", "Zl", "Zp"]), min_size=1, max_size=80)
)
def test_any_text_is_read_back(text: str) -> None:
    """Whatever a person writes."""
    line = " ".join(text.split())
    added = with_entry(WRITTEN["a list with indent"], {**ENTRY, "comment": line})
    assert entries(added)[2]["comment"] == line
    assert without_entry(added, 2) == WRITTEN["a list with indent"]

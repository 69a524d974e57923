"""Messages to people, and names in the code, use the terms of the field instead of our own."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from tests.packages import modules

ROOT = Path(__file__).resolve().parents[1]
#: Words that nobody uses so but we did, and the plain one. Each is meant where it stands in a text for people.
NOT_SAID = {
    r"\bmend(s|ed|ing)?\b": "fix, work around",
    r"\bhangs? on\b": "depends on",
    r"kept? .{0,30}from (a|its|the) core|held up|stood still|starved?": "the computer was too busy",
    r"\bstrays?\b|\bleavings\b|left behind": "orphan, stale",
    r"\bcensus\b|\bspoil(t|s|ed)?\b|\bstrangers?\b|\btouched\b": "interfered with, invalidated",
    r"\bcells?\b|\bturns?\b": "sandbox, slot",
    r"taken in\b|\btakes? in\b|\bset aside\b|\bput aside\b": "extracted, used",
    r"once is no proof|\b(may|can|that) (be|is) chance\b|\bby chance\b": "a single occurrence is not conclusive",
    r"\bcharged (there|in|elsewhere|above)\b|which may be why|as said above": "costs points in; not tested, because",
    r"not to be had|cannot be had|makes? it anew|broken? off|\bheed(s|ed)?\b": "not available, again, interrupted",
    r"(?<!there )\bis no (number|result|type|time|valid)\b|\bno launch plan\b": "is not a",
    r"\bparcels?\b|\btrials?\b|\bcautions?\b": "bundle, selftest run, warning",
}
#: Parts of names for concepts with an established term; some name a key in recordings.
NOT_NAMED = {
    "handed": "source",
    "told": "reported",
    "mended": "worked_around",
    "chance": "flaky, inconclusive",
    "believed": "may_be_flaky",
    "census": "integrity",
    "strangers": "student_endpoints",
    "spoilt": "invalidated",
    "unrecorded": "gap",
    "starved": "cpu_delay",
    "stood": "stall",
    "spot": "location",
    "spots": "location",
    "lined": "with_lines",
    "waves": "sinusoid",
    "caution": "warning",
    "parcel": "bundle",
    "trial": "selftest",
    "strays": "orphans",
    "remains": "stale",
    "turns": "scheduler",
}
#: Keys of recordings, which keep their names.
RECORDED = {"unrecorded", "mended"}


@pytest.fixture(scope="module")
def messages() -> list[Any]:
    """Give all texts of the product."""
    lister = runpy.run_path(str(ROOT / "tools/messages"))
    return list(lister["messages"](lister["PRODUCT"]))


def test_messages_of_every_kind_are_listed(messages: list[Any]) -> None:
    """Messages of modules, tables, the rubric, pages and their scripts: one of each is listed."""
    kinds = {Path(message.path).suffix for message in messages}
    assert kinds >= {".py", ".yaml", ".j2", ".js"}
    texts = {message.text for message in messages}
    assert "The launch file could not be evaluated." in texts
    assert any(text.startswith("Publishes joint commands") for text in texts)
    assert not any(text.startswith("Lists every text") for text in texts), "a docstring is none"


@pytest.mark.parametrize("words", NOT_SAID, ids=list(NOT_SAID.values()))
def test_no_message_has_a_word_of_our_own(words: str, messages: list[Any]) -> None:
    """The established term is used; the id of the case gives it."""
    found = re.compile(words, re.IGNORECASE)
    assert not [str(message) for message in messages if found.search(message.text)]


#: Names defined in a line: functions and classes, variables and fields, parameters.
_DEFINED = re.compile(
    r"^ *(?:async )?(?:def|class) (\w+)|^ *(?:self\.)?(\w+)(?:: [^=\n]+)? = |[(,] *(\w+): ",
    re.MULTILINE,
)


def test_no_name_has_a_word_of_our_own() -> None:
    """Names defined in the grader use the terms of the glossary."""
    wrong = []
    for path in modules():
        names = set()
        for match in _DEFINED.finditer(path.read_text(encoding="utf-8")):
            names.add("".join(match.groups("")))
        for name in names:
            parts = set(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().split("_"))
            wrong += [
                f"{path.relative_to(ROOT)}: {name}: {NOT_NAMED[p]}"
                for p in parts & NOT_NAMED.keys() - RECORDED
            ]
    assert not wrong

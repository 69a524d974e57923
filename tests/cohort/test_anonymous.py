"""A class without names: no remaining text identifies a student."""

from __future__ import annotations

import dataclasses
import json
from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.cohort.anonymous import HIDDEN, anonymous
from grader.cohort.entries import ClassEntry, report_link
from grader.cohort.statistics import summarise
from grader.recording.submission import Identity, Person
from grader.report import class_page, grades_csv
from tests.cohort.made_up import entry_of, result_of, rubric_of

LAB = rubric_of(("a.topic", 60), ("b.rate", 40))


def entry(name: str, reason: str = "", **more: Any) -> ClassEntry:
    """Give a student with a reason at the first check and a submission of their own."""
    plain = result_of(LAB, [0.5, 1], {"a.topic": reason})
    plain["provenance"]["submission_sha256"] = f"hash of {name}"
    return entry_of(name, plain | {"submission": name} | more, "", report_link(name))


def changed(entry: ClassEntry, **change: Any) -> ClassEntry:
    """Return a student with a changed result."""
    assert entry.result is not None
    return dataclasses.replace(entry, result=dataclasses.replace(entry.result, **change))


def said(*entries: ClassEntry) -> str:
    """Give all that an anonymous class says, as data, page and table, in lower case."""
    hidden = anonymous(entries, LAB)
    summary = summarise(hidden, LAB)
    plain = json.dumps([dataclasses.asdict(e) for e in hidden], default=str, ensure_ascii=False)
    return (plain + class_page.render(summary, anonymous=True) + grades_csv.render(summary)).lower()


@pytest.mark.parametrize(
    ("name", "reason", "left"),
    [
        ("alice", "Node /alice_node died (Alice in alice/pub.py).", ("alice",)),
        ("mueller_anna", "AnnaPublisher, anna_mueller, mueller.", ("mueller", "anna")),
        (
            "Müller, Änne",
            "muller, mueller and Anne, MÜLLER.",
            ("muller", "mueller", "müller", "anne", "änne"),
        ),
        ("o'brien-4711999", "obrien? O'Brien handed in 4711999.", ("o'brien", "4711999")),
        ("Jo Ng", "Jo Ng wrote it.", ("jo ng",)),
        ("kim", "KimPublisher by kim; lab9_kim/x.py.", ("kim",)),
        (
            "\u738b\u4f1f_8",
            "\u8bdd\u9898\u738b\u4f1f\u7684\u8282\u70b9, \u738b\u4f1fNode.",
            ("\u738b\u4f1f",),
        ),
        ("\uae40 \ucca0\uc218", "\uae40\ucca0\uc218\uac00; lab9\ucca0\uc218.", ("\ucca0\uc218",)),
    ],
)
def test_no_part_of_a_name_is_left(name: str, reason: str, left: tuple[str, ...]) -> None:
    """Whole names and their parts go from every text, in any case, with and without marks on their letters."""
    text = said(entry(name, reason), entry("someone", f"Copied from {name}."))
    assert [word for word in left if word in text] == []


def test_short_names_are_hidden_as_words_only() -> None:
    """A student called Ann does not tear holes into planning."""
    hidden = anonymous([entry("ann", "Ann planned AnnNode.")], LAB)
    assert hidden[0].result is not None
    assert hidden[0].result.checks[0].reason == f"{HIDDEN} planned {HIDDEN}Node."


def test_a_korean_name_hides_no_word_that_sounds_alike_at_first() -> None:
    """Syllables are compared whole, not by their first letters."""
    hidden = anonymous([entry("\ucca0\uc218", "\ucca0\uc218, \ucd08\uc18d.")], LAB)
    assert hidden[0].result is not None
    assert hidden[0].result.checks[0].reason == f"{HIDDEN}, \ucd08\uc18d."


def test_words_of_the_rubric_are_no_names() -> None:
    """A submission named after its mistake keeps the reasons readable; its whole name goes."""
    lab = LAB.model_copy(update={"text": "title: the topic has its rate"})
    hidden = anonymous([entry("wrong_topic", "The topic of wrong_topic.")], lab)
    assert hidden[0].result is not None
    assert hidden[0].result.checks[0].reason == f"The topic of {HIDDEN}."


def test_links_ids_times_and_words_of_adjustments_go() -> None:
    """Facts that can be looked up are removed, and counts stay."""
    made = {
        "kind": "extension",
        "what": "due 2026-11-22",
        "points": 0,
        "reason": "surgery",
        "who": "Dr Who",
        "when": "x",
    }
    bonus = {
        "kind": "bonus",
        "what": "score",
        "points": 3,
        "reason": "helped Bob",
        "who": "Dr Who",
        "when": "y",
    }
    known = dataclasses.replace(
        entry(
            "alice",
            adjustments=[made, bonus],
            violations=[{"kind": "spoofs_clock", "session": "s", "text": "alice went out"}],
        ),
        student_id="990017",
        submitted_at=datetime(2026, 11, 20, 21, 7, tzinfo=UTC),
    )
    text = said(known)
    for word in (
        "990017",
        "21:07",
        "surgery",
        "dr who",
        "2026-11-22",
        "helped",
        "report.html",
        "alice",
        "hash of",
    ):
        assert word not in text
    assert "bonus" in text
    assert f"{HIDDEN} went out" in text


def test_no_login_address_or_partner_is_left() -> None:
    """Other identifications of the submitting people are hidden too; words common to many stay."""
    people = (
        Person("Müller, Änne", "0012999", "amu47", "aenne.mu@uni.example", "Monday", "11"),
        Person("Bob O'Brien", login="bobrien3"),
    )
    reason = "amu47 and bobrien3 wrote to aenne.mu@uni.example on Monday: 11 messages of Änne and O'Brien, 0012999."
    text = said(dataclasses.replace(entry("team_red", reason), identity=Identity(people)))
    assert [
        word
        for word in ("amu47", "bobrien3", "aenne", "änne", "o'brien", "0012999", "team_red")
        if word in text
    ] == []
    assert "on monday: 11 messages" in text


def test_problems_of_what_was_not_graded_have_no_names_either() -> None:
    """Why something was not graded is said without the path of a folder that bears the name."""
    assert "carol" not in said(
        ClassEntry("carol", None, "Nothing in /srv/carol.zip", "carol/report.html")
    )


def test_pseudonyms_do_not_follow_the_names_and_need_the_submissions() -> None:
    """The order is not the names' order; it is stable, and another for other submissions."""
    names = [f"student{n:02d}" for n in range(40)]
    entries = [entry(name) for name in names]

    def order(listed: list[ClassEntry]) -> list[int]:
        marked = [changed(e, problems=(str(n),)) for n, e in enumerate(listed)]
        return [int(e.result.problems[0]) for e in anonymous(marked, LAB) if e.result is not None]

    assert order(entries) == order(entries)
    assert order(entries) != sorted(order(entries))
    other = [changed(e, provenance={"submission_sha256": f"new {e.name}"}) for e in entries]
    assert order(entries) != order(other)
    assert [e.name for e in anonymous(entries, LAB)] == [f"Student {n:02d}" for n in range(1, 41)]


def test_the_same_mistakes_stay_the_same() -> None:
    """Hiding names neither joins nor parts mistakes, nor does it change a point."""
    entries = [entry(name, f"Topic /{name} is unknown.") for name in ("alice", "berta", "carol")]
    named, hidden = summarise(entries, LAB), summarise(anonymous(entries, LAB), LAB)
    assert (
        [len(m.made_by) for m in hidden.mistakes] == [len(m.made_by) for m in named.mistakes] == [3]
    )
    assert hidden.spread == named.spread


@given(st.text(min_size=1, max_size=20), st.text(max_size=60), st.text(max_size=60))
def test_a_name_of_four_letters_or_more_never_stays(name: str, before: str, after: str) -> None:
    """Whatever stands around it, and whatever characters it is of."""
    whole = "".join(c for c in name if c.isascii() and c.isalpha()).ljust(4, "q")
    hidden = anonymous([entry(whole, f"{before}{whole}{after}")], LAB)
    assert hidden[0].result is not None
    assert whole.lower() not in hidden[0].result.checks[0].reason.lower().replace(HIDDEN, "\0")

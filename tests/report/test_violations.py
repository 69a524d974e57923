"""Tampering with the grader's own nodes and topics, in the report and on the terminal."""

from __future__ import annotations

import dataclasses
import io
from decimal import Decimal
from html.parser import HTMLParser

from rich.console import Console

from grader.evidence.recorded import Recorded
from grader.recording.session import SessionRecord
from grader.recording.submission import SubmissionRecord
from grader.report.submission_page import render
from grader.report.terminal import print_result
from grader.report.views import EXPLANATION, HEADING
from grader.result import (
    CheckResult,
    CriterionResult,
    Finding,
    Location,
    Outcome,
    Result,
    Score,
    Violation,
    ViolationKind,
)
from ros_bag.reading import Bag

EVIL = "<script>\x1b[2J\u202e"
SPOOFED = Violation(
    ViolationKind.SPOOFS_CLOCK,
    "launch",
    "The submission (/node) published time on /clock.",
    ("9 messages", "publisher of node /node, gid 0b"),
    Location(session="launch", topic="/clock", start_s=1.2, end_s=4.5),
    True,
    ("a.together",),
)
ENDED = Violation(ViolationKind.ENDS_REFERENCE, "launch", "The arm ended.", (EVIL,), certain=False)


def result(*violations: Violation) -> Result:
    """Give a result with one check."""
    zero = Decimal(0)
    finding = Finding(Outcome.FAILED, zero, reason="not measured")
    check = CheckResult.of(
        finding,
        id="a.together",
        title="Together",
        session="launch",
        earned=zero,
        possible=Decimal(2),
        undecided=zero,
    )
    criterion = CriterionResult("a", "A", zero, Decimal(2), zero, (check,))
    return Result(
        "ann",
        "Lab 1",
        Score(Decimal(0), Decimal(2), Decimal(0)),
        (criterion,),
        violations=violations,
    )


class Words(HTMLParser):
    """The words of a page that can be seen."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self._hidden = False
        self.text = ""
        self.feed(page)
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag: str, attributes: object) -> None:
        """Pass over style and script."""
        self._hidden = tag in ("style", "script")

    def handle_endtag(self, tag: str) -> None:
        """Go on after style and script."""
        self._hidden = False

    def handle_data(self, data: str) -> None:
        """Keep visible text."""
        self.text += "" if self._hidden else data


def page(*violations: Violation) -> str:
    """Render the report."""
    return render(
        result(*violations),
        {},
        {"launch": Recorded(SessionRecord("launch"), Bag.empty())},
        SubmissionRecord("ann"),
    )


def test_the_report_begins_with_what_was_tampered_with() -> None:
    """Before all points the report has the violation, its session and evidence, and the check that fails because of it."""
    words = Words(page(SPOOFED)).text
    assert HEADING in words
    assert EXPLANATION in words
    shown = words[words.index(HEADING) : words.index("What to fix first")]
    assert "published time on /clock. recording 'launch', /clock, 1.2–4.5 s" in shown
    assert "9 messages" in shown
    assert "Fails because of it: Together." in shown
    assert 'href="#check-a.together"' in page(SPOOFED)


def test_a_report_on_an_honest_submission_does_not_speak_of_it() -> None:
    """Nothing is there to be read where nothing was tampered with."""
    assert HEADING not in Words(page()).text


def test_what_is_not_certain_says_so() -> None:
    """No check fails for it, and the cause stays open."""
    words = Words(page(ENDED)).text
    assert "The arm ended. What caused it is not certain." in words
    assert "Fails because of it" not in words


def printed(*violations: Violation) -> str:
    """Return the terminal's text."""
    file = io.StringIO()
    print_result(Console(file=file, width=200, highlight=False), result(*violations))
    return file.getvalue()


def test_the_terminal_tells_it_too() -> None:
    """The same facts in a few lines."""
    text = printed(SPOOFED, ENDED)
    assert (
        "For the instructor: The submission (/node) published time on /clock. (session launch)"
        in text
    )
    assert "• 9 messages" in text
    assert "Fails because of it: Together" in text
    assert "What caused it is not certain." in text


def test_names_of_students_are_shown_safely() -> None:
    """Evidence holds names that a student chose: neither page nor terminal obeys them."""
    evil = dataclasses.replace(SPOOFED, text=EVIL, evidence=(EVIL,), session=EVIL)
    assert "<script>\x1b" not in page(evil)
    assert "&lt;script&gt;" in page(evil)
    assert not {"\x1b", "\u202e"} & set(page(evil) + printed(evil))

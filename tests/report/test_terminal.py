"""The result on the terminal: its contents, and the harmlessness of student text in it."""

from __future__ import annotations

import io
import re
import unicodedata
from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from grader.report.escape import terminal_text
from grader.report.terminal import ProgressDisplay, print_result
from grader.report.views import points
from grader.result import (
    CheckResult,
    ChosenFile,
    CriterionResult,
    Finding,
    Location,
    Outcome,
    Result,
    Score,
)

EVIL = "\x1b[2J\x1b]0;owned\x07[red]x[/red][link=http://a]\r\x9b31m\u202eabc\x00\ud800"


def finding(
    outcome: Outcome, reason: str = "too slow", hint: str = "use a timer", file: str = "a.py"
) -> Finding:
    """Give a finding of an outcome."""
    return Finding(
        outcome,
        Decimal(0),
        "",
        "",
        reason,
        hint,
        (Location(file=file, line=3), Location(session="s")),
    )


def result(*findings: Finding, name: str = "ann", advice: str = "", problem: str = "") -> Result:
    """Return a result with checks of 5 points each, earned if passed."""
    checks = []
    for number, each in enumerate(findings):
        if each.outcome is Outcome.PASSED:
            earned = Decimal(5)
        else:
            earned = Decimal(0)
        undecided = Decimal(0) if each.outcome.decided else Decimal(5)
        points = {"earned": earned, "possible": Decimal(5), "undecided": undecided}
        checks.append(
            CheckResult.of(each, id=f"a.{number}", title=f"Check {number}", session="s", **points)
        )
    sums = []
    for key in ("earned", "possible", "undecided"):
        sums.append(sum((getattr(c, key) for c in checks), Decimal(0)))
    criterion = CriterionResult("a", "Criterion", sums[0], sums[1], sums[2], tuple(checks))
    return Result(
        name,
        "Lab 1",
        Score(*sums),
        (criterion,),
        (advice,) if advice else (),
        (problem,) if problem else (),
    )


def printed(shown: Result, terminal: bool = False) -> str:
    """Return the printed text of a result."""
    file = io.StringIO()
    print_result(Console(file=file, width=100, force_terminal=terminal, highlight=False), shown)
    return file.getvalue()


def test_each_lost_point_has_its_reason() -> None:
    """Checks that did not pass are shown with reason, hint and line; those that passed are not."""
    text = printed(
        result(finding(Outcome.PASSED), finding(Outcome.FAILED), finding(Outcome.NOT_REACHED))
    )
    assert "Check 0" not in text
    assert re.search(r"✕ +Check 1", text)
    assert "too slow" in text
    assert "→ use a timer" in text
    assert text.count("try again: grade . --sessions s") == 1
    assert "a.py:3" in text
    assert re.search(r"– +Check 2", text)
    assert "5 / 15" in text


def test_what_one_failure_hides_is_one_row() -> None:
    """Checks that were not reached for the same reason share it, with the sum of their points."""
    hidden = finding(Outcome.NOT_REACHED, "since 'Check 0' failed", "")
    text = printed(
        result(
            finding(Outcome.FAILED),
            hidden,
            hidden,
            finding(Outcome.NOT_REACHED, "for another reason", ""),
        )
    )
    assert re.search(r"– +Check 1, Check 2  a.1, a.2 +0 / 10", text)
    assert re.search(r"– +Check 3  a.3 +0 / 5", text)
    assert text.count("since 'Check 0' failed") == 1


def test_long_advice_stays_under_its_bullet() -> None:
    """The rest of a long line continues below the bullet, not at the margin."""
    lines = printed(result(finding(Outcome.PASSED), advice="word " * 30)).splitlines()
    after = lines[next(n for n, text in enumerate(lines) if "•" in text) :]
    assert len(after) > 1
    for text in after:
        assert text.startswith("  ")


def test_what_is_undecided_is_not_shown_as_lost() -> None:
    """Undecided points are asked, not subtracted, and told apart."""
    text = printed(result(finding(Outcome.INCONCLUSIVE), finding(Outcome.ERROR)))
    assert text.count("? / 5") == 2
    assert "0 now, up to 10: 10 points are undecided." in text


def test_of_several_files_of_one_name_the_graded_one_is_told_first() -> None:
    """The graded file, the reason, and the other files stand above the table; an open choice asks a person to look."""
    sure = ChosenFile("a.py", "new/a.py", ("old/a.py",), "new/ holds 3 of the lab's files, old/ 2")
    unsure = ChosenFile("b.py", "v1/b.py", tuple(f"v{n}/b.py" for n in range(2, 9)), "", True)
    text = printed(replace(result(finding(Outcome.FAILED)), chosen=(sure, unsure)))
    words = "new/a.py was graded, because new/ holds 3 of the lab's files, old/ 2. Not graded: old/a.py."
    head, table, _ = " ".join(text.split()).partition("ann: ")
    assert table
    assert words in head
    assert "v6/b.py and 2 more. Your instructor is asked to look." in head


def test_advice_and_problems_are_shown() -> None:
    """Advisories cost nothing and say so; the grader's problems are named as its own."""
    text = printed(result(finding(Outcome.PASSED), advice="try_shutdown", problem="cut off"))
    assert "Costs nothing, but worth knowing:" in text
    assert "• try_shutdown" in text
    assert "Grader: cut off" in text


@pytest.mark.parametrize("terminal", [False, True])
def test_escape_sequences_of_students_are_not_obeyed(terminal: bool) -> None:
    """Neither reasons, hints, file names, advice nor the submission's name can steer the terminal or its markup."""
    evil = finding(Outcome.FAILED, EVIL, EVIL, EVIL)
    text = printed(result(evil, name=EVIL, advice=EVIL, problem=EVIL), terminal)
    assert "\x1b[2J" not in text
    assert "\x1b]" not in text
    assert not {"\x07", "\r", "\x9b", "\u202e", "\x00", "\ud800"} & set(text)
    assert text.count("[red]x[/red]") >= 4
    if not terminal:
        assert "\x1b" not in text


@given(st.text(), st.integers(2, 50))
def test_terminal_text_has_nothing_but_what_prints(text: str, limit: int) -> None:
    """Whatever the text, nothing that is not seen is left but joiners of letters, and its length is bounded."""
    shown = terminal_text(text, limit)
    assert len(shown) <= limit
    hidden = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
    assert not {unicodedata.category(c) for c in shown if c not in "\u200c\u200d"} & hidden


def test_plain_text_is_shown_as_it_is() -> None:
    """Words of any language stay; line ends become spaces; a cut text has a mark."""
    assert terminal_text("Größe 大小 ✓\n\tx") == "Größe 大小 ✓ x"
    assert terminal_text("abcdef", 4) == "abc…"
    assert terminal_text("a\x1b[0m\u200b\x1b") == "a⟨U+200B⟩⟨U+001B⟩"


@pytest.mark.parametrize(
    ("value", "shown"), [("0", "0"), ("0.0", "0"), ("5.0", "5"), ("2.50", "2.5"), ("100", "100")]
)
def test_points_have_no_needless_zeros(value: str, shown: str) -> None:
    """Points are written as a person would."""
    assert points(Decimal(value)) == shown


def test_progress_without_a_terminal_is_a_line_a_session() -> None:
    """In a log, a session is named once, when it has ended."""
    file = io.StringIO()
    console = Console(file=file, width=100, force_terminal=False)
    with ProgressDisplay(console, "ann", ["one", "two"]) as display:
        display.note("one", "starting", 1, 3, False)
        display.note("one", "recorded", 3, 3, True)
    lines = file.getvalue().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("  one: recorded")


def test_progress_on_a_terminal_shows_each_session() -> None:
    """In place, sessions that wait, run and have ended are told apart, and names cannot steer the terminal."""
    file = io.StringIO()
    console = Console(file=file, width=100, force_terminal=True)
    with ProgressDisplay(console, EVIL, ["one", "two", "three"]) as display:
        display.note("one", EVIL, 1, 3, False)
        display.note("two", "recorded", 3, 3, True)
        console.print(display._table())
    text = file.getvalue()
    assert "(1 of 3)" in text
    assert "in the queue" in text
    assert "\x1b[2J" not in text
    assert "\x1b]0;owned" not in text

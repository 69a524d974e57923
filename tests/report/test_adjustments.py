"""Adjustments where students read them: the page, the terminal, and `result.json` by its schema."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from decimal import Decimal
from html import unescape
from pathlib import Path

import jsonschema
import pytest
from rich.console import Console

from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.recording.submission import SubmissionRecord
from grader.report import submission_page
from grader.report.terminal import print_result
from grader.report.views import adjustments_of, final_share
from grader.result import (
    Adjustment,
    AdjustmentKind,
    Result,
    number,
    result_schema,
    to_json,
    to_plain,
)
from tests.report.untrusted_texts import FRAGMENTS

KEPT = Path(__file__).resolve().parents[1] / "recordings"
SCHEMA = result_schema()


def adjustment(
    kind: AdjustmentKind, what: str, points: str, reason: str = "so it was", who: str = "J. Smith"
) -> Adjustment:
    """Give an adjustment."""
    return Adjustment(kind, what, Decimal(points), reason, who, "2026-11-21" if who else "")


@pytest.fixture(scope="module")
def judged() -> Result:
    """Give the result of a submission without a service file."""
    rubric = read_rubric(None)
    return judge(open_recordings(KEPT / "missing_service_file", rubric), rubric)


@pytest.fixture(scope="module")
def adjusted(judged: Result) -> Result:
    """Give it with an adjustment of each kind."""
    changes = (
        adjustment(AdjustmentKind.POINTS, "publisher.rate", "-1.5"),
        adjustment(AdjustmentKind.EXCUSED, "documentation", "7.6"),
        adjustment(AdjustmentKind.REVIEWED, "score", "0"),
        adjustment(
            AdjustmentKind.APPEAL, "publisher.rate", "0", "My timer is <b>right</b>.", "ann"
        ),
        adjustment(AdjustmentKind.BONUS, "score", "3"),
        adjustment(AdjustmentKind.SUBMITTED, "2026-11-22 10:00 +01:00", "0"),
        adjustment(AdjustmentKind.EXTENSION, "due 2026-11-21 23:59 +01:00", "0"),
        adjustment(AdjustmentKind.LATE, "score", "-2.4", "Handed in late.", ""),
    )
    return replace(judged, adjustments=changes)


def page_of(result: Result) -> str:
    """Give the report of a result without recordings."""
    return submission_page.render(result, {}, {}, SubmissionRecord("ann"))


def words_of(page: str) -> str:
    """Give a page's words, without its elements."""
    return " ".join(
        unescape(
            re.sub(r"<style>.*?</style>|<script>.*?</script>|<[^>]*>", " ", page, flags=re.DOTALL)
        ).split()
    )


def printed(result: Result) -> str:
    """Return the terminal's text in one line."""
    file = io.StringIO()
    print_result(Console(file=file, width=200, highlight=False), result)
    return " ".join(file.getvalue().split())


# -- the page --------------------------------------------------------------------------------------


def test_the_page_shows_final_points_and_what_was_judged(judged: Result, adjusted: Result) -> None:
    """The large number has all adjustments, the judged one stands beside it, and the title agrees."""
    earned, possible = judged.score.earned, judged.score.possible
    final = earned + Decimal("6.7")
    page = page_of(adjusted)
    assert f"{final} of {number(possible)} points" in words_of(page)
    assert f"{number(earned)} as judged; adjusted" in words_of(page)
    assert re.search(rf"<title>[^<]*: {re.escape(str(final))} of", page)


def test_each_adjustment_says_what_why_and_who(adjusted: Result) -> None:
    """Each adjustment is a row: points with their sign, title of the check, reason, name and date."""
    words = words_of(page_of(adjusted))
    assert "−1.5 Commands arrive at 100 Hz so it was J. Smith, 2026-11-21" in words
    assert "+7.6 Documentation: excused" in words
    assert "+3 Bonus" in words
    assert "±0 Handed in 2026-11-22 10:00 +01:00" in words
    assert "±0 Extension: due 2026-11-21 23:59 +01:00" in words
    assert "−2.4 Late Handed in late. the lab's rule" in words


def test_adjustments_link_to_what_they_concern(adjusted: Result) -> None:
    """A check and a criterion are a click away, and the links lead somewhere."""
    page = page_of(adjusted)
    hrefs = [view.href for view in adjustments_of(adjusted) if view.href]
    assert hrefs == ["#check-publisher.rate", "#criterion-documentation", "#check-publisher.rate"]
    for href in [*hrefs, "#adjustments"]:
        assert f'id="{href[1:]}"' in page


def test_without_adjustments_nothing_is_said_of_them(judged: Result) -> None:
    """The page of an ordinary result has no section for them."""
    page = page_of(judged)
    assert 'id="adjustments"' not in page
    assert "as judged" not in words_of(page)


def test_more_than_is_possible_is_still_a_bar(judged: Result) -> None:
    """A bonus beyond the rubric's points is written out, and the bar is full."""
    beyond = replace(judged, adjustments=(adjustment(AdjustmentKind.BONUS, "score", "50"),))
    share = final_share(beyond)
    assert share.earned == str(number(judged.score.earned + 50))
    assert (share.earned_part, share.undecided_part) == ("100.00", "0.00")


@pytest.mark.parametrize("first", range(0, len(FRAGMENTS), 25))
def test_whatever_people_write_is_only_text(judged: Result, first: int) -> None:
    """Reasons and names are text on the page and in the terminal, whatever stands in them."""
    evil = "".join(FRAGMENTS[first : first + 25])
    changes = tuple(adjustment(kind, "publisher.rate", "1", evil, evil) for kind in AdjustmentKind)
    hostile = replace(judged, adjustments=changes)
    page = page_of(hostile)
    page.encode()
    assert "<script>alert" not in page
    assert not re.search("[\x00\x1b\x9b\u202e]", page)
    assert not re.search("[\x00\x1b\x9b\u202e]", printed(hostile))


# -- the terminal ----------------------------------------------------------------------------------


def test_the_terminal_shows_them_below_the_sum(judged: Result, adjusted: Result) -> None:
    """First come the points as judged, then each adjustment, and at last the final points."""
    text = printed(adjusted)
    before = f"{number(judged.score.earned)} / {number(judged.score.possible)}"
    after = f"With all adjustments {number(adjusted.final)} / {number(adjusted.score.possible)}"
    assert (
        text.index(before)
        < text.index("Commands arrive at 100 Hz −1.5")
        < text.index("Late −2.4")
        < text.index(after)
    )
    assert "so it was (J. Smith, 2026-11-21)" in text
    assert "With all adjustments" not in printed(judged)


# -- result.json -----------------------------------------------------------------------------------


def test_the_schema_describes_results(judged: Result, adjusted: Result) -> None:
    """Results with and without adjustments are valid; the points agree."""
    for result in (judged, adjusted):
        plain = json.loads(to_json(result))
        jsonschema.Draft202012Validator(SCHEMA).validate(plain)
        assert plain["score"]["final"] == float(result.final)
    assert to_plain(judged)["adjustments"] == []
    assert [a["kind"] for a in to_plain(adjusted)["adjustments"]] == [
        kind.value for kind in AdjustmentKind
    ]
    assert to_plain(adjusted)["adjustments"][0] == {
        "kind": "points",
        "what": "publisher.rate",
        "points": -1.5,
        "reason": "so it was",
        "who": "J. Smith",
        "when": "2026-11-21",
        "comment": "",
    }


def test_question_and_answer_stand_at_their_check(judged: Result) -> None:
    """Appeals and decisions stand in their order, with their authors, also at passed checks and at a criterion."""
    answer = replace(
        adjustment(AdjustmentKind.POINTS, "publisher.rate", "-1", "", "J. Smith"),
        comment="It is 94 Hz.",
    )
    told = replace(
        adjustment(AdjustmentKind.REVIEWED, "publisher", "0", "", "J. Smith"),
        comment="Well structured.",
    )
    asked = adjustment(
        AdjustmentKind.APPEAL, "publisher.rate", "0", "My timer is <b>right</b>.", "ann"
    )
    page = page_of(replace(judged, adjustments=(asked, answer, told)))
    section = page[page.index('id="check-publisher.rate"') :]
    words = words_of(section[:6000])
    assert words.index("Appeal ann, 2026-11-21 My timer is <b>right</b>.") < words.index(
        "It is 94 Hz."
    )
    assert "Well structured." in words_of(page[page.index('id="criterion-publisher"') :])[:600]
    assert "Ask about this" in words


@pytest.mark.parametrize("key", ["score.final", "adjustments"])
def test_the_schema_asks_for_what_is_always_there(judged: Result, key: str) -> None:
    """A result without final points, or without adjustments, is no result of this version."""
    plain = json.loads(to_json(judged))
    if key == "adjustments":
        del plain[key]
    else:
        del plain["score"]["final"]
    assert not jsonschema.Draft202012Validator(SCHEMA).is_valid(plain)

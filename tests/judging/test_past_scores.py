"""A result names the points of the previous submissions."""

from __future__ import annotations

import json
from decimal import Decimal

from grader.judging.past_scores import MOST, with_past
from grader.recording.submission import SubmissionRecord
from grader.report.submission_page import render
from grader.result import Result, Score, SessionProvenance, read_result, to_json


def scored(earned: float, started_ns: int = 0) -> Result:
    """Make a result of 10 possible points, recorded at a time."""
    points = Decimal(str(earned))
    result = Result("ada", "Lab", Score(points, Decimal(10), Decimal(0)), ())
    if started_ns:
        session = SessionProvenance(started_ns=started_ns, duration_s=1.0, isolation="full")
        result.provenance["sessions"] = {"alone": session}
    return result


def test_a_first_submission_names_none() -> None:
    """Nothing is added to it."""
    assert with_past(scored(3), None) == scored(3)


def test_each_submission_adds_its_points() -> None:
    """The list is kept in the result itself, also in its text."""
    second = with_past(scored(5, 2_000), scored(3, 1_000))
    third = with_past(scored(7.5, 3_000), read_result(json.loads(to_json(second))))
    listed = [(past["recorded_ns"], past["earned"]) for past in third.provenance["previous"]]
    assert listed == [(1_000, 3), (2_000, 5)]


def test_the_list_has_an_end() -> None:
    """Only the newest submissions are named."""
    result = scored(0)
    for number in range(1, MOST + 3):
        result = with_past(scored(number / 10), result)
    earned = [past["earned"] for past in result.provenance["previous"]]
    assert len(earned) == MOST
    assert earned[-1] == (MOST + 1) / 10


def test_the_page_lists_several_previous_submissions() -> None:
    """A single one is told by the changes."""
    first, second = scored(3, 10**18), with_past(scored(5, 2 * 10**18), scored(3, 10**18))
    assert "oldest first" not in page(second, first)
    third = with_past(scored(7.5), second)
    assert "oldest first" in page(third, second)
    assert "<td>3 / 10</td>" in page(third, second)
    assert "2001-09-09 01:46 UTC" in page(third, second)


def page(result: Result, before: Result) -> str:
    """Render a result without recordings."""
    submission = SubmissionRecord("ada")
    return render(result, {}, {}, submission, before)

"""The job summary: its parsed form in GitHub, the order by worth, and GitHub's limit on size."""

from __future__ import annotations

import re
from collections import Counter

import pytest
from hypothesis import HealthCheck, given, settings

from grader.report.exports.github_summary import LONGEST_BYTES, fitting
from tests.report.exports.sample_results import (
    adjusted_and_tampered,
    every_outcome,
    exported,
    hostile_results,
    megabyte_result,
)
from tests.report.rendered_markdown import MADE_ACTIVE, Page

#: Elements of the summary itself.
_OWN = {"h1", "h2", "h3", "p", "ul", "li", "strong", "code", "blockquote", "details", "summary"}
_OWN |= {"table", "thead", "tbody", "tr", "th", "td"}


def test_each_lost_point_has_its_reason_and_proof() -> None:
    """The costliest loss comes first, with expectation, measurement, place and remedy."""
    page = Page(exported("github-summary", every_outcome()))
    assert "Lab 1: One: 7.5 of 20 points" in page.text
    parts = page.text.split("What cost points")[1]
    assert re.findall(r"[✕◐] Title of (\S+): −(\S+) points", parts) == [
        ("b.failed", "3"),
        ("a.partial", "2.5"),
    ]
    for said in (
        "Reason of a.partial.",
        "Expected: 100 Hz",
        "Measured: 90 Hz",
        "Where: a.partial.py:3",
        "Hint: Use",
    ):
        assert said in parts


def test_what_was_not_reached_comes_after_its_cause() -> None:
    """A check that was not reached costs points too, but is not the mistake itself."""
    text = Page(exported("github-summary", every_outcome())).text
    assert (
        "b.missed (−2 points): Reason of b.missed."
        in text.split("Not tested, because of the above")[1]
    )


def test_undecided_points_are_said_on_top_and_not_counted_as_lost() -> None:
    """Undecided points stand on top, because they are the grader's matter and not lost."""
    text = Page(exported("github-summary", every_outcome())).text
    assert "5 points are undecided, and not earned before they are" in text.split("Criterion")[0]
    assert "b.open (3 points): The machine was busy." in text.split("Undecided, not earned")[1]
    assert "b.open" not in text.split("What cost points")[1].split("##")[0].split("Undecided")[0]


def test_adjustments_and_violations_are_reported() -> None:
    """A person's adjustment is listed with its reason, and tampering with its evidence."""
    text = Page(exported("github-summary", adjusted_and_tampered())).text
    assert "11 of 20 points" in text
    assert (
        "+2.5 Title of a.partial: excused: The handout was wrong. (prof@lab.example, 2026-06-01)"
        in text
    )
    assert "−1 Late: A day late." in text
    assert "There was a second server. What caused it is not certain. node /x" in text


def test_unconfined_code_is_said() -> None:
    """A reader sees it when the code ran unconfined."""
    plain = every_outcome()
    assert "unconfined" not in exported("github-summary", plain)
    plain["provenance"]["sessions"]["one"]["isolation"] = "none"
    assert "ran unconfined" in exported("github-summary", plain)


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(hostile_results())
def test_hostile_texts_are_only_text(plain: dict[str, object]) -> None:
    """The page has the summary's own elements, each as often as with harmless texts, and nothing active."""
    page, harmless = (
        Page(exported("github-summary", each)) for each in (plain, adjusted_and_tampered())
    )
    assert {tag for tag, _ in page.elements} <= _OWN
    found, wanted = (Counter(tag for tag, _ in each.elements) for each in (page, harmless))
    for tag in ("h1", "table", "tr", "td", "th", "details", "summary", "blockquote"):
        assert found[tag] == wanted[tag]
    for _, attributes in page.elements:
        assert {name for name, _ in attributes} <= {"align"}
    assert MADE_ACTIVE.search(page.prose) is None


def test_what_does_not_fit_is_left_out_whole() -> None:
    """Parts come whole and in order, and the reader is told that there is more."""
    parts = ["a" * 300, "ü" * 300, "c" * 300]
    assert fitting(parts, 10_000) == "\n".join(parts)
    cut = fitting(parts, 1_000)
    assert cut.startswith(f"{parts[0]}\n{parts[1]}\n*More did not fit")
    assert len(cut.encode()) <= 1_000
    assert fitting(parts, 320).startswith("*More did not fit")


@pytest.mark.slow
def test_a_summary_of_many_long_checks_fits() -> None:
    """GitHub shows nothing of a summary above its limit."""
    plain = megabyte_result()
    plain["criteria"] = plain["criteria"] * 300
    text = exported("github-summary", plain)
    assert len(text.encode()) <= LONGEST_BYTES
    assert text.endswith("*More did not fit here; the report has all.*\n")
    assert Page(text).elements[0][0] == "h1"

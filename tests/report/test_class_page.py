"""The class page: its contents, their order, and the harmlessness of student text in it."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import re
from datetime import datetime, timedelta, timezone
from typing import Any

import pytest

from grader.cohort.anonymous import anonymous
from grader.cohort.entries import ClassEntry, report_link
from grader.cohort.statistics import ClassSummary, summarise
from grader.judging.adjust import adjust
from grader.judging.rubrics import read_rubric
from grader.lab.overrides import Override
from grader.lab.policy import LatePolicy, SubmissionTime
from grader.lab.rubric import Rubric
from grader.report.class_page import render
from tests.cohort.made_up import entry_of, result_of, rubric_of
from tests.report.taken_apart import Page
from tests.sample_class import sample_class

LAB = rubric_of(("pub.topic", 12), ("pub.rate", 8), ("doc.readme", 10))
EVIL = "\"'><script>alert(1)</script></style></table><img src=x onerror=alert(2)>{{ 7*7 }}\x1b[31m\u202e\x00\ud800"


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


@pytest.fixture(scope="module")
def entries(rubric: Rubric) -> list[ClassEntry]:
    """Give a class of forty."""
    return sample_class(rubric)


@pytest.fixture(scope="module")
def summary(rubric: Rubric, entries: list[ClassEntry]) -> ClassSummary:
    """Give the class of forty in numbers."""
    return summarise(entries, rubric)


def entry(
    name: str, credits: list[float | None], reasons: dict[str, str] | None = None, **more: Any
) -> ClassEntry:
    """Give a student with a report."""
    return entry_of(
        name,
        result_of(LAB, credits, reasons) | more,
        report=report_link(name.replace("\ud800", "")),
    )


def page_of(*entries: ClassEntry) -> Page:
    """Give the page of a class, taken apart."""
    return Page(render(summarise(entries, LAB)))


def rows_of(page: Page) -> list[dict[str, str]]:
    """Give the attributes of the students' rows."""
    found = []
    for tag, attributes in page.elements:
        if tag == "tr" and "data-codes" in attributes:
            found.append(attributes)
    return found


# -- the page as a file ------------------------------------------------------------------------


def source_of(part: str) -> str:
    """Return the source expression that allows a style or script by its hash."""
    digest = hashlib.sha256(part.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def policy_of(page: Page) -> str:
    """Return the page's content security policy."""
    (policy,) = (
        attributes["content"]
        for _, attributes in page.elements
        if attributes.get("http-equiv") == "Content-Security-Policy"
    )
    return policy


def test_the_page_needs_nothing_else(summary: ClassSummary) -> None:
    """Its policy allows its own style and script by their hashes; nothing is loaded, nothing is styled in place."""
    page = Page(render(summary))
    style, script = map(source_of, page.scripts)
    assert policy_of(page) == (
        f"default-src 'none'; style-src {style}; script-src {script}; base-uri 'none'; form-action 'none'"
    )
    assert page.tags().isdisjoint({"link", "img", "iframe", "object", "base"})
    assert not page.values("style")
    for _, attributes in page.elements:
        assert not [name for name in attributes if name.startswith("on")]
    assert not re.search(r"url\(|@import|https?:", "".join(page.scripts))
    outside = [href for href in page.values("href") if not href.startswith("#")]
    assert {
        re.sub(r"^[a-z%A-Z0-9_]+/report\.html(#check-[a-z._]+|#tampering)?$", "", href)
        for href in outside
    } == {""}


def test_the_same_class_gives_the_same_bytes(summary: ClassSummary) -> None:
    """Nothing of the page depends on time or chance."""
    assert render(summary) == render(summary)


def test_all_that_is_pointed_at_is_there(summary: ClassSummary) -> None:
    """Ids are unique, and each label, description and link within the page has its target."""
    page = Page(render(summary))
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    pointed = [href[1:] for href in page.values("href") if href.startswith("#")]
    for key in ("aria-labelledby", "aria-describedby", "for"):
        pointed += " ".join(page.values(key)).split()
    assert set(pointed) - set(ids) == set()
    assert any(name.startswith("adjusted-") for name in pointed)


def test_two_hundred_students_make_a_page_that_can_be_mailed(rubric: Rubric) -> None:
    """The page grows with the class, and stays below a megabyte."""
    assert len(render(summarise(sample_class(rubric, 200), rubric)).encode()) < 1_000_000


# -- contents ----------------------------------------------------------------------------------


def test_each_student_has_a_row_with_the_outcomes_of_criteria_and_checks() -> None:
    """A row has letters for the criteria, then for the checks, a link to the report, and a mark if a person must look."""
    page = page_of(
        entry("alice", [1, 0.5, None]),
        entry("bob", [0, 0, 1]),
        ClassEntry("carol", None, "Her archive is broken."),
    )
    rows = rows_of(page)
    assert [row["data-codes"] for row in rows] == ["aupau", "fpffp", "-----"]
    assert ["data-needs" in row for row in rows] == [True, False, True]
    assert {"alice/report.html", "bob/report.html"} <= set(page.values("href"))
    assert "carol/report.html" not in page.values("href")
    assert "Her archive is broken." in page.words


def test_a_mistake_names_its_students_and_what_to_say() -> None:
    """The span of the numbers, the cost, the hint, and links to the check in each report."""
    reason = "Messages come at {} Hz, too slow."
    hint = "A timer of 0.01 s gives 100 Hz."
    students = []
    for name, rate in (("alice", 90), ("bob", 80)):
        plain = result_of(LAB, [1, 0.5, 1], {"pub.rate": reason.format(rate)})
        plain["criteria"][0]["checks"][1]["hint"] = hint
        students.append(entry_of(name, plain, report=report_link(name)))
    page = page_of(*students, entry("carol", [1, 1, 1]))
    words = " ".join(page.words.split())
    assert "−8 PUB.RATE Pub Messages come at 80 to 90 Hz, too slow." in words
    assert f"What students were told: {hint} 2 of 3 students" in words
    assert {"alice/report.html#check-pub.rate", "bob/report.html#check-pub.rate"} <= set(
        page.values("href")
    )
    assert [row["data-mistakes"] for row in rows_of(page)] == ["0", "0", ""]


def test_what_is_to_do_stands_before_all_else(summary: ClassSummary) -> None:
    """Not graded, violations and undecided, in this order, before points and table."""
    words = " ".join(Page(render(summary)).words.split())
    places = []
    for text in (
        "Not graded 1",
        "Interfered with the grader 1",
        "Undecided 2",
        "Points",
        "Students",
    ):
        places.append(words.index(text))
    assert places == sorted(places)
    assert "published 40 messages on /joint_states" in words
    assert "6 undecided" in words


def test_the_picture_says_how_many_have_how_many_points() -> None:
    """A bar with its number for each range that someone is in, the median, and all of it in words."""
    page = page_of(*(entry(str(n), [1, 1, share]) for n, share in enumerate((0, 0, 0.5, 1))))
    bars = []
    for tag, attributes in page.elements:
        if tag == "rect" and attributes.get("class") == "bar":
            bars.append(attributes)
    heights = [float(bar["height"]) for bar in bars]
    assert len(bars) == 3
    assert heights[0] == pytest.approx(2 * heights[1])
    words = " ".join(page.words.split())
    assert "2 1 1 median 22.5" in words
    assert (
        "4 graded. Bars are 1.5 points wide. The middle half, shaded, has 20 to 26.3 points."
        in words
    )


def test_nothing_to_do_is_said() -> None:
    """An empty list is not left to be guessed."""
    assert (
        "Nothing: all submissions are graded, and all points decided."
        in page_of(entry("alice", [1, 1, 1])).words
    )


def test_a_class_without_any_result_has_a_page() -> None:
    """Nobody, or nobody graded: a page that says so."""
    assert "There are no submissions." in page_of().words
    page = page_of(ClassEntry("alice", None, "An empty archive."))
    assert "An empty archive." in page.words
    assert len(rows_of(page)) == 1


def test_adjustments_are_explained() -> None:
    """Adjusted points name the person and the reason."""
    change = {
        "kind": "points",
        "what": "pub.rate",
        "points": 4,
        "reason": "Seen.",
        "who": "JS",
        "when": "2026-11-21",
    }
    student = entry("alice", [1, 0.5, 1], adjustments=[change])
    words = " ".join(page_of(student).words.split())
    assert "30 +4 by adjustments" in words
    assert "+4 PUB.RATE: Seen. (JS, 2026-11-21)" in words


def test_a_check_that_tells_nothing_says_why() -> None:
    """Nobody passes it, or strong ones fail it: the check itself may be wrong."""
    none = page_of(*(entry(str(n), [1, 1, 0]) for n in range(3)))
    assert "Nobody passes it" in none.words
    assert "too few" in none.words
    upside_down = page_of(*(entry(str(n), [n / 19, n / 19, 1 - n / 19]) for n in range(20)))
    assert "Strong submissions fail it more often than weak ones" in upside_down.words
    assert "−1.00" in upside_down.words


@pytest.mark.parametrize(
    ("offsets", "heading", "shown"),
    [
        ((1, 1), "Handed in, UTC+01:00", "2026-11-20 22:00"),
        ((1, 2), "Handed in, UTC", "2026-11-20 21:00"),
    ],
)
def test_times_of_submission_can_be_compared(
    offsets: tuple[int, int], heading: str, shown: str
) -> None:
    """All times stand in their common zone, or else in UTC, and the heading names the zone."""
    students = []
    for n, hours in enumerate(offsets):
        students.append(
            dataclasses.replace(
                entry(str(n), [1, 1, 1]),
                submitted_at=datetime(2026, 11, 20, 22, tzinfo=timezone(timedelta(hours=hours))),
            )
        )
    words = " ".join(page_of(*students).words.split())
    assert f"{heading} " in words
    assert shown in words


DUE = LatePolicy.model_validate({"due": "2026-11-20T23:59:00+01:00", "per_day": "10 %"})


def timed(name: str, submission_time: SubmissionTime, *decided: Override) -> ClassEntry:
    """Give an entry with all that is known of its times."""
    plain = entry(name, [1, 1, 1])
    assert plain.result is not None
    return dataclasses.replace(
        plain,
        result=adjust(plain.result, decided, DUE, submission_time),
        submitted_at=submission_time.at,
        time_source=submission_time.source,
        newest_file=submission_time.newest_file,
        last_commit=submission_time.last_commit,
        marked_late_by=submission_time.marked_late_by,
    )


def test_the_page_says_how_times_are_known() -> None:
    """Due time, extensions and the source of each time are shown; a time that proves nothing is to do."""
    at = datetime(2026, 11, 20, 22, tzinfo=timezone(timedelta(hours=1)))
    extended = Override.model_validate(
        {
            "submission": "bob",
            "extension": "2 days",
            "reason": "ill",
            "who": "J",
            "when": "2026-11-19",
        }
    )
    page = page_of(
        timed("alice", SubmissionTime(at, "Moodle's grading worksheet")),
        timed("bob", SubmissionTime(at + timedelta(days=1), "the class list"), extended),
        timed("carl", SubmissionTime(newest_file=datetime(2026, 11, 20, 23, 40))),
        timed("emil", SubmissionTime(last_commit=at + timedelta(days=3))),
        timed("fritz", SubmissionTime(marked_late_by="Canvas")),
        timed("dora", SubmissionTime(datetime(2026, 11, 20, 23, 40), "Blackboard's download")),
    )
    words = " ".join(page.words.split())
    assert "due 2026-11-20 23:59 +01:00" in words
    assert "2026-11-20 22:00 Moodle's grading worksheet" in words
    assert "the class list; due 2026-11-22 23:59 +01:00, extended" in words
    assert "newest file 2026-11-20 23:40" in words
    assert "Blackboard's download; time zone not known" in words
    assert "last commit 2026-11-23 22:00 +01:00" in words
    assert "marked late by Canvas" in words
    assert "Perhaps late 4 " in words


def test_outcomes_are_reported_by_more_than_colour() -> None:
    """Each cell has a sign, and a word for screen readers."""
    words = " ".join(page_of(entry("alice", [1, 1, None]), entry("bob", [0.5, 1, 0])).words.split())
    for text in ("✓ passed 20", "? undecided 0", "◐ partial 14", "✕ failed 0"):
        assert text in words


# -- untrusted text ----------------------------------------------------------------------------


def test_student_text_is_only_ever_text() -> None:
    """Whatever stands in a name, reason, problem, violation or adjustment, no element comes of it."""
    harmless = page_of(*hostile("x"))
    page = page_of(*hostile(EVIL))
    # A name may be broken behind some of its marks.
    assert [tag for tag, _ in page.elements if tag != "wbr"] == [
        tag for tag, _ in harmless.elements if tag != "wbr"
    ]
    assert len(page.scripts) == 2
    assert "{{ 7*7 }}" in page.words
    assert not re.search("[\x00\x1b\u202e\ud800]", page.words)


def hostile(text: str) -> list[ClassEntry]:
    """Give a class with a text wherever students' text can come to stand."""
    reasons = {"pub.topic": text, "pub.rate": text, "doc.readme": text}
    change = {
        "kind": "points",
        "what": text,
        "points": 1,
        "reason": text,
        "who": text,
        "when": text,
    }
    violation = {"kind": "spoofs_clock", "session": text, "text": text}
    more = {"adjustments": [change], "violations": [violation], "problems": [text]}
    return [
        entry(text, [0, 0.5, None], reasons, **more),
        entry(f"{text} 2", [0, 0.5, 1], reasons),
        ClassEntry(text, None, text, student_id=text),
    ]


def test_an_anonymous_page_has_no_link_to_a_folder(
    rubric: Rubric, entries: list[ClassEntry]
) -> None:
    """Links would give the names away; the page says that names were replaced."""
    html = render(summarise(anonymous(entries, rubric), rubric), anonymous=True)
    page = Page(html)
    assert [href for href in page.values("href") if not href.startswith("#")] == []
    assert "names replaced by pseudonyms" in page.words
    for known in entries:
        assert known.name not in html
        assert str(known.student_id) not in html


def test_the_order_of_the_entries_is_the_order_of_the_rows() -> None:
    """Without scripts the table is as it was given."""
    students = [entry(name, [1, 1, 1]) for name in ("b", "a", "c")]
    html = render(summarise(students, LAB))
    assert re.findall(
        r'<th scope="row"><span class="student" translate="no"><a href="(.)/', html
    ) == [
        "b",
        "a",
        "c",
    ]
    assert html != render(summarise([dataclasses.replace(s) for s in reversed(students)], LAB))

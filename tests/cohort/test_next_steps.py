"""Next steps after a class was graded, for exactly this class."""

from __future__ import annotations

from pathlib import Path

from grader.cohort.entries import NOTHING_SUBMITTED, ClassEntry
from grader.cohort.next_steps import next_steps
from grader.cohort.statistics import summarise
from grader.recording.submission import Identity, Person
from grader.report.exports import CLASS_EXPORTS
from tests.cohort.made_up import entries_of, entry_of, result_of, rubric_of

TWO = rubric_of(("a.first", 4), ("b.second", 6))
RESULTS = Path("results")


def steps(*entries: ClassEntry) -> list[str]:
    """Return the steps for a class."""
    return [str(step) for step in next_steps(summarise(entries, TWO), RESULTS, CLASS_EXPORTS)]


def test_a_class_without_questions_is_only_looked_at() -> None:
    """If all is decided and no system is known, one step is left."""
    looked_at = "the class, its mistakes and points → grade open results"
    assert steps(*entries_of(TWO, [1, 1], [0, 1])) == [looked_at]


def test_questions_come_first_and_are_counted() -> None:
    """Undecided and ungraded submissions are counted and named; absent ones are no step."""
    known = entries_of(TWO, [1, None], [None, 1], [1, 1])
    found = steps(
        *known, ClassEntry("d", None, "An empty archive."), ClassEntry("e", None, NOTHING_SUBMITTED)
    )
    assert found[:2] == [
        "2 undecided: a, b → grade review results",
        "1 not graded: d → remove the reason above, and run the same command again",
    ]
    assert len(found) == 3


def test_interference_stands_before_undecided_points_and_names_are_cut() -> None:
    """One command answers both; of five names three are listed."""
    plain = result_of(TWO, [1, 1])
    plain["violations"] = [{"kind": "spoofs_clock", "session": "s", "text": "t", "certain": True}]
    found = steps(entry_of("eve", plain), *entries_of(TWO, *([[1, None]] * 5)))
    assert found[0] == (
        "1 interfered with the grader: eve; 5 undecided: a, b, c and 2 more → grade review results"
    )


def test_points_go_back_to_the_system_of_the_download() -> None:
    """Points and reports return to the system of the download; mails need an address."""
    result = result_of(TWO, [1, 1])
    identity = Identity((Person("Ann"),), "Canvas", ("ann_1_2_x",))
    assert steps(entry_of("ann", result, identity=identity))[1:] == [
        "points into Canvas → grade export results --to canvas",
        "reports into the same system → grade export results --to feedback",
    ]
    identity = Identity((Person("Ann", email="ann@uni.example"),))
    assert steps(entry_of("ann", result, identity=identity))[1:] == [
        "a mail to each student → grade export results --to mail"
    ]


def test_nothing_graded_leaves_nothing_to_return() -> None:
    """Without a result, only the reason is left."""
    assert len(steps(ClassEntry("d", None, "An empty archive."))) == 1


def test_who_is_missing_from_the_class_list_is_named() -> None:
    """Submissions without an id are a step if others have one; mails are counted by their addresses."""
    result = result_of(TWO, [1, 1])
    ann = Identity((Person("Ann", email="ann@uni.example"),))
    known = entry_of("ann", result, student_id="1", identity=ann)
    found = steps(known, entry_of("bob", result))
    assert found[0] == (
        "1 not on the class list: bob → add these names to it, and run the same command again"
    )
    assert found[-1] == ("a mail to the 1 of 2 with an address → grade export results --to mail")
    assert not any("class list" in step for step in steps(known))
    assert not any("class list" in step for step in steps(entry_of("bob", result)))

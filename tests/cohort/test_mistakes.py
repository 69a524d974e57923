"""The same mistakes in a class: their equality, their cost, and their consequences."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import pytest

from grader.cohort.entries import ClassEntry
from grader.cohort.mistakes import Mistake, gist, pattern_of
from grader.cohort.statistics import summarise
from grader.lab.rubric import Rubric
from tests.cohort.made_up import entry_of, result_of, rubric_of
from tests.plain_results import checks_of

RATE = "Messages come at {} Hz, {}% slower than 100 Hz."


# -- equality ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (RATE.format("90.7", "9.3"), RATE.format("87", "13.0")),
        ("There is no a.py in the submission.", "There is no pkg/other_file.py in the submission."),
        (
            "The topic is named /cmd, not /commands; the rest is judged on /cmd.",
            "The topic is named /x, not /commands.",
        ),
        ("Executable 'a b' not found.", 'Executable "node" not found.'),
        (
            "1 comment explains something; for 51 lines 2.",
            "0 comments explain something; for 21 lines 1.",
        ),
        ("It does not say what a.py does.", "It does not say what a.py, b.py and c.py do."),
        (
            "Without a docstring: module a_b (none), class C (none).",
            "Without a docstring: method A.b (none).",
        ),
        (
            "Python finds no module named scipy. It is not here.",
            "Python finds no module named pandas.",
        ),
        (
            "The class TalkerNode uses its node too early.",
            "The class PubNode uses its node too early.",
        ),
        ("Expected: [0.1 0.2].", "Expected: [3 -1e-3 2]."),
    ],
)
def test_other_names_and_numbers_are_the_same_mistake(one: str, other: str) -> None:
    """Numbers, quoted parts, names, lists and the plural do not make another mistake."""
    assert gist(one) == gist(other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (RATE.format("90.7", "9.3"), "Messages come at 110 Hz, 10% faster than 100 Hz."),
        ("It ends with an AttributeError.", "It ends with a TypeError."),
        (
            "The publisher offers BEST_EFFORT, not RELIABLE.",
            "The publisher offers VOLATILE, not TRANSIENT_LOCAL.",
        ),
        ("The interpreter crashed: Segmentation fault.", "The interpreter crashed: out of memory."),
        ("No answer came within 3 s.", "It answers, but late."),
    ],
)
def test_other_words_are_another_mistake(one: str, other: str) -> None:
    """The mistake itself decides, and constants and kinds of exception are no names."""
    assert gist(one) != gist(other)


def test_one_text_stands_for_several() -> None:
    """Numbers become their span, names the commonest of them, and equal parts stay."""
    assert pattern_of(
        [RATE.format(a, b) for a, b in (("9.5", "5"), ("90.7", "9.3"), ("87", "13"))]
    ) == ("Messages come at 9.5 to 90.7 Hz, 5 to 13% slower than 100 Hz.")
    assert (
        pattern_of(["No '/b' here.", "No '/a' here.", "No '/b' here."]) == "No '/b' or '/a' here."
    )
    assert (
        pattern_of([f"No '/{name}' here." for name in "abcdef"])
        == "No '/a' or '/b' or '/c' or 3 others here."
    )
    assert pattern_of(["It is 3 ms off. (line 4)", "It is 5 ms off."]) == "It is 3 to 5 ms off."
    assert pattern_of(["Without one: a.py and b.py.", "Without one: a.py."]) == "Without one: …"
    assert (
        pattern_of(["1 word stands.", "2 words stand.", "2 words stand."])
        == "For example: 2 words stand."
    )


def test_a_text_is_its_own_pattern() -> None:
    """One student's words are given as they are."""
    text = "Nothing  at /x:\n'y' (TypeError in a.py, line 3)."
    assert pattern_of([text]) == "Nothing at /x: 'y' (TypeError in a.py, line 3)."


# -- costs -------------------------------------------------------------------------------------

LAB = rubric_of(
    ("s.offers", 4),
    ("s.calls", 6),
    ("s.more", 2),
    ("t.rate", 8),
    requires={"s.calls": ("s.offers",), "s.more": ("s.calls",)},
)


def student(
    name: str, credits: list[float], reasons: dict[str, str], hint: str = "", **blocked: str
) -> ClassEntry:
    """Return a student with credits, reasons, and the blocking check of each check that was not reached."""
    plain: dict[str, Any] = result_of(LAB, credits, reasons)
    for check in checks_of(plain):
        if (cause := blocked.get(check["id"].partition(".")[2])) is not None:
            check |= {"outcome": "not_reached", **({"blocked_by": cause} if cause else {})}
        check["hint"] = hint
    return entry_of(name, plain)


def mistakes(*entries: ClassEntry, rubric: Rubric = LAB) -> tuple[Mistake, ...]:
    """Give the mistakes of a class."""
    return summarise(entries, rubric).mistakes


def costs(found: tuple[Mistake, ...]) -> list[tuple[str, int, int]]:
    """Return check, points, and the points among them that were out of reach."""
    return [(m.check_id, int(m.cost), int(m.following)) for m in found]


def test_a_mistake_has_its_students_its_cost_and_its_hint() -> None:
    """Students with the largest loss come first; the cost is the sum; the hint is the commonest."""
    found = mistakes(
        student("a", [1, 1, 1, 0.75], {"t.rate": RATE.format(95, 5)}, "Use a timer."),
        student("b", [1, 1, 1, 1], {}),
        student("c", [1, 1, 1, 0.25], {"t.rate": RATE.format(80, 20)}, "Use a timer."),
    )
    assert len(found) == 1
    assert [(made.row, int(made.lost)) for made in found[0].made_by] == [(2, 6), (0, 2)]
    assert costs(found) == [("t.rate", 8, 0)]
    assert found[0].hint == "Use a timer."
    assert found[0].pattern == "Messages come at 80 to 95 Hz, 5 to 20% slower than 100 Hz."


def test_what_could_not_be_reached_counts_with_its_cause() -> None:
    """A missing service costs its own points and the dependent checks' points, nothing twice."""
    lost = {"calls": "s.offers", "more": "s.offers"}
    found = mistakes(student("a", [0, 0, 0, 1], {"s.offers": "There is no x.py."}, **lost))
    assert costs(found) == [("s.offers", 12, 8)]


def test_what_no_check_blocked_stands_for_itself() -> None:
    """A call that could not be made after one without an answer belongs to that one; else it stands for itself."""
    found = mistakes(student("a", [1, 0, 0, 1], {"s.calls": "No answer."}, more="s.calls"))
    assert costs(found) == [("s.calls", 8, 2)]
    found = mistakes(student("a", [0, 1, 1, 1], {"s.offers": "Nothing is started."}, offers=""))
    assert costs(found) == [("s.offers", 4, 0)]


def test_the_dearest_mistake_stands_first() -> None:
    """Two students with a loss of 2 each come before one with a loss of 3."""
    found = mistakes(
        student("a", [0.25, 1, 1, 0.75], {"s.offers": "Wrong name.", "t.rate": "Too slow."}),
        student("b", [1, 1, 1, 0.75], {"t.rate": "Too slow."}),
    )
    assert costs(found) == [("t.rate", 4, 0), ("s.offers", 3, 0)]


def test_the_same_check_with_another_remedy_is_another_mistake() -> None:
    """Another remedy makes another mistake, even if the reason begins alike."""
    found = mistakes(
        student("a", [1, 1, 1, 0], {"t.rate": "No module named x."}, "Hand it in."),
        student("b", [1, 1, 1, 0], {"t.rate": "No module named y."}, "Do without it."),
    )
    assert [len(m.made_by) for m in found] == [1, 1]


def test_all_lost_points_are_reported_once() -> None:
    """The costs of all mistakes together are the points that the class lost; undecided ones are not among them."""
    entries = [
        student("a", [0, 0, 0, 1], {}, calls="not_reached", more="not_reached"),
        student("b", [1, 0.5, 0, 0.25], {}, more="not_reached"),
        entry_of("c", result_of(LAB, [None, 0, 1, 1])),
    ]
    assert sum((m.cost for m in mistakes(*entries)), Decimal(0)) == 12 + 11 + 6

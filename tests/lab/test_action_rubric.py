"""Mistakes about actions in a rubric are reported when it loads, by the definition of the action."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from grader.errors import RubricError
from grader.judging.rubrics import rubric_kinds
from grader.lab.rubric import load_rubric
from ros_bag.definitions import fields_of, types_in

LAB = Path(__file__).parents[1] / "labs" / "fibonacci" / "rubric.yaml"
KIND = "test_msgs/action/Fibonacci"

#: Text, misspelling, and message.
MISTYPED = [
    (
        "goal: {order: 5}",
        "goal: {oder: 5}",
        "Fibonacci_Goal has no field 'oder'; did you mean 'order'?",
    ),
    ("newer_goal: {order: 3}", "newer_goal: {odrer: 3}", "Fibonacci_Goal has no field 'odrer'"),
    (
        "type: test_msgs/action/Fibonacci, goal",
        "type: test_msgs/action/Fibonaci, goal",
        "did you mean",
    ),
    (
        "type: test_msgs/action/Fibonacci, goal",
        "type: test_msgs/msg/Fibonacci, goal",
        "is not a type such as",
    ),
    (
        "type: test_msgs/action/Fibonacci, timeout_s",
        "type: test_msgs/srv/Empty, timeout_s",
        "is not a type such as",
    ),
    ("cancel_after_s: 0.5", "cancel_after: 0.5", "unknown key; did you mean 'cancel_after_s'?"),
    ("cancel_after_s: 0.5", "cancel_after_s: soon", "a number is expected"),
    (
        "values: {sequence:",
        "values: {sequense:",
        "Fibonacci_Result has no field 'sequense'; did you mean 'sequence'?",
    ),
    ("values: {sequence: [0, 1, 1, 2, 3, 5]}", "values: {}", "it is empty"),
    (
        "rising: sequence",
        "rising: sequenc",
        "Fibonacci_Feedback has no field 'sequenc'; did you mean 'sequence'?",
    ),
    ("rising: sequence", "rising: 'sequence[0].x'", "int32 has no field 'x'"),
    (
        "accepted: {step: five}",
        "accepted: {step: fife}",
        "no step labelled 'fife' in session 'server'",
    ),
    (
        "status: succeeded",
        "status: suceeded",
        "'suceeded' is not possible here; did you mean 'succeeded'?",
    ),
    ("cancelled: {step:", "canceled: {step:", "unknown key; did you mean 'cancelled'?"),
    ("hz_tolerance: 10%", "hz_tolerance: 10", "a share from 0 to 1 is expected"),
    ("weight: 2}\n          result", "weight: 0}\n          result", "greater than 0"),
    ("          offered: {}\n", "", "at least one of offered, accepted"),
]


@pytest.fixture(scope="module")
def lab() -> str:
    """Give the rubric without a mistake, where its action is installed."""
    if KIND not in types_in("test_msgs", "action"):
        pytest.skip(f"{KIND} is not installed")
    load_rubric(LAB, rubric_kinds())
    return LAB.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "words"), MISTYPED, ids=[f"{n} {m[1]:.30}" for n, m in enumerate(MISTYPED)]
)
def test_what_is_mistyped_is_reported_with_its_line(
    tmp_path: Path, lab: str, old: str, new: str, words: str
) -> None:
    """A wrong goal, result, feedback, type, step or status is reported with its line and remedy."""
    assert old in lab
    (tmp_path / "lab.yaml").write_text(lab.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(RubricError) as caught:
        load_rubric(tmp_path / "lab.yaml", rubric_kinds())
    (found,) = [mistake for mistake in caught.value.mistakes if words in mistake]
    assert found.startswith("lab.yaml:"), os.linesep.join(caught.value.mistakes)


def test_fields_of_the_feedbacks_topic_are_looked_up(tmp_path: Path, lab: str) -> None:
    """Fields of the feedback's topic are known from the action's type, to any check."""
    head, _, _ = lab.rpartition("        check: action_server\n")
    for field, words in (
        ("feedback.sequence", ""),
        ("feedback.sequenc", "did you mean 'sequence'?"),
    ):
        values = f"with: {{topic: /fibonacci/_action/feedback, field: {field}, low: 1}}\n"
        (tmp_path / "lab.yaml").write_text(
            f"{head}        check: field_range\n        {values}", encoding="utf-8"
        )
        found: list[str] = []
        try:
            load_rubric(tmp_path / "lab.yaml", rubric_kinds())
        except RubricError as error:
            found = list(error.mistakes)
        assert [words in mistake for mistake in found] == ([True] if words else [])


def test_feedback_is_a_topic_whose_fields_are_known(lab: str) -> None:
    """The feedback's topic is described together with its action."""
    fields = fields_of(f"{KIND}_FeedbackMessage")
    assert fields is not None
    assert fields["feedback"] == f"{KIND}_Feedback"
    assert fields_of(f"{KIND}_Feedback") == {"sequence": "int32[]"}

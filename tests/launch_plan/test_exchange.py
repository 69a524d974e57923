"""Answers of an evaluating process are read as plans, or as problems that say how the process ended."""

from __future__ import annotations

import json

import pytest

from launch_plan.exchange import Ending, command, plan_of_answer
from launch_plan.format import SCHEMA
from launch_plan.plan import Plan

ENDED = Ending(in_time=True, timeout_s=1.0)


@pytest.mark.parametrize(("depth", "kind"), [(50, None), (56, "no_plan")])
def test_a_plan_that_could_not_be_kept_is_none(depth: int, kind: str | None) -> None:
    """A number missing in JSON is kept one level deeper, and a plan of that depth would be refused."""
    value: object = float("nan")
    for _ in range(depth):
        value = {"a": value}
    plain = {
        "schema": SCHEMA,
        "outcome": "ok",
        "processes": [{"id": "a-1", "path": "a", "output": value}],
    }
    plan = plan_of_answer(json.dumps(plain), ENDED, "")
    found = None if plan.problem is None else plan.problem.kind
    assert found == kind
    assert Plan.from_plain(plan.to_plain()) is not None


@pytest.mark.parametrize(
    ("answer", "ending", "kind", "said"),
    [
        ("", Ending(False, 2.0), "too_slow", "still busy after 2 s"),
        ("{}", ENDED, "no_plan", "its schema is not"),
        ("[" * 100_000, ENDED, "no_plan", "no description that can be read"),
        ("\n", Ending(True, 2.0, limit="output"), "no_plan", "at the limit of output"),
        ("\n", Ending(True, 2.0, exit_status=137), "no_plan", "by signal 9"),
        ("\n", Ending(True, 2.0, exit_status=-9), "no_plan", "by signal 9"),
        ("", Ending(True, 2.0, exit_status=3, output="bye"), "no_plan", "with status 3"),
        ("", Ending(True, 2.0, exit_status=3, output="bye"), "no_plan", "it said: bye"),
    ],
)
def test_a_missing_plan_is_a_problem(answer: str, ending: Ending, kind: str, said: str) -> None:
    """The problem names the launch file and how the process ended."""
    problem = plan_of_answer(answer, ending, "a.launch.py").problem
    assert problem is not None
    assert (problem.kind, problem.file) == (kind, "a.launch.py")
    assert said in problem.message
    assert problem.remedy


def test_a_lone_surrogate_is_replaced() -> None:
    """A plan with half a character can still be written to a file."""
    plan = plan_of_answer(
        json.dumps({"schema": SCHEMA, "outcome": "ok", "logs": [{"message": "\ud800"}]}), ENDED, ""
    )
    assert plan.logs[0].message.encode()


def test_the_program_is_named_by_its_folder() -> None:
    """A sandbox may show the package elsewhere."""
    words = command("/usr/bin/python3", "/launching", 7)
    assert words == ["/usr/bin/python3", "/launching/inside/evaluate.py", "--result-fd", "7"]

"""What an evaluation of a launch file gave is a plan, and the files that it brings are placed."""

from __future__ import annotations

import json
import sys
import time

import pytest

from grader.live.session.launch_runner import _read_plan, with_places
from grader.recording.launch_plan import PLAN_SCHEMA, Plan
from grader.recording.session import ProcessRun

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")


def test_what_is_kept_of_a_plan_is_a_plan() -> None:
    """A number that JSON has not is a level deeper when it is kept; what would be too deep then is no description."""
    for depth, kind in ((50, None), (56, "no_plan")):
        value: object = float("nan")
        for _ in range(depth):
            value = {"a": value}
        plain = {"schema": PLAN_SCHEMA, "outcome": "ok", "processes": [{"id": "a-1", "path": "a", "output": value}]}
        plan = _read_plan(
            json.dumps(plain), in_time=True, timeout_s=1.0, run=ProcessRun("it", "student", []), source=""
        )
        assert (plan.problem.kind if plan.problem is not None else None) == kind
        assert Plan.from_plain(plan.to_plain()) is not None


def test_a_plans_own_files_are_placed_in_one_pass() -> None:
    """Each file that the plan brings is found under its whole name, however many files and texts there are."""
    names = {f"arm_{n}.yaml" for n in range(2000)}
    texts = ["{parameters}/arm_1.yaml:{parameters}/arm_12.yaml.", "{parameters}/else.yaml", *["x" * 20] * 100_000]
    began_s = time.process_time()
    placed = [with_places(text, names, "/p") for text in texts]
    assert time.process_time() - began_s < 5.0
    assert placed[:3] == ["/p/arm_1.yaml:/p/arm_12.yaml.", "{parameters}/else.yaml", "x" * 20]

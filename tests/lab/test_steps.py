"""Steps: results in a session's record, and steps that older graders recorded."""

from __future__ import annotations

import json
import math

import pytest

from grader.lab.steps import STEPS
from grader.lab.steps.base import StepResult
from grader.lab.steps.call import CallRecord, CallResult, CallStep
from grader.lab.steps.change_state import ChangeStateResult
from grader.lab.steps.get_parameters import GetParametersResult, ParameterValue
from grader.lab.steps.link import LinkResult
from grader.lab.steps.plan import PlanResult, Repair
from grader.lab.steps.publish import PublishResult, PublishStep
from grader.lab.steps.send_goal import Cancelling, Feedback, GoalRecord, SendGoalResult
from grader.lab.steps.set_parameters import SetParametersResult
from grader.lab.steps.start import StartResult, StartStep
from grader.lab.steps.wait_for import WaitForResult, WaitForStep
from grader.recording.session import StepRun

RESULTS = [
    StepResult("there is no process talker"),
    StartResult(started=False),
    StartResult(processes=["talker", "listener"]),
    WaitForResult(waited_s=0.25, name="/chatter", type="std_msgs/msg/String"),
    PublishResult(topic="/chatter", matched=False),
    CallResult(service="/add", calls=[CallRecord(1, 2, {"sum": 3}), CallRecord(3, 9, gone=True)]),
    GetParametersResult(node="/it", values={"rate": ParameterValue("double", 50.0)}),
    SetParametersResult(node="/it", refused={"rate": "too fast"}),
    ChangeStateResult(node="/it", success=True, before="inactive", after="active"),
    PlanResult(plan={"outcome": "ok"}, mended=[Repair("unknown_keyword", "no keyword 'nme'")]),
    LinkResult(delay_ms=10.0, means="a relay"),
    SendGoalResult(
        action="/count",
        goals=[GoalRecord({"to": 3}, "ab", 5, feedback=[Feedback(6, 1)], cancel=Cancelling(7))],
    ),
]


@pytest.mark.parametrize("result", RESULTS, ids=lambda result: type(result).__name__)
def test_results_are_read_as_they_were_written(result: StepResult) -> None:
    """A result goes through the JSON of a record unchanged."""
    plain = json.loads(json.dumps(result.to_plain()))
    assert type(result).of(StepRun("any", {}, result=plain)) == result


def test_fields_without_a_value_are_left_out_of_the_record() -> None:
    """The record of a step that ended early is short; calls and goals without an answer say so."""
    assert StepResult().to_plain() == {}
    assert PublishResult(topic="/chatter").to_plain() == {"topic": "/chatter"}
    (call,) = CallResult(calls=[CallRecord(1, 2)]).to_plain()["calls"]
    assert call == {"started_ns": 1, "ended_ns": 2, "response": None}
    (goal,) = SendGoalResult(goals=[GoalRecord()]).to_plain()["goals"]
    assert goal["accepted"] is None
    assert goal["cancel"] is None


def test_steps_of_older_graders_are_read() -> None:
    """Parameters that they did not have get defaults, and keys that are unknown now are passed over."""
    run = StepRun("call", {"service": "/add", "gone": 1}, result={"service": "/add", "gone": 1})
    given = CallStep.given(run)
    assert (given.service, given.repeat, given.request) == ("/add", 1, {})
    assert not given.type
    assert CallResult.of(run) == CallResult(service="/add")


def test_settings_are_given_under_the_key_of_the_rubric() -> None:
    """A recorded step has them under `with`."""
    run = StepRun("start", {"reference": "arm", "with": {"noise": 0.1}})
    assert StartStep.given(run).with_ == {"noise": 0.1}


def test_a_step_tells_what_it_waits_for_in_the_graph() -> None:
    """A step waits for the first key that names something in the graph; for output it has none."""
    assert WaitForStep(publisher="/chatter").awaited == ("publisher", "/chatter")
    assert WaitForStep(output_of="talker", text="ready").awaited == ("", "")


def test_kinds_are_the_keys_of_rubrics() -> None:
    """Each model stands under its own kind, in a module of that name."""
    for kind, model in STEPS.items():
        assert model.kind == kind
        assert model.__module__ == f"grader.lab.steps.{kind}"


@pytest.mark.parametrize(
    ("result", "note"),
    [
        (StartResult(started=False), "it was running"),
        (StartResult(processes=["a", "b"]), "a, b"),
        (PublishResult(matched=True), ""),
        (PublishResult(matched=False), "no subscription was matched"),
        (RESULTS[6], "rate: 50.0"),
        (RESULTS[7], "refused: rate: 'too fast'"),
        (RESULTS[8], "inactive → active"),
    ],
)
def test_notes_of_results(result: StepResult, note: str) -> None:
    """The report's note on a step's result is short."""
    assert result.note() == note


def test_a_message_keeps_what_is_infinite_or_no_number() -> None:
    """A laser scanner sends infinity where nothing reflects, and not-a-number where it cannot tell."""
    message = {"ranges": [4.0, math.nan, math.inf]}
    step = PublishStep.model_construct(
        topic="/scan", type="sensor_msgs/msg/LaserScan", message=message
    )
    far, nothing, infinite = step.model_dump(mode="json")["message"]["ranges"]
    assert (far, infinite) == (4.0, math.inf)
    assert math.isnan(nothing)

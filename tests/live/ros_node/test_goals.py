"""Goals from the director in a real sandbox: the records of honest and of hostile servers."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy")
pytest.importorskip("test_msgs")

from rosbags.highlevel import AnyReader

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT))

from grader.evidence.recorded import Recorded  # noqa: E402
from grader.recording.session import StepRun  # noqa: E402
from tests.live.small_lab import FREE, Lab, record_one  # noqa: E402

pytestmark = pytest.mark.live

KIND = "test_msgs/action/Fibonacci"
#: A server with a placeholder for its execute callback; ends properly on Ctrl-C.
SERVER = """
import time
import rclpy
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from test_msgs.action import Fibonacci, NestedMessage

class Student(Node):
    def __init__(self):
        super().__init__('student')
        self.create_service(__import__('std_srvs.srv').srv.Trigger, '/fibonacy', lambda request, response: response)
        self.server = ActionServer(self, TYPE, '/fibonaci', self.execute, callback_group=ReentrantCallbackGroup(),
                                   cancel_callback=lambda goal: CancelResponse.ACCEPT)

    def execute(self, handle):
BODY

rclpy.init()
node = Student()
try:
    rclpy.spin(node, executor=MultiThreadedExecutor(3))
except (KeyboardInterrupt, ExternalShutdownException):
    pass
rclpy.try_shutdown()
"""
WAIT = {"wait_for": {"action": "/fibonacci", "type": KIND, "timeout_s": 20}}


def server(body: str, kind: str = "Fibonacci") -> str:
    """Return the source of a server; the body is its execute callback's."""
    return SERVER.replace("TYPE", kind).replace(
        "BODY", "\n".join(" " * 8 + line for line in body.strip().split("\n"))
    )


def goal(**more: Any) -> dict[str, Any]:
    """Make a step that sends a goal."""
    return {"send_goal": {"action": "/fibonacci", "type": KIND, "goal": {"order": 5}, **more}}


def sent(recorded: Recorded) -> list[StepRun]:
    """Return the steps that sent goals; fails if the session had trouble of its own."""
    assert recorded.record.complete
    assert not recorded.record.problems
    return [step for step in recorded.record.steps if step.kind == "send_goal"]


HONEST = """
for n in range(handle.request.order):
    handle.publish_feedback(Fibonacci.Feedback(sequence=range(n)))
    time.sleep(0.05)
    if handle.is_cancel_requested:
        handle.canceled()
        return Fibonacci.Result(sequence=[n])
handle.succeed()
return Fibonacci.Result(sequence=[1, 2, 3])
"""


def require_succeeded(step: StepRun) -> None:
    """Fail unless the goal has its answer, its feedback with times, its result and its status."""
    (one,) = step.result["goals"]
    assert (step.outcome, one["accepted"], one["status"]) == ("done", True, "succeeded")
    assert one["result"] == {"sequence": [1, 2, 3]}
    values = [message["values"]["sequence"] for message in one["feedback"]]
    assert values == [list(range(n)) for n in range(5)]
    assert one["feedback_count"] == 5
    assert one["sent_ns"] <= one["stamp_ns"] <= one["answered_ns"] <= one["ended_ns"]
    times = [message["t_ns"] for message in one["feedback"]]
    assert times == sorted(times)
    assert 0.15 < (times[-1] - times[0]) / 1e9 < 2


def require_cancelled(step: StepRun) -> None:
    """Fail unless the goal was cancelled, and the answer came before its end."""
    (one,) = step.result["goals"]
    assert one["status"] == "canceled"
    assert one["cancel"]["accepted"] is True
    assert one["cancel"]["answered_ns"] <= one["ended_ns"] + 1e8


def test_goals_are_kept_with_all_that_comes_of_them(tmp_path: Path) -> None:
    """Under a near miss of the name: answer, feedback with its times, result, status, cancelling, a newer goal."""
    steps = [
        WAIT,
        goal(),
        goal(goal={"order": 100}, cancel_after_feedback=3),
        goal(goal={"order": 12}, newer_goal={"order": 2}, newer_after_s=0.2),
        goal(goal={"order": 100}, timeout_s=1.0),
    ]
    recorded = record_one(tmp_path, server(HONEST), steps)
    assert recorded.record.names == {"/fibonacci": "/fibonaci"}, (
        "the service of a nearer name is no action"
    )
    plain, cancelled, newer, endless = sent(recorded)
    require_succeeded(plain)
    require_cancelled(cancelled)
    assert [one["status"] for one in newer.result["goals"]] == ["succeeded", "succeeded"]
    assert newer.result["goals"][1]["goal"] == {"order": 2}
    assert endless.outcome == "timeout"
    assert endless.result["goals"][0]["status"] == "executing"
    (claim,) = [claim for claim in recorded.record.claims if claim.kind == "action"]
    assert (claim.name, claim.type, claim.file) == ("/fibonaci", KIND, "node.py")


def test_feedback_and_status_are_in_the_bag(tmp_path: Path) -> None:
    """Feedback and status are topics implied by the action, and another reader decodes them."""
    recorded = record_one(tmp_path, server(HONEST), [WAIT, goal()])
    (step,) = sent(recorded)
    with AnyReader([tmp_path / "results" / "recordings" / "only"]) as reader:
        messages = {}
        for c in reader.connections:
            messages[c.topic] = [
                reader.deserialize(data, c.msgtype) for _, _, data in reader.messages([c])
            ]
    identifier = step.result["goals"][0]["goal_id"]
    feedback: list[Any] = messages["/fibonaci/_action/feedback"]
    assert [list(message.feedback.sequence) for message in feedback] == [
        list(range(n)) for n in range(5)
    ]
    assert {bytes(message.goal_id.uuid).hex() for message in feedback} == {identifier}
    statuses: list[Any] = messages["/fibonaci/_action/status"]
    assert [message.status_list[0].status for message in statuses] == [1, 2, 4]


BURST = """
for n in range(300):
    handle.publish_feedback(Fibonacci.Feedback(sequence=[n]))
handle.succeed()
return Fibonacci.Result()
"""


def test_feedback_in_one_burst_before_the_end_is_not_lost(tmp_path: Path) -> None:
    """Feedback in one burst counts, although rclpy's own client drops it after the result."""
    (step,) = sent(record_one(tmp_path, server(BURST), [WAIT, goal()]))
    assert step.result["goals"][0]["feedback_count"] == 300


HOSTILE = {
    "a result of 100 MB": "handle.succeed()\nreturn Fibonacci.Result(sequence=range(25_000_000))",
    "large feedback": (
        "end, large = time.time() + 2, Fibonacci.Feedback(sequence=range(500_000))\n"
        "while time.time() < end: handle.publish_feedback(large)\n"
        "handle.succeed()\nreturn Fibonacci.Result(sequence=[7])"
    ),
    "feedback without end": (
        "one = Fibonacci.Feedback(sequence=[1])\nwhile True: handle.publish_feedback(one)\nreturn Fibonacci.Result()"
    ),
    "no result": "handle.succeed()",
    "an exception": "raise ValueError('\\x00' * 1000)",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_whatever_a_server_sends_is_kept_within_bounds(tmp_path: Path, name: str) -> None:
    """The session goes on in time, with a small record, whatever a server sends.

    Everything from before the hostile message is in the record.
    """
    source = server(HOSTILE[name]).replace("/fibonaci'", "/fibonacci'")
    timeout_s = 4.0
    if name == "a result of 100 MB":
        timeout_s = 15.0
    recorded = record_one(tmp_path, source, [WAIT, goal(timeout_s=timeout_s)], timeout_s=40.0)
    (step,) = sent(recorded)
    (one,) = step.result["goals"]
    assert one["accepted"] is True
    assert len(json.dumps(step.result)) < 500_000
    assert (step.ended_ns - step.started_ns) / 1e9 < 20
    if name == "a result of 100 MB":
        assert one["result"]["sequence"] == list(range(1000))
    if name == "no result":
        assert (one["status"], one["result"]) == ("succeeded", None)


#: A reference node that serves an action, and publishes each request and each answer.
REFERENCE = """
import sys
from dataclasses import dataclass
from rclpy.executors import SingleThreadedExecutor
from grader.reference_node import reference_node, run
from test_msgs.action import Fibonacci

@dataclass
class Settings:
    answer: int = 0

def play(configuration, settings, stop):
    with reference_node('reference') as reference:
        goals = reference.open_publisher(Fibonacci.Goal, '/fibonacci/goals', 10)
        results = reference.open_publisher(Fibonacci.Result, '/fibonacci/results', 10)

        def execute(handle):
            goals.publish(handle.request)
            handle.publish_feedback(Fibonacci.Feedback(sequence=[1]))
            handle.succeed()
            result = Fibonacci.Result(sequence=[settings.answer])
            results.publish(result)
            return result

        server = reference.open_action_server(Fibonacci, configuration.name('/fibonacci'), execute)
        executor = SingleThreadedExecutor()
        executor.add_node(reference.node)
        print('ready', flush=True)
        reference.wait_until_recorded(stop, 5.0)
        while not stop:
            executor.spin_once(timeout_sec=0.02)
        server.destroy()

sys.exit(run(Settings, play))
"""
CLIENT = """
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node
from test_msgs.action import Fibonacci

rclpy.init()
node = Node('student')
client = ActionClient(node, Fibonacci, '/fibonaci')
client.wait_for_server()
heard = []
sent = client.send_goal_async(Fibonacci.Goal(order=7), feedback_callback=heard.append)
rclpy.spin_until_future_complete(node, sent)
result = sent.result().get_result_async()
rclpy.spin_until_future_complete(node, result)
print('result', result.result().result.sequence[0], flush=True)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    rclpy.try_shutdown()
"""


def test_a_students_client_has_a_reference_server(tmp_path: Path) -> None:
    """A student's client finds the reference server, even under a near miss, and is recorded."""
    plain = {
        "lab": {"id": "T", "title": "A test", "points": 0},
        "artifacts": {"node": {"file": "node.py"}},
        "reference": {
            "server": {"file": "server.py", "node": "/reference", "settings": "server.py:Settings"}
        },
        "sessions": {
            "only": {
                "steps": [
                    {"start": {"student": "node"}},
                    {"wait_for": {"action_client": "/fibonacci", "type": KIND, "timeout_s": 20}},
                    {"start": {"reference": "server", "with": {"answer": 42}}},
                    {"wait_for": {"output_of": "node", "text": "result", "timeout_s": 20}},
                    {"interrupt": {"process": "node"}},
                ]
            }
        },
        "criteria": [{"id": "all", "title": "All", "points": 0, "checks": [FREE]}],
    }
    submission = tmp_path / "submission"
    submission.mkdir()
    (submission / "node.py").write_text(CLIENT, encoding="utf-8")
    (tmp_path / "server.py").write_text(REFERENCE, encoding="utf-8")
    (tmp_path / "rubric.yaml").write_text(yaml.safe_dump(plain), encoding="utf-8")
    recorded = Lab(tmp_path / "rubric.yaml", submission, tmp_path / "results").record()["only"]
    assert not recorded.record.problems
    assert recorded.record.names == {"/fibonacci": "/fibonaci"}
    values = {}
    for topic, field in (
        ("/fibonaci/_action/feedback", "feedback.sequence"),
        ("/fibonacci/results", "sequence"),
    ):
        values[topic] = [
            list(each) for each in recorded.stream(topic).field(field) if each is not None
        ]
    assert values == {"/fibonaci/_action/feedback": [[1]], "/fibonacci/results": [[42]]}
    assert recorded.stream("/fibonacci/goals").field("order") == [7]
    assert recorded.stream("/fibonaci/_action/status").field("status_list[0].status")[-1] == 4
    assert [claim.name for claim in recorded.record.claims if claim.kind == "action_client"] == [
        "/fibonaci"
    ]

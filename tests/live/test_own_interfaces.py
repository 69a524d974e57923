"""A lab and a student with interfaces of their own, graded in real sandboxes by the real grader."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from grader import pipeline
from grader.judging.rubrics import read_rubric
from grader.live.interfaces.build import lacking_toolchain
from grader.result import Outcome, Result
from tests.live.shared_server import scheduler
from tests.thorough import EVERY_FIXTURE, part

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(bool(lacking_toolchain()), reason=f"not here: {lacking_toolchain()}"),
]

NODE = """
import rclpy
from rclpy.action import ActionServer
from rclpy.node import Node
from lab_msgs.msg import Reading
from team_msgs.action import Count
from team_msgs.msg import Pair
from team_msgs.srv import Add
from tf2_ros import StaticTransformBroadcaster
from geometry_msgs.msg import TransformStamped

class Worker(Node):
    def __init__(self):
        super().__init__('worker')
        self.readings = self.create_publisher(Reading, '/reading', 10)
        self.pairs = self.create_publisher(Pair, '/pair', 10)
        self.create_service(Add, '/add', self.add)
        self.counting = ActionServer(self, Count, '/count', self.count)
        self.tf = StaticTransformBroadcaster(self)
        fixed = TransformStamped(child_frame_id='b')
        fixed.header.frame_id = 'a'
        self.tf.sendTransform(fixed)
        self.create_timer(0.05, self.tick)

    def tick(self):
        reading = Reading(value=2.5)
        self.readings.publish(reading)
        self.pairs.publish(Pair(readings=[reading, reading]))

    def add(self, request, response):
        response.sum = request.a + request.b
        return response

    def count(self, goal):
        goal.succeed()
        return Count.Result(total=goal.request.order)

rclpy.init()
try:
    rclpy.spin(Worker())
except KeyboardInterrupt:
    pass
"""

#: The same with the action alone; its result does not depend on the goal.
ACTION_NODE = """
import rclpy
from rclpy.action import ActionServer
from rclpy.node import Node
from team_msgs.action import Count

class Worker(Node):
    def __init__(self):
        super().__init__('worker')
        self.counting = ActionServer(self, Count, '/count', self.count)

    def count(self, goal):
        goal.succeed()
        return Count.Result(total=3)

rclpy.init()
try:
    rclpy.spin(Worker())
except KeyboardInterrupt:
    pass
"""

#: A file that leaves a mark wherever it is executed; it must not be.
CMAKE = """
execute_process(COMMAND touch {marker})
file(WRITE {marker} "x")
project(team_msgs)
rosidl_generate_interfaces(${{PROJECT_NAME}} "msg/Pair.msg" "srv/Add.srv" "action/Count.action" DEPENDENCIES lab_msgs)
add_custom_target(x ALL COMMAND touch {marker})
"""

ACTION_CMAKE = """
project(team_msgs)
rosidl_generate_interfaces(${PROJECT_NAME} "action/Count.action")
"""


def check(name: str, topic: str, kind: str) -> dict[str, Any]:
    """Make a check that something is published, worth 1 point."""
    parameters = {"artifact": "worker", "topic": topic, "type": kind}
    return {
        "id": name,
        "points": 1,
        "session": "only",
        "check": "topic_published",
        "with": parameters,
    }


CHECKS = [
    check("reading", "/reading", "lab_msgs/msg/Reading"),
    check("pair", "/pair", "team_msgs/msg/Pair"),
    check("static", "/tf_static", "tf2_msgs/msg/TFMessage"),
]
RUBRIC = {
    "lab": {"id": "own", "title": "Own interfaces", "points": len(CHECKS)},
    "interfaces": "interfaces",
    "artifacts": {"worker": {"file": "worker.py"}},
    "sessions": {
        "only": {
            "steps": [
                {"start": {"student": "worker"}},
                *(
                    {"wait_for": {"publisher": c["with"]["topic"], "type": c["with"]["type"]}}
                    for c in CHECKS
                ),
                {
                    "call": {
                        "service": "/add",
                        "type": "team_msgs/srv/Add",
                        "request": {"a": 3, "b": 4},
                    },
                    "label": "add",
                },
                {"observe": {"duration_s": 0.5, "first_message_on": "/reading"}},
                {"interrupt": {"process": "worker"}},
            ]
        }
    },
    "criteria": [{"id": "all", "title": "All", "points": len(CHECKS), "checks": CHECKS}],
}


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Give a cache of this module's own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def write(folder: Path, files: dict[str, str]) -> None:
    """Write files of a folder."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def grade(folder: Path, **other: str) -> tuple[Result, Path]:
    """Grade the submission with some files replaced; returns result and folder of the recording."""
    write(
        folder / "lab/interfaces/lab_msgs",
        {"msg/Reading.msg": "std_msgs/Header header\nfloat64 value\n"},
    )
    files = {
        "worker.py": NODE,
        "team_msgs/package.xml": "<package><name>team_msgs</name></package>",
        "team_msgs/CMakeLists.txt": CMAKE.format(marker=folder / "ran"),
        "team_msgs/msg/Pair.msg": "lab_msgs/Reading[2] readings\n",
        "team_msgs/srv/Add.srv": "int64 a\nint64 b\n---\nint64 sum\n",
        "team_msgs/action/Count.action": "int32 order\n---\nint32 total\n---\nint32 so_far\n",
    }
    return grade_files(folder, RUBRIC, {**files, **other})


def grade_files(folder: Path, plain: dict[str, Any], files: dict[str, str]) -> tuple[Result, Path]:
    """Grade a submission of some files by a rubric; returns result and folder of the recording."""
    write(folder / "lab", {"rubric.yaml": yaml.safe_dump(plain, sort_keys=False)})
    write(folder / "submission", files)
    rubric = read_rubric(folder / "lab/rubric.yaml")
    options = pipeline.Options(Path(sys.executable))
    result = pipeline.grade(
        folder / "submission",
        rubric,
        folder / "results",
        options,
        lambda progress: None,
        scheduler(),
    )
    return result, folder / "results"


def outcomes(result: Result) -> dict[str, Outcome]:
    """Return the outcome of each check."""
    return {found.id: found.outcome for found in result.checks}


def test_a_students_node_with_its_own_interfaces_is_graded(tmp_path: Path) -> None:
    """Its messages are recorded, its service is called, its build files are not run, and no ROS judges it again."""
    from grader.evidence.recorded import Recorded

    result, results = grade(tmp_path)
    assert outcomes(result) == {
        "reading": Outcome.PASSED,
        "pair": Outcome.PASSED,
        "static": Outcome.PASSED,
    }
    assert not (tmp_path / "ran").exists()
    recorded = Recorded.open(results / "recordings/only")
    called = recorded.step("add")
    assert called is not None
    assert called.result["calls"][0]["response"] == {"sum": 7}, called.result
    assert {t.topic_type for t in recorded.bag.topics} >= {
        "team_msgs/msg/Pair",
        "tf2_msgs/msg/TFMessage",
    }


def test_without_a_compiler_it_is_not_assessable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No check is decided, none is lost, and the reason is told."""
    tools = tmp_path / "bin"
    tools.mkdir()
    for path in Path("/usr/bin").iterdir():
        if path.name not in ("cc", "c++"):
            (tools / path.name).symlink_to(path)
    monkeypatch.setenv("PATH", f"{tools}:/usr/sbin:/sbin")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    result, _ = grade(tmp_path)
    assert set(outcomes(result).values()) == {Outcome.INCONCLUSIVE}
    for found in result.checks:
        assert "could not be built" in found.reason, result.checks


@pytest.mark.parametrize(
    ("definition", "outcome", "word"),
    [
        ("int num\n", Outcome.FAILED, "colcon build"),
        ("string x 'a\\\\b'\n", Outcome.INCONCLUSIVE, "not built"),
    ],
    ids=["a mistake", "what the grader does not take"],
)
def test_a_students_own_mistake_costs_its_points(
    definition: str, outcome: Outcome, word: str, tmp_path: Path
) -> None:
    """A definition that colcon would refuse costs points.

    A person decides about one that the grader alone refuses.
    """
    result, _ = grade(tmp_path, **{"team_msgs/msg/Pair.msg": definition})
    assert outcomes(result)["pair"] is outcome
    said = (*result.advisories, *(replace(found, hint="").reason for found in result.checks))
    assert any(word in text for text in said), said


@pytest.mark.parametrize(
    ("kind", "outcome", "word"),
    part(
        [
            ("float64", Outcome.PARTIAL, "The type of /count is team_msgs/action/Count"),
            ("string", Outcome.FAILED, "is of type string, and cannot hold 3"),
        ],
        2,
        EVERY_FIXTURE,
    ),
)
def test_an_action_type_of_the_students_own_ends_no_process_of_the_graders(
    kind: str, outcome: Outcome, word: str, tmp_path: Path
) -> None:
    """A goal for a field of another type than the lab's is sent if it fits, else refused.

    The refusal has its reason, and no process of the grader's ends.
    """
    lab_type = "test_msgs/action/Fibonacci"
    goal = {"action": "/count", "type": lab_type, "goal": {"order": 3}, "timeout_s": 3}
    steps = [
        {"start": {"student": "worker"}},
        {"wait_for": {"action": "/count", "type": lab_type}},
        {"send_goal": goal, "label": "goal"},
        {"interrupt": {"process": "worker"}},
    ]
    accepted = {
        "id": "accepted",
        "points": 1,
        "session": "only",
        "check": "action_server",
        "with": {
            "artifact": "worker",
            "action": "/count",
            "type": lab_type,
            "accepted": {"step": "goal"},
            "offered": {"weight": 1},
            "other_type_costs": 1.0,
        },
    }
    rubric = {
        "lab": {"id": "own", "title": "Own interfaces", "points": 1},
        "artifacts": RUBRIC["artifacts"],
        "sessions": {"only": {"steps": steps}},
        "criteria": [{"id": "all", "title": "All", "points": 1, "checks": [accepted]}],
    }
    files = {
        "worker.py": ACTION_NODE,
        "team_msgs/package.xml": "<package><name>team_msgs</name></package>",
        "team_msgs/CMakeLists.txt": ACTION_CMAKE,
        "team_msgs/action/Count.action": f"{kind} order\n---\nint32 total\n---\nint32 so_far\n",
    }
    result, _ = grade_files(tmp_path, rubric, files)
    (found,) = result.checks
    assert (found.outcome, result.problems, result.violations) == (outcome, (), ())
    assert word in found.reason

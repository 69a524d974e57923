"""The link that loses and delays: effects on profiles, the student's own profiles, and cleanup."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from statistics import median
from typing import Any

import pytest

pytest.importorskip("rclpy")

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT))

from grader.lab.steps.link import Crossing, LinkedTopic, LinkResult  # noqa: E402
from grader.live.sandbox.probing import probe_isolation  # noqa: E402
from grader.recording.record import from_plain  # noqa: E402
from grader.recording.session import SessionRecord, read_session  # noqa: E402
from tests.live.small_lab import TEXT, make_lab, record_one  # noqa: E402
from tests.live.test_attacks import Environment, run_in  # noqa: E402

pytestmark = pytest.mark.live

#: Three topics, the last with incompatible sides, and one without a subscription.
TOOL = """
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

LOSSY = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
KEPT = QoSProfile(depth=1, history=HistoryPolicy.KEEP_ALL, durability=DurabilityPolicy.TRANSIENT_LOCAL)

rclpy.init()
node = Node('node')
for topic, offered, requested in (('/lossy', LOSSY, LOSSY), ('/kept', KEPT, KEPT), ('/split', LOSSY, KEPT)):
    node.create_publisher(String, topic, offered)
    node.create_subscription(String, topic, lambda message: None, requested)
node.create_publisher(String, '/alone', LOSSY)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    rclpy.try_shutdown()
"""
STEPS: list[dict[str, Any]] = [
    *(
        {"wait_for": {"publisher": topic, "type": TEXT, "timeout_s": 20}}
        for topic in ("/lossy", "/kept", "/split")
    ),
    {
        "link": {
            "topics": ["/lossy", "/kept", "/split", "/alone"],
            "loss": [0.1],
            "delay_ms": 20,
            "rate_hz": 100,
            "duration_s": 1.5,
        },
        "label": "link",
    },
]


@pytest.fixture(scope="module", autouse=True)
def _confined() -> None:
    """Skip where no sandboxes can be made."""
    isolation = probe_isolation(Path(sys.executable))
    if not isolation.namespaces:
        pytest.skip(f"no sandboxes here: {isolation.remedy}")


def linked(record: SessionRecord) -> tuple[LinkResult, dict[str, LinkedTopic]]:
    """Return a session's findings about the link, and its topics by name."""
    (step,) = (step for step in record.steps if step.kind == "link")
    result = from_plain(LinkResult, step.result)
    assert (step.outcome, result.problem) == ("done", "")
    return result, {topic.name: topic for topic in result.topics}


def require_lossy(crossing: Crossing) -> None:
    """Fail unless a best-effort topic lost a tenth, was delayed, and kept nothing for late joiners."""
    # 10 % of 150 with five times its standard deviation; a queue this deep loses nothing to a busy machine.
    assert 0.77 < len(crossing.received) / crossing.sent < 1
    assert min(latency for _, latency in crossing.received) >= 20_000, "a packet was not delayed"
    assert crossing.late == [[], [], [], []], "a late joiner got a message that is not kept"


def require_kept(crossing: Crossing) -> None:
    """Fail unless a reliable latched topic arrived in order, in part late, and for late joiners too."""
    numbers = [number for number, _ in crossing.received]
    assert len(numbers) >= 0.9 * crossing.sent
    assert numbers == [n + 1 for n in range(len(numbers))]
    assert max(latency for _, latency in crossing.received) > 40_000, "nothing was sent again"
    most = max(map(len, crossing.late))
    assert most >= 0.9 * crossing.sent, "no late joiner got the kept messages"


def require_what_profiles_promise(record: SessionRecord) -> None:
    """Fail unless each profile had its intended effect on the link."""
    result, topics = linked(record)
    (lossy,), (kept,), (split,) = (topics[name].crossings for name in ("/lossy", "/kept", "/split"))
    require_lossy(lossy)
    require_kept(kept)
    assert (split.received, split.late) == ([], [[], [], [], []]), "incompatible sides are matched"
    assert topics["/alone"].crossings == []
    assert 0 < result.cpu_s < 3


def recorded_in(environment: Environment, folder: Path) -> SessionRecord:
    """Grade the tool by the command in an environment, and return the record; fails if anything stays behind."""
    lab = make_lab(folder, {"node": TOOL}, {"only": [{"start": {"student": "node"}}, *STEPS]})
    for name in ("home", "tmp", "results"):
        (folder / name).mkdir()
    for path in (folder, lab.rubric_file, lab.submission, *lab.submission.iterdir()):
        path.chmod(0o755)
    grade = [sys.executable, "-m", "grader.cli", str(lab.submission), "--lab", str(lab.rubric_file)]
    remains, _ = run_in(environment, folder, [*grade, "-o", str(lab.results)], 120)
    assert remains.exit_status == 0, remains.errors
    assert (remains.processes, remains.mounts, [*(folder / "tmp").iterdir()]) == ([], [], [])
    return read_session(lab.results / "submission" / "recordings" / "only")


@pytest.mark.parametrize(
    "environment", [Environment.USER, Environment.ROOT] if os.geteuid() == 0 else [None]
)
def test_profiles_do_on_the_link_what_they_are_for(
    environment: Environment | None, tmp_path: Path
) -> None:
    """As root and as an ordinary user, with no process and no file left."""
    record = recorded_in(environment or Environment.USER, tmp_path)
    assert record.problems == []
    require_what_profiles_promise(record)


@pytest.mark.skipif(
    os.geteuid() != 0, reason="only root can take the means from a command that it starts"
)
def test_where_there_are_no_networks_it_is_left_out(tmp_path: Path) -> None:
    """As in a plain container: the step says why, and the rest of the session goes on."""
    (found,) = (
        step for step in recorded_in(Environment.CONTAINER, tmp_path).steps if step.kind == "link"
    )
    assert found.outcome == "failed"
    assert found.result["problem"] == "this machine gives a session no networks of its own"


def test_the_profiles_are_the_students(tmp_path: Path) -> None:
    """Reliability and durability as announced, history and depth as the running program asked for."""
    step = {
        "link": {**STEPS[-1]["link"], "topics": ["/lossy", "/kept"], "duration_s": 0.1},
        "label": "link",
    }
    record = record_one(tmp_path, TOOL, [*STEPS[:-1], step]).record
    offered = {}
    for name, topic in linked(record)[1].items():
        if topic.offered is not None:
            offered[name] = topic.offered
    policies = {
        name: (q.reliability, q.durability, q.history, q.depth) for name, q in offered.items()
    }
    assert policies["/lossy"] == ("best_effort", "volatile", "keep_last", 50)
    assert policies["/kept"][:3] == ("reliable", "transient_local", "keep_all")
    # None of its nodes was seen in the session's graph, nor its messages: it has networks of its own.
    for graph in record.graph:
        assert "link" not in " ".join(graph.nodes)


#: Profiles with times that would each keep a core of the grader's busy, if its endpoints had them
#: too; and a matching pair and another one for a deadline alone.
HASTY = """
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSProfile
from std_msgs.msg import String

TINY = Duration(nanoseconds=1000)
HASTY = QoSProfile(depth=10, deadline=TINY, lifespan=TINY)
LIVELY = QoSProfile(depth=10, liveliness=LivelinessPolicy.AUTOMATIC, liveliness_lease_duration=Duration(seconds=2))

rclpy.init()
node = Node('node')
for topic, offered, requested in (('/hasty', HASTY, HASTY), ('/lively', LIVELY, LIVELY),
                                  ('/split', QoSProfile(depth=10), QoSProfile(depth=10, deadline=Duration(seconds=1)))):
    node.create_publisher(String, topic, offered)
    node.create_subscription(String, topic, lambda message: None, requested)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    rclpy.try_shutdown()
"""


def test_no_time_of_a_profile_sets_the_pace_of_the_link(tmp_path: Path) -> None:
    """A deadline and a lifespan of 1 µs cost no core, and a pair that a deadline keeps apart gets nothing."""
    topics = ["/hasty", "/lively", "/split"]
    waits = [{"wait_for": {"publisher": name, "type": TEXT, "timeout_s": 20}} for name in topics]
    step = {"link": {**STEPS[-1]["link"], "topics": topics, "duration_s": 2}, "label": "link"}
    record = record_one(tmp_path, HASTY, [*waits, step]).record
    result, found = linked(record)
    hasty, lively, split = (found[name].crossings[0] for name in topics)
    assert result.cpu_s < 2.5
    assert len(lively.received) > 0.7 * lively.sent
    assert hasty.received == [], "what is older than its lifespan arrived"
    assert (split.received, split.late) == ([], [[]] * 4)
    (link,) = (run for run in record.processes if run.name == "link")
    assert link.usage, "nobody watched it"
    assert (link.limit, record.problems) == (None, [])


def test_each_share_of_lost_packets_has_its_own_messages(tmp_path: Path) -> None:
    """After a level with losses, the next one has its messages, and both have the subscriptions that join late."""
    step = {
        "link": {
            **STEPS[-1]["link"],
            "topics": ["/lossy", "/kept"],
            "loss": [0.5, 0],
            "duration_s": 0.5,
        },
        "label": "link",
    }
    topics = linked(record_one(tmp_path, TOOL, [*STEPS[:-1], step]).record)[1]
    for name in ("/lossy", "/kept"):
        losing, whole = topics[name].crossings
        assert len(losing.late) == len(whole.late) == 4
        numbers, latencies_us = zip(*whole.received, strict=True)
        assert numbers == tuple(range(1, whole.sent + 1))
        assert median(latencies_us) < 200_000, "they were taken late"
    assert len(topics["/lossy"].crossings[0].received) < topics["/lossy"].crossings[0].sent


def test_sides_that_never_match_alone_are_carried_too(tmp_path: Path) -> None:
    """A link with sides that never match counts sent messages, and nothing arrives."""
    step = {"link": {**STEPS[-1]["link"], "topics": ["/split"], "duration_s": 0.2}, "label": "link"}
    (split,) = linked(record_one(tmp_path, TOOL, [*STEPS[:-1], step]).record)[1].values()
    crossing = split.crossings[0]
    assert (crossing.sent > 0, crossing.received, crossing.late) == (True, [], [[]] * 4)


def test_without_topics_of_two_sides_the_step_says_so(tmp_path: Path) -> None:
    """Nothing is carried, and the session goes on."""
    step = {"link": {**STEPS[-1]["link"], "topics": ["/alone"]}, "label": "link"}
    record = record_one(tmp_path, TOOL, [*STEPS[:-1], step]).record
    (found,) = (step for step in record.steps if step.kind == "link")
    assert found.outcome == "failed"
    assert found.result["problem"].startswith(
        "none of the topics has both a publisher and a subscription"
    )

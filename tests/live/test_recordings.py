"""Recordings of the sample: other readers agree on them, and a dead recorder costs nothing."""

from __future__ import annotations

import dataclasses
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy")

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))

from grader import pipeline, result_folder  # noqa: E402
from grader.evidence.recorded import Recorded  # noqa: E402
from grader.judging import judgement  # noqa: E402
from grader.judging.judge import judge, open_recordings  # noqa: E402
from grader.result import Outcome, to_json  # noqa: E402
from ros_bag.reading import Stream  # noqa: E402
from tests.live.sample import Graded  # noqa: E402
from tests.live.shared_server import scheduler  # noqa: E402
from tests.live.small_lab import (  # noqa: E402
    TALKER,
    TEXT,
    below,
    interrupt_students,
    look_on,
    make_lab,
    name_of,
    published,
    until,
)
from tests.regraded import regraded  # noqa: E402

pytestmark = pytest.mark.live

SESSIONS = ("publisher", "subscriber", "service", "launch", "qos")


@pytest.mark.parametrize("session", SESSIONS)
def test_other_readers_agree_with_ours(session: str, alice: Graded) -> None:
    """`rosbags`, `mcap` and our own reader give the same counts, times and bytes, and every message decodes."""
    folder = alice.folder / result_folder.RECORDINGS / session
    recorded = Recorded.open(folder)
    assert recorded.record.complete
    assert not recorded.record.problems
    metadata = yaml.safe_load((folder / "metadata.yaml").read_text(encoding="utf-8"))[
        "rosbag2_bagfile_information"
    ]
    assert metadata["version"] == 8
    raw = read_by_mcap(folder / metadata["relative_file_paths"][0])
    assert metadata["message_count"] == len(raw) > 0
    theirs = sorted((channel.topic, m.log_time, m.data) for _, channel, m in raw)
    assert read_by_rosbags(folder) == theirs
    for topic in {channel.topic for _, channel, _ in raw}:
        wanted = [message for _, channel, message in raw if channel.topic == topic]
        require_same(recorded.bag.stream(topic), wanted)


def read_by_mcap(file: Path) -> list[Any]:
    """Return schema, channel and message for each message of a bag, read by `mcap`."""
    with file.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        raw: list[Any] = list(reader.iter_messages())
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(raw)
    return raw


def read_by_rosbags(folder: Path) -> list[tuple[str, int, bytes]]:
    """Return topic, time and bytes of each message of a bag, sorted, after decoding all of them."""
    found = []
    with AnyReader([folder]) as bag:
        for connection, t_ns, data in bag.messages():
            bag.deserialize(data, connection.msgtype)
            found.append((connection.topic, t_ns, bytes(data)))
    return sorted(found)


def require_same(ours: Stream, theirs: list[Any]) -> None:
    """Fail unless a topic's messages, read by the grader, are the ones read by `mcap`."""
    columns = zip(
        ours.source_ns.tolist(),
        ours.sequence.tolist(),
        ours.received_ns.tolist(),
        map(bytes, ours.data),
        strict=True,
    )
    wanted = {(m.publish_time, m.sequence, m.log_time, m.data) for m in theirs}
    assert set(columns) == wanted
    for message in ours.messages:
        assert message is not None


def test_values_are_those_that_were_published(alice: Graded) -> None:
    """The first joint's command in the bag is the sample's sinusoid, as read by `rosbags`."""
    with AnyReader([alice.folder / result_folder.RECORDINGS / "publisher"]) as bag:
        connections = [c for c in bag.connections if c.topic == "/joint_commands"]
        messages: list[Any] = []
        for c, _, data in bag.messages(connections):
            messages.append(bag.deserialize(data, c.msgtype))
    ours = Recorded.open(alice.folder / result_folder.RECORDINGS / "publisher").numeric(
        "/joint_commands", "data"
    )
    assert ours is not None
    values = np.array([message.data for message in messages])
    assert len(values) > 100
    assert np.array_equal(values, ours.values)
    first = round(float(np.arcsin(values[0, 0] / 0.5) / (2 * np.pi * 0.2 * 0.01)))
    expected = 0.5 * np.sin(2 * np.pi * 0.2 * 0.01 * (first + np.arange(len(values))))
    assert np.allclose(values[:, 0], expected, atol=1e-9)


def test_all_traffic_is_recorded(alice: Graded) -> None:
    """Logs, the clock, the grader's own publications and its service calls are in the bags too."""
    topics = {}
    for s in SESSIONS:
        topics[s] = {
            t.topic for t in Recorded.open(alice.folder / result_folder.RECORDINGS / s).bag.topics
        }
    assert {"/joint_commands", "/rosout", "/parameter_events"} <= topics["publisher"]
    assert {"/joint_commands", "/joint_states", "/rosout"} <= topics["subscriber"]
    assert {"/robot/enable/_service_event", "/parameter_events"} <= topics["service"]
    assert {"/clock", "/joint_states", "/joint_commands"} <= topics["launch"]
    assert {
        "/test_best_effort",
        "/test_reliable",
        "/test_sensor_data",
        "/test_control_command",
    } <= topics["qos"]
    early = (
        Recorded.open(alice.folder / result_folder.RECORDINGS / "subscriber")
        .stream("/joint_states")
        .field("data")
    )
    assert [list(data) for data in early[:20]] == [[0.1, 0.2, 0.3, 0.1, 0.2, 0.3, 0.1]] * 20


def require_recovered(cut: Recorded, folder: Path, killed_ns: int) -> None:
    """Fail unless the bag of a killed recorder reaches up to its end, and other readers agree."""
    chatter = cut.bag.stream("/chatter")
    assert any("the recorder died" in problem for problem in cut.record.problems)
    assert killed_ns - int(chatter.received_ns[-1]) < 1.5e9
    with AnyReader([folder]) as bag:
        counts = [c.msgcount for c in bag.connections if c.topic == "/chatter"]
    assert sum(counts) == len(chatter)


def test_a_killed_recorder_costs_no_points(tmp_path: Path) -> None:
    """When the recorder dies, its bag is recovered, the checks are undecided, and the session is recorded again."""
    steps: list[dict[str, Any]] = [
        {"start": {"student": "talker"}},
        {"wait_for": {"publisher": "/chatter", "type": TEXT, "timeout_s": 20}},
        {"observe": {"duration_s": 0.5, "first_message_on": "/chatter", "timeout_s": 20}},
        {"wait_exit": {"process": "talker", "timeout_s": 60}},
    ]
    lab = make_lab(tmp_path, {"talker": TALKER}, {"only": steps}, checks=[published("/chatter")])
    broken = tmp_path / "broken"
    killed_ns: list[int] = []

    def on_progress(progress: Any) -> None:
        if "until talker ends" in progress.text:
            if not killed_ns:
                # The bag grows while we look, for the sandbox does not wait for us.
                look_on(1.0)
                (director,) = (p for p in below(os.getpid()) if name_of(p) == "director")
                killed_ns.append(time.time_ns())
                os.kill(director, signal.SIGKILL)
                until(lambda: name_of(director) != "director")
            interrupt_students()
        if progress.ended and not broken.exists():
            shutil.copytree(lab.recordings, broken)

    again = lab.record(on_progress)["only"]
    first = open_recordings(broken, lab.rubric())
    require_recovered(first.sessions["only"], broken / "only", killed_ns[0])
    result = judge(first, lab.rubric())
    assert [check.outcome for check in result.checks] == [Outcome.INCONCLUSIVE]
    assert result.score.earned == 0
    assert result.score.undecided == 1
    assert not again.record.problems
    assert judge(open_recordings(lab.recordings, lab.rubric()), lab.rubric()).score.earned == 1


def test_a_grading_without_memory_for_judging_leaves_its_points_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The result names the limit and replaces an earlier one, and the recordings can be judged again."""
    steps: list[dict[str, Any]] = [
        {"start": {"student": "talker"}},
        {"observe": {"duration_s": 3, "first_message_on": "/chatter", "timeout_s": 20}},
        {"interrupt": {"process": "talker"}},
    ]
    long_talker = TALKER.replace("uuid.uuid4().hex", "uuid.uuid4().hex * 50_000")
    lab = make_lab(
        tmp_path, {"talker": long_talker}, {"only": steps}, checks=[published("/chatter")]
    )
    lab.results.mkdir()
    (lab.results / result_folder.RESULT_FILE).write_text("of an earlier grading")
    options = pipeline.Options(Path(sys.executable))
    with monkeypatch.context() as small:
        # Enough to judge without the session, and less than its messages have.
        bound = dataclasses.replace(judgement.JUDGING_BOUND, memory_bytes=64 * 2**20)
        small.setattr(judgement, "JUDGING_BOUND", bound)
        small.setattr(judgement, "SPARING_BOUND", bound)
        result = pipeline.grade(
            lab.submission, lab.rubric(), lab.results, options, lambda progress: None, scheduler()
        )
    assert result.score.earned == 0
    assert result.score.undecided == 1
    assert "(limit: judging)" in to_json(result)
    assert regraded(lab.results).score.earned == 1

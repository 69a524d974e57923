"""Recordings that take too much time or memory to judge: the result names the parts left out."""

from __future__ import annotations

import shutil
import struct
from dataclasses import replace
from pathlib import Path

import pytest

from grader.bounded import Bound
from grader.judging import judgement as judging
from grader.judging import rubrics
from grader.judging.judge import judge, open_recordings
from grader.judging.judgement import judge_bounded
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric
from grader.result import CheckResult, Outcome, Result
from ros_bag.definitions import definition_of
from ros_bag.elements import MOST_VALUES
from ros_bag.qos import Qos
from ros_bag.reading import Bag
from ros_bag.writing import METADATA_FILE, BagWriter
from tests.judging.test_damaged_bags import KEPT, checks_of
from tests.judging.test_invalidated import require_limit
from tests.ros_bag.test_elements import with_dimensions

pytestmark = pytest.mark.slow

FLOATS, COMMANDS = "std_msgs/msg/Float64MultiArray", "/joint_commands"
MOST_MIB = 160


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the rubric of the grader's own lab."""
    return rubrics.read_rubric(None)


def with_messages(folder: Path, session: str, messages: list[bytes]) -> Path:
    """Return a copy of the solution's recordings with other student messages in one session."""
    copy = Path(shutil.copytree(KEPT / "solution", folder / "recordings"))
    bag = Bag.open(copy / session)
    stream = bag.stream(COMMANDS)
    for name in (f"{session}.mcap", METADATA_FILE):
        (copy / session / name).unlink()
    writer = BagWriter(copy / session, session)
    qos = [Qos("reliable", "volatile", liveliness="automatic")]
    for info in bag.topics:
        definition = definition_of(info.topic_type)
        channel = writer.add_channel(info.topic, info.topic_type, "", definition, qos)
        kept = bag.stream(info.topic, info.topic_type)
        data = messages if info.topic == COMMANDS else kept.data
        for number, each in enumerate(data):
            row = number * len(kept) // len(data)
            writer.write(
                channel,
                each,
                received_ns=int(kept.received_ns[row]),
                source_ns=int(kept.source_ns[row]),
                sequence=int(kept.sequence[row]),
            )
    writer.close()
    assert len(stream)
    return copy


def of_session(result: Result, session: str) -> list[CheckResult]:
    """Return the checks of a session."""
    return [check for check in checks_of(result).values() if check.session == session]


def test_a_flood_of_values_is_named_and_the_rest_is_judged(tmp_path: Path, rubric: Rubric) -> None:
    """The student's messages hold more values than are decoded.

    Only checks of their topic are lost.
    """
    per_message = 4 * 20_000 + 5
    count = MOST_VALUES // per_message + 10
    recordings = with_messages(tmp_path, "publisher", [with_dimensions(20_000)] * count)
    result = judge_bounded(recordings, rubric, Overrides(), page=False).result
    named = []
    for check in of_session(result, "publisher"):
        if "limit: decoding" in check.reason:
            named.append(check)
    assert named
    assert all(COMMANDS in check.reason for check in named)
    require_limit(checks_of(result)["publisher.publishes"], f"{count} messages", "decoding")
    whole = checks_of(judge(open_recordings(KEPT / "solution", rubric), rubric))
    others = [check for check in checks_of(result).values() if check.session != "publisher"]
    assert [check.outcome for check in others] == [whole[check.id].outcome for check in others]


def test_a_session_that_takes_too_much_is_left_out(
    tmp_path: Path, rubric: Rubric, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The session is undecided, with the reason; every other session keeps its points."""
    zeros = struct.pack("<BBHIII", 0, 1, 0, 0, 0, 2**20) + bytes(4 + 8 * 2**20)
    recordings = with_messages(tmp_path, "publisher", [zeros] * 30)
    bound = Bound("judging", cpu_s=30.0, wall_s=100.0, memory_bytes=MOST_MIB * 2**20)
    monkeypatch.setattr(judging, "JUDGING_BOUND", bound)
    monkeypatch.setattr(judging, "SPARING_BOUND", replace(bound, cpu_s=10.0))
    judgement = judge_bounded(recordings, rubric, Overrides())
    left_out = of_session(judgement.result, "publisher")
    assert {check.outcome for check in left_out} == {Outcome.INCONCLUSIVE}
    assert any("limit: judging" in check.reason for check in left_out)
    assert any("limit: judging" in problem for problem in judgement.result.problems)
    whole = checks_of(judge(open_recordings(KEPT / "solution", rubric), rubric))
    for session in ("subscriber", "service", "qos"):
        assert [c.outcome for c in of_session(judgement.result, session)] == [
            whole[c.id].outcome for c in of_session(judgement.result, session)
        ]
    assert "publisher" in judgement.page

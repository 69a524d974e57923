"""Checks with a disturbed measurement, in recordings of the solution with a second clock added."""

from __future__ import annotations

import dataclasses
import shutil
from decimal import Decimal
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from grader.judging.attempts import undecided_sessions
from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from grader.recording.session import (
    Endpoint,
    RecordingGap,
    SessionRecord,
    read_session,
    write_session,
)
from grader.recording.trusted_channel import DIGEST_DIGITS
from grader.result import CheckResult, Outcome, Result, ViolationKind
from tests.synthetic import ROOT

#: Messages of the arm that the tests make another's, by their place.
SOME = slice(150 * DIGEST_DIGITS, 160 * DIGEST_DIGITS)


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    """Give a copy of the solution's recordings."""
    shutil.copytree(ROOT / "tests/recordings/solution", tmp_path / "recordings")
    return tmp_path / "recordings"


def disown(folder: Path, topic: str, publisher: bool = True, **changes: object) -> None:
    """Let the arm not have sent some of the messages on a topic, and a node of the student's publish there."""
    record: SessionRecord = read_session(folder / "launch")
    for entry in record.published:
        if entry.topic == topic:
            wrong = "0" * len(entry.digests[SOME])
            entry.digests = entry.digests[: SOME.start] + wrong + entry.digests[SOME.stop :]
    if publisher:
        record.graph[-2].endpoints.append(
            Endpoint("publisher", topic, "", "", "/clockwork", "0b" * 16)
        )
    write_session(folder / "launch", dataclasses.replace(record, **changes))  # type: ignore[arg-type]


def judged(folder: Path, rubric: Rubric) -> tuple[Result, dict[str, CheckResult]]:
    """Judge recordings, and give the results of checks by their ids."""
    result = judge(open_recordings(folder, rubric), rubric)
    return result, {check.id: check for criterion in result.criteria for check in criterion.checks}


def test_what_rests_on_a_second_clock_fails(recordings: Path, rubric: Rubric) -> None:
    """Only the check of traffic in that session fails, with reason and place."""
    disown(recordings, "/clock")
    result, checks = judged(recordings, rubric)
    (violation,) = result.violations
    assert (violation.kind, violation.checks) == (ViolationKind.SPOOFS_CLOCK, ("launch.together",))
    finding = checks.pop("launch.together")
    assert (finding.outcome, finding.credit, finding.measured) == (
        Outcome.FAILED,
        Decimal(0),
        "not measured",
    )
    assert finding.decided_by == "tampered"
    assert finding.reason == f"{violation.text} So this cannot be measured."
    assert finding.where == (violation.where,)
    assert finding.expected
    assert finding.hint
    assert {check.outcome for check in checks.values()} == {Outcome.PASSED}
    assert result.score.earned == Decimal("97.5")


def test_what_can_be_measured_all_the_same_is_judged(recordings: Path, rubric: Rubric) -> None:
    """Messages of others on the arm's topic are stated, left out, and cost nothing by themselves."""
    disown(recordings, "/joint_states")
    result, _ = judged(recordings, rubric)
    (violation,) = result.violations
    assert (violation.kind, violation.checks) == (ViolationKind.PUBLISHES_ON_REFERENCE_TOPIC, ())
    assert violation.evidence[0].startswith("10 messages")
    assert result.score.earned == 100


def test_what_is_not_certain_fails_nothing(recordings: Path, rubric: Rubric) -> None:
    """Without a visible publisher, nobody is charged."""
    disown(recordings, "/clock", publisher=False)
    result, _ = judged(recordings, rubric)
    assert [(v.certain, v.checks) for v in result.violations] == [(False, ())]
    assert result.score.earned == 100


def test_a_session_with_a_problem_stays_undecided(recordings: Path, rubric: Rubric) -> None:
    """A failed experiment of the grader decides nothing, even beside a disturbance."""
    disown(recordings, "/clock", problems=["the reference node arm ended with status -11"])
    result, checks = judged(recordings, rubric)
    assert result.violations
    assert checks["launch.together"].outcome is Outcome.INCONCLUSIVE
    assert checks["launch.loads"].decided_by == "unsound"
    assert result.score.earned + result.score.undecided == 100


def unheard(folder: Path, *, again: bool) -> None:
    """Let the stimulus have published four times as many states as were recorded, once or again."""
    record = read_session(folder / "subscriber")
    for entry in record.published:
        if (entry.process, entry.topic) == ("plateaus", "/joint_states"):
            entry.digests += "0" * 3 * len(entry.digests)
    write_session(
        folder / "subscriber", dataclasses.replace(record, attempt=3, disturbed_before=again)
    )


@pytest.mark.parametrize(
    ("again", "outcome"), [(False, Outcome.INCONCLUSIVE), (True, Outcome.FAILED)]
)
def test_what_rests_on_messages_that_were_not_recorded(
    recordings: Path, rubric: Rubric, again: bool, outcome: Outcome
) -> None:
    """Unrecorded messages leave a check undecided the first time, and fail it the second time.

    All else is judged.
    """
    unheard(recordings, again=again)
    result, checks = judged(recordings, rubric)
    assert [(v.kind, v.certain) for v in result.violations] == [
        (ViolationKind.DISTURBS_RECORDING, again)
    ]
    assert checks["subscriber.receives"].outcome is outcome
    assert checks["subscriber.receives"].decided_by == (
        "disturbed" if again else "messages_dropped"
    )
    assert checks["publisher.rate"].outcome is Outcome.PASSED
    assert checks["subscriber.rms"].earned == 0


@pytest.mark.parametrize(("again", "undecided"), [(False, 20), (True, 0)])
def test_a_recorder_that_is_brought_down_does_not_pay(
    recordings: Path, rubric: Rubric, again: bool, undecided: int
) -> None:
    """A session with a crashed recorder is undecided, and not for ever."""
    record = read_session(recordings / "subscriber")
    director = next(run for run in record.processes if run.role == "grader")
    director.exit_status, problems = -6, ["the recorder died: "]
    write_session(
        recordings / "subscriber",
        dataclasses.replace(record, problems=problems, disturbed_before=again),
    )
    result, checks = judged(recordings, rubric)
    assert [v.kind for v in result.violations] == [ViolationKind.ENDS_REFERENCE]
    assert result.score.undecided == undecided
    assert result.score.earned == 80
    expected = Outcome.FAILED if again else Outcome.INCONCLUSIVE
    assert checks["subscriber.receives"].outcome is expected


def cut_short(folder: Path, session: str, topic: str, messages: int) -> None:
    """Let the recorder have left off a topic of a session, after so many messages."""
    record = read_session(folder / session)
    reason = "they fill as much space as is left for all other topics"
    gap = RecordingGap(
        topic,
        "std_msgs/msg/Float64MultiArray",
        record.started_ns,
        messages,
        10**6,
        reason,
        limit=True,
    )
    write_session(folder / session, dataclasses.replace(record, unrecorded=[gap]))


def test_what_needs_messages_that_a_flood_kept_out_fails_and_says_so(
    recordings: Path, rubric: Rubric
) -> None:
    """Checks of the endpoint alone pass.

    All others fail in full, without a part or an open decision.
    """
    cut_short(recordings, "publisher", "/joint_commands", 34)
    result, checks = judged(recordings, rubric)
    failed = {"publisher.rate", "publisher.steady", "publisher.values", "publisher.motion"}
    assert {name for name, check in checks.items() if check.outcome is not Outcome.PASSED} == failed
    for name in failed:
        finding = checks[name]
        decided = (finding.decided_by, finding.outcome, finding.credit, finding.measured)
        assert decided == ("left_out", Outcome.FAILED, Decimal(0), "not measured in full")
        words = "Only the first 34 messages on /joint_commands (1 MB, 29.4 kB each)"
        before, *after = finding.reason.split(words)
        assert (before, len(after)) == ("", 1), "said once, at the beginning"
        assert finding.expected
        assert finding.hint
    require_limit(checks["publisher.publishes"], "at least ", "recording")
    assert result.problems == ()
    assert result.provenance["sessions"]["publisher"]["limits"] == {"publisher": "recording"}
    assert any("limit: recording" in text for text in result.advisories)


def require_limit(check: CheckResult, measured: str, limit: str) -> None:
    """Require that a check passed by the endpoint names a limit, and does not count only some messages."""
    assert check.outcome is Outcome.PASSED
    assert check.measured.startswith(measured)
    assert any(f"limit: {limit}" in note for note in check.notes)


def keep_first_half(bag: Path) -> None:
    """Write a bag again with the earlier half of its messages."""
    with bag.open("rb") as stream:
        taken = list(make_reader(stream).iter_messages())
    with bag.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in taken[: len(taken) // 2]:
            assert schema is not None
            if channel.id not in channels:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, kind, channel.metadata
                )
            writer.add_message(
                channels[channel.id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
        writer.finish()  # type: ignore[no-untyped-call]


def test_silence_of_a_flood_is_not_called_silence(recordings: Path, rubric: Rubric) -> None:
    """If the window goes on after the recording's end, the reason is the flood, not silence."""
    keep_first_half(next((recordings / "publisher").glob("*.mcap")))
    cut_short(recordings, "publisher", "/joint_commands", 34)
    finding = judged(recordings, rubric)[1]["publisher.rate"]
    assert finding.outcome is Outcome.FAILED
    assert "stop" not in finding.reason + finding.measured


def test_a_recording_that_the_grader_filled_costs_nothing(recordings: Path, rubric: Rubric) -> None:
    """A gap that the grader caused leaves the session undecided, to be recorded again."""
    cut_short(recordings, "launch", "/clock", 34)
    record = read_session(recordings / "launch")
    own_type = next(entry.type for entry in record.published if entry.topic == "/clock")
    gap = [dataclasses.replace(record.unrecorded[0], type=own_type, limit=False, messages=0)]
    write_session(recordings / "launch", dataclasses.replace(record, unrecorded=gap))
    opened = open_recordings(recordings, rubric)
    result = judge(opened, rubric)
    assert (result.score.earned, result.score.undecided) == (Decimal(85), Decimal(15))
    assert "/clock" in result.problems[0]
    assert undecided_sessions(result, list(rubric.sessions)) == ["launch"]

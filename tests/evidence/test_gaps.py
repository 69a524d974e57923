"""Recording gaps, attributed to the writer that filled the recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader.evidence.gaps import describe_gap, dropped, gaps_by_student, limits_hit
from grader.recording.session import (
    Claim,
    Endpoint,
    ProcessRun,
    Published,
    RecordingGap,
    Trusted,
    Usage,
)
from grader.recording.trusted_channel import digest
from tests.synthetic import FLOATS, RELIABLE, Session, at, floats

STATES, COMMANDS = "/joint_states", "/joint_commands"
FILLED = "they fill as much space as is left for all other topics"


def cut(topic: str, messages: int = 3, size_bytes: int = 24_000_150) -> RecordingGap:
    """Return the note about a topic that was recorded up to a limit."""
    return RecordingGap(topic, FLOATS, at(2.0), messages, size_bytes, FILLED, limit=True)


def session(folder: Path, *, own: int, theirs: int) -> Session:
    """Return a session with one message from the arm and one from a student, of these lengths."""
    made = Session(folder).process("arm_driver").process("watcher")
    arm = ProcessRun("arm", "reference", [], started_ns=at(1.0))
    made.record.processes.append(arm)
    made.record.trusted.append(Trusted("arm", "0a" * 12))
    made.record.published.append(Published("arm", STATES, FLOATS, digest(floats([1.0] * own))))
    made.messages(STATES, [[1.0] * own], [1.0]).messages(COMMANDS, [[2.0] * theirs], [1.5])
    return made


@pytest.mark.parametrize(("own", "theirs", "students"), [(10, 1000, True), (1000, 10, False)])
@pytest.mark.parametrize("topic", [STATES, COMMANDS])
def test_who_wrote_most_of_the_recording_has_filled_it(
    tmp_path: Path, own: int, theirs: int, students: bool, topic: str
) -> None:
    """The bytes of each writer decide, not the cut topic's owner: all topics share the room."""
    made = session(tmp_path, own=own, theirs=theirs)
    made.record.unrecorded.append(cut(topic))
    assert len(gaps_by_student(made.recorded())) == (1 if students else 0)


def test_a_students_messages_on_the_graders_topic_are_the_students(tmp_path: Path) -> None:
    """Messages that the grader did not account for are the student's, on any topic."""
    made = session(tmp_path, own=100, theirs=1).messages(STATES, [[9.0] * 300], [1.2])
    made.record.unrecorded.append(cut(STATES))
    assert gaps_by_student(made.recorded()) == [cut(STATES)]


def test_where_a_reference_node_reported_nothing_nobody_is_blamed(tmp_path: Path) -> None:
    """Without a report of the reference node, the grader's own messages are unknown."""
    made = session(tmp_path, own=1, theirs=1000)
    made.record.trusted.clear()
    made.record.unrecorded.append(cut(COMMANDS))
    assert gaps_by_student(made.recorded()) == []


def test_a_type_that_cannot_be_recorded_is_the_students_unless_the_grader_publishes_it(
    tmp_path: Path,
) -> None:
    """The grader must be able to record its own types. No limit was hit, whatever the sizes."""
    made = session(tmp_path, own=1000, theirs=1)
    kinds = ((STATES, FLOATS), (STATES, "a/msg/B"))
    strange = []
    for topic, kind in kinds:
        strange.append(RecordingGap(topic, kind, at(1.0), 0, 0, "unknown", limit=False))
    made.record.unrecorded += strange
    recorded = made.recorded()
    assert gaps_by_student(recorded) == strange[1:]
    assert limits_hit(recorded) == {}


def test_a_topic_too_many_is_the_students(tmp_path: Path) -> None:
    """The grader's own topics are few, and each is recorded from its start."""
    made = session(tmp_path, own=1000, theirs=1)
    made.record.unrecorded.append(
        RecordingGap("/more", FLOATS, at(1.0), 0, 0, "1000 topics are there", limit=True)
    )
    recorded = made.recorded()
    assert len(gaps_by_student(recorded)) == 1
    assert list(limits_hit(recorded).values()) == ["recording"]


def test_the_process_that_asked_for_the_publisher_hit_the_limit(tmp_path: Path) -> None:
    """The tap names the publisher's process; without a note, the busiest process counts.

    A limit hit otherwise stays.
    """
    made = session(tmp_path, own=1, theirs=1000)
    made.record.unrecorded.append(cut(COMMANDS))
    driver, watcher = made.record.processes[:2]
    driver.usage, watcher.usage = [Usage(at(3.0), 10, 0)], [Usage(at(3.0), 20, 0)]
    assert limits_hit(made.recorded()) == {"watcher": "recording"}
    made.record.claims.append(Claim("arm_driver", "publisher", "joint_commands"))
    assert limits_hit(made.recorded()) == {"arm_driver": "recording"}
    driver.limit = "memory"
    assert limits_hit(made.recorded()) == {"arm_driver": "memory"}


@pytest.mark.parametrize(
    ("left_out", "said"),
    [
        (
            cut("/a"),
            f"Only the first 3 messages on /a (24 MB, 8 MB each) are recorded: {FILLED} (limit: recording).",
        ),
        (
            cut("/a", 1, 900),
            f"Only the first message on /a (0.9 kB, 0.9 kB each) are recorded: {FILLED}",
        ),
        (cut("/a", 0, 0), f"Messages on /a are not recorded: {FILLED} (limit: recording)."),
        (
            RecordingGap("/a", "b/msg/C", 0, 0, 0, "unknown", limit=False),
            "Messages on /a of type b/msg/C cannot be recorded: unknown.",
        ),
    ],
)
def test_it_says_what_is_missing(left_out: RecordingGap, said: str) -> None:
    """The text gives the number of recorded messages, their size, and the reason for the gap."""
    assert describe_gap(left_out).startswith(said)


@pytest.mark.parametrize(
    ("ends_s", "first", "honest"), [(20.0, 23, True), (4.0, 301, True), (20.0, 601, False)]
)
def test_what_came_before_the_recorder_is_excused_where_nobody_waited_for_it(
    tmp_path: Path, ends_s: float, first: int, honest: bool
) -> None:
    """A publisher that waited for the recorder published nothing earlier.

    None of its first messages may be missing.
    """
    rows = [[float(n)] for n in range(1000)]
    for waited in (False, True):
        made = Session(tmp_path, f"waited_{waited}")
        made.record.processes.append(
            ProcessRun("arm", "reference", [], started_ns=at(0.0), exited_ns=at(ends_s))
        )
        made.record.trusted.append(Trusted("arm", "0a" * 12))
        digests = "".join(digest(floats(row)) for row in rows)
        made.record.published.append(Published("arm", STATES, FLOATS, digests, recorded=waited))
        made.graph.endpoints.append(
            Endpoint("publisher", STATES, FLOATS, "", "/arm", "0a" * 12 + "01", RELIABLE)
        )
        there = range(first, 1001)
        made.messages(STATES, rows[first - 1 :], [1 + n / 100 for n in there], sequence=there)
        lost = first - 1 > 50 if waited else not honest
        assert len(dropped(made.recorded())) == lost

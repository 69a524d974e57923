"""Telling the grader's own messages from others on the same topic."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from grader.evidence.authorship import Authorship
from grader.evidence.recorded import Recorded
from grader.recording.session import Published, Trusted
from grader.recording.trusted_channel import digest
from tests.synthetic import FLOATS, TEXT, Session, at, floats

TOPIC = "/joint_states"
OWN = [[0.1], [0.2], [0.3]]
OWN_TIMES_S = [1.0, 2.0, 3.0]


def told(rows: Sequence[Sequence[float]] = OWN, process: str = "arm") -> Published:
    """Return a process's account of its own publications."""
    return Published(process, TOPIC, FLOATS, "".join(digest(floats(row)) for row in rows))


def with_own(folder: Path) -> Session:
    """Return a session with three messages published and accounted for by the arm."""
    session = Session(folder).messages(TOPIC, OWN, OWN_TIMES_S)
    session.record.published.append(told())
    return session


def apart(session: Session) -> Authorship:
    """Give the session's messages told apart."""
    found = session.recorded().authorship(TOPIC)
    assert found is not None
    return found


def values(recorded: Recorded) -> list[float]:
    """Give the first number of each message that checks see."""
    return [float(field[0]) for field in recorded.stream(TOPIC).field("data")]


def test_messages_of_another_publisher_are_not_seen(tmp_path: Path) -> None:
    """Between the grader's messages stand others, with sequence numbers of their own: they are left out and counted."""
    session = with_own(tmp_path).messages(TOPIC, [[9.0], [9.1]], [1.5, 2.5])
    assert apart(session).others_ns.tolist() == [at(1.5002), at(2.5002)]
    assert values(session.recorded()) == [0.1, 0.2, 0.3]


def test_what_others_say_before_and_after_is_not_counted(tmp_path: Path) -> None:
    """Only while the grader publishes is the topic its own."""
    assert not len(apart(with_own(tmp_path).messages(TOPIC, [[9.0], [9.1]], [0.5, 3.5])).others_ns)


def test_a_repeated_message_counts_once(tmp_path: Path) -> None:
    """A copy of the grader's message with the same sequence number arrives later. It is foreign."""
    found = apart(with_own(tmp_path).messages(TOPIC, [[0.1]], [1.5]))
    assert found.own.source_ns.tolist() == [at(t) for t in OWN_TIMES_S]
    assert found.others_ns.tolist() == [at(1.5002)]


def test_a_message_recorded_twice_is_nobodys_second(tmp_path: Path) -> None:
    """The same sequence number and source timestamp are the same message."""
    found = apart(with_own(tmp_path).messages(TOPIC, [[0.2]], [2.0], sequence=[2], latency_s=0.3))
    assert len(found.own) == 3
    assert not len(found.others_ns)


def test_the_same_contents_under_another_number_are_anothers(tmp_path: Path) -> None:
    """A digest belongs to its place in the order of publication."""
    assert (
        len(apart(with_own(tmp_path).messages(TOPIC, [[0.1]], [2.5], sequence=[3])).others_ns) == 1
    )


def test_a_flood_of_another_type_does_not_take_the_topic(tmp_path: Path) -> None:
    """The type published by the grader counts, not the most frequent one."""
    session = with_own(tmp_path).texts(TOPIC, ["no"] * 20, [1.5] * 20)
    assert len(apart(session).others_ns) == 20
    recorded = session.recorded()
    assert recorded.stream(TOPIC).topic_type == FLOATS
    assert recorded.bag.stream(TOPIC).topic_type == TEXT
    assert values(recorded) == [0.1, 0.2, 0.3]


def test_two_publishers_of_the_grader_are_both_its_own(tmp_path: Path) -> None:
    """A probe and a reference node may publish on the same topic, one after the other."""
    session = with_own(tmp_path).messages(TOPIC, [[0.7], [0.7]], [0.1, 0.2])
    session.record.published.append(told([[0.7], [0.7]], "director"))
    found = apart(session)
    assert len(found.own) == 5
    assert not len(found.others_ns)


def test_a_lost_message_makes_none_of_the_others_foreign(tmp_path: Path) -> None:
    """A message lost by the recorder leaves a gap, and no more."""
    session = Session(tmp_path).messages(TOPIC, [OWN[0], OWN[2]], [1.0, 3.0], sequence=[1, 3])
    session.record.published.append(told())
    found = apart(session)
    assert (len(found.own), len(found.others_ns)) == (2, 0)


def test_without_anything_reported_all_messages_are_seen(tmp_path: Path) -> None:
    """Older recordings are judged as they were."""
    session = Session(tmp_path).messages(TOPIC, OWN, OWN_TIMES_S).messages(TOPIC, [[9.0]], [1.5])
    recorded = session.recorded()
    assert recorded.authorship(TOPIC) is None
    assert values(recorded) == [0.1, 9.0, 0.2, 0.3]


def test_where_the_student_is_expected_to_publish_nothing_is_left_out(tmp_path: Path) -> None:
    """A topic awaited by the steps is the student's as well: all of its messages count."""
    session = with_own(tmp_path).messages(TOPIC, [[9.0]], [1.5])
    session.step("wait_for", "there", parameters={"publisher": "/states"}).called(
        f"/states={TOPIC}"
    )
    assert values(session.recorded()) == [0.1, 9.0, 0.2, 0.3]


def test_a_publisher_of_the_graders_that_reported_nothing_keeps_all(tmp_path: Path) -> None:
    """A reference node that had to be killed reported no digests: its messages must not be lost for that."""
    session = (
        with_own(tmp_path).messages(TOPIC, [[5.0]], [1.5]).endpoint("publisher", TOPIC, "/plateaus")
    )
    session.record.trusted.append(Trusted("plateaus", session.graph.endpoints[-1].gid[:24]))
    assert values(session.recorded()) == [0.1, 5.0, 0.2, 0.3]


def test_digests_that_fit_no_message_change_nothing(tmp_path: Path) -> None:
    """If not one message can be recognised, the digests are not to be trusted: nothing is left out."""
    session = Session(tmp_path).messages(TOPIC, OWN, OWN_TIMES_S)
    session.record.published.append(told([[7.0]]))
    assert values(session.recorded()) == [0.1, 0.2, 0.3]

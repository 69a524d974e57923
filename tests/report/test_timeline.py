"""The timeline of a session: each thing that the recording tells is a moment of its lane, at its time."""

from __future__ import annotations

import dataclasses
import tarfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from grader.evidence.recorded import Recorded
from grader.recording.session import GraphSnapshot, MachineSample, Trusted
from grader.report.timeline import Moment, Timeline, timeline_of
from grader.result import Location, Outcome
from tests.report.test_submission_page import check, result_of
from tests.synthetic import FLOATS, Session, at, evenly

LABS = Path(__file__).resolve().parents[1] / "labs"


def about(*times_s: float | None) -> Any:
    """Return a value that equals times which differ by less than a message takes."""
    return pytest.approx(times_s[0] if len(times_s) == 1 else times_s, abs=1e-3)


def drawn(session: Session | Recorded, checks: Sequence[Any] = ()) -> Timeline:
    """Return the timeline of a recording."""
    if isinstance(session, Session):
        recorded = session.recorded()
    else:
        recorded = session
    return timeline_of(recorded, result_of(checks))


def lane(timeline: Timeline, name: str, remark: str = "") -> list[Moment]:
    """Return the moments of the only lane of a name."""
    (found,) = [lane for lane in timeline.lanes if lane.name == name and remark in lane.remark]
    return list(found.moments)


def of(moments: Sequence[Moment], style: str) -> Moment:
    """Return the only moment of a style."""
    (found,) = [moment for moment in moments if moment.style == style]
    return found


def test_a_process_from_start_to_exit(tmp_path: Path) -> None:
    """The process runs from its start, its node is found by the tap's notes, and Ctrl-C comes before the exit."""
    session = (
        Session(tmp_path)
        .process("it")
        .claim("publisher", "/cmd")
        .endpoint("publisher", "/cmd", "/talker")
    )
    session.record.claims[0].node = "/talker"
    moments = lane(drawn(session), "it")
    run, found = of(moments, "run"), of(moments, "found")
    assert (run.start_s, run.end_s) == (about(0.1), about(20.1))
    assert (found.start_s, found.text) == (about(1.0), "node /talker is in the graph")
    assert found.note == "900 ms after the start"
    assert of(moments, "interrupt").start_s == about(20.0)
    assert of(moments, "exit").note == ""
    for moment in moments:
        assert not moment.trouble


def test_the_node_of_a_reference_is_known_by_its_gid(tmp_path: Path) -> None:
    """A grader process's own report tells which endpoints are its own."""
    session = (
        Session(tmp_path)
        .process("arm", role="reference")
        .endpoint("publisher", "/states", "/arm_node")
    )
    session.record.trusted.append(Trusted("arm", session.graph.endpoints[0].gid))
    assert of(lane(drawn(session), "arm"), "found").text == "node /arm_node is in the graph"


def test_a_second_start_has_what_came_after_it(tmp_path: Path) -> None:
    """A node that was in the graph before belongs to the first start."""
    session = Session(tmp_path).process("it", exited_ns=at(2.0), interrupted_ns=None)
    session.process("it", started_ns=at(3.0)).endpoint("publisher", "/cmd", "/talker").claim(
        "publisher", "/cmd"
    )
    session.record.claims[0].node = "/talker"
    again = dataclasses.replace(session.graph.endpoints[0], gid="f" * 32)
    session.record.graph.append(GraphSnapshot(at(4.0), ["/talker"], [again]))
    timeline = drawn(session)
    assert of(lane(timeline, "it, start 1"), "found").start_s == about(1.0)
    assert of(lane(timeline, "it, start 2"), "found").start_s == about(4.0)


@pytest.mark.parametrize(
    ("facts", "style"),
    [
        ({"exit_status": 1, "ended_by": "itself"}, "bad-exit"),
        ({"exit_status": -9, "ended_by": "kill"}, "bad-exit"),
        ({"exit_status": 0, "ended_by": "itself"}, "exit"),
        ({"exit_status": -9, "ended_by": "kill", "role": "reference"}, "exit"),
    ],
)
def test_how_a_process_ended(facts: dict[str, Any], style: str, tmp_path: Path) -> None:
    """A student's that ended with an error, or had to be ended, is marked."""
    moment = of(lane(drawn(Session(tmp_path).process("it", **facts)), "it"), style)
    assert moment.trouble == (style == "bad-exit")


TRACEBACK = (
    "Traceback (most recent call last):",
    '  File "it.py", line 3, in <module>',
    "    self.x()",
    "AttributeError: no x",
)


def test_warnings_errors_and_exceptions_lead_to_their_lines(tmp_path: Path) -> None:
    """Each is at the time of its line; of a traceback that is its last."""
    lines = [
        (2.0, "[INFO] [1.0] [it]: begins"),
        (2.5, "[it-1] [WARN] [1.0] [it]: slow [3]: very"),
        (2.6, "it.py:3: DeprecationWarning: old"),
        (3.0, "[ERROR] [1.0] [it]: bad"),
        *((4.0, text) for text in TRACEBACK),
        (5.0, "said [WARN] in the middle"),
    ]
    timeline = drawn(Session(tmp_path).process("it", lines))
    told = [(m.style, m.start_s, m.text, m.line) for m in lane(timeline, "it") if m.trouble]
    assert sorted(told, key=lambda one: one[1]) == [
        ("warning", about(2.5), "slow [3]: very", (0, 1)),
        ("warning", about(2.6), "it.py:3: DeprecationWarning: old", (0, 2)),
        ("logged-error", about(3.0), "bad", (0, 3)),
        ("raised", about(4.0), "AttributeError: no x", (0, 7)),
    ]
    assert timeline.linked_lines(0) >= {1, 2, 3, 7}
    assert timeline.linked_lines(1) == set()


def test_a_flood_of_warnings_is_bounded(tmp_path: Path) -> None:
    """Equal ones are one, with their number; of different ones some are shown, and it is told; how it ended stays."""
    same = [(2.0 + n / 1e4, "[WARN] [1.0] [it]: again") for n in range(5000)]
    (warning,) = [
        m
        for m in lane(drawn(Session(tmp_path / "a").process("it", same)), "it")
        if m.style == "warning"
    ]
    assert warning.note == "5000 times"
    other = [(2.0 + n / 1e4, f"[WARN] [1.0] [it]: number {n}") for n in range(5000)]
    other += [(3.0, text) for text in TRACEBACK]
    moments = lane(drawn(Session(tmp_path / "b").process("it", other)), "it", "60 of 5004 moments")
    assert len(moments) == 60
    assert {"run", "interrupt", "exit", "raised"} < {moment.style for moment in moments}


def test_steps_say_what_came_of_them(tmp_path: Path) -> None:
    """A window begins when it opened; a timeout is marked, with the alternatives in the graph."""
    session = Session(tmp_path).window(1.2, 7.2)
    wait = {"publisher": "/cmd", "timeout_s": 5.0}
    session.step("wait_for", "topic", "timeout", parameters=wait)
    session.step("wait_for", "near", parameters=wait, name="/comd")
    session.step(
        "set_parameters", "", parameters={"node": "/it", "values": {}}, refused={"rate": "too high"}
    )
    moments = lane(drawn(session), "steps")
    window = of(moments, "window")
    assert (window.start_s, window.end_s, window.text) == (
        about(1.2),
        about(7.2),
        "observe (window)",
    )
    late, near = (moment for moment in moments if moment.style == "wait")
    assert (late.text, late.note, late.trouble) == (
        "waiting for publisher /cmd (topic)",
        "gave up waiting",
        True,
    )
    assert near.note == "found as /comd"
    assert of(moments, "step").note == "refused: rate: 'too high'"


def test_steps_are_named_in_words(tmp_path: Path) -> None:
    """Labels are keys of a rubric, `*` means all programs, and a window without a message is named."""
    session = Session(tmp_path)
    window = {"duration_s": 9.5, "first_message_on": "/cmd"}
    session.step("observe", "while_off", "timeout", parameters=window, topic="/cmd")
    session.step("interrupt", "", parameters={"process": "*"})
    silent, ended = lane(drawn(session), "steps")
    assert silent.text == "observing for 9.5 s (while off)"
    assert silent.note == "gave up waiting; no message on /cmd"
    assert ended.text == "interrupting all programs"


def call(start_s: float, answer: Any, took_s: float = 0.001) -> dict[str, Any]:
    """Return the record of a call."""
    return {"started_ns": at(start_s), "ended_ns": at(start_s + took_s), "response": answer}


def test_calls_have_their_answers(tmp_path: Path) -> None:
    """Calls that were answered alike, one after the other, are one moment; silence is trouble."""
    calls = [
        call(2.0, {"success": True}),
        call(2.1, {"success": True}, 0.004),
        call(2.2, {"success": False}),
    ]
    session = Session(tmp_path)
    request = {"request": {"data": True}}
    session.step(
        "call", "many", parameters=request, service="/enable", calls=[*calls, call(2.3, None, 1.0)]
    )
    accepted, refused, silent = lane(drawn(session), "steps")
    assert accepted.text == "calling /enable with data: true (many)"
    assert (accepted.style, accepted.note) == (
        "call-accepted",
        "2 times: success: true, after at most 4 ms",
    )
    assert (refused.style, refused.note) == ("call-refused", "success: false, after 1 ms")
    assert (silent.style, silent.note, silent.trouble) == (
        "call-silent",
        "no answer, after 1 s",
        True,
    )
    assert silent.end_s == about(3.3)


def test_a_topic_shows_its_endpoints_first_message_and_silence(tmp_path: Path) -> None:
    """Messages between silences are a bar, with their rate; every node's own topics are left out."""
    session = (
        Session(tmp_path)
        .endpoint("publisher", "/cmd", "/talker")
        .endpoint("publisher", "/rosout", "/talker")
    )
    times_s = [*evenly(100, 1.0, 2.0), *evenly(100, 1.0, 6.0)]
    timeline = drawn(session.messages("/cmd", [[0.0]] * len(times_s), times_s))
    moments = lane(timeline, "/cmd")
    assert of(moments, "found").text == "publisher of /cmd is in the graph"
    assert of(moments, "first").start_s == about(2.0)
    bars = [moment for moment in moments if moment.style == "traffic"]
    assert [(b.start_s, b.end_s) for b in bars] == [about(2, 3), about(6, 7)]
    assert bars[0].text == "/cmd: 101 messages, 100 Hz"
    assert [lane.name for lane in timeline.lanes] == ["/cmd"]


def test_a_topic_without_messages_is_there(tmp_path: Path) -> None:
    """Its endpoint was in the graph, and nothing came."""
    moments = lane(
        drawn(Session(tmp_path).endpoint("subscription", "/states", "/listener", FLOATS)), "/states"
    )
    assert [moment.style for moment in moments] == ["found"]


def test_the_machine_is_shown_where_it_was_late(tmp_path: Path) -> None:
    """A stall is a lane of its own, a delay lies in the lane of its process; without them there is neither."""
    session = Session(tmp_path / "late").process("it").disturbed("it", (3.0, 0.2), (5.0, 0.01))
    times_s = [*evenly(2, 4.0, 0.5), *evenly(2, 3.0, 7.5)]
    session.record.machine = [MachineSample(at(t), 0) for t in times_s]
    timeline = drawn(session)
    assert (
        of(lane(timeline, "it"), "delay").text
        == "the grading computer was busy: it waited for a core, 200 ms"
    )
    (stall,) = lane(timeline, "grading computer")
    assert (stall.start_s, stall.end_s) == (about(4.5), about(7.5))
    assert stall.text == "everything stalled for about 2.5 s"
    quiet = drawn(Session(tmp_path / "quiet").process("it"))
    assert not {"delay", "stall"} & quiet.styles


def test_states_of_a_lifecycle_node_follow_each_other(tmp_path: Path) -> None:
    """Each lasts until the next transition was answered, the last to the end."""
    session = Session(tmp_path)
    times: dict[str, Any]
    for asked_s, before, after in ((2.0, "unconfigured", "inactive"), (4.0, "inactive", "active")):
        times = {"called_ns": at(asked_s), "answered_ns": at(asked_s + 0.1)}
        session.step(
            "change_state", after, node="/talker", before=before, after=after, success=True, **times
        )
    timeline = drawn(session)
    states = [(m.text, m.start_s, m.end_s) for m in lane(timeline, "/talker")]
    assert states == [
        ("/talker is unconfigured", about(1.0), about(2.1)),
        ("/talker is inactive", about(2.1), about(4.1)),
        ("/talker is active", about(4.1), about(30.0)),
    ]
    assert lane(timeline, "steps")[0].note == "unconfigured → inactive"


def test_goals_of_a_real_recording(tmp_path: Path) -> None:
    """Goals that ran side by side lie in two lanes; below are feedback and the wish to cancel."""
    with tarfile.open(LABS / "fibonacci/recordings/not_preempted.tar.xz") as archive:
        archive.extractall(tmp_path, filter="data")
    timeline = drawn(Recorded.open(tmp_path / "server"))
    first, second = (lane.moments for lane in timeline.lanes if lane.remark == "goals")
    texts = [moment.text for moment in first]
    assert texts == [
        "five: order: 5",
        "negative: order: -1",
        "cancelled: order: 25",
        "preempted: order: 25",
    ]
    assert first[1].note == "rejected"
    assert first[0].note.startswith("accepted, succeeded: sequence: [0, 1, 1")
    assert second[0].start_s < (first[3].end_s or 0)
    beside = lane(timeline, "/fibonacci", "feedback")
    assert of(beside, "cancel").note == "accepted"
    assert sum(moment.style == "feedback" for moment in beside) >= 2


@pytest.mark.parametrize(
    ("accepted", "ended_ns", "style", "note"),
    [
        (True, None, "goal-silent", "accepted, no result"),
        (None, None, "goal-silent", "not answered"),
        (False, None, "goal", "rejected"),
    ],
)
def test_goals_without_a_result(
    accepted: bool | None, ended_ns: None, style: str, note: str, tmp_path: Path
) -> None:
    """A goal without an answer lasts to the end of its step, and is trouble; a rejected goal is none."""
    goal = {
        "sent_ns": at(1.1),
        "answered_ns": at(1.2),
        "accepted": accepted,
        "ended_ns": ended_ns,
        "goal": {"order": 3},
    }
    session = Session(tmp_path).step(
        "send_goal", "three", parameters={"action": "/count"}, goals=[goal]
    )
    (moment,) = lane(drawn(session), "/count", "goals")
    assert (moment.style, moment.note, moment.trouble) == (style, note, style == "goal-silent")
    assert moment.end_s == about(1.2 if accepted is False else 2.0)


def test_points_are_where_their_proof_lies(tmp_path: Path) -> None:
    """Losses that overlap lie below each other, each a link to its check; losses of other sessions are not there."""
    places = [Location(session="experiment", start_s=s, end_s=s + 2) for s in (1.0, 2.0, 4.0)]
    checks = [
        check("a.one", Outcome.FAILED, "0", "4", reason="It is late.", where=(places[0],)),
        check("a.two", Outcome.INCONCLUSIVE, "0", "2", where=(places[1],)),
        check("a.three", Outcome.PARTIAL, "1", "2", where=(Location(file="it.py"), places[2])),
        check("a.good", Outcome.PASSED, "2", "2", where=(places[0],)),
        check(
            "a.other",
            Outcome.FAILED,
            "0",
            "2",
            where=(dataclasses.replace(places[0], session="other"),),
        ),
    ]
    timeline = drawn(Session(tmp_path).process("it"), checks)
    first, second = (lane.moments for lane in timeline.lanes if lane.name == "points")
    assert [moment.text for moment in first] == ["−4: Title of a.one", "−1: Title of a.three"]
    assert (first[0].href, first[0].note, first[0].end_s) == ("#check-a.one", "It is late.", 3.0)
    assert [(moment.style, moment.text) for moment in second] == [
        ("open", "2 open: Title of a.two")
    ]


def test_a_moment_leads_to_what_was_written_soon_after(tmp_path: Path) -> None:
    """A step leads to the first line of a student's program within a second; later lines have other causes."""
    session = Session(tmp_path).process("it", [(0.5, "early"), (1.4, "soon"), (1.5, "later")])
    session.process("arm", [(1.1, "the lab's")], role="reference").step("publish", "")
    (step,) = lane(drawn(session), "steps")
    assert step.line == (0, 1)
    other = Session(tmp_path / "late").process("it", [(2.5, "much later")]).step("publish", "")
    assert lane(drawn(other), "steps")[0].line is None


def test_what_lies_outside_of_the_session_is_brought_in(tmp_path: Path) -> None:
    """Times of a clock that was set stay within the picture, and nothing divides by zero."""
    session = Session(tmp_path)
    session.process("it", [(-5.0, "[WARN] [1]: a"), (50.0, "[WARN] [1]: b")])
    timeline = drawn(session)
    for *_, m in timeline.rows:
        assert 0 <= m.start_s <= timeline.length_s
        assert (m.end_s or 0) <= timeline.length_s
    empty = Session(tmp_path / "empty")
    empty.record.ended_ns, empty.record.graph = 0, []
    assert drawn(empty).lanes == []
    assert drawn(empty).percentage(0.0) == "0%"

"""Accidents that also happen to correct programs now and then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from grader.evidence.flakiness import flaky_end, inconclusive_reason
from grader.recording.session import Claim, OutputLine, ProcessRun
from tests.synthetic import Session, at

#: Words about a wait that the machine can have prolonged.
BUSY = "in time while the grading computer was busy"
_TRACEBACK = """\
Traceback (most recent call last):
  File "/ws/src/joint_subscriber.py", line 93, in <module>
    main()
  File "/ws/src/joint_subscriber.py", line 84, in main
    {call}
  File "{file}", line 7, in {function}
    pass
KeyboardInterrupt"""


def interrupted(file: str, function: str, call: str) -> ProcessRun:
    """Give a process that Ctrl-C ended within a function."""
    text = _TRACEBACK.format(file=file, function=function, call=call)
    lines = [OutputLine(2, "stderr", line) for line in text.splitlines()]
    return ProcessRun(
        "subscriber", "student", [], output=lines, interrupted_ns=1, ended_by="interrupt"
    )


@pytest.mark.parametrize(
    ("run", "is_flaky"),
    [
        (
            interrupted(
                "/ws/src/joint_subscriber.py", "print_statistics", "print_statistics(node)"
            ),
            True,
        ),
        (interrupted("/opt/rclpy/__init__.py", "spin", "rclpy.spin(node)"), False),
        (interrupted("/opt/rclpy/executors.py", "spin_once", "executor.spin_once()"), False),
    ],
)
def test_ctrl_c_is_to_be_expected_while_a_node_spins(run: ProcessRun, is_flaky: bool) -> None:
    """Spin ends when rclpy hears the signal; Python may raise the exception later, after spin."""
    assert bool(flaky_end(run)) == is_flaky


def test_an_interrupt_that_nobody_sent_is_the_programs_own() -> None:
    """A program may raise the exception itself."""
    run = interrupted("/ws/src/joint_subscriber.py", "print_statistics", "print_statistics(node)")
    run.interrupted_ns = None
    assert not flaky_end(run)


@pytest.mark.parametrize(
    ("between", "is_open"),
    [(None, False), ({"started": False}, False), ({"started": True}, True)],
)
@pytest.mark.parametrize("delayed_s", [1.05, 5.0])
def test_what_was_missing_in_a_calm_time_is_not_waited_for_again(
    tmp_path: Path, delayed_s: float, between: dict[str, Any] | None, is_open: bool
) -> None:
    """A delay does not explain an object that was also missing in a calm time, earlier or later.

    A program started between the two times may have created or ended the object.
    """
    session = Session(tmp_path).process("it").disturbed("it", (delayed_s, 0.9))
    session.step("wait_for", "first", "timeout", parameters={"service": "/enable"})
    if between is not None:
        session.step("start", "again", **between)
    session.step("call", "second", "timeout", parameters={"service": "/enable"})
    session.record.steps[-1].started_ns, session.record.steps[-1].ended_ns = at(5.0), at(6.0)
    assert (BUSY in str(inconclusive_reason(session.recorded(), ()))) == is_open


@pytest.mark.parametrize("kind", ["service", "node"])
def test_what_a_delay_may_explain_is_waited_for_again(tmp_path: Path, kind: str) -> None:
    """Another object is waited for again, and so is one with two disturbed waits."""
    session = Session(tmp_path).process("it").disturbed("it", (1.05, 0.9), (5.0, 0.9))
    session.step("wait_for", "first", "timeout", parameters={kind: "/enable"})
    assert BUSY in str(inconclusive_reason(session.recorded(), ()))
    session = Session(tmp_path / "other").process("it").disturbed("it", (5.0, 0.9))
    session.step("wait_for", "first", "timeout", parameters={kind: "/other"})
    session.step("call", "second", "timeout", parameters={"service": "/enable"}, calls=[{}])
    session.step("call", "third", "timeout", parameters={"service": "/enable"})
    session.record.steps[-1].started_ns, session.record.steps[-1].ended_ns = at(5.0), at(6.0)
    assert BUSY in str(inconclusive_reason(session.recorded(), ()))


def test_a_program_that_ended_by_itself_is_not_waited_for(tmp_path: Path) -> None:
    """The name of a program that has ended cannot come any more, whatever the machine did; another may still come."""
    session = Session(tmp_path).process("it").disturbed("it", (1.05, 0.9))
    session.step("wait_for", "first", "timeout", parameters={"service": "/enable"})
    assert "/enable did not appear in time" in str(inconclusive_reason(session.recorded(), ()))
    run = session.record.processes[0]
    run.ended_by, run.interrupted_ns, run.exited_ns = "itself", None, at(1.2)
    assert BUSY not in str(inconclusive_reason(session.recorded(), ()))
    session.process("another")
    assert BUSY in str(inconclusive_reason(session.recorded(), ()))
    session.claim("service", "enable")
    assert session.record.claims[0].process == "it"
    assert BUSY not in str(inconclusive_reason(session.recorded(), ()))


def test_what_was_explained_before_a_start_stays_so(tmp_path: Path) -> None:
    """A calm wait outweighs a disturbed one for the same object; later starts change nothing."""
    session = Session(tmp_path).process("it").disturbed("it", (5.0, 0.9))
    session.step("wait_for", "first", "timeout", parameters={"service": "/enable"})
    session.step("call", "second", "timeout", parameters={"service": "/enable"})
    session.record.steps[-1].started_ns, session.record.steps[-1].ended_ns = at(5.0), at(6.0)
    session.step("start", "another")
    assert BUSY not in str(inconclusive_reason(session.recorded(), ()))


@pytest.mark.parametrize("came", [False, True])
def test_what_has_not_come_in_a_calm_time_after_either_was_not_kept_by_a_delay(
    tmp_path: Path, came: bool
) -> None:
    """Any calm time counts, even one spent on another wait.

    An object that came in that time may have been delayed until then.
    """
    session = (
        Session(tmp_path).process("it").disturbed("it", (1.05, 0.9)).node("/it").claim("node", "it")
    )
    session.step("wait_for", "first", "timeout", parameters={"publisher": "/late"})
    session.step("wait_for", "second", "timeout", parameters={"publisher": "/other"})
    session.record.steps[-1].started_ns, session.record.steps[-1].ended_ns = at(5.0), at(8.0)
    if came:
        session.endpoint("publisher", "/late")
    assert (BUSY in str(inconclusive_reason(session.recorded(), ()))) == came


@pytest.mark.parametrize(("delay_s", "is_open"), [(5.5, False), (7.5, True)])
def test_who_had_time_enough_was_not_kept_by_a_delay(
    tmp_path: Path, delay_s: float, is_open: bool
) -> None:
    """With a delay in each half second of 10 s, 3 s in all are enough for ten starts of a node."""
    parts = ((1.0 + n / 2, delay_s / 20) for n in range(20))
    session = (
        Session(tmp_path).process("it").disturbed("it", *parts).node("/it").claim("node", "it")
    )
    session.step("wait_for", "first", "timeout", parameters={"service": "/enable"})
    session.record.steps[-1].ended_ns = at(11.0)
    assert (BUSY in str(inconclusive_reason(session.recorded(), ()))) == is_open


@pytest.mark.parametrize(
    ("ended_by", "times", "is_open"),
    [("interrupt", 1, True), ("interrupt", 2, False), ("itself", 1, False)],
)
def test_a_program_that_asked_for_nothing_while_it_was_waited_for_is_seen_again(
    tmp_path: Path, ended_by: str, times: int, is_open: bool
) -> None:
    """A node of a correct launch file once stood in Python's own start for 16 s, beside others that came up."""
    session = (
        Session(tmp_path).process("it", ended_by="interrupt").process("stands", ended_by=ended_by)
    )
    session.node("/it").claim("node", "it").step(
        "wait_for", "service", "timeout", parameters={"service": "/enable"}
    )
    session.record.attempt = times
    assert (
        "its node did not appear" in str(inconclusive_reason(session.recorded(), ()))
    ) == is_open
    session.record.claims.append(Claim("stands", "node", "other"))
    assert inconclusive_reason(session.recorded(), ()) is None


@pytest.mark.parametrize(("waited_s", "is_open"), [(2.0, True), (15.0, False)])
def test_a_crowd_of_ones_own_threads_waits_for_itself(
    tmp_path: Path, waited_s: float, is_open: bool
) -> None:
    """A program with a dozen threads that wait at a time starts late by its own doing."""
    session = Session(tmp_path).process("it").delayed("it", 10 * waited_s, 10.0, 1.0)
    session.disturbed("it", (1.05, 0.9))
    session.step("wait_for", "first", "timeout", parameters={"node": "/it"})
    assert (BUSY in str(inconclusive_reason(session.recorded(), ()))) == is_open

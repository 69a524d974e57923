"""The checks that Lab 09-01 has of its own for the extensions, on recordings made by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grader.checks.base import Context
from grader.checks.registry import check_named
from grader.lab.lab_code import OwnParameters
from grader.recording.session import StepRun
from grader.result import Finding, Outcome
from tests.synthetic import ROOT, Session, at, evenly, submission

COMMANDS = "/joint_commands"
POINTS = [([1.0, -0.5], {"sec": 1}), ([0.0, 0.5], {"sec": 2, "nanosec": 500_000_000})]
GOAL = {
    "trajectory": {
        "points": [{"positions": place, "time_from_start": time} for place, time in POINTS]
    }
}
#: When the goal is sent, and how long the step takes.
SENT_S, TAKES_S = 5.0, 3.0


def judged(name: str, session: Session, **parameters: Any) -> Finding:
    """Let one of the lab's own checks judge a session."""
    recorded = session.recorded()
    context = Context(submission(), recorded, {"experiment": recorded}, {}, frozenset(), ROOT)
    given = OwnParameters.model_validate({"process": "it", **parameters})
    return check_named(f"reference/extension_checks.py:{name}").judge(context, given)


def stepped(
    session: Session, kind: str, start_s: float, end_s: float, outcome: str = "done", **given: Any
) -> Session:
    """Add a step called "step"."""
    session.record.steps.append(StepRun(kind, given, "step", at(start_s), at(end_s), outcome, {}))
    return session


def moved(
    folder: Path, rate_hz: float, ends_s: tuple[float, float] = (1.0, 2.5), *, late_s: float = 0.0
) -> Session:
    """Give a node that follows the lines at a rate, with its points at some times, from a moment after the goal on."""
    times_s = np.arange(0.0, ends_s[1] + 1e-9, 1 / rate_hz)
    columns = zip((0.0, 0.0), *(place for place, _ in POINTS), strict=True)
    rows = np.stack([np.interp(times_s, (0.0, *ends_s), column) for column in columns], axis=1)
    session = (
        Session(folder)
        .process()
        .messages(COMMANDS, rows.tolist(), (times_s + SENT_S + late_s).tolist())
    )
    return stepped(session, "send_goal", SENT_S, SENT_S + TAKES_S, goal=GOAL)


def line(session: Session) -> Finding:
    """Judge whether the commands are on the lines."""
    return judged("on_the_line", session, step="step", topic=COMMANDS)


@pytest.mark.parametrize("rate_hz", [48.0, 100.0, 333.0])
@pytest.mark.parametrize("late_s", [0.0, 0.2])
def test_a_node_that_keeps_to_the_lines_is_right_at_any_rate(
    tmp_path: Path, rate_hz: float, late_s: float
) -> None:
    """The time begins with the first command, as a thread may take a moment to begin."""
    assert line(moved(tmp_path, rate_hz, late_s=late_s)).outcome is Outcome.PASSED


def test_times_that_are_added_up_are_named(tmp_path: Path) -> None:
    """A point's time is that from the start, not the length of its line."""
    found = line(moved(tmp_path, 100.0, (1.0, 3.5)))
    assert found.outcome is Outcome.FAILED
    assert "added up, to 1 and 3.5 s" in found.reason


def test_the_bare_points_earn_nothing_although_each_comes_at_its_time(tmp_path: Path) -> None:
    """Between them the arm is where it must not be."""
    session = (
        Session(tmp_path)
        .process()
        .messages(COMMANDS, [[0.0, 0.0], *(p for p, _ in POINTS)], [5.0, 6.0, 7.5])
    )
    found = line(stepped(session, "send_goal", SENT_S, SENT_S + TAKES_S, goal=GOAL))
    assert found.outcome is Outcome.FAILED
    assert "added up" not in found.reason


def test_a_motion_that_ends_early_earns_a_part(tmp_path: Path) -> None:
    """From 2.0 s on the arm is kept short of the last point."""
    session = moved(tmp_path, 100.0)
    times_s = [SENT_S + 2.0 + n / 100 for n in range(1, 101)]
    rows = [[1 - 1 / 1.5, -0.5 + 1 / 1.5]] * len(times_s)
    kept = Session(tmp_path / "short").process()
    stream = session.recorded().stream(COMMANDS)
    before = stream.source_ns <= at(SENT_S + 2.0)
    moving = []
    for row, is_before in zip(stream.field("data"), before, strict=True):
        if is_before:
            moving.append(list(row))
    kept.messages(
        COMMANDS,
        moving + rows,
        [(t - at(0)) / 1e9 for t in stream.source_ns[before].tolist()] + times_s,
    )
    found = line(stepped(kept, "send_goal", SENT_S, SENT_S + TAKES_S, goal=GOAL))
    assert found.outcome is Outcome.PARTIAL


@pytest.mark.parametrize("rows", [[[1.0]], [[np.nan, np.nan]], [[np.inf, 0.0]], [[]]])
def test_messages_of_anything_are_judged(tmp_path: Path, rows: list[list[float]]) -> None:
    """A message with another number of values, or none that is finite, is off the line."""
    session = Session(tmp_path).process().messages(COMMANDS, rows * 300, evenly(100, 2.99, SENT_S))
    assert (
        line(stepped(session, "send_goal", SENT_S, SENT_S + TAKES_S, goal=GOAL)).outcome
        is Outcome.FAILED
    )


def test_a_line_that_the_machine_delayed_is_undecided(tmp_path: Path) -> None:
    """A node that counts its steps lags by the time without a core."""
    session = moved(tmp_path, 100.0, (1.2, 2.9)).disturbed("it", (SENT_S + 0.5, 0.4))
    assert line(session).outcome is Outcome.INCONCLUSIVE
    assert line(moved(tmp_path / "idle", 100.0, (1.2, 2.9))).outcome is not Outcome.INCONCLUSIVE


@pytest.mark.parametrize(
    ("rate_hz", "credit"), [(100.0, 1.0), (46.0, 1.0), (33.0, 0.5), (20.0, 0.0)]
)
def test_the_rate_of_commands(tmp_path: Path, rate_hz: float, credit: float) -> None:
    """A loop that sleeps for its whole period of 0.02 s is right; one of 33 Hz earns a part."""
    found = judged("often_enough", moved(tmp_path, rate_hz), step="step", topic=COMMANDS)
    assert float(found.credit) == pytest.approx(credit, abs=0.1)


@pytest.mark.parametrize(
    ("scale", "kept_s", "outcome"),
    [
        (1.0, 0.0, Outcome.PASSED),
        (100.0, 0.0, Outcome.FAILED),
        (0.7, 0.0, Outcome.FAILED),
        (float("nan"), 0.0, Outcome.FAILED),
        (0.85, 0.4, Outcome.INCONCLUSIVE),
    ],
    ids=["the share", "percent", "of another time", "no number", "behind, as it had no core"],
)
def test_progress_is_the_share_of_the_time(
    tmp_path: Path, scale: float, kept_s: float, outcome: Outcome
) -> None:
    """Progress is compared with the time since the goal was accepted."""
    told = []
    for n in range(26):
        told.append({"t_ns": at(SENT_S + n / 10), "values": {"progress": scale * n / 25}})
    session = moved(tmp_path, 100.0).disturbed("it", (SENT_S + 0.5, kept_s))
    session.record.steps[-1].result["goals"] = [{"answered_ns": at(SENT_S), "feedback": told}]
    assert judged("progress_by_time", session, step="step").outcome is outcome


def test_what_was_not_recorded_is_no_pause(tmp_path: Path) -> None:
    """A number is missing where a message was published all the same."""
    times_s = [t for t in evenly(100, 9.0) if not 5.0 < t < 6.0]
    numbers = [round(100 * t) for t in times_s]
    session = Session(tmp_path).process(exited_ns=at(10.1))
    session.messages(COMMANDS, [[0.0]] * len(times_s), times_s, sequence=numbers)
    found = judged("goes_on", stepped(session, "call", SENT_S, 6.0), topic=COMMANDS, step="step")
    assert found.outcome is Outcome.PASSED


def answering(folder: Path, pauses: list[tuple[float, float]], ended_s: float) -> Session:
    """Give a publisher at 100 Hz with pauses, and a call at 5 s that is answered at some time."""
    times_s = []
    for t in evenly(100, 9.0):
        if not any(a < t < b for a, b in pauses):
            times_s.append(t)
    session = (
        Session(folder)
        .process(exited_ns=at(10.1))
        .messages(COMMANDS, [[0.0]] * len(times_s), times_s)
    )
    return stepped(session, "call", SENT_S, ended_s)


@pytest.mark.parametrize(
    ("pauses", "ended_s", "outcome"),
    [
        ([], 5.001, Outcome.PASSED),
        ([(3.0, 4.0)], 5.001, Outcome.PASSED),
        ([], 6.5, Outcome.PASSED),
        ([(5.0, 6.0)], 6.0, Outcome.FAILED),
        ([(4.99, 5.4)], 5.4, Outcome.PARTIAL),
        ([(5.2, 99.0)], 5.4, Outcome.FAILED),
    ],
    ids=[
        "at once",
        "a pause before",
        "slow and beside",
        "sleeps",
        "sleeps a little",
        "never again",
    ],
)
def test_commands_go_on_while_a_call_is_answered(
    tmp_path: Path, pauses: list[tuple[float, float]], ended_s: float, outcome: Outcome
) -> None:
    """Only a pause that touches the call counts, however long the answer takes."""
    session = answering(tmp_path, pauses, ended_s)
    assert judged("goes_on", session, topic=COMMANDS, step="step").outcome is outcome


def test_a_pause_of_the_machines_is_undecided(tmp_path: Path) -> None:
    """The process had no core while the call was under way."""
    session = answering(tmp_path, [(5.0, 5.7)], 5.7).disturbed("it", (5.05, 0.6))
    assert judged("goes_on", session, topic=COMMANDS, step="step").outcome is Outcome.INCONCLUSIVE


@pytest.mark.parametrize(
    ("outcome", "wanted"), [("done", Outcome.PASSED), ("timeout", Outcome.FAILED)]
)
def test_a_publisher_that_a_step_waited_for(tmp_path: Path, outcome: str, wanted: Outcome) -> None:
    """The publisher was there in time, or it was not."""
    session = stepped(
        Session(tmp_path).process(), "wait_for", 1.0, 3.0, outcome, publisher=COMMANDS
    )
    assert judged("came", session, step="step").outcome is wanted


@pytest.mark.parametrize(
    ("said", "outcome"),
    [
        ("RMS tracking error: 0.1234 rad", Outcome.PASSED),
        ("[1795543787.4] joint_state_subscriber started", Outcome.FAILED),
        ("RMS: not enough samples", Outcome.FAILED),
    ],
)
def test_a_subscriber_reports(tmp_path: Path, said: str, outcome: Outcome) -> None:
    """A number behind the word is a report; one before it, as a logger's time, is none."""
    assert judged("prints", Session(tmp_path).process(lines=[said]), text="rms").outcome is outcome

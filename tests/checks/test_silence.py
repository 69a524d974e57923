"""Silence until something happens, and after it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from grader.result import Outcome
from tests.synthetic import Session, at, judged

FLOAT = "std_msgs/msg/Float64"


def spoken(folder: Path, *times_s: float) -> Session:
    """Make a session with publications at some times, a step from 1 to 2 s and a goal at 3 s."""
    session = Session(folder).process().step("publish", "go")
    session.typed("/goal", FLOAT, [{"data": n} for n in range(5)], [3.0 + n for n in range(5)])
    if times_s:
        return session.typed("/out", FLOAT, [{}] * len(times_s), times_s)
    return session


UNTIL: dict[str, dict[str, Any]] = {
    "step": {"topic": "/out", "step": "go"},
    "message": {"topic": "/out", "message_on": "/goal"},
    "condition": {"topic": "/out", "condition": {"topic": "/goal", "field": "data", "low": 2.0}},
}
BEGINS = {"step": 1.0, "message": 3.0, "condition": 5.0}


@pytest.mark.parametrize("kind", UNTIL)
def test_who_waits_passes_and_who_does_not_is_shown(tmp_path: Path, kind: str) -> None:
    """A message stamped a little before counts as after it."""
    begins = BEGINS[kind]
    for name, first, outcome in (
        ("right", begins + 0.1, Outcome.PASSED),
        ("edge", begins - 0.049, Outcome.PASSED),
    ):
        assert (
            judged("silent_until", UNTIL[kind], spoken(tmp_path / name, first)).outcome is outcome
        )
    finding = judged(
        "silent_until", UNTIL[kind], spoken(tmp_path / "wrong", begins - 0.06, begins + 0.1)
    )
    assert finding.outcome is Outcome.FAILED
    assert finding.measured == "1 messages too early"
    assert f"Messages come from {begins - 0.06:.2f} s on" in finding.reason


def test_silence_for_ever_proves_nothing_unless_it_may(tmp_path: Path) -> None:
    """Publishing must begin, soon enough."""
    assert (
        judged("silent_until", UNTIL["step"], spoken(tmp_path / "never")).outcome is Outcome.FAILED
    )
    assert (
        judged("silent_until", UNTIL["step"], spoken(tmp_path / "late", 9.0)).outcome
        is Outcome.FAILED
    )
    may = {**UNTIL["step"], "begins_within_s": None}
    assert judged("silent_until", may, spoken(tmp_path / "may")).outcome is Outcome.PASSED


def test_the_machine_may_have_kept_it_silent(tmp_path: Path) -> None:
    """Half a second too late, with a delay of one."""
    session = spoken(tmp_path, 6.5).disturbed("it", (3.0, 1.0))
    assert judged("silent_until", UNTIL["step"], session).outcome is Outcome.INCONCLUSIVE


def test_what_never_came_can_prove_nothing(tmp_path: Path) -> None:
    """A node that published without waiting has failed all the same."""
    parameters = {"topic": "/out", "message_on": "/start"}
    assert (
        judged("silent_until", parameters, spoken(tmp_path / "silent")).outcome
        is Outcome.NOT_REACHED
    )
    assert (
        judged("silent_until", parameters, spoken(tmp_path / "loud", 4.0)).outcome is Outcome.FAILED
    )


@pytest.mark.parametrize(
    ("ended_s", "outcome"), [(8.0, Outcome.INCONCLUSIVE), (20.0, Outcome.FAILED)]
)
def test_what_may_come_after_the_end_is_in_doubt(
    tmp_path: Path, ended_s: float, outcome: Outcome
) -> None:
    """A node that was delayed for four seconds need not have begun a moment after its five."""
    session = Session(tmp_path).process().step("publish", "go").disturbed("it", (1.5, 4.0))
    session.record.ended_ns = at(ended_s)
    assert judged("silent_until", {"topic": "/out", "step": "go"}, session).outcome is outcome

"""Silence after a step, as Lab 09-01 checks it."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.result import Outcome
from tests.synthetic import Session, judged

STOPS_PUBLISHING = "reference/checks/silence.py:stops_publishing"
FLOAT = "std_msgs/msg/Float64"


def spoken(folder: Path, *times_s: float) -> Session:
    """Make a session with publications at some times, a step from 1 to 2 s and a goal at 3 s."""
    session = Session(folder).process().step("publish", "go")
    session.typed("/goal", FLOAT, [{"data": n} for n in range(5)], [3.0 + n for n in range(5)])
    if times_s:
        return session.typed("/out", FLOAT, [{}] * len(times_s), times_s)
    return session


STOPS: dict[str, Any] = {"topic": "/out", "step": "go", "within_s": 0.5, "none_from_s": 1.5}


@pytest.mark.parametrize(
    ("times", "credit"),
    [
        ((1.5,), "1"),
        ((1.5, 2.49), "1"),
        ((1.5, 3.0), "0.5"),
        ((1.5, 2.6, 3.6), "0"),
        ((1.5, 20.0), "0"),
    ],
)
def test_the_last_message_after_the_step_counts(
    tmp_path: Path, times: Sequence[float], credit: str
) -> None:
    """The step ends at 2 s; half a second is allowed, and after one and a half there is no credit."""
    assert judged(STOPS_PUBLISHING, STOPS, spoken(tmp_path, *times)).credit == Decimal(credit)


def test_a_node_that_never_published_has_nothing_to_stop(tmp_path: Path) -> None:
    """The missing messages are charged elsewhere."""
    assert (
        judged(STOPS_PUBLISHING, STOPS, spoken(tmp_path / "a", 2.2)).outcome is Outcome.NOT_REACHED
    )
    unknown = {**STOPS, "step": "stop"}
    assert (
        judged(STOPS_PUBLISHING, unknown, spoken(tmp_path / "b", 1.5)).outcome
        is Outcome.NOT_REACHED
    )


def test_it_counts_until_a_step(tmp_path: Path) -> None:
    """Messages after another step do not count."""
    session = spoken(tmp_path, 1.5, 20.0).step("publish", "again")
    session.record.steps[-1].started_ns += 10_000_000_000
    assert judged(STOPS_PUBLISHING, {**STOPS, "until": "again"}, session).outcome is Outcome.PASSED


def test_a_message_that_the_machine_made_late_is_in_doubt(tmp_path: Path) -> None:
    """0.3 s late, with a delay of as much."""
    session = spoken(tmp_path, 1.5, 2.8).disturbed("it", (2.2, 0.4))
    assert judged(STOPS_PUBLISHING, STOPS, session).outcome is Outcome.INCONCLUSIVE

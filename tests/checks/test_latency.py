"""Times from messages to their answers, and the delays that the machine added."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.result import Finding, Outcome
from tests.synthetic import START_NS, Session, at, judged

STAMPED, INT = "geometry_msgs/msg/PointStamped", "std_msgs/msg/Int32"
LIMITS = [
    {"share": "50%", "full_within_s": 0.02, "none_beyond_s": 0.1},
    {"share": "95%", "full_within_s": 0.05, "none_beyond_s": 0.2},
]
BY_STAMP = {
    "input": {"topic": "/in"},
    "output": {"topic": "/out"},
    "match": "stamp",
    "limits": LIMITS,
}
COUNT = 200


def stamped(time_s: float) -> dict[str, Any]:
    """Give a message with its stamp."""
    since = at(time_s) - START_NS
    return {"header": {"stamp": {"sec": since // 10**9, "nanosec": since % 10**9}}}


def answered(folder: Path, lag_s: Callable[[int], float | None], kind: str = STAMPED) -> Session:
    """Make a session with a node that answers 200 messages at 20 Hz, each after a time or never."""
    times = [1.0 + n / 20 for n in range(COUNT)]
    lags = [lag_s(n) for n in range(COUNT)]
    sent = sorted(
        (t + lag, n) for n, (t, lag) in enumerate(zip(times, lags, strict=True)) if lag is not None
    )

    def message(n: int) -> dict[str, Any]:
        return stamped(times[n]) if kind == STAMPED else {"data": n}

    session = (
        Session(folder).process().typed("/in", kind, [message(n) for n in range(COUNT)], times)
    )
    return session.typed("/out", kind, [message(n) for _, n in sent], [t for t, _ in sent])


def latency(folder: Path, lag_s: Callable[[int], float | None], **more: Any) -> Finding:
    """Judge the latency by stamps."""
    return judged("message_latency", {**BY_STAMP, **more}, answered(folder, lag_s))


def test_soon_is_right(tmp_path: Path) -> None:
    """5 ms, within 20."""
    finding = latency(tmp_path, lambda n: 0.005)
    assert finding.outcome is Outcome.PASSED
    assert finding.measured == "50% within 5.0 ms; 95% within 5.0 ms; 200 of 200 messages answered"


@pytest.mark.parametrize(
    ("lag_s", "credit"), [(0.019, "1"), (0.045, "0.8"), (0.06, "0.6"), (0.15, "0.1"), (0.3, "0")]
)
def test_later_answers_earn_less(tmp_path: Path, lag_s: float, credit: str) -> None:
    """Median and 95 % count the same, each in steps."""
    assert latency(tmp_path, lambda n: lag_s).credit == Decimal(credit)


def test_few_slow_answers_cost_the_quantile_only(tmp_path: Path) -> None:
    """One in eight takes 0.3 s: the median does not see it, 95 % does."""
    finding = latency(tmp_path, lambda n: 0.3 if n % 8 == 0 else 0.005)
    assert finding.credit == Decimal("0.5")
    assert "95% of the answers take up to" in finding.reason


def test_what_is_not_answered_costs_its_share(tmp_path: Path) -> None:
    """Unanswered messages, half of all, cost their share."""
    finding = latency(tmp_path, lambda n: 0.005 if n % 2 == 0 else None)
    assert finding.credit == Decimal("0.5")
    assert "of 200 messages were not answered" in finding.reason


def test_what_the_machine_delayed_is_in_doubt_and_no_more_than_that(tmp_path: Path) -> None:
    """Slow answers in delays may be fast ones; slow answers everywhere are the node's."""
    pauses = [(1.0 + n / 20, 0.05) for n in range(0, COUNT, 4)]
    some = answered(tmp_path / "some", lambda n: 0.051 if n % 4 == 0 else 0.005).disturbed(
        "it", *pauses
    )
    only = [{"share": "95%", "full_within_s": 0.01, "none_beyond_s": 0.2}]
    assert (
        judged("message_latency", {**BY_STAMP, "limits": only}, some).outcome
        is Outcome.INCONCLUSIVE
    )
    every = answered(tmp_path / "every", lambda n: 0.5).disturbed("it", *pauses)
    assert judged("message_latency", {**BY_STAMP, "limits": only}, every).outcome is Outcome.FAILED


@pytest.mark.parametrize(("usual_s", "outcome"), [(0.005, Outcome.PASSED), (0.3, Outcome.FAILED)])
def test_a_delay_of_one_message_decides_nothing(
    tmp_path: Path, usual_s: float, outcome: Outcome
) -> None:
    """One of eighty answers waited for the machine, and is the slowest: 95 % of them are known all the same."""
    within = {
        "window": "window",
        "limits": [{"share": "95%", "full_within_s": 0.02, "none_beyond_s": 0.1}],
    }
    session = answered(tmp_path, lambda n: usual_s + (0.03 if n == 50 else 0.0)).disturbed(
        "it", (3.5, 0.03)
    )
    finding = judged("message_latency", {**BY_STAMP, **within}, session.window(2.0, 6.0))
    assert finding.outcome is outcome


def test_messages_that_the_machine_kept_away_are_in_doubt(tmp_path: Path) -> None:
    """Without room in a queue, a delay of two seconds loses all messages that arrive in it."""
    session = answered(tmp_path, lambda n: None if 40 <= n < 80 else 0.005).disturbed(
        "it", (3.0, 2.0)
    )
    assert judged("message_latency", BY_STAMP, session).outcome is Outcome.INCONCLUSIVE


def test_a_field_can_name_the_message(tmp_path: Path) -> None:
    """Answers may overtake each other."""
    field = {
        "input": {"topic": "/in", "field": "data"},
        "output": {"topic": "/out", "field": "data"},
        "match": "field",
    }
    session = answered(tmp_path, lambda n: 0.011 if n % 2 else 0.063, INT)
    finding = judged("message_latency", {**BY_STAMP, **field}, session)
    assert "95% within 63.0 ms" in finding.measured


def test_the_next_message_is_the_answer(tmp_path: Path) -> None:
    """An input followed directly by the next input has no answer."""
    session = answered(tmp_path, lambda n: 0.005 if n % 4 else None, INT)
    finding = judged("message_latency", {**BY_STAMP, "match": "next"}, session)
    assert "50% within 5.0 ms" in finding.measured
    assert "150 of 199 messages answered" in finding.measured


def test_without_answers_it_fails_and_without_inputs_nothing_can_be_said(tmp_path: Path) -> None:
    """A missing answer is the node's fault; a missing question is not."""
    assert latency(tmp_path / "silent", lambda n: None).outcome is Outcome.FAILED
    alone = Session(tmp_path / "alone").process().typed("/out", STAMPED, [stamped(1.0)], [1.0])
    assert judged("message_latency", BY_STAMP, alone).outcome is Outcome.NOT_REACHED


def test_what_answers_nothing_is_said_to(tmp_path: Path) -> None:
    """Messages came, but with other stamps."""
    session = answered(tmp_path, lambda n: None)
    session.typed(
        "/out",
        STAMPED,
        [stamped(100.0 + n / 20) for n in range(COUNT)],
        [1.0 + n / 20 for n in range(COUNT)],
    )
    finding = judged("message_latency", BY_STAMP, session)
    assert finding.outcome is Outcome.FAILED
    assert finding.reason == "No message on /out answers one on /in."

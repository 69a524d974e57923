"""Highest rate of a topic without a lost message: our recorder compared with a plain one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bench.together import run_together

RATES_HZ = (500, 1000, 2000, 3000, 5000, 7500, 10000, 15000, 20000, 30000, 40000)
_LENGTH_S = 2.0
#: Smallest share of the rate that a publisher must reach; below it, the publisher is the limit.
_KEPT_UP = 0.95
_TRIES = 2


@dataclass(frozen=True)
class Limit:
    """The highest rate of a recorder without a lost message.

    Attributes
    ----------
    held_by : str
        Cause of the limit, e.g. `loses 3.1% at 2,000 Hz`.
    """

    rate_hz: float
    held_by: str


def greatest_rate(recorder: str, *more: str) -> Limit:
    """Increase the rate until messages are lost twice in a row, or the publisher is too slow."""
    best_hz = 0.0
    for rate_hz in RATES_HZ:
        for _ in range(_TRIES):
            published, received = _once(rate_hz, recorder, *more)
            if received["recorded"] == published["published"]:
                break
        if published["rate_hz"] < _KEPT_UP * rate_hz:
            return Limit(best_hz, f"the publisher reaches {published['rate_hz']:,.0f} Hz")
        if received["recorded"] < published["published"]:
            lost = 1 - received["recorded"] / published["published"]
            return Limit(best_hz, f"loses {lost:.1%} at {rate_hz:,} Hz")
        best_hz = published["rate_hz"]
    return Limit(best_hz, "nothing lost at the highest rate tried")


def _once(rate_hz: float, recorder: str, *more: str) -> list[dict[str, Any]]:
    publisher = ["publisher", str(rate_hz), str(round(rate_hz * _LENGTH_S)), "1"]
    return run_together([[recorder, *more]], publisher)


def rows() -> list[list[str]]:
    """Return the row of the table: our limit, the plain recorder's limit, ratio."""
    ours = greatest_rate("our_recorder", "idle")
    plain = greatest_rate("plain_recorder")
    ratio = f"{ours.rate_hz / plain.rate_hz:.1f}" if plain.rate_hz else "–"
    return [
        [
            f"{ours.rate_hz:,.0f} Hz ({ours.held_by})",
            f"{plain.rate_hz:,.0f} Hz ({plain.held_by})",
            ratio,
        ]
    ]

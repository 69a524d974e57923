"""How fast a topic may be for nothing of it to be lost: our recorder against a plain one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bench.together import run_together

RATES_HZ = (500, 1000, 2000, 3000, 5000, 7500, 10000, 15000, 20000, 30000, 40000)
_LENGTH_S = 2.0
#: A publisher that keeps up with less of the rate than this has found its own limit.
_KEPT_UP = 0.95
_TRIES = 2


@dataclass(frozen=True)
class Limit:
    """The greatest rate at which a recorder lost nothing.

    Attributes
    ----------
    held_by : str
        What happened at the next rate.
    """

    rate_hz: float
    held_by: str


def greatest_rate(recorder: str, *more: str) -> Limit:
    """Step the rate up until messages are lost, twice in a row, or the publisher does not keep up."""
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
    return Limit(best_hz, "nothing lost at the greatest rate tried")


def _once(rate_hz: float, recorder: str, *more: str) -> list[dict[str, Any]]:
    publisher = ["publisher", str(rate_hz), str(round(rate_hz * _LENGTH_S)), "1"]
    return run_together([[recorder, *more]], publisher)


def rows() -> list[list[str]]:
    """Return the rows of the table: what, ours, plain."""
    ours, plain = greatest_rate("our_recorder", "idle"), greatest_rate("plain_recorder")
    ratio = f"{ours.rate_hz / plain.rate_hz:.1f}" if plain.rate_hz else "–"
    return [
        [
            f"{ours.rate_hz:,.0f} Hz ({ours.held_by})",
            f"{plain.rate_hz:,.0f} Hz ({plain.held_by})",
            ratio,
        ]
    ]

"""The schedule that a publisher keeps to, seen in what the machine did not disturb.

A timer that was late stays on its schedule: what it missed it leaves out, or makes up for at once. So the times of
undisturbed messages lie on a lattice, and tell its period some hundred times as exactly as the intervals between them.
A loop that sleeps from one message to the next begins anew after each delay, and keeps to none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grader.evidence.cpu_delay import MADE_UP, Calm, Delay
from grader.evidence.recorded import Floats, Integers
from grader.evidence.timing import Timing


@dataclass(frozen=True)
class Schedule:
    """Evenly spaced times, and how many of them a program left out by itself."""

    #: Times a second, and the share of them by which that may be wrong.
    rate_hz: float
    error: float
    #: Share of the times at which nothing was disturbed and no message came, and the share's error.
    left_out: float
    left_out_error: float

    def bounds_hz(self) -> tuple[float, float]:
        """Return the bounds of the rate at which it would have published on a machine of its own."""
        least_hz, most_hz = (
            self.rate_hz
            * (1 + sign * self.error)
            * (1 - self.left_out + sign * self.left_out_error)
            for sign in (-1, 1)
        )
        return least_hz, most_hz


def kept_schedule(calm: Calm, delays: Sequence[Delay], timing: Timing) -> Schedule | None:
    """Return the schedule that the undisturbed messages of a topic keep to; None if they keep to none.

    Of the delays, those that are harmless to the intervals should be left out.
    """
    where = np.flatnonzero(calm.undisturbed)
    if len(where) < _FEWEST:
        return None
    times_s: Floats = (timing.times_ns[where] - timing.times_ns[0]) / np.float64(1e9)
    stretch: Integers = np.cumsum(np.diff(where, prepend=where[0]) > 1, dtype=np.int64)
    ticks = _ticks(times_s, stretch, float(np.median(calm.intervals_s)))
    if ticks is None:
        return None
    period_s, start_s = np.polyfit(ticks, times_s, 1)
    off_s, centred = times_s - start_s - period_s * ticks, ticks - ticks.mean()
    error = float(
        np.linalg.norm(np.bincount(stretch, off_s * centred)) / (centred @ centred) / period_s
    )
    lacking = _lacking(
        delays, timing, float(period_s) * 1e9, timing.times_ns[0] + float(start_s) * 1e9
    )
    if len(lacking) < _FEWEST:
        return None
    of_runs = np.bincount(
        np.cumsum(lacking == 0), lacking
    )  # what lacks in a row, lacks for one reason
    error_left_out = _ERRORS * float(np.linalg.norm(of_runs)) / len(lacking)
    return Schedule(1 / float(period_s), _ERRORS * error, float(lacking.mean()), error_left_out)


#: How many standard deviations are an error.
_ERRORS = 2.5
#: From so many undisturbed messages there may be a schedule, and from so many of its times it is known what lacks.
_FEWEST = 20


def _lacking(
    delays: Sequence[Delay], timing: Timing, period_ns: float, start_ns: float
) -> Integers:
    """Return how many messages lack at each time of a schedule that nothing disturbed; where two came, -1.

    Times are looked at, not messages: where one lacks, the interval is longer, and is disturbed the more often.
    """
    last = np.rint((timing.times_ns - start_ns) / period_ns).astype(np.int64)
    before = np.rint((timing.times_ns - timing.intervals_s * 1e9 - start_ns) / period_ns).astype(
        np.int64
    )
    first = int(before.min())
    came = np.bincount(last - first)
    # What lies between two messages of which one between was not recorded is in no interval.
    within = (
        np.cumsum(np.bincount(before + 1 - first, minlength=len(came) + 1)[: len(came)])
        - np.cumsum(came)
        + came
    )
    clear = within > 0
    for delay in delays:
        until_ns = delay.end_ns + MADE_UP * delay.delay_ns
        from_tick, to_tick = (
            (ns - start_ns) / period_ns - first for ns in (delay.start_ns, until_ns)
        )
        clear[max(0, math.ceil(from_tick - 0.5)) : max(0, math.ceil(to_tick + 0.5))] = False
    lacking: Integers = 1 - came[clear]
    return lacking


def _ticks(times_s: Floats, stretch: Integers, usual_s: float) -> Floats | None:
    """Return by number the times of a schedule near which others lie; None if they lie near those of none.

    Where messages keep to none, each undisturbed stretch has a phase by chance: the square of the sum of all vectors is
    more than x times that of the stretches' with a probability of exp(-x), at each of some hundred frequencies.
    """
    near_hz, step_hz = 1 / usual_s, 1 / (_FINENESS * max(float(times_s[-1]), usual_s))
    rates_hz = near_hz + np.arange(-_NEAR * near_hz, _NEAR * near_hz + step_hz, step_hz)
    if len(rates_hz) * len(times_s) > _MOST:
        return None
    vectors = np.exp(2j * np.pi * np.outer(rates_hz, times_s))
    best = int(np.abs(vectors.sum(axis=1)).argmax())
    together = vectors[best].sum()
    apart = np.add.reduceat(vectors[best], np.flatnonzero(np.diff(stretch, prepend=-1)))
    if abs(together) < _ALIKE * len(times_s) or abs(together) ** 2 < _UNLIKELY * float(
        (np.abs(apart) ** 2).sum()
    ):
        return None
    ticks: Floats = np.rint(rates_hz[best] * times_s - np.angle(together) / (2 * np.pi))
    return ticks


#: How far from the usual interval's a rate is looked for, and how finely, in parts of one more tick in all.
_NEAR, _FINENESS = 0.05, 8
#: What is looked through, rates by times: up to some 350 Hz. The intervals of a higher rate are many.
_MOST = 2_000_000
#: The length of the mean vector from which each message is near the tick that it belongs to.
_ALIKE = 0.7
#: A schedule by chance has a probability of a hundred times exp(-14), one in ten thousand.
_UNLIKELY = 14.0

"""The schedule of a publisher, as its undisturbed messages show it.

A timer that was late stays on its schedule: it leaves out the missed times, or makes up for them at once. The times of
undisturbed messages therefore lie on a lattice, and give its period about a hundred times as exactly as the intervals
between them. A loop that sleeps after each message starts anew after each delay, and has no schedule.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from grader.evidence.cpu_delay import MADE_UP, Calm, Delay
from grader.evidence.recorded import Floats, Integers
from grader.evidence.timing import Timing

Vectors: TypeAlias = NDArray[np.complex128]

#: Standard deviations that count as an error.
_ERRORS = 2.5
#: Undisturbed messages, and undisturbed times of a schedule, from which one is known.
_FEWEST = 20
#: Largest relative distance of a rate from the rate of the usual interval.
_NEAR = 0.05
#: Steps between rates that differ by one tick over the whole time.
_FINENESS = 8
#: Rates times messages that are tried: enough for about 350 Hz. A higher rate has many intervals, and needs no lattice.
_MOST = 2_000_000
#: Length of the mean vector from which each message is near its own tick.
_ALIKE = 0.7
#: A schedule by chance has a probability of a hundred times exp(-14), one in ten thousand.
_UNLIKELY = 14.0


@dataclass(frozen=True)
class Schedule:
    """Evenly spaced times, and the share of them that a program left out by itself."""

    #: Times per second.
    rate_hz: float
    #: Relative error of the rate.
    error: float
    #: Share of the undisturbed times without a message.
    left_out: float
    #: Error of that share.
    left_out_error: float

    def bounds_hz(self) -> tuple[float, float]:
        """Return the bounds of the rate that the program would have on a machine of its own."""
        least_share = 1 - self.left_out - self.left_out_error
        most_share = 1 - self.left_out + self.left_out_error
        least_hz = self.rate_hz * (1 - self.error) * least_share
        most_hz = self.rate_hz * (1 + self.error) * most_share
        return least_hz, most_hz


def kept_schedule(calm: Calm, delays: Sequence[Delay], timing: Timing) -> Schedule | None:
    """Return the schedule of a topic's undisturbed messages; None if they have none.

    Parameters
    ----------
    calm
        The undisturbed intervals.
    delays
        Delays of the publisher, without those that are harmless to the intervals.
    timing
        All intervals.
    """
    where = np.flatnonzero(calm.undisturbed)
    if len(where) < _FEWEST:
        return None
    start_ns = timing.times_ns[0]
    times_s: Floats = (timing.times_ns[where] - start_ns) / np.float64(1e9)
    begins = np.diff(where, prepend=where[0]) > 1
    stretch: Integers = np.cumsum(begins, dtype=np.int64)
    ticks = _ticks(times_s, stretch, float(np.median(calm.intervals_s)))
    if ticks is None:
        return None
    period_s, first_s = np.polyfit(ticks, times_s, 1)
    error = _period_error(ticks, times_s - first_s - period_s * ticks, stretch) / period_s
    lattice = _Lattice(start_ns + float(first_s) * 1e9, float(period_s) * 1e9)
    missing = _missing(delays, timing, lattice)
    if len(missing) < _FEWEST:
        return None
    rate_hz = 1 / float(period_s)
    return Schedule(rate_hz, _ERRORS * float(error), float(missing.mean()), _share_error(missing))


@dataclass(frozen=True)
class _Lattice:
    """Evenly spaced times in ns."""

    start_ns: float
    period_ns: float

    def tick(self, time_ns: float) -> float:
        """Convert a time to ticks of the lattice, from 0 at its start."""
        return (time_ns - self.start_ns) / self.period_ns

    def nearest(self, times_ns: Floats | Integers) -> Integers:
        """Return the tick nearest to each time."""
        ticks = (times_ns - self.start_ns) / self.period_ns
        return np.rint(ticks).astype(np.int64)


def _period_error(ticks: Floats, off_s: Floats, stretch: Integers) -> float:
    """Return the standard error of a fitted period in s; the messages of a stretch are not independent."""
    centred = ticks - ticks.mean()
    of_stretches = np.bincount(stretch, off_s * centred)
    return float(np.linalg.norm(of_stretches) / (centred @ centred))


def _share_error(missing: Integers) -> float:
    """Return the error of the share of missing messages; those missing in a row have one cause."""
    runs = np.cumsum(missing == 0)
    of_runs = np.bincount(runs, missing)
    return _ERRORS * float(np.linalg.norm(of_runs)) / len(missing)


def _missing(delays: Sequence[Delay], timing: Timing, lattice: _Lattice) -> Integers:
    """Return the number of missing messages at each undisturbed time of a schedule; -1 if two came.

    Times are examined, not messages: a missing message makes its interval longer, and a long interval is disturbed
    more often.
    """
    last = lattice.nearest(timing.times_ns)
    before = lattice.nearest(timing.times_ns - timing.intervals_s * 1e9)
    first = int(before.min())
    came = np.bincount(last - first)
    # Ticks between two messages, with a message between them that was not recorded, lie in no interval.
    opened = np.bincount(before + 1 - first, minlength=len(came) + 1)[: len(came)]
    within = np.cumsum(opened) - np.cumsum(came) + came
    clear = within > 0
    for delay in delays:
        until_ns = delay.end_ns + MADE_UP * delay.delay_ns
        start = math.ceil(lattice.tick(delay.start_ns) - first - 0.5)
        end = math.ceil(lattice.tick(until_ns) - first + 0.5)
        clear[max(0, start) : max(0, end)] = False
    missing: Integers = 1 - came[clear]
    return missing


def _ticks(times_s: Floats, stretch: Integers, usual_s: float) -> Floats | None:
    """Return the tick of each message on the schedule that fits best; None if no schedule fits.

    Notes
    -----
    Without a schedule each undisturbed stretch has a phase by chance. The square of the sum of all vectors then
    exceeds x times that of the stretches with a probability of exp(-x), at each of some hundred frequencies.
    """
    near_hz = 1 / usual_s
    length_s = max(float(times_s[-1]), usual_s)
    step_hz = 1 / (_FINENESS * length_s)
    reach_hz = _NEAR * near_hz
    offsets_hz = np.arange(-reach_hz, reach_hz + step_hz, step_hz)
    rates_hz = near_hz + offsets_hz
    if len(rates_hz) * len(times_s) > _MOST:
        return None
    best_hz = _rate_of_longest_sum(rates_hz, times_s)
    vectors = _vectors(best_hz, times_s)
    if not _is_schedule(vectors, stretch):
        return None
    phase = np.angle(vectors.sum()) / (2 * np.pi)
    ticks: Floats = np.rint(best_hz * times_s - phase)
    return ticks


def _vectors(rate_hz: float, times_s: Floats) -> Vectors:
    """Return the phases of times at a rate, as complex numbers of length 1."""
    vectors: Vectors = np.exp(2j * np.pi * (rate_hz * times_s))
    return vectors


def _rate_of_longest_sum(rates_hz: Floats, times_s: Floats) -> float:
    """Return the one of some evenly spaced rates at which the phases of the times agree most."""
    # A rate is the first one of its block and an offset. The phases at all rates are then products of a few, which takes
    # a tenth of the time of the functions of an angle.
    size = math.isqrt(len(rates_hz))
    first = np.exp(2j * np.pi * np.outer(rates_hz[::size], times_s))
    offsets = np.exp(2j * np.pi * np.outer(rates_hz[:size] - rates_hz[0], times_s))
    # A matrix product would start threads.
    sums = np.einsum("rt,ot->ro", first, offsets).ravel()
    lengths = np.abs(sums[: len(rates_hz)])
    return float(rates_hz[lengths.argmax()])


def _is_schedule(vectors: Vectors, stretch: Integers) -> bool:
    """Return whether the phases of messages agree, and more so than stretches do by chance."""
    length = abs(vectors.sum())
    if length < _ALIKE * len(vectors):
        return False
    begins = np.flatnonzero(np.diff(stretch, prepend=-1))
    apart = np.abs(np.add.reduceat(vectors, begins))
    return bool(length**2 >= _UNLIKELY * float((apart**2).sum()))

"""Delays of a process by the machine, and the part of a measurement that they did not affect.

The machine delays a process that has work while its core serves others, or stalls. Waits for threads of its own, or
for other programs of the student's, do not count.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Least share of a core by which a process is taken to catch up.
_LEAST_BUSY = 0.1
#: Undisturbed stretches from which their deviations are known.
_FEWEST_STRETCHES = 12
#: Standard deviations of stretches that count as an error.
_SURE = 2.5
#: Standard deviations of a sample's quantile that count as its error.
_CONFIDENCE = 3.0
#: Undisturbed intervals that can stand for all.
_ENOUGH = 20
#: Least sum of these intervals, in s.
_ENOUGH_S = 0.5
#: Part of a delay within which a process makes up for it afterwards.
MADE_UP = 0.5
#: Usual intervals, delays not counted, from which an interval is a pause of the program itself.
_PAUSE = 3.0


@dataclass(frozen=True)
class Span:
    """A span of time in ns of the system clock."""

    start_ns: int
    end_ns: int

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return (self.end_ns - self.start_ns) / 1e9

    def shared_ns(self, start_ns: int, end_ns: int) -> int:
        """Return the length of the overlap with another span, in ns."""
        latest_start_ns = max(start_ns, self.start_ns)
        return max(0, min(end_ns, self.end_ns) - latest_start_ns)


@dataclass(frozen=True)
class Delay:
    """A delay of a process at an unknown moment of a span; times in ns."""

    start_ns: int
    end_ns: int
    delay_ns: int
    #: Standstill of the core in the delay; the rest are waits for other programs.
    stalled_ns: int = 0

    @property
    def waited_ns(self) -> int:
        """Waits for other programs in the delay, in ns."""
        return self.delay_ns - self.stalled_ns


def clipped(delays: Iterable[Delay], span: Span) -> Iterator[Delay]:
    """Yield the parts of delays that can lie within a span, at most as long as the overlap."""
    for delay in delays:
        shared_ns = span.shared_ns(delay.start_ns, delay.end_ns)
        if shared_ns:
            start_ns = max(delay.start_ns, span.start_ns)
            yield Delay(start_ns, start_ns + shared_ns, min(delay.delay_ns, shared_ns))


def delay_before(delays: Iterable[Delay], times_ns: Integers) -> Floats:
    """Return the sum of the delays before each time in ns; a delay is spread evenly over its span."""
    edges_ns: list[int] = []
    growth_ns: list[int] = []
    for delay in delays:
        edges_ns += [delay.start_ns, delay.end_ns]
        growth_ns += [0, delay.delay_ns]
    found: Floats = np.interp(times_ns, np.array(edges_ns), np.cumsum(growth_ns))
    return found


@dataclass(frozen=True)
class Backlog:
    """Messages that waited for a process while the machine delayed it."""

    #: Time within a span during which arriving messages found a full queue.
    lost_s: float
    #: Average additional time until a message was handled.
    late_s: float


def backlog(delays: Iterable[Delay], span: Span, room_s: float, busy: float) -> Backlog:
    """Return the largest possible backlog, within a span, of a process that receives at an even rate.

    Parameters
    ----------
    delays
        Delays of the process.
    span
        The span.
    room_s
        Time after which its queue is full.
    busy
        Share of a core that the process uses by itself; a less busy process catches up sooner.
    """
    pace = (1 - busy) / max(busy, _LEAST_BUSY)
    waiting = 0.0
    lost = 0.0
    late = 0.0
    undelayed_s = 0.0
    end_ns = span.start_ns
    for delay in clipped(delays, span):
        delay_s = delay.delay_ns / 1e9
        between_s = (delay.start_ns - end_ns) / 1e9
        waiting = max(0.0, waiting - pace * between_s) + delay_s
        lost += max(0.0, waiting - room_s)
        waiting = min(waiting, room_s)
        late += waiting * delay_s
        # A delay can lie at the end of its span and the next one at its start, with nothing between them.
        waiting = max(0.0, waiting - pace * undelayed_s)
        undelayed_s = (delay.end_ns - delay.start_ns - delay.delay_ns) / 1e9
        end_ns = delay.end_ns
    return Backlog(lost, late / max(span.duration_s, 1e-9))


@dataclass(frozen=True)
class Calm:
    """The intervals between messages that the machine did not affect."""

    #: float64[n]: Lengths in s.
    intervals_s: Floats
    #: int64[n]: Number of the undisturbed stretch of each, from 0.
    stretch: Integers
    #: Share of their time with delays that are too short to do harm.
    delayed_share: float
    #: bool[m]: True for each undisturbed one of all intervals.
    undisturbed: NDArray[np.bool_]

    @property
    def is_enough(self) -> bool:
        """True if these intervals can stand for a whole window."""
        if len(self.intervals_s) < _ENOUGH:
            return False
        return float(self.intervals_s.sum()) >= _ENOUGH_S

    @property
    def said(self) -> str:
        """A clause with the sum of the intervals."""
        return f", measured in {self.intervals_s.sum():.1f} s in which the grading computer was not busy"

    def rate_hz(self) -> tuple[float, float]:
        """Return the bounds of the rate.

        Notes
        -----
        The error of a mean is twice the standard deviation of one interval by √n. If a timer makes up for delays, the
        deviations of whole stretches give a smaller error. Long intervals are affected more often than short ones; in
        a stretch of m intervals, this makes the mean too small by the square of their relative spread, by m.
        """
        mean_s = float(self.intervals_s.mean())
        count = len(self.intervals_s)
        spread = float(self.intervals_s.std()) / mean_s
        error = 2 * spread / float(np.sqrt(count))
        off_s = np.bincount(self.stretch, self.intervals_s - mean_s)
        if len(off_s) >= _FEWEST_STRETCHES:
            sum_error_s = _SURE * float(np.linalg.norm(off_s))
            error = min(error, sum_error_s / (count * mean_s))
        error += spread**2 * len(off_s) / count
        undelayed = 1 - min(0.5, self.delayed_share)
        return (1 - error) / mean_s, (1 + error) / mean_s / undelayed

    def deviations_s(self, share: float) -> tuple[float, float]:
        """Return the bounds of a quantile of the intervals' distances from their median, in s."""
        distances = np.abs(self.intervals_s - np.median(self.intervals_s))
        shares = shares_around(share, len(distances))
        least_s, largest_s = np.quantile(distances, shares)
        return float(least_s), float(largest_s)


def shares_around(share: float, count: int) -> tuple[float, float]:
    """Return the shares of a sample's quantiles around a quantile of its population."""
    spread = _CONFIDENCE * math.sqrt(share * (1 - share) / count)
    return max(0.0, share - spread), min(1.0, share + spread)


def calm_intervals(
    delays: Sequence[Delay], ends_ns: Integers, intervals_s: Floats, harmless_s: float
) -> Calm:
    """Return the intervals that no delay affected.

    A delay makes one interval longer and the next one shorter, and missed messages can follow at once; therefore some
    intervals after it are left out too. A pause of the program itself counts with the part that no delay explains.

    Parameters
    ----------
    delays
        Delays of the publisher.
    ends_ns, intervals_s
        Ends and lengths of all intervals.
    harmless_s
        Longest delay without an effect.
    """
    intervals = _Intervals(ends_ns, intervals_s)
    for delay in delays:
        intervals.disturb(delay, harmless_s)
    touched = intervals.touched
    touched[1:] |= touched[:-1]
    calm = ~touched
    calm_s = float(intervals_s[calm].sum())
    share = float(intervals.within_ns[calm].sum()) / 1e9 / max(calm_s, 1e-9)
    begins = np.flatnonzero(np.diff(calm, prepend=False) & calm)
    stretch = np.searchsorted(begins, np.flatnonzero(calm), side="right") - 1
    pauses_s = intervals.pauses_s()
    # Each pause counts as a stretch of its own.
    apart = len(begins) + np.arange(len(pauses_s))
    lengths_s = np.concatenate((intervals_s[calm], pauses_s))
    stretches = np.concatenate((stretch, apart))
    return Calm(lengths_s, stretches, share, calm)


class _Intervals:
    """Intervals between messages, and the effect of delays on each."""

    def __init__(self, ends_ns: Integers, intervals_s: Floats) -> None:
        self.ends_ns = ends_ns
        self.intervals_s = intervals_s
        self.starts_ns = ends_ns - np.round(intervals_s * 1e9).astype(np.int64)
        self.touched = np.zeros(len(ends_ns), dtype=bool)
        #: float64[n]: Delays within each interval, in ns.
        self.within_ns = np.zeros(len(ends_ns))

    def disturb(self, delay: Delay, harmless_s: float) -> None:
        """Add a delay to the intervals that it overlaps."""
        first = int(np.searchsorted(self.ends_ns, delay.start_ns, side="right"))
        last = int(np.searchsorted(self.starts_ns, delay.end_ns))
        overlap_ends_ns = np.minimum(self.ends_ns[first:last], delay.end_ns)
        overlap_starts_ns = np.maximum(self.starts_ns[first:last], delay.start_ns)
        # A harmless delay is shared among the intervals; a long one can lie in any of them.
        most_ns: float = delay.delay_ns
        if delay.delay_ns > harmless_s * 1e9:
            until_ns = delay.end_ns + MADE_UP * delay.delay_ns
            end = int(np.searchsorted(self.starts_ns, until_ns))
            self.touched[first:end] = True
        else:
            most_ns /= max(1, last - first)
        self.within_ns[first:last] += np.minimum(overlap_ends_ns - overlap_starts_ns, most_ns)

    def pauses_s(self) -> Floats:
        """Return the unexplained parts of the affected intervals that are pauses of the program itself."""
        unexplained_s = self.intervals_s - self.within_ns / 1e9
        is_long = unexplained_s > _PAUSE * np.median(self.intervals_s)
        pauses_s: Floats = unexplained_s[self.touched & is_long]
        return pauses_s

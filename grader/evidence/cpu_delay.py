"""When the machine delayed a process, and what of a measurement was not affected by that.

A process was delayed when it had work and the core was with others, or stalled. Waits for threads of its
own, or for other programs of the student's, are none of these.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


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
        """Return how long another time lies within this one, in ns."""
        return max(0, min(end_ns, self.end_ns) - max(start_ns, self.start_ns))


@dataclass(frozen=True)
class Delay:
    """A time within which the machine delayed a process for so long; when in it, is not known."""

    start_ns: int
    end_ns: int
    delay_ns: int


def clipped(delays: Iterable[Delay], span: Span) -> Iterator[Delay]:
    """Return what of delays may lie within a span: of one that reaches over its ends, as much as there is room for."""
    for delay in delays:
        if shared_ns := span.shared_ns(delay.start_ns, delay.end_ns):
            start_ns = max(delay.start_ns, span.start_ns)
            yield Delay(start_ns, start_ns + shared_ns, min(delay.delay_ns, shared_ns))


@dataclass(frozen=True)
class Backlog:
    """What waited for a process while the machine delayed it."""

    #: For how long of a span what came found a queue full.
    lost_s: float
    #: By how much what came was handled later for it, on average.
    late_s: float


def backlog(delays: Iterable[Delay], span: Span, room_s: float, busy: float) -> Backlog:
    """Return what waited within a span, at most, for a process that handles what comes at an even rate.

    Its queue gets full in `room_s`. It uses a share of a core by itself: the less `busy`, the sooner it has caught up.
    """
    pace = (1 - busy) / max(busy, _LEAST_BUSY)
    waiting = lost = late = slack = 0.0
    end_ns = span.start_ns
    for delay in clipped(delays, span):
        delay_s = delay.delay_ns / 1e9
        waiting = max(0.0, waiting - pace * (delay.start_ns - end_ns) / 1e9) + delay_s
        lost += max(0.0, waiting - room_s)
        waiting = min(waiting, room_s)
        late += waiting * delay_s
        # One delay may lie at the end of its time and the next at its beginning, so that nothing is between the two.
        waiting = max(0.0, waiting - pace * slack)
        slack = (
            delay.end_ns - delay.start_ns - delay.delay_ns
        ) / 1e9  # in it the process was not delayed
        end_ns = delay.end_ns
    return Backlog(lost, late / max(span.duration_s, 1e-9))


#: Nobody is taken to catch up faster than this share of a core by itself allows.
_LEAST_BUSY = 0.1


@dataclass(frozen=True)
class Calm:
    """The intervals between messages that the machine did not affect."""

    #: float64[n]: Their lengths in s.
    intervals_s: Floats
    #: int64[n]: Which undisturbed stretch each lies in; they are counted from 0.
    stretch: Integers
    #: Share of their time in which the machine delayed the process all the same, for moments that do no
    #: harm by themselves.
    delayed_share: float
    #: bool[m]: Which of all intervals they are.
    undisturbed: NDArray[np.bool_]

    @property
    def is_enough(self) -> bool:
        """Whether they can stand for all of a window."""
        return len(self.intervals_s) >= _ENOUGH and float(self.intervals_s.sum()) >= _ENOUGH_S

    @property
    def said(self) -> str:
        """A clause that tells how much of the time they are."""
        return f", by {self.intervals_s.sum():.1f} s in which the grading computer was not busy"

    def rate_hz(self) -> tuple[float, float]:
        """Return the bounds of the rate.

        The error of a mean of n is that of one by √n, twice; where a timer makes up for what was late, the deviations
        of whole stretches tell. Long intervals are affected more often than short ones: in a stretch of m, that makes
        the mean too small by the square of their relative spread, by m.
        """
        mean_s, count = float(self.intervals_s.mean()), len(self.intervals_s)
        spread = float(self.intervals_s.std()) / mean_s
        error = 2 * spread / float(np.sqrt(count))
        off_s = np.bincount(self.stretch, self.intervals_s - mean_s)
        if len(off_s) >= _FEWEST_STRETCHES:
            error = min(error, _SURE * float(np.linalg.norm(off_s)) / (count * mean_s))
        error += spread**2 * len(off_s) / count
        return (1 - error) / mean_s, (1 + error) / mean_s / (1 - min(0.5, self.delayed_share))

    def deviations_s(self, share: float) -> tuple[float, float]:
        """Return the bounds of a quantile of the intervals' distances from their median, in s."""
        distances = np.abs(self.intervals_s - np.median(self.intervals_s))
        least_s, largest_s = np.quantile(distances, shares_around(share, len(distances)))
        return float(least_s), float(largest_s)


#: Undisturbed stretches from which their deviations are known, and how many standard deviations are an error then.
_FEWEST_STRETCHES, _SURE = 12, 2.5
#: Standard deviations of a sample's quantile that count as its error.
_CONFIDENCE = 3.0


def shares_around(share: float, count: int) -> tuple[float, float]:
    """Return the quantiles of a sample between which one of what it was taken from lies."""
    spread = _CONFIDENCE * math.sqrt(share * (1 - share) / count)
    return max(0.0, share - spread), min(1.0, share + spread)


#: Intervals, and the time that they fill together, from which those that were not affected stand for all.
_ENOUGH, _ENOUGH_S = 20, 0.5
#: Who was kept from a core makes up for it within this part of the time.
MADE_UP = 0.5
#: An interval of so many usual ones, without the delays in it, was not made by these.
_PAUSE = 3.0


def calm_intervals(
    delays: Sequence[Delay], ends_ns: Integers, intervals_s: Floats, harmless_s: float
) -> Calm:
    """Return the intervals that no delay affected which is longer than what is harmless.

    A delay makes one interval longer and the next one shorter, and what was missed may follow at once: so a part of
    what follows it is left out. A pause of the program's own counts by what the delays in it do not explain.
    """
    starts_ns = ends_ns - np.round(intervals_s * 1e9).astype(np.int64)
    touched = np.zeros(len(ends_ns), dtype=bool)
    within_ns = np.zeros(len(ends_ns))
    for delay in delays:
        long = delay.delay_ns > harmless_s * 1e9
        first = int(np.searchsorted(ends_ns, delay.start_ns, side="right"))
        last = int(np.searchsorted(starts_ns, delay.end_ns))
        shared = np.minimum(ends_ns[first:last], delay.end_ns) - np.maximum(
            starts_ns[first:last], delay.start_ns
        )
        # Of a long one nobody knows which interval had it; harmless ones count in the sum.
        within_ns[first:last] += np.minimum(
            shared, delay.delay_ns if long else delay.delay_ns / max(1, last - first)
        )
        if long:
            touched[
                first : int(np.searchsorted(starts_ns, delay.end_ns + MADE_UP * delay.delay_ns))
            ] = True
    touched[1:] |= touched[:-1]
    calm = ~touched
    share = float(within_ns[calm].sum()) / 1e9 / max(float(intervals_s[calm].sum()), 1e-9)
    begins = np.flatnonzero(np.diff(calm, prepend=False) & calm)
    stretch = np.searchsorted(begins, np.flatnonzero(calm), side="right") - 1
    unexplained_s = intervals_s - within_ns / 1e9
    pauses_s = unexplained_s[touched & (unexplained_s > _PAUSE * np.median(intervals_s))]
    apart = len(begins) + np.arange(len(pauses_s))
    return Calm(
        np.concatenate((intervals_s[calm], pauses_s)), np.concatenate((stretch, apart)), share, calm
    )

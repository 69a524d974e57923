"""Rates and intervals from source timestamps and sequence numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from grader.evidence.cpu_delay import Delay, Span
from grader.evidence.timing import Timing, timing_of
from ros_bag.reading import Stream
from tests.synthetic import START_NS, at


def stream(times_s: Sequence[float], sequence: Sequence[int] | None = None) -> Stream:
    """Give a stream of messages without contents."""
    source = np.array([at(t) for t in times_s], dtype=np.int64)
    numbers = np.array(
        sequence if sequence is not None else range(1, len(source) + 1), dtype=np.int64
    )
    return Stream("/a", "", source + 1000, source, numbers, tuple(b"" for _ in source))


def measured(
    times_s: Sequence[float], sequence: Sequence[int] | None = None, span: Span | None = None
) -> Timing:
    """Give the timing of a stream that has one."""
    timing = timing_of(stream(times_s, sequence), span)
    assert timing is not None
    return timing


@given(st.floats(1, 1000), st.integers(3, 400))
def test_a_rate_is_exact_however_high(rate_hz: float, count: int) -> None:
    """From 1 Hz to 1 kHz the rate comes back to a millionth, without a loss."""
    timing = measured([1 + n / rate_hz for n in range(count)])
    assert timing.rate_hz == pytest.approx(rate_hz, rel=1e-6)
    assert (timing.written, len(timing.intervals_s)) == (count, count - 1)


@given(st.lists(st.booleans(), min_size=20, max_size=300))
def test_samples_lost_by_the_recorder_change_neither_rate_nor_intervals(kept: list[bool]) -> None:
    """Whatever is lost in between, the rate is the writer's, and intervals across a gap are left out."""
    numbers = [1, *(n for n, keep in enumerate(kept, 2) if keep), len(kept) + 2, len(kept) + 3]
    timing = measured([1 + n / 100 for n in numbers], numbers)
    assert timing.rate_hz == pytest.approx(100, rel=1e-6)
    assert timing.written == numbers[-1]
    assert np.allclose(timing.intervals_s, 0.01)


@pytest.mark.parametrize("first", [0, 1, 2**32 - 1])
def test_impossible_times_raise_nothing(first: int) -> None:
    """A bag may state the smallest and the largest times and sequence numbers in any order."""
    extreme = np.array([0, 2**63 - 1, 2**63 - 1, 0, 1], dtype=np.int64)
    numbers = np.array([first, 2**32 - 1, 0, 1, 2], dtype=np.int64)
    data = (b"",) * len(extreme)
    timing_of(Stream("/a", "", extreme, extreme[::-1], numbers, data), None)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_samples_are_no_timing(count: int) -> None:
    """Fewer than three samples say nothing of a rate."""
    assert timing_of(stream([1.0 + n for n in range(count)]), None) is None


def test_samples_of_one_moment_are_no_timing() -> None:
    """Timestamps that never advance are no rate."""
    assert timing_of(stream([1.0] * 5), None) is None


def test_only_samples_inside_the_span_count() -> None:
    """Samples outside the window change nothing."""
    times = [n / 50 for n in range(100)] + [2 + n / 100 for n in range(101)]
    timing = measured(times, span=Span(at(2.0), at(3.0)))
    assert timing.rate_hz == pytest.approx(100)
    assert timing.written == 101
    assert timing_of(stream(times), Span(at(9.0), at(10.0))) is None


def test_of_a_node_that_started_again_the_longer_run_is_measured() -> None:
    """Sequence numbers that begin anew break the stream in two."""
    times = [n / 100 for n in range(50)] + [5 + n / 20 for n in range(200)]
    timing = measured(times, [*range(1, 51), *range(1, 201)])
    assert timing.rate_hz == pytest.approx(20)


@given(
    st.floats(0, 0.01),
    st.integers(1, 3000),
    st.integers(1, 3000),
    st.integers(20, 300),
    st.integers(0, 999),
)
def test_of_two_publishers_one_is_measured(
    phase_s: float, first: int, other: int, rate_hz: int, seed: int
) -> None:
    """Their samples interleave, and some are lost: the rate is of the one that sent more, or of one of two alike."""
    # Neither overtakes the other's numbers, and a few lost samples of one do not lead to the other's numbers.
    assume(abs(first - other) > 10)
    if rate_hz != 100:
        other += first + 5000
    sent = [(1 + n / 100, first + n) for n in range(400)]
    sent += [(1 + phase_s + n / rate_hz, other + n) for n in range(4 * rate_hz)]
    kept = np.random.default_rng(seed).random(len(sent)) > 0.02
    times_s, numbers = zip(
        *sorted(sample for sample, is_kept in zip(sent, kept, strict=True) if is_kept), strict=True
    )
    timing = measured(times_s, numbers)
    if 90 < rate_hz < 110:
        rates = {100, rate_hz}
    else:
        rates = {max(100, rate_hz)}
    assert any(timing.rate_hz == pytest.approx(rate, rel=0.01) for rate in rates)
    assert timing.lost < 0.06 * timing.written


def test_the_order_of_reception_does_not_matter() -> None:
    """Samples are ordered by their source timestamps."""
    order = np.random.default_rng(1).permutation(100)
    timing = measured([1 + n / 100 for n in order], [int(n) + 1 for n in order])
    assert timing.rate_hz == pytest.approx(100)
    assert timing.times_ns[0] == START_NS + 1_010_000_000


def test_a_late_sample_is_two_distances_for_one_delay() -> None:
    """A delay lengthens one interval and shortens the next; excusing the delay leaves none."""
    times = np.arange(100) / 100
    times[50] += 0.008
    timing = measured(times.tolist())
    assert timing.median_s == pytest.approx(0.01)
    assert timing.deviation_s(1.0) == pytest.approx(0.008)
    assert timing.deviation_s(0.95) == pytest.approx(0.0, abs=1e-6)
    assert timing.deviation_s(1.0, excused_s=0.0081) == pytest.approx(0.0, abs=1e-6)
    assert timing.deviation_s(1.0, excused_s=0.001) == pytest.approx(0.008)


def test_without_consecutive_samples_there_is_no_deviation() -> None:
    """A stream with nothing but gaps has a rate and no interval."""
    timing = measured([1.0, 1.2, 1.4], [1, 3, 5])
    assert timing.rate_hz == pytest.approx(10)
    assert math.isnan(timing.median_s)
    assert math.isnan(timing.deviation_s())


def test_all_intervals_excused_leave_nothing() -> None:
    """An excuse for more than there is gives no deviation."""
    assert measured([1.0, 1.1, 1.3, 1.4]).deviation_s(0.95, excused_s=100.0) == 0.0


def arriving(times_s: Sequence[float], arrivals_s: Sequence[float]) -> Timing:
    """Give the timing of messages that are stamped at some times and received at others."""
    received = np.array([at(t) for t in arrivals_s], dtype=np.int64)
    timing = timing_of(replace(stream(times_s), received_ns=received), None)
    assert timing is not None
    return timing


def test_stamps_that_arrive_as_they_say_are_believed() -> None:
    """Delays on the way, and a recorder that was delayed now and then, contradict no stamp."""
    times = [1 + n / 100 for n in range(600)]
    assert not arriving(
        times, [t + 0.0001 * (n % 7) for n, t in enumerate(times)]
    ).contradicted_by_arrival(0.0)
    assert not arriving(
        times, [t + 0.030 * (n % 40 == 0) for n, t in enumerate(times)]
    ).contradicted_by_arrival(0.0)


def test_stamps_of_another_evenness_than_the_arrival_are_not_believed() -> None:
    """Messages that come in bursts of ten, stamped as if each came by itself, did not leave so."""
    times = [1 + n / 100 for n in range(600)]
    bursts = [1.1 + 0.1 * (n // 10) + 0.0001 * (n % 10) for n in range(600)]
    assert arriving(times, bursts).contradicted_by_arrival(0.0)
    assert not arriving(bursts, [t + 0.0001 for t in bursts]).contradicted_by_arrival(0.0)


def test_stamps_of_another_rate_than_the_arrival_are_not_believed() -> None:
    """Messages stamped at 100 Hz that come at 80 Hz left at 80 Hz."""
    times = [1 + n / 100 for n in range(600)]
    timing = arriving(times, [1 + n / 80 for n in range(600)])
    assert timing.contradicted_by_arrival(0.0)
    assert timing.arrived is not None
    assert timing.arrived.rate_hz == pytest.approx(80)


def test_a_recorder_without_a_core_contradicts_nothing() -> None:
    """An arrival delayed by the recorder itself does not contradict the stamps."""
    times = [1 + n / 100 for n in range(600)]
    late = [t + 0.02 * (n % 5 == 0) for n, t in enumerate(times)]
    assert arriving(times, late).contradicted_by_arrival(0.0)
    assert not arriving(times, late).contradicted_by_arrival(120 * 0.02)
    delays = [Delay(at(t), at(t + 0.02), 20_000_000) for t in times[::5]]
    assert not arriving(times, late).contradicted_by_arrival(0.0, [delays])
    assert arriving(times, late).contradicted_by_arrival(0.0, [delays[:40]])

"""The sinusoid nearest to a series."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grader.evidence.sinusoid import Sinusoid, fit_sinusoid

TIMES = np.arange(600) / 100


def wave(
    amplitude: float, frequency_hz: float, phase: float = 0.0, offset: float = 0.0
) -> np.ndarray[Any, Any]:
    """Give a sampled sinusoid of 6 s."""
    values: np.ndarray[Any, Any] = offset + amplitude * np.sin(
        2 * np.pi * frequency_hz * TIMES + phase
    )
    return values


@settings(max_examples=12, deadline=None)
@given(st.floats(0.05, 2), st.floats(0.2, 0.9), st.floats(-3, 3), st.floats(-1, 1))
def test_a_clean_sinusoid_is_found(
    amplitude: float, frequency_hz: float, phase: float, offset: float
) -> None:
    """Amplitude, frequency and offset come back whatever the phase, if a whole period is there."""
    fit = fit_sinusoid(TIMES, wave(amplitude, frequency_hz, phase, offset), 0.02, 1.0)
    assert fit.amplitude == pytest.approx(amplitude, rel=0.01)
    assert fit.frequency_hz == pytest.approx(frequency_hz, rel=0.01)
    assert fit.offset == pytest.approx(offset, abs=0.02)
    assert fit.residual < 0.01


def test_noise_is_left_in_the_residual() -> None:
    """What is no sinusoid stays as the residual, and hardly moves the fit."""
    noise = np.random.default_rng(1).normal(0, 0.05, len(TIMES))
    fit = fit_sinusoid(TIMES, wave(0.5, 0.2) + noise, 0.02, 1.0)
    assert fit.residual == pytest.approx(0.05, rel=0.1)
    assert fit.amplitude == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize("value", [0.0, 0.7])
def test_a_constant_has_an_amplitude_of_nothing(value: float) -> None:
    """A series that does not move fits with a residual of zero, and no number breaks."""
    fit = fit_sinusoid(TIMES, np.full(len(TIMES), value), 0.02, 1.0)
    assert isinstance(fit, Sinusoid)
    assert fit.residual == pytest.approx(0.0, abs=1e-6)
    assert np.isfinite([fit.amplitude, fit.frequency_hz, fit.offset]).all()


def test_the_frequency_stays_within_its_bounds() -> None:
    """A faster sinusoid than looked for is not found, and the residual says so."""
    fit = fit_sinusoid(TIMES, wave(0.5, 3.0), 0.02, 1.0)
    assert 0.02 <= fit.frequency_hz <= 1.0
    assert fit.residual > 0.3


def test_half_a_million_samples_are_fitted_in_bounded_memory() -> None:
    """A flooded topic is fitted by a part of its samples, and its sinusoid is found all the same."""
    times = np.linspace(0.0, 6.0, 500_000)
    tracemalloc.start()
    found = fit_sinusoid(times, 0.5 * np.sin(2 * np.pi * 0.2 * times), 0.02, 1.0)
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.amplitude == pytest.approx(0.5, rel=0.01)
    assert found.frequency_hz == pytest.approx(0.2, rel=0.01)
    assert most_bytes < 200_000_000


def test_the_largest_numbers_break_nothing() -> None:
    """Numbers whose squares are beyond all numbers are fitted without an infinity and without a warning."""
    values = np.where(np.arange(len(TIMES)) % 2, 1e308, -1e308)
    with np.errstate(all="raise"):
        fit = fit_sinusoid(TIMES, values, 0.02, 1.0)
    assert np.isfinite([fit.amplitude, fit.frequency_hz, fit.offset, fit.residual]).all()

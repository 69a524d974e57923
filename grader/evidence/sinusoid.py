"""Sinusoids in sampled series: amplitude and frequency by least squares.

References
----------
IEEE Std 1057 describes the sine-wave fit of known and unknown frequency by linear least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grader.evidence.recorded import Floats

#: Points of the first grid, and of each finer one; those of the last are 5e-7 of the whole range apart.
_GRIDS = (200, 21, 21, 21, 21)
#: Evenly chosen samples of a longer series that are fitted; more samples cost memory, and add nothing.
_MOST_SAMPLES = 10_000
#: Largest value; larger ones are fitted as this one, because their squares overflow.
_LARGEST = 1e9
#: Weight that keeps the normal equations regular.
_RIDGE = 1e-12


@dataclass(frozen=True)
class Sinusoid:
    """The sinusoid nearest to a series."""

    #: Amplitude, offset and residual are in the unit of the series.
    amplitude: float
    frequency_hz: float
    offset: float
    #: Root mean square of the differences.
    residual: float
    #: Phase at time 0 in rad, from -π to π; 0 for a sine that begins at time 0.
    phase: float = 0.0


def fit_sinusoid(times_s: Floats, values: Floats, lowest_hz: float, highest_hz: float) -> Sinusoid:
    """Fit ``offset + a·sin(2πft) + b·cos(2πft)`` with f between the two bounds.

    The frequency is searched on a grid that is refined around its best point.
    """
    every = -(-len(values) // _MOST_SAMPLES) or 1
    times_s = times_s[::every]
    values = np.clip(values[::every], -_LARGEST, _LARGEST)
    best = Sinusoid(0.0, lowest_hz, 0.0, float("inf"))
    for points in _GRIDS:
        grid_hz = np.linspace(lowest_hz, highest_hz, points)
        coefficients, residuals = _fit_each(times_s, values, grid_hz)
        index = int(np.argmin(residuals))
        best = _sinusoid(coefficients[index], float(grid_hz[index]), float(residuals[index]))
        lowest_hz = float(grid_hz[max(index - 1, 0)])
        highest_hz = float(grid_hz[min(index + 1, points - 1)])
    return best


def _sinusoid(coefficients: Floats, frequency_hz: float, residual: float) -> Sinusoid:
    """Return the sinusoid of an offset and the coefficients of sine and cosine."""
    offset, sine, cosine = coefficients
    amplitude = float(np.hypot(sine, cosine))
    phase = float(np.arctan2(cosine, sine))
    return Sinusoid(amplitude, frequency_hz, float(offset), residual, phase)


def _fit_each(times_s: Floats, values: Floats, frequencies_hz: Floats) -> tuple[Floats, Floats]:
    """Fit offset, sine and cosine at each frequency; returns coefficients float64[n, 3], residuals float64[n]."""
    phases = 2 * np.pi * np.outer(frequencies_hz, times_s)
    design = np.ones((len(phases), 3, len(times_s)))
    np.sin(phases, out=design[:, 1])
    np.cos(phases, out=design[:, 2])
    ridge = _RIDGE * len(values) * np.eye(3)
    normal = design @ design.transpose(0, 2, 1) + ridge
    right = (design @ values)[:, :, np.newaxis]
    coefficients = np.linalg.solve(normal, right)[:, :, 0]
    # The largest arrays share their memory.
    fitted = np.einsum("fk,fkt->ft", coefficients, design, out=phases)
    left = np.subtract(values, fitted, out=phases)
    squares = np.square(left, out=left)
    return coefficients, np.sqrt(np.mean(squares, axis=1))

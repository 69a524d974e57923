"""Sinusoids in sampled series: amplitude and frequency by least squares.

References
----------
IEEE Std 1057 describes the sine-wave fit of known and unknown frequency by linear least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grader.evidence.recorded import Floats

#: Points of the first grid, and of each finer one, so that the last lies some 5e-7 of the whole apart.
_GRIDS = (200, 21, 21, 21, 21)
#: Of a longer series, evenly chosen samples are fitted: more of them say no more, and cost memory.
_MOST_SAMPLES = 10_000
#: Larger values, which nobody means, are fitted as if they were this large: no square of one is beyond all numbers.
_LARGEST = 1e9


@dataclass(frozen=True)
class Sinusoid:
    """The sinusoid nearest to a series."""

    #: In the unit of the series; `residual` is the root mean square of what is left.
    amplitude: float
    frequency_hz: float
    offset: float
    residual: float
    #: In rad, at time 0: between -π and π, and 0 for a sine that begins there.
    phase: float = 0.0


def fit_sinusoid(times_s: Floats, values: Floats, lowest_hz: float, highest_hz: float) -> Sinusoid:
    """Fit ``offset + a·sin(2πft) + b·cos(2πft)`` with f between the two bounds.

    The frequency is searched on a grid, which is then refined around its best point.
    """
    every = -(-len(values) // _MOST_SAMPLES) or 1
    times_s, values = times_s[::every], np.clip(values[::every], -_LARGEST, _LARGEST)
    low, high = lowest_hz, highest_hz
    best = Sinusoid(0.0, lowest_hz, 0.0, float("inf"))
    for points in _GRIDS:
        grid = np.linspace(low, high, points)
        fits, residuals = _fit_each(times_s, values, grid)
        index = int(np.argmin(residuals))
        offset, sine, cosine = fits[index]
        amplitude, phase = float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine))
        best = Sinusoid(
            amplitude, float(grid[index]), float(offset), float(residuals[index]), phase
        )
        low, high = float(grid[max(index - 1, 0)]), float(grid[min(index + 1, len(grid) - 1)])
    return best


def _fit_each(times_s: Floats, values: Floats, frequencies_hz: Floats) -> tuple[Floats, Floats]:
    """Fit offset, sine and cosine at each frequency; returns the (n, 3) coefficients and n residuals."""
    phases = 2 * np.pi * np.outer(frequencies_hz, times_s)
    design = np.ones((len(phases), 3, len(times_s)))
    np.sin(phases, out=design[:, 1])
    np.cos(phases, out=design[:, 2])
    normal = design @ design.transpose(0, 2, 1) + 1e-12 * len(values) * np.eye(3)
    coefficients = np.linalg.solve(normal, (design @ values)[:, :, np.newaxis])[:, :, 0]
    left = np.subtract(
        values, np.einsum("fk,fkt->ft", coefficients, design, out=phases), out=phases
    )
    return coefficients, np.sqrt(np.mean(np.square(left, out=left), axis=1))

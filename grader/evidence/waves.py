"""Sinusoids in sampled series: amplitude and frequency by least squares.

References
----------
IEEE Std 1057 describes the sine-wave fit of known and unknown frequency by linear least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grader.evidence.recorded import Floats

_GRID_POINTS = 400
_REFINEMENTS = 3


@dataclass(frozen=True)
class Sinusoid:
    """The sinusoid nearest to a series.

    Attributes
    ----------
    amplitude, offset, residual : float
        In the unit of the series; `residual` is the root mean square of what is left.
    frequency_hz : float
    """

    amplitude: float
    frequency_hz: float
    offset: float
    residual: float


def fit_sinusoid(times_s: Floats, values: Floats, lowest_hz: float, highest_hz: float) -> Sinusoid:
    """Fit ``offset + a·sin(2πft) + b·cos(2πft)`` with f between the two bounds.

    The frequency is searched on a grid, which is then refined around its best point.
    """
    low, high = lowest_hz, highest_hz
    best = _fit_at(times_s, values, low)
    for _ in range(_REFINEMENTS):
        grid = np.linspace(low, high, _GRID_POINTS)
        fits = [_fit_at(times_s, values, float(f)) for f in grid]
        index = int(np.argmin([fit.residual for fit in fits]))
        best = fits[index]
        low, high = float(grid[max(index - 1, 0)]), float(grid[min(index + 1, len(grid) - 1)])
    return best


def _fit_at(times_s: Floats, values: Floats, frequency_hz: float) -> Sinusoid:
    phase = 2 * np.pi * frequency_hz * times_s
    design = np.column_stack([np.ones_like(phase), np.sin(phase), np.cos(phase)])
    normal = design.T @ design + 1e-12 * np.eye(3)
    offset, sine, cosine = np.linalg.solve(normal, design.T @ values)
    left = values - design @ np.array([offset, sine, cosine])
    return Sinusoid(float(np.hypot(sine, cosine)), frequency_hz, float(offset), float(np.sqrt(np.mean(left**2))))

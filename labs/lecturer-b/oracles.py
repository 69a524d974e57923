"""What is right, computed from the scans."""

import numpy as np

LEAST, MOST = 0.125, 8.0


def filtered(streams, parameters, seed):
    """Each scan clamped, and each ray the median of itself and its neighbours; the ends stay."""
    rows = np.array(streams["scan"].values)
    if parameters.get("clamp", True):
        rows = np.clip(rows, LEAST, MOST)
    out = rows.copy()
    if parameters.get("median", True):
        out[:, 1:-1] = np.median(np.stack([rows[:, :-2], rows[:, 1:-1], rows[:, 2:]]), axis=0)
    return out


def nearest(streams, parameters, seed):
    """The least range of each scan."""
    return np.min(np.array(streams["scan"].values), axis=1, keepdims=True)


def bearing(streams, parameters, seed):
    """The angle of the nearest ray of each scan."""
    rows = np.array(streams["scan"].values)
    if parameters.get("what") == "index":
        return np.argmin(rows, axis=1)[:, None].astype(float)
    angles = -np.pi / 2 + np.argmin(rows, axis=1) * np.pi / 90
    if parameters.get("what") == "degrees":
        angles = np.degrees(angles)
    elif parameters.get("what") == "mirrored":
        angles = -angles
    elif parameters.get("what") == "from zero":
        angles = angles + np.pi / 2
    return angles[:, None]

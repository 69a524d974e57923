"""Right answers, computed from the scans."""

import numpy as np


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

"""Where the frames of the lab should be at each time."""

import math
from collections.abc import Mapping
from typing import Any


def circle(
    streams: Mapping[str, Any], parameters: Mapping[str, Any], seed: int
) -> list[list[float]]:
    """Drive a circle about the origin, by the time of the system clock."""
    return [
        _pose(int(time_ns) / 1e9, parameters, 0.0, 0.0, 0.0) for time_ns in parameters["times_ns"]
    ]


def laser_on_circle(
    streams: Mapping[str, Any], parameters: Mapping[str, Any], seed: int
) -> list[list[float]]:
    """The same of the laser: 0.2 m ahead, 0.3 m up, and turned by an eighth."""
    return [
        _pose(int(time_ns) / 1e9, parameters, 0.2, 0.3, math.pi / 4)
        for time_ns in parameters["times_ns"]
    ]


def _pose(
    time_s: float, parameters: Mapping[str, Any], ahead: float, up: float, turned: float
) -> list[float]:
    angle = 2 * math.pi * (time_s % parameters["period_s"]) / parameters["period_s"]
    heading = angle + math.pi / 2
    x = parameters["radius_m"] * math.cos(angle) + ahead * math.cos(heading)
    y = parameters["radius_m"] * math.sin(angle) + ahead * math.sin(heading)
    half = (heading + turned) / 2
    return [x, y, up, 0.0, 0.0, math.sin(half), math.cos(half)]

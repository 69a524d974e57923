"""Oracles for tests of checks that compare with oracles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grader.evidence.recorded import NumericStream

Streams = Mapping[str, NumericStream]


def scaled(streams: Streams, parameters: Mapping[str, Any], seed: int) -> Any:
    """Give a factor times each input; nothing for those that are below 0."""
    values = streams["input"].values
    return np.where(values >= 0, values * parameters.get("factor", 2.0), np.nan)


def sine(streams: Streams, parameters: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Give sin(t) at the input's times, by seconds since the first."""
    times_ns = streams["input"].source_ns
    return {"times_ns": times_ns, "values": np.sin((times_ns - times_ns[0]) / 1e9)}


def last(streams: Streams, parameters: Mapping[str, Any], seed: int) -> Any:
    """Give the last input."""
    return streams["input"].values[-1]

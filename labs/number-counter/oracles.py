"""Right sums of the counter."""

import numpy as np


def sums(streams, parameters, seed):
    """Return the sum after each number; it starts again at the messages of the indices `resets`."""
    numbers = streams["number"].values
    totals = np.cumsum(numbers, axis=0)
    for index in parameters.get("resets", []):
        if index < len(numbers):
            totals[index:] -= totals[index - 1]
    return totals


def mistake(streams, parameters, seed):
    """Return the values of a known mistake: the count of messages, or the number that came."""
    numbers = streams["number"].values
    if parameters["kind"] == "count":
        return np.arange(1.0, len(numbers) + 1)[:, None]
    return numbers

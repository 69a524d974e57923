"""Errors of measured rates: our recorder compared with the estimator of `ros2 topic hz`."""

from __future__ import annotations

from bench.together import run_together

#: True rate and number of messages.
_CASES = ((10.0, 80), (100.0, 600), (1000.0, 4000))


def rows() -> list[list[str]]:
    """Return the rows of the table: true rate, receiver, our rate, the other's rate."""
    table = []
    for rate_hz, count in _CASES:
        for receiver in ("idle", "busy"):
            true, ours, theirs = run_together(
                [["our_recorder", receiver], ["callback_rate", receiver]],
                ["publisher", str(rate_hz), str(count), "2"],
            )
            errors = [_error(said["rate_hz"], true["rate_hz"]) for said in (ours, theirs)]
            table.append([f"{rate_hz:g} Hz", receiver, *errors])
    return table


def _error(measured_hz: float, true_hz: float) -> str:
    return f"{measured_hz:.2f} Hz ({measured_hz / true_hz - 1:+.3%})"

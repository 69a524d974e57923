"""Whatever numbers and times a student publishes, a check of fields finds something, and takes no exception."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grader.result import Outcome
from tests.synthetic import Session, judged
from tests.thorough import examples

FLOAT = "std_msgs/msg/Float64"
X = {"topic": "/x", "field": "data"}
ORACLE = {
    "streams": {"input": {"topic": "/in", "field": "data"}},
    "oracle": "tests/checks/made_up_oracles.py:scaled",
}
CHECKS: dict[str, list[dict[str, Any]]] = {
    "field_range": [
        {**X, "low": 0.0, "high": 1.0, "change_per_s": 1.0},
        {**X, "finite": False, "high": 1.0},
    ],
    "field_matches": [
        {**X, "pattern": "^(?P<n>.*)$", "numbers": {"n": {"low": 0.0}}, "in_order": ["1", "2"]}
    ],
    "reaches": [
        {
            **X,
            "target": {"value": 1.0},
            "tolerance": 0.1,
            "hold_s": 0.5,
            "within_s": 1.0,
            "overshoot": 0.1,
        },
        {
            **X,
            "target": {"field": {"topic": "/in", "field": "data"}},
            "tolerance": 0.1,
            "within_s": 1.0,
        },
    ],
    "topic_equals_oracle": [
        {**X, **ORACLE, "tolerance": 0.1, "for_each": "input", "match": "order"},
        {
            **X,
            **ORACLE,
            "oracle": "tests/checks/made_up_oracles.py:sine",
            "tolerance": 0.1,
            "match": "interpolated",
        },
        {
            **X,
            **ORACLE,
            "oracle": "tests/checks/made_up_oracles.py:sine",
            "tolerance": 0.1,
            "match": "nearest",
        },
    ],
    "message_latency": [
        {
            "input": {"topic": "/in", "field": "data"},
            "output": X,
            "match": match,
            "limits": [{"share": 0.5, "full_within_s": 0.1, "none_beyond_s": 0.2}],
        }
        for match in ("next", "field", "stamp")
    ],
    "signal_property": [
        {
            "signals": {"x": X, "y": {**X, "topic": "/in"}},
            "property": "always(x / y < 1) or until(x < y, x > 0)",
        }
    ],
    "silent_until": [
        {"topic": "/x", "message_on": "/in"},
        {"topic": "/x", "condition": {**X, "low": 1.0}},
    ],
    "reference/checks/silence.py:stops_publishing": [
        {"topic": "/x", "step": "go", "within_s": 0.1}
    ],
}
VALUES = st.one_of(
    st.floats(), st.sampled_from([0.0, 1.0, 1e308, -1e308, float("inf"), float("nan")])
)
MESSAGES = st.lists(st.tuples(VALUES, st.floats(0.0, 20.0).map(lambda t: round(t, 1))), max_size=8)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("check", CHECKS)
@settings(max_examples=examples(25), deadline=None)
@given(x=MESSAGES, y=MESSAGES)
def test_nothing_that_is_published_breaks_a_check(
    check: str, x: list[tuple[float, float]], y: list[tuple[float, float]]
) -> None:
    """Credit is a share, whatever comes, in whatever order."""
    with tempfile.TemporaryDirectory() as folder, np.errstate(all="ignore"):
        session = Session(Path(folder)).process().step("publish", "go").disturbed("it", (2.0, 0.5))
        for topic, messages in (("/x", x), ("/in", y)):
            if messages:
                session.typed(
                    topic, FLOAT, [{"data": v} for v, _ in messages], [t for _, t in messages]
                )
        recorded = session.recorded()
        for parameters in CHECKS[check]:
            finding = judged(check, parameters, recorded)
            assert 0 <= finding.credit <= 1
            assert finding.outcome is not Outcome.ERROR
            assert "nan" not in finding.measured or any(np.isnan(v) for v, _ in x + y)

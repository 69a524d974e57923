"""A check enters the engine once two labs use it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from grader.checks.registry import REGISTRY
from grader.judging.rubrics import read_rubric

ROOT = Path(__file__).resolve().parents[1]
RUBRICS = [ROOT / "rubric.yaml", *sorted(ROOT.glob("labs/*/rubric.yaml"))]
#: Built-in checks of fewer than two shipped labs, each with the reason why it stays in the engine.
EXCEPTIONS = {
    "message_latency": "its bounds on delays are the engine's; it is for any node that answers messages",
    "parameter_effect": "it is for any parameter that changes a rate or a value of a running node",
    "requested_qos": "it is the counterpart of `offered_qos`, for subscriptions",
    "call_value": "it is the counterpart of `call_answered`, for numbers in a response",
    "signal_property": "it is the language of conditions over time, for labs outside this repository",
    "person": "it leaves points to a person, in any lab",
}


def uses() -> Counter[str]:
    """Return the number of shipped labs that use each check."""
    found: Counter[str] = Counter()
    for path in RUBRICS:
        found.update({spec.check for spec in read_rubric(path).checks()})
    return found


def test_two_labs_use_each_check_of_the_engine() -> None:
    """A check of fewer labs is an exception with a reason, and no exception is out of date."""
    found = uses()
    rare = {name for name in REGISTRY if found[name] < 2}
    assert rare == set(EXCEPTIONS)


def test_the_rubrics_are_counted() -> None:
    """All labs are read, and a check that several use is counted once for each."""
    assert len(RUBRICS) > 5
    assert uses()["topic_published"] > 5

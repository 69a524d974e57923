"""The summary of many gradings."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

from bench.stability import Grading, promises, read, read_grading, steadiness, table

FULL, PART = {"publisher.rate": 6.0, "publisher.steady": 2.0}, {"publisher.rate": 6.0}
GRADING = Grading("solution", False, 8.0, 0.0, FULL, [], {})


def test_the_same_decisions_are_steady_whatever_stays_undecided() -> None:
    """Undecided gradings and repeated sessions are counted, apart for a quiet machine, and are no difference."""
    busy = replace(GRADING, loaded=True, earned=6.0, decided=PART, undecided=["publisher.steady"], retries={"a": 2})
    (row,) = steadiness([GRADING, busy, replace(GRADING, retries={"a": 1})])
    assert row.steady
    assert (row.gradings, row.loaded, row.scores) == (3, 1, [8.0])
    assert (row.undecided, row.undecided_idle, row.retries, row.retries_idle) == (1, 0, 3, 1)


def test_a_check_decided_in_two_ways_is_named() -> None:
    """One check with other points is a difference, also where the sums of two gradings are the same."""
    other = replace(GRADING, decided={"publisher.rate": 5.0, "publisher.steady": 3.0})
    (row,) = steadiness([GRADING, other])
    assert not row.steady
    assert row.scores == [8.0]
    assert row.differing == {"publisher.rate": [5.0, 6.0], "publisher.steady": [2.0, 3.0]}
    assert "publisher.rate: [5.0, 6.0]" in table([GRADING, other])


def test_promises_count_what_is_right_and_fails_and_what_is_slow_and_passes() -> None:
    """Each of the two is counted by itself; what is undecided breaks no promise."""
    failed = replace(GRADING, decided={"publisher.rate": 5.4})
    open_one = replace(GRADING, decided={})
    slow, passed = (replace(GRADING, submission="rate_90_hz", decided={"publisher.rate": p}) for p in (3.0, 6.0))
    assert promises([GRADING, slow, open_one]) == [
        "100 Hz: decided 1 times, 0 times below full.",
        "90 Hz: decided 1 times, 0 times full.",
    ]
    assert promises([GRADING, failed, passed]) == [
        "100 Hz: decided 2 times, 1 times below full.",
        "90 Hz: decided 1 times, 1 times full.",
    ]


def test_collected_gradings_are_read_back(tmp_path: Path) -> None:
    """What was written by one run is taken up by the next; no file is no gradings."""
    file = tmp_path / "collected.jsonl"
    assert read(file) == []
    file.write_text("".join(json.dumps(asdict(g)) + "\n" for g in (GRADING, GRADING)), encoding="utf-8")
    assert read(file) == [GRADING, GRADING]


def test_a_results_folder_is_read(tmp_path: Path) -> None:
    """Points of decided checks, names of the others, and how often each session was recorded again."""
    checks = [
        {"id": "a", "outcome": "partial", "earned": 1.5, "measured": "", "reason": ""},
        {"id": "b", "outcome": "inconclusive", "earned": 0, "measured": "5 ms", "reason": "busy"},
    ]
    score = {"earned": 1.5, "undecided": 2}
    (tmp_path / "recordings/publisher").mkdir(parents=True)
    (tmp_path / "recordings/publisher/session.json").write_text('{"attempt": 3}', encoding="utf-8")
    plain = {"submission": "alice", "score": score, "criteria": [{"checks": checks}]}
    (tmp_path / "result.json").write_text(json.dumps(plain), encoding="utf-8")
    grading = read_grading(tmp_path, loaded=True)
    assert (grading.submission, grading.loaded, grading.earned) == ("alice", True, 1.5)
    assert (grading.decided, grading.undecided, grading.retries) == ({"a": 1.5}, ["b"], {"publisher": 2})
    assert grading.measured == {"b": "5 ms | busy"}

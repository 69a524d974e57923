"""The summary of many gradings, and the loads beside which they are made."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

from bench.load import LOADS
from bench.stability import Grading, differing, read, read_grading, table

FULL, PART = {"publisher.rate": 6.0, "publisher.steady": 2.0}, {"publisher.rate": 6.0}
GRADING = Grading("solution", "idle", 10.0, 8.0, FULL)
BUSY = replace(
    GRADING,
    load="busy",
    took_s=13.0,
    decided=PART,
    undecided={"publisher.steady": ""},
    retries={"a": 2},
)


def test_the_same_decisions_are_no_difference_whatever_stays_undecided() -> None:
    """Undecided gradings, repeated sessions and times are told by load, and against the idle machine."""
    assert differing([GRADING, BUSY]) == {}
    said = table([GRADING, BUSY, GRADING])
    assert "| idle | 2 | 0 | 0 | 10.0 s | 1.00 |" in said
    assert "| busy | 1 | 1 | 2 | 13.0 s | 1.30 |" in said
    assert "Contradictory outcomes: none." in said


def test_a_check_decided_in_two_ways_is_named() -> None:
    """One check with other points is a difference, also where the sums of two gradings are the same."""
    other = replace(GRADING, decided={"publisher.rate": 5.0, "publisher.steady": 3.0})
    elsewhere = replace(other, submission="another")
    assert differing([GRADING, elsewhere]) == {}
    found = differing([GRADING, other])
    assert found == {
        "solution: publisher.rate": [5.0, 6.0],
        "solution: publisher.steady": [2.0, 3.0],
    }
    assert "solution: publisher.rate: [5.0, 6.0]" in table([GRADING, other])


def test_collected_gradings_are_read_back(tmp_path: Path) -> None:
    """A run continues from the gradings of an earlier run; a missing file holds none."""
    file = tmp_path / "collected.jsonl"
    assert read(file) == []
    file.write_text(
        "".join(json.dumps(asdict(g)) + "\n" for g in (GRADING, BUSY)), encoding="utf-8"
    )
    assert read(file) == [GRADING, BUSY]


def test_a_results_folder_is_read(tmp_path: Path) -> None:
    """Points of decided checks, why the others are none, and how often each session was recorded again."""
    checks = [
        {"id": "a", "outcome": "partial", "earned": 1.5, "measured": "", "reason": ""},
        {"id": "b", "outcome": "inconclusive", "earned": 0, "measured": "5 ms", "reason": "busy"},
    ]
    score = {"earned": 1.5, "undecided": 2}
    (tmp_path / "recordings/publisher").mkdir(parents=True)
    (tmp_path / "recordings/publisher/session.json").write_text('{"attempt": 3}', encoding="utf-8")
    plain = {"submission": "alice", "score": score, "criteria": [{"checks": checks}]}
    (tmp_path / "result.json").write_text(json.dumps(plain), encoding="utf-8")
    grading = read_grading(tmp_path, "busy", 12.345)
    assert (grading.submission, grading.load, grading.took_s, grading.earned) == (
        "alice",
        "busy",
        12.35,
        1.5,
    )
    assert (grading.decided, grading.undecided, grading.retries) == (
        {"a": 1.5},
        {"b": "5 ms | busy"},
        {"publisher": 2},
    )


# A process with a child that reports each pause longer than 4 ms.
_CHILD = """
import subprocess, sys
late = '''
import sys, time
before, found, end = time.monotonic(), 0, time.monotonic() + 1.5
while before < end:
    time.sleep(0.001)
    now = time.monotonic()
    found, before = found + (now - before if now - before > 0.004 else 0), now
print(found / 1.5)
'''
print(subprocess.run([sys.executable, '-c', late], capture_output=True, text=True).stdout)
"""


def test_a_host_takes_time_from_what_was_started_and_gives_it_back() -> None:
    """Processes started by a child pause for a notable share of the time, and resume afterwards."""
    with LOADS["stolen"]():
        said = subprocess.run(
            [sys.executable, "-c", _CHILD], capture_output=True, text=True, check=True, timeout=60
        )
    assert float(said.stdout) > 0.1


def test_a_busy_machine_is_left_idle() -> None:
    """The processes of a load end with it."""
    with LOADS["busy"]():
        begun = _children()
        assert len(begun) == 7
    assert not begun & _children()


def _children() -> set[str]:
    return set(Path("/proc/thread-self/children").read_text(encoding="utf-8").split())

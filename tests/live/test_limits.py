"""Grading below the hard limits that sudo, systemd, Docker and hardened machines set."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from grader.live.sandbox.probing import probe_isolation
from tests.thorough import EVERY_ATTACK, part

ROOT = Path(__file__).resolve().parents[2]
GRADE = Path(sys.executable).with_name("grade")
#: A lab with one session of three seconds.
LAB = ROOT / "grader/doctor/lab"
MIB = 1024**2
#: Limit -> the lowest value with which this is graded.
LOW = {"core": 0, "nofile": 64, "nproc": 64, "as": 768 * MIB, "fsize": 16 * MIB, "memlock": 0}
#: Limit -> a value with which nothing can be graded.
TOO_LOW = {"nofile": 24, "nproc": 8, "as": 300 * MIB, "fsize": MIB, "data": 300 * MIB}
TOO_LOW |= {"cpu": 60, "stack": MIB // 4}
#: sudo sets the first; of the others a part is tried in every run.
TRIED = [*list(LOW.items())[:1], *part(list(LOW.items())[1:], 5, EVERY_ATTACK)]
TRIED_TOO_LOW = part(list(TOO_LOW.items()), 3, EVERY_ATTACK)

pytestmark = pytest.mark.live


def run(limit: str, value: int, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run `grade` below a limit that it cannot raise."""
    command = ["prlimit", f"--{limit}={value}:{value}", "--", str(GRADE), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize(("limit", "value"), TRIED)
def test_a_low_limit(limit: str, value: int, tmp_path: Path) -> None:
    """`grade doctor` and a grading work under a low limit as without it, confined as well."""
    level = probe_isolation(Path(sys.executable)).level.value
    examined = run(limit, value, "doctor")
    assert f"confinement: {level}" in examined.stdout
    graded = run(limit, value, LAB / "submission", "--lab", LAB, "--one", "-o", tmp_path)
    assert graded.returncode == 0, graded.stdout + graded.stderr
    result = json.loads((tmp_path / "submission/result.json").read_text(encoding="utf-8"))
    assert result["score"]["earned"] == 1, graded.stdout
    sessions = result["provenance"]["sessions"].values()
    assert {session["isolation"] for session in sessions} == {level}


@pytest.mark.parametrize(("limit", "value"), TRIED_TOO_LOW)
def test_a_limit_that_is_too_low(limit: str, value: int, tmp_path: Path) -> None:
    """A limit that is too low is named as the only cause, with its value and a remedy."""
    examined = run(limit, value, "doctor")
    assert examined.returncode == 1
    graded = run(limit, value, ROOT / "submissions/alice", "-o", tmp_path / "results")
    assert graded.returncode == 5, graded.stdout + graded.stderr
    for said in (examined.stdout, graded.stderr):
        assert f"({limit}) is " in said
        assert f"Raise the hard limit '{limit}'" in said
        assert "chmod" not in said
        assert "--privileged" not in said
    assert not (tmp_path / "results").exists()

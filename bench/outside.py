"""CPU time of the solution's programs: inside their sandboxes, and outside as plain programs beside the same nodes.

Both run one session at a time, by turns.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.grading import run_grade
from bench.submissions import ROOT, SOLUTION
from bench.together import own_network
from grader.live.sandbox.environment import trusted_environment
from grader.recording.session import read_session
from grader.result_folder import RECORDINGS

_DOMAIN = 98
_LONGEST_S = 120.0
#: Session -> its subject.
SESSIONS = {
    "publisher": "publisher",
    "subscriber": "subscriber",
    "service": "service, two of them",
    "launch": "the three nodes of the launch file",
    "qos": "QoS comparison",
}
#: Names of the evaluations of a launch file in a recording.
_EVALUATION = "launch file"


def inside_s(recording: Path) -> float:
    """Return the CPU time of the student's programs in a recording, in s."""
    total_ns = 0
    for run in read_session(recording).processes:
        if run.role != "student":
            continue
        if run.name.startswith(_EVALUATION):
            continue
        for last in run.usage[-1:]:
            total_ns += last.cpu_ns
    return total_ns / 1e9


def outside_s(session: str, recording: Path, scratch: Path) -> float:
    """Return the CPU time of the same programs as plain programs, in s.

    Raises
    ------
    RuntimeError
        If the session could not be run.
    """
    environment = {**trusted_environment(scratch, _DOMAIN), "PYTHONPATH": str(ROOT)}
    program = [sys.executable, "-m", "bench.programs.plain_session", session, str(recording)]
    run = subprocess.run(
        [*own_network(), *program],
        capture_output=True,
        text=True,
        env=environment,
        cwd=ROOT,
        timeout=_LONGEST_S,
        check=False,
    )
    if run.returncode != 0:
        raise RuntimeError(run.stderr.strip())
    used: Mapping[str, float] = json.loads(run.stdout.splitlines()[-1])
    return sum(used.values())


def row(session: str, inside: Sequence[float], outside: Sequence[float]) -> list[str]:
    """Return a row of the table: programs, CPU time inside, outside (medians), and their ratio."""
    within_s = statistics.median(inside)
    plain_s = statistics.median(outside)
    return [
        SESSIONS[session],
        f"{within_s:.2f} s",
        f"{plain_s:.2f} s",
        f"{within_s / plain_s:.2f}",
    ]


def rows(runs: int) -> list[list[str]]:
    """Run each session inside and outside by turns, and return the rows of the table."""
    found = []
    with tempfile.TemporaryDirectory(prefix="bench-outside-") as folder:
        scratch = Path(folder)
        for session in SESSIONS:
            inside = []
            outside = []
            for _ in range(runs):
                run_grade(str(SOLUTION), "-o", folder, "--sessions", session)
                recording = scratch / SOLUTION.name / RECORDINGS / session
                inside.append(inside_s(recording))
                outside.append(outside_s(session, recording, scratch))
            found.append(row(session, inside, outside))
    return found

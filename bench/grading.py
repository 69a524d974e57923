"""Costs of a grading: compared with the student's slowest tool, with sessions one after another, and in CPU time."""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.load import load_average
from bench.submissions import SOLUTION

#: Session of the student's slowest tool, its only process.
_TOOL = "qos"
_CLASS = 20
_SIDE_BY_SIDE = 8
_SESSION_FILE = "session.json"


@dataclass(frozen=True)
class Command:
    """A run of `grade`: its wall time, and its CPU time including child processes."""

    wall_s: float
    cpu_s: float


@dataclass(frozen=True)
class Full:
    """A grading of all sessions.

    Attributes
    ----------
    again : int
        Number of recordings made again because the machine disturbed the first.
    """

    command: Command
    students_cpu_s: float
    again: int

    @property
    def share(self) -> float:
        """The grader's CPU time over the student's."""
        return (self.command.cpu_s - self.students_cpu_s) / self.students_cpu_s


def run_grade(*arguments: str) -> Command:
    """Run `grade` with arguments.

    Raises
    ------
    RuntimeError
        If the command fails.
    """
    begun_s = time.monotonic()
    with subprocess.Popen(
        [sys.executable, "-I", "-m", "grader.cli", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stderr is not None
        said = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        wall_s = time.monotonic() - begun_s
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(said.decode("utf-8", "replace").strip())
    return Command(wall_s, used.ru_utime + used.ru_stime)


def full(results: Path, *more: str) -> Full:
    """Grade the solution in all sessions."""
    command = run_grade(str(SOLUTION), "-o", str(results), *more)
    folder = results / SOLUTION.name
    result = _read(folder / "result.json")
    sessions = result["provenance"]["sessions"]
    students_cpu_s = sum(session["cpu_s"]["student"] for session in sessions.values())
    again = 0
    for file in folder.glob(f"recordings/*/{_SESSION_FILE}"):
        again += _read(file)["attempt"] - 1
    return Full(command, students_cpu_s, again)


def _read(file: Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8"))


def tool_alone_s(results: Path) -> float:
    """Return the time that the tool takes alone in its sandbox."""
    run_grade(str(SOLUTION), "-o", str(results), "--sessions", _TOOL)
    file = results / SOLUTION.name / "recordings" / _TOOL / _SESSION_FILE
    processes = {process["name"]: process for process in _read(file)["processes"]}
    tool = processes[_TOOL]
    return float(tool["exited_ns"] - tool["started_ns"]) / 1e9


def regrades_s(results: Path, runs: int) -> tuple[list[float], list[float]]:
    """Return wall times of regrading: one submission by a command, and one of many given to a command."""
    one = results / SOLUTION.name
    many = results / "many"
    copies = [many / f"student_{number:02}" for number in range(_CLASS)]
    for copy in copies:
        shutil.copytree(one, copy)
    alone = [run_grade("regrade", str(one)).wall_s for _ in range(runs)]
    each = [run_grade("regrade", *map(str, copies)).wall_s / _CLASS for _ in range(runs)]
    return alone, each


def class_of_eight_s(results: Path) -> float:
    """Return the wall time of grading eight copies of the solution as one class.

    Raises
    ------
    RuntimeError
        If the scores of the copies differ.
    """
    submissions = results / "submissions"
    for number in range(_SIDE_BY_SIDE):
        shutil.copytree(
            SOLUTION,
            submissions / f"student_{number}",
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    took_s = run_grade(str(submissions), "--each", "-o", str(results / "class")).wall_s
    files = (results / "class").glob("student_*/result.json")
    scores = {_read(file)["score"]["earned"] for file in files}
    if len(scores) != 1:
        raise RuntimeError(f"copies of one submission have different scores: {sorted(scores)}")
    return took_s


def spread(values: Sequence[float], unit: str = "s") -> str:
    """Return median and range, e.g. `1.50 s (1.20 – 1.90)`."""
    median = statistics.median(values)
    return f"{median:.2f} {unit} ({min(values):.2f} – {max(values):.2f})".replace("  ", " ")


def ratio(of: Sequence[float], to: Sequence[float]) -> str:
    """Return the ratio of two medians."""
    return f"{statistics.median(of) / statistics.median(to):.2f}"


def rows(runs: int) -> list[list[str]]:
    """Return the rows of the table: subject, measured, compared with, ratio."""
    with tempfile.TemporaryDirectory(prefix="bench-grading-") as scratch:
        results = Path(scratch)
        few = max(1, runs // 3)
        tool = [tool_alone_s(results / "tool") for _ in range(few)]
        before = load_average()
        fulls = [full(results) for _ in range(runs)]
        after = load_average()
        sequential = [full(results / "sequential", "-j", "1").command.wall_s for _ in range(few)]
        alone, each = regrades_s(results, few)
        eight_s = class_of_eight_s(results)
    one_s = statistics.median(run.command.wall_s for run in fulls)
    return [
        *_rows(tool, fulls, sequential, alone, each, f"{before:.1f} – {after:.1f}"),
        [
            f"{_SIDE_BY_SIDE} submissions as a class, all with the same score",
            f"{60 * _SIDE_BY_SIDE / eight_s:.1f} a minute",
            f"one after another, {60 / one_s:.1f} a minute",
            f"{_SIDE_BY_SIDE * one_s / eight_s:.2f}",
        ],
    ]


def _rows(
    tool: Sequence[float],
    fulls: Sequence[Full],
    sequential: Sequence[float],
    alone: Sequence[float],
    each: Sequence[float],
    load: str,
) -> list[list[str]]:
    walls = [run.command.wall_s for run in fulls]
    undisturbed = [run for run in fulls if not run.again] or list(fulls)
    ours = [run.command.cpu_s - run.students_cpu_s for run in undisturbed]
    students = [run.students_cpu_s for run in undisturbed]
    again = sum(run.again for run in fulls)
    note = f"load average {load}; {again} sessions recorded again"
    whole = spread(walls)
    return [
        [
            f"one full grading, {len(fulls)} times ({note})",
            whole,
            f"the QoS tool alone {spread(tool)}",
            ratio(walls, tool),
        ],
        [
            "the same",
            whole,
            f"one session after another {spread(sequential)}",
            ratio(walls, sequential),
        ],
        [
            "CPU time of the grader",
            spread(ours),
            f"of the student's processes {spread(students)}",
            ratio(ours, students),
        ],
        ["regrading one, as a command", spread(alone), "a full grading", ratio(alone, walls)],
        [f"regrading one of {_CLASS}", spread(each), "a full grading", ratio(each, walls)],
    ]

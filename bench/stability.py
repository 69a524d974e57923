"""Measures the repeatability of scores beside other work, and the time of the gradings.

Correct submissions in different styles, and some near a limit, are graded repeatedly, one at a time, on three machines:
idle, busy, and with a host that takes a quarter of the time. Each grading adds a line to a JSON-lines file, from which
an interrupted run continues.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from bench import submissions
from bench.load import LOADS, load_average

_UNDECIDED = ("inconclusive", "error")
_SUBMISSIONS = "submissions"


@dataclass(frozen=True)
class Grading:
    """One grading of one submission.

    Attributes
    ----------
    load : str
        Name of the load in `bench.load.LOADS`.
    decided : dict
        Points of the decided checks, by the check's id.
    undecided : dict
        Measured value and reason of the undecided checks, by the check's id.
    retries : dict
        Number of retries of sessions recorded again, by the session's name.
    """

    submission: str
    load: str
    took_s: float
    earned: float
    decided: dict[str, float]
    undecided: dict[str, str] = field(default_factory=dict)
    retries: dict[str, int] = field(default_factory=dict)
    load_average: float = 0.0


def read_grading(results: Path, load: str, took_s: float) -> Grading:
    """Read the grading in a results folder."""
    plain = json.loads((results / "result.json").read_text(encoding="utf-8"))
    decided: dict[str, float] = {}
    undecided: dict[str, str] = {}
    for criterion in plain["criteria"]:
        for check in criterion["checks"]:
            if check["outcome"] in _UNDECIDED:
                undecided[check["id"]] = f"{check['measured']} | {check['reason']}"
            else:
                decided[check["id"]] = check["earned"]
    retries: dict[str, int] = {}
    for file in sorted((results / "recordings").glob("*/session.json")):
        attempt = int(json.loads(file.read_text(encoding="utf-8"))["attempt"])
        if attempt > 1:
            retries[file.parent.name] = attempt - 1
    return Grading(
        submission=plain["submission"],
        load=load,
        took_s=round(took_s, 2),
        earned=plain["score"]["earned"],
        decided=decided,
        undecided=undecided,
        retries=retries,
        load_average=round(load_average(), 2),
    )


def grade(submission: Path, load: str, before: Iterable[Grading], keep: Path) -> Grading:
    """Grade a submission beside a load, and keep results that contradict earlier ones in a folder."""
    with tempfile.TemporaryDirectory(prefix="bench-stability-") as scratch:
        command = [
            sys.executable,
            "-I",
            "-m",
            "grader.cli",
            str(submission),
            "--one",
            "-o",
            scratch,
        ]
        environment = dict(os.environ)
        environment.pop("CI", None)
        with LOADS[load]():
            begun_s = time.monotonic()
            # A session of its own, like a person's terminal, because Linux may weigh sessions.
            subprocess.run(
                command,
                stdout=subprocess.DEVNULL,
                check=True,
                env=environment,
                start_new_session=True,
            )
            took_s = time.monotonic() - begun_s
        results = Path(scratch) / submission.name
        grading = read_grading(results, load, took_s)
        earlier = [g for g in before if g.submission == grading.submission]
        if differing([*earlier, grading]):
            shutil.copytree(results, keep / f"{grading.submission}-{load}-{time.time_ns()}")
        return grading


def differing(gradings: Iterable[Grading]) -> dict[str, list[float]]:
    """Return the points of checks with contradictory outcomes, by submission and check."""
    points: dict[str, set[float]] = {}
    for grading in gradings:
        for check, earned in grading.decided.items():
            points.setdefault(f"{grading.submission}: {check}", set()).add(earned)
    return {check: sorted(earned) for check, earned in points.items() if len(earned) > 1}


def table(gradings: Sequence[Grading]) -> str:
    """Return the summary as Markdown, with a line for each load."""
    lines = [
        "| machine | gradings | with an undecided check | sessions recorded again | median time | ratio to idle |",
        "|---|---|---|---|---|---|",
    ]
    by_load: dict[str, list[Grading]] = {load: [] for load in LOADS}
    for grading in gradings:
        by_load[grading.load].append(grading)
    idle = _usual_times(by_load["idle"])
    for load, some in by_load.items():
        if some:
            lines.append(_line(load, some, idle))
    contradictions = [f"{check}: {points}" for check, points in differing(gradings).items()]
    listed = "; ".join(contradictions) or "none"
    return "\n".join([*lines, "", f"Contradictory outcomes: {listed}."])


def _line(load: str, gradings: Sequence[Grading], idle: Mapping[str, float]) -> str:
    """Return the line of a load; `idle` has the usual time of each submission on the idle machine, in s."""
    times = _usual_times(gradings)
    ratios = [times[name] / idle[name] for name in times.keys() & idle.keys()]
    undecided = sum(bool(grading.undecided) for grading in gradings)
    retries = sum(sum(grading.retries.values()) for grading in gradings)
    median_s = statistics.median(grading.took_s for grading in gradings)
    ratio = f"{statistics.median(ratios):.2f}" if ratios else ""
    return f"| {load} | {len(gradings)} | {undecided} | {retries} | {median_s:.1f} s | {ratio} |"


def _usual_times(gradings: Iterable[Grading]) -> dict[str, float]:
    times: dict[str, list[float]] = {}
    for grading in gradings:
        times.setdefault(grading.submission, []).append(grading.took_s)
    return {name: statistics.median(took_s) for name, took_s in times.items()}


def read(file: Path) -> list[Grading]:
    """Read the gradings in a file; none if the file is missing."""
    if not file.is_file():
        return []
    return [Grading(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]


def collect(times: int, into: Path, loads: Sequence[str], until_s: float | None = None) -> None:
    """Grade each submission a number of times beside each load; loads and submissions alternate.

    Parameters
    ----------
    until_s : float, optional
        Latest time of the system clock for the start of a grading.
    """
    gradings = read(into)
    there = Counter((grading.submission, grading.load) for grading in gradings)
    kept = into.with_suffix(".kept")
    with tempfile.TemporaryDirectory(prefix="bench-") as scratch:
        folder = Path(scratch) / _SUBMISSIONS
        submissions.write(folder)
        for number, name, load in itertools.product(range(times), submissions.NAMES, loads):
            if there[name, load] > number:
                continue
            if until_s is not None and time.time() > until_s:
                break
            gradings.append(grade(folder / name, load, gradings, kept))
            with into.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(asdict(gradings[-1])) + "\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Collect gradings, or sum up a file of gradings; returns 1 if outcomes contradict each other."""
    parser = argparse.ArgumentParser(prog="python -m bench.stability", description=__doc__)
    parser.add_argument(
        "--times", type=int, default=1, help="gradings of each submission beside each load"
    )
    parser.add_argument(
        "--into", type=Path, default=Path("bench/stability.jsonl"), help="file for the gradings"
    )
    parser.add_argument(
        "--minutes", type=float, help="start no further grading after N minutes", metavar="N"
    )
    parser.add_argument(
        "--only",
        choices=sorted(LOADS),
        action="append",
        help="load to use; may be repeated (default: all)",
    )
    parser.add_argument(
        "--summary", type=Path, metavar="FILE", help="only sum up the gradings in a file"
    )
    options = parser.parse_args(arguments)
    if options.summary is None:
        until_s = time.time() + 60 * options.minutes if options.minutes else None
        collect(options.times, options.into, options.only or list(LOADS), until_s)
    gradings = read(options.summary or options.into)
    print(table(gradings))
    return 1 if differing(gradings) else 0


if __name__ == "__main__":
    sys.exit(main())

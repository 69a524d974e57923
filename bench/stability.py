"""Tells whether the same submission is given the same score whatever else the machine does, and how long that takes.

Correct submissions in different styles, and some near a limit, are graded one at a time, again and again, on a quiet
machine, on a busy one, and on one whose host takes a quarter of the time. Each grading adds a line to a JSON-lines
file, so that a run can be interrupted and gone on with.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

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
        What else the machine did: a name of `bench.load.LOADS`.
    decided : dict
        Check -> points, of the checks that were decided.
    undecided : dict
        The others -> what was measured, and why that decides nothing.
    retries : dict
        Session -> how often it was recorded again, where it was.
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
    """Read what a results folder says of its submission."""
    plain = json.loads((results / "result.json").read_text(encoding="utf-8"))
    checks: list[dict[str, Any]] = [
        check for criterion in plain["criteria"] for check in criterion["checks"]
    ]
    attempts = {
        file.parent.name: int(json.loads(file.read_text(encoding="utf-8"))["attempt"])
        for file in sorted((results / "recordings").glob("*/session.json"))
    }
    return Grading(
        plain["submission"],
        load,
        round(took_s, 2),
        plain["score"]["earned"],
        {check["id"]: check["earned"] for check in checks if check["outcome"] not in _UNDECIDED},
        {c["id"]: f"{c['measured']} | {c['reason']}" for c in checks if c["outcome"] in _UNDECIDED},
        {session: attempt - 1 for session, attempt in attempts.items() if attempt > 1},
        round(load_average(), 2),
    )


def grade(submission: Path, load: str, before: Iterable[Grading], keep: Path) -> Grading:
    """Grade a submission beside a load; results that decide anything otherwise than before are kept."""
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
        environment = {name: value for name, value in os.environ.items() if name != "CI"}
        with LOADS[load]():
            begun_s = time.monotonic()
            # In a session of its own, as a person's terminal is: Linux may weigh sessions.
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
        if differing([*(g for g in before if g.submission == grading.submission), grading]):
            shutil.copytree(results, keep / f"{grading.submission}-{load}-{time.time_ns()}")
        return grading


def differing(gradings: Iterable[Grading]) -> dict[str, list[float]]:
    """Return the different points of each check that was decided in more than one way, by submission and check."""
    points: dict[str, set[float]] = {}
    for grading in gradings:
        for check, earned in grading.decided.items():
            points.setdefault(f"{grading.submission}: {check}", set()).add(earned)
    return {check: sorted(earned) for check, earned in points.items() if len(earned) > 1}


def table(gradings: Sequence[Grading]) -> str:
    """Return the summary as Markdown: a line for each load."""
    lines = [
        "| the machine | gradings | with something undecided | sessions recorded again | median time | to idle |",
        "|---|---|---|---|---|---|",
    ]
    whole = {load: [g for g in gradings if g.load == load] for load in LOADS}
    times = {load: _usual_times(some) for load, some in whole.items()}
    for load, some in whole.items():
        if some:
            both = times[load].keys() & times["idle"].keys()
            ratios = [times[load][name] / times["idle"][name] for name in both]
            lines.append(
                f"| {load} | {len(some)} | {sum(bool(g.undecided) for g in some)} "
                f"| {sum(sum(g.retries.values()) for g in some)} | {statistics.median(g.took_s for g in some):.1f} s "
                f"| {f'{statistics.median(ratios):.2f}' if ratios else ''} |"
            )
    ways = differing(gradings)
    said = "; ".join(f"{check}: {points}" for check, points in ways.items()) if ways else "nothing"
    return "\n".join([*lines, "", f"Decided in two ways: {said}."])


def _usual_times(gradings: Iterable[Grading]) -> dict[str, float]:
    times: dict[str, list[float]] = {}
    for grading in gradings:
        times.setdefault(grading.submission, []).append(grading.took_s)
    return {name: statistics.median(took_s) for name, took_s in times.items()}


def read(file: Path) -> list[Grading]:
    """Read the gradings that a file holds; none if there is no such file."""
    if not file.is_file():
        return []
    return [Grading(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]


def collect(times: int, into: Path, loads: Sequence[str], until_s: float | None = None) -> None:
    """Grade until each submission was graded so often beside each load; loads and submissions take turns.

    Parameters
    ----------
    until_s : float, optional
        Begin no grading after this time of the system clock.
    """
    gradings = read(into)
    there = Counter((grading.submission, grading.load) for grading in gradings)
    with tempfile.TemporaryDirectory(prefix="bench-") as scratch:
        submissions.write(Path(scratch) / _SUBMISSIONS)
        for number in range(times):
            for name in submissions.NAMES:
                for load in loads:
                    if there[name, load] > number or (
                        until_s is not None and time.time() > until_s
                    ):
                        continue
                    kept = into.with_suffix(".kept")
                    gradings.append(
                        grade(Path(scratch) / _SUBMISSIONS / name, load, gradings, kept)
                    )
                    with into.open("a", encoding="utf-8") as stream:
                        stream.write(json.dumps(asdict(gradings[-1])) + "\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Collect gradings, or sum up those that a file holds; 1 if anything was decided in two ways."""
    parser = argparse.ArgumentParser(prog="python -m bench.stability", description=__doc__)
    parser.add_argument(
        "--times", type=int, default=1, help="gradings of each submission beside each load"
    )
    parser.add_argument(
        "--into", type=Path, default=Path("bench/stability.jsonl"), help="file that collects them"
    )
    parser.add_argument(
        "--minutes", type=float, help="begin no further grading after so many minutes"
    )
    parser.add_argument(
        "--only", choices=sorted(LOADS), action="append", help="beside this load only"
    )
    parser.add_argument(
        "--summary", type=Path, metavar="FILE", help="only sum up what a file holds"
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

"""Tells whether the same submission is given the same score, on a quiet machine and on a busy one.

The reference solution, and submissions near a limit, are graded over and over as a class, in every second round
beside twice as many spinning processes as there are cores. Each grading adds a line to a JSON-lines file, so
that a run can be interrupted and gone on with.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from bench import near_limits
from bench.load import cores, load_average, spinners

_UNDECIDED = ("inconclusive", "error")
#: Checks of the two promises about rates: at the right rate never below full, at nine tenths of it never full.
_RATE_CHECK, _RIGHT, _SLOW = "publisher.rate", ("solution",), ("rate_90_hz",)


@dataclass(frozen=True)
class Grading:
    """One grading of one submission.

    Attributes
    ----------
    loaded : bool
        Whether processes that never wait took part of all cores.
    decided : dict
        Check -> points, of the checks that were decided.
    undecided : list of str
        The other checks.
    retries : dict
        Session -> how often it was recorded again, where it was.
    """

    submission: str
    loaded: bool
    earned: float
    undecided_points: float
    decided: dict[str, float]
    undecided: list[str]
    retries: dict[str, int]
    load_average: float = 0.0
    measured: dict[str, str] = field(default_factory=dict)


def read_grading(results: Path, *, loaded: bool) -> Grading:
    """Read what a results folder says of its submission."""
    plain = json.loads((results / "result.json").read_text(encoding="utf-8"))
    checks: list[dict[str, Any]] = [check for criterion in plain["criteria"] for check in criterion["checks"]]
    attempts = {
        file.parent.name: int(json.loads(file.read_text(encoding="utf-8"))["attempt"])
        for file in sorted((results / "recordings").glob("*/session.json"))
    }
    undecided = [check for check in checks if check["outcome"] in _UNDECIDED]
    return Grading(
        plain["submission"],
        loaded,
        plain["score"]["earned"],
        plain["score"]["undecided"],
        {check["id"]: check["earned"] for check in checks if check["outcome"] not in _UNDECIDED},
        [check["id"] for check in undecided],
        {session: attempt - 1 for session, attempt in attempts.items() if attempt > 1},
        round(load_average(), 2),
        {check["id"]: f"{check['measured']} | {check['reason']}" for check in undecided},
    )


def one_round(submissions: Path, before: Sequence[Grading], keep: Path, *, loaded: bool) -> list[Grading]:
    """Grade a class once; a results folder that decides anything otherwise than before is kept."""
    with tempfile.TemporaryDirectory(prefix="bench-stability-") as scratch:
        results = Path(scratch)
        with spinners(2 * cores()) if loaded else nullcontext():
            command = [sys.executable, "-m", "grader.cli", str(submissions), "--each", "-o", str(results)]
            environment = {name: value for name, value in os.environ.items() if name != "CI"}
            subprocess.run(command, stdout=subprocess.DEVNULL, check=True, env=environment)
        folders = [file.parent for file in sorted(results.glob("*/result.json"))]
        gradings = [read_grading(folder, loaded=loaded) for folder in folders]
        for folder, grading in zip(folders, gradings, strict=True):
            if not _steadiness(grading.submission, [*_of(before, grading.submission), grading]).steady:
                shutil.copytree(folder, keep / f"{grading.submission}-{time.time_ns()}")
        return gradings


def _of(gradings: Iterable[Grading], name: str) -> list[Grading]:
    return [grading for grading in gradings if grading.submission == name]


@dataclass(frozen=True)
class Steadiness:
    """What many gradings of one submission say together.

    Attributes
    ----------
    scores : list of float
        Different scores of the gradings in which all was decided: one, if all is well.
    differing : dict
        Check -> its different points, of the checks that were decided in more than one way.
    """

    submission: str
    gradings: int
    loaded: int
    scores: list[float]
    differing: dict[str, list[float]]
    undecided: int
    undecided_idle: int
    retries: int
    retries_idle: int

    @property
    def steady(self) -> bool:
        """Whether nothing was decided in two ways."""
        return len(self.scores) <= 1 and not self.differing


def steadiness(gradings: Sequence[Grading]) -> list[Steadiness]:
    """Sum up gradings, by submission."""
    names = list(dict.fromkeys(grading.submission for grading in gradings))
    return [_steadiness(name, _of(gradings, name)) for name in names]


def _steadiness(name: str, gradings: Sequence[Grading]) -> Steadiness:
    points: dict[str, set[float]] = {}
    for grading in gradings:
        for check, earned in grading.decided.items():
            points.setdefault(check, set()).add(earned)
    idle = [g for g in gradings if not g.loaded]
    return Steadiness(
        name,
        len(gradings),
        len(gradings) - len(idle),
        sorted({g.earned for g in gradings if not g.undecided}),
        {check: sorted(earned) for check, earned in points.items() if len(earned) > 1},
        sum(bool(g.undecided) for g in gradings),
        sum(bool(g.undecided) for g in idle),
        sum(sum(g.retries.values()) for g in gradings),
        sum(sum(g.retries.values()) for g in idle),
    )


def promises(gradings: Iterable[Grading]) -> list[str]:
    """Say whether what runs at the right rate never failed, and what runs at nine tenths of it never passed."""
    right: list[float] = []
    slow: list[float] = []
    best = 0.0
    for grading in gradings:
        earned = grading.decided.get(_RATE_CHECK)
        if earned is not None and grading.submission in _RIGHT:
            right.append(earned)
            best = max(best, earned)
        elif earned is not None and grading.submission in _SLOW:
            slow.append(earned)
    failed, passed = sum(earned < best for earned in right), sum(earned >= best for earned in slow)
    return [
        f"100 Hz: decided {len(right)} times, {failed} times below full.",
        f"90 Hz: decided {len(slow)} times, {passed} times full.",
    ]


def table(gradings: Sequence[Grading]) -> str:
    """Return the summary as Markdown."""
    lines = [
        "| submission | gradings (loaded) | scores decided | checks decided in two ways | with something undecided "
        "(idle) | sessions run again (idle) |",
        "|---|---|---|---|---|---|",
    ]
    for row in steadiness(gradings):
        scores = ", ".join(f"{score:g}" for score in row.scores) or "none"
        differing = "; ".join(f"{check}: {points}" for check, points in row.differing.items()) or "none"
        lines.append(
            f"| {row.submission} | {row.gradings} ({row.loaded}) | {scores} | {differing} "
            f"| {row.undecided} ({row.undecided_idle}) | {row.retries} ({row.retries_idle}) |"
        )
    return "\n".join([*lines, "", *promises(gradings)])


def read(file: Path) -> list[Grading]:
    """Read the gradings that a file holds; none if there is no such file."""
    if not file.is_file():
        return []
    return [Grading(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]


def collect(times: int, into: Path, until_s: float | None = None, only: bool | None = None) -> None:
    """Grade until each submission was graded so often, half of the times on a loaded machine.

    Parameters
    ----------
    only : bool, optional
        True for the loaded half alone, False for the other.
    until_s : float, optional
        Begin no round after this time of the system clock.
    """
    with tempfile.TemporaryDirectory(prefix="bench-submissions-") as scratch:
        while until_s is None or time.time() < until_s:
            gradings = read(into)
            missing = {half: _missing(gradings, times // 2, half) for half in (False, True) if only in (None, half)}
            if not any(missing.values()):
                return
            # The half of which less is there comes next.
            loaded = max(missing, key=lambda half: sum(missing[half].values()))
            near_limits.write(Path(scratch), list(missing[loaded]))
            done = one_round(Path(scratch), gradings, into.with_suffix(".kept"), loaded=loaded)
            with into.open("a", encoding="utf-8") as stream:
                stream.writelines(json.dumps(asdict(grading)) + "\n" for grading in done)


def _missing(gradings: Iterable[Grading], wanted: int, loaded: bool) -> dict[str, int]:
    """Return how many gradings of one half are still to be made, by submission."""
    there = Counter(grading.submission for grading in gradings if grading.loaded == loaded)
    return {name: wanted - there[name] for name in near_limits.NAMES if there[name] < wanted}


def main(arguments: Sequence[str] | None = None) -> int:
    """Collect gradings, or sum up those that a file holds; 1 if anything was decided in two ways."""
    parser = argparse.ArgumentParser(prog="python -m bench.stability", description=__doc__)
    parser.add_argument("--times", type=int, default=4, help="gradings of each submission, those there are included")
    parser.add_argument("--into", type=Path, default=Path("bench/stability.jsonl"), help="file that collects them")
    parser.add_argument("--minutes", type=float, help="begin no further round after so many minutes")
    parser.add_argument("--only", choices=("idle", "loaded"), help="only one of the two halves")
    parser.add_argument("--summary", type=Path, metavar="FILE", help="only sum up what a file holds")
    options = parser.parse_args(arguments)
    if options.summary is None:
        until_s = time.time() + 60 * options.minutes if options.minutes else None
        collect(options.times, options.into, until_s, options.only and options.only == "loaded")
    gradings = read(options.summary or options.into)
    print(table(gradings))
    return 0 if all(row.steady for row in steadiness(gradings)) else 1


if __name__ == "__main__":
    sys.exit(main())

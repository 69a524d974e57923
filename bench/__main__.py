"""Measures everything in one run, and writes the tables for docs/measurements.md."""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Sequence
from pathlib import Path

from bench import grading, outside, processes, rates, recording, stability
from bench.load import cores

_RESULTS = Path(__file__).with_name("results.md")


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def report(runs: int, gradings: Path) -> str:
    """Measure, and return the tables as Markdown."""
    parts = [
        f"Measured on {cores()} cores, Linux {platform.release().split('-')[0]}, Python {platform.python_version()}. "
        "Values are medians, with the range in brackets.",
        table(["", "measured", "compared with", "ratio"], grading.rows(runs)),
        "CPU time of the processes of one full grading, and its ratio to the student's:",
        table(["process", "CPU time", "ratio"], processes.rows(runs)),
        "CPU time of the student's programs in their sandboxes, and as plain programs beside the same nodes, by turns:",
        table(["programs", "inside", "outside", "ratio"], outside.rows(runs)),
        "Highest rate of a topic without a lost message:",
        table(
            ["this recorder", "a callback that writes with `rosbags`", "ratio"], recording.rows()
        ),
        "Measured rate of a topic, by an idle receiver and by a busy one (it computes half of the time):",
        table(
            ["true rate", "receiver", "this recorder", "the method of `ros2 topic hz`"],
            rates.rows(),
        ),
    ]
    collected = stability.read(gradings)
    if collected:
        parts.append("The same submissions graded repeatedly, beside the loads of `bench/load.py`:")
        parts.append(stability.table(collected))
    return "\n\n".join(parts) + "\n"


def main() -> int:
    """Print the tables, and keep them in bench/results.md."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--runs", type=int, default=3, help="gradings of each kind (default: 3)")
    parser.add_argument(
        "--stability",
        type=Path,
        default=Path(__file__).with_name("stability.jsonl"),
        metavar="FILE",
        help="gradings collected by `python -m bench.stability`, if any",
    )
    options = parser.parse_args()
    text = report(options.runs, options.stability)
    _RESULTS.write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())

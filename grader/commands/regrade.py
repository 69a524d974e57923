"""`grade regrade RESULTS_DIR...`: judge recordings again, without ROS."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

from rich.console import Console

from grader.commands.arguments import add_fail_under, each


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="grade regrade", description="Judge recordings again; needs no ROS.")
    parser.add_argument(
        "results",
        nargs="+",
        type=Path,
        metavar="RESULTS_DIR",
        help="results of a submission, e.g. results/alice",
    )
    parser.add_argument("--rubric", type=Path, metavar="FILE", help="rubric (default: the one it was recorded with)")
    add_fail_under(parser)
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Judge the results again; returns the exit status."""
    from grader import pipeline
    from grader.report.terminal import print_result

    options = _parser().parse_args(arguments)

    def regrade_one(folder: Path) -> Decimal:
        result = pipeline.regrade(folder, options.rubric)
        print_result(console, result)
        return result.score.earned

    return each(options.results, regrade_one, options.fail_under)

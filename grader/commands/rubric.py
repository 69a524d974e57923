"""`grade rubric`: check a rubric, or print the JSON Schema for editors."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from rich.console import Console

from grader.commands.arguments import parser_of, rubric_path


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    words = "Check a rubric, or print the JSON Schema for editors."
    parser = parser_of("grade rubric", words)
    parser.add_argument(
        "rubric",
        nargs="?",
        type=rubric_path,
        metavar="LAB",
        help="name of a shipped lab, folder of a lab, or its rubric.yaml (default: the first of `grade lab list`)",
    )
    parser.add_argument(
        "--schema",
        action="store_true",
        help="print the JSON Schema of rubrics, with the lab's own checks",
    )
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Check a rubric; returns the exit status."""
    chosen = make_parser().parse_args(arguments)
    from grader.judging.rubrics import read_rubric, rubric_kinds
    from grader.lab.rubric import json_schema, own_models

    rubric = read_rubric(chosen.rubric)
    if chosen.schema:
        print(json.dumps(json_schema(rubric_kinds(), own_models(rubric)), indent=1))
        return 0
    checks, sessions = len(list(rubric.checks())), len(rubric.sessions)
    console.print(
        f"The rubric is in order. Points: {rubric.lab.points}, checks: {checks}, sessions: {sessions}."
    )
    return 0

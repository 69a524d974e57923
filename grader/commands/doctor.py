"""`grade doctor`: examine this machine."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from grader.commands.arguments import (
    add_flag,
    add_lab,
    add_path,
    add_ros,
    interpreter_for,
    parser_of,
)
from grader.doctor.status import Status, Verdict, status_of_limits
from grader.report.escape import terminal_text

if TYPE_CHECKING:
    from grader.lab.rubric import Rubric

#: Exit status if this machine cannot grade.
_UNFIT = 1
_STYLES = {"PASS": "green", "WARNING": "yellow", "FAIL": "red"}


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    words = "Examine this machine: can it grade, how well does it confine students' code, how busy is it?"
    parser = parser_of(
        "grade doctor",
        words,
        "The exit status is 1 if this machine cannot grade, or students' nodes cannot run with the installation of --ros.",
    )
    add_path(parser, "--python", "interpreter for students' code, or `lab`, see `grade --help`")
    add_ros(parser)
    add_flag(
        parser,
        "--calibrate",
        "also grade the lab's solution, and report which checks this machine can decide",
    )
    add_lab(parser, "for --calibrate; default: the lab shipped with grade")
    add_flag(parser, "--json", "print JSON")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Examine the machine; returns the exit status."""
    options = make_parser().parse_args(arguments)
    verdicts = []
    statuses = []
    for status in _statuses(options):
        verdicts.append(status.verdict)
        if options.json:
            statuses.append(asdict(status))
        else:
            _print(status, console)
    if options.json:
        print(json.dumps(statuses, indent=1))
    return _UNFIT if Verdict.FAIL in verdicts else 0


def _statuses(options: argparse.Namespace) -> Iterator[Status]:
    interpreter = interpreter_for(options.python, partial(_rubric_of, options))
    limits = status_of_limits()
    yield limits
    if limits.verdict is Verdict.FAIL:  # A limit on memory prevents the imports below.
        return
    from grader.doctor.examination import calibrate, examine
    from grader.doctor.ros_prefix import examine_ros

    yield from examine(interpreter)
    if options.ros is not None:
        chosen = None
        if options.python is not None:
            chosen = interpreter
        yield from examine_ros(options.ros, chosen)
    if options.calibrate:
        yield from calibrate(interpreter, _rubric_of(options))


def _rubric_of(options: argparse.Namespace) -> Rubric:
    """Read the rubric, which few examinations need."""
    from grader.judging import rubrics

    return rubrics.read_rubric(options.rubric)


def _print(status: Status, console: Console) -> None:
    line = Text(f"{status.verdict.value:<8}", style=_STYLES[status.verdict.value])
    line.append(f"{status.subject}: ", style="bold").append(
        terminal_text(status.found), style="default not bold"
    )
    console.print(line, soft_wrap=True)
    if status.remedy:
        console.print(Text(f"        → {terminal_text(status.remedy)}"), soft_wrap=True)

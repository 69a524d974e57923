"""`grade doctor`: examine this machine."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from grader.commands.arguments import add_flag, add_lab, add_path, interpreter_of, parser_of
from grader.report.escape import terminal_text

#: Exit status when something keeps this machine from grading.
_UNFIT = 1
_STYLES = {"PASS": "green", "WARNING": "yellow", "FAIL": "red"}


def run(arguments: Sequence[str], console: Console) -> int:
    """Examine the machine; returns the exit status."""
    from grader.doctor.examination import Verdict, calibrate, examine
    from grader.judging import rubrics

    words = "Examine this machine: can it grade, how well does it confine students' code, how quiet is it?"
    parser = parser_of("grade doctor", words, "Exit status 1 if it cannot grade.")
    add_path(parser, "--python", "interpreter for students' code")
    add_flag(parser, "--calibrate", "also grade the lab's own solution: what can be decided here?")
    add_lab(parser, "its solution is graded; default: that which travels with grade")
    options = parser.parse_args(arguments)
    interpreter = interpreter_of(options.python)
    statuses = examine(interpreter)
    if options.calibrate:
        statuses = itertools.chain(
            statuses, calibrate(interpreter, rubrics.read_rubric(options.rubric))
        )
    verdicts = []
    for status in statuses:
        verdicts.append(status.verdict)
        line = Text(f"{status.verdict.value:<8}", style=_STYLES[status.verdict.value])
        line.append(f"{status.subject}: ", style="bold").append(
            terminal_text(status.found), style="default not bold"
        )
        console.print(line, soft_wrap=True)
        if status.remedy:
            console.print(Text(f"        → {terminal_text(status.remedy)}"), soft_wrap=True)
    return _UNFIT if Verdict.FAIL in verdicts else 0

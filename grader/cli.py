"""The `grade` command: finds the command meant, runs it, and catches errors, once."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

from rich.console import Console

from grader.commands import grade
from grader.commands.arguments import print_error
from grader.errors import GraderError

#: Command -> what it does; each is a module of `grader.commands`. Without one of these words, submissions are graded.
COMMANDS = {
    "regrade": "judge recordings again, without ROS",
    "report": "the page over a class and its grades.csv, from results that are there",
    "export": "write results in the forms of CI systems and learning platforms",
    "selftest": "grade submissions whose verdict is known, and compare",
    "doctor": "examine this machine: can it grade, how well does it confine, how quiet is it",
    "checks": "list the checks that a rubric can use",
}

_EXIT_STATUS = """\
exit status:
  0 graded, whatever the score    1 below --fail-under    2 wrong usage
  3 no such submission            4 rubric not usable     5 platform not supported
  6 recording not readable        7 isolation not to be had  70 other trouble
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    console = Console(highlight=False)
    try:
        if arguments and arguments[0] in COMMANDS:
            command = importlib.import_module(f"grader.commands.{arguments[0]}")
            return int(command.run(arguments[1:], console))
        return grade.run(arguments, console, epilog=_epilog())
    except GraderError as error:
        print_error(error)
        return error.exit_status
    except OSError as error:
        print_error(GraderError(error.strerror or str(error), where=str(error.filename or ""), remedy="Check -o."))
        return GraderError.exit_status
    except KeyboardInterrupt:
        print("grade: interrupted; there is no result of this submission", file=sys.stderr)
        return 130


def _epilog() -> str:
    lines = [f"  grade {name:<10}{text}" for name, text in COMMANDS.items()]
    return "other commands (each with --help):\n" + "\n".join(lines) + "\n\n" + _EXIT_STATUS


if __name__ == "__main__":
    sys.exit(main())

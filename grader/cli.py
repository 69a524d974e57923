"""The `grade` command: finds the command meant, runs it, and catches errors, once."""

from __future__ import annotations

import difflib
import importlib
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from grader.commands import grade
from grader.commands.arguments import print_error
from grader.errors import GraderError, SubmissionError, described

#: Command -> what it does; each is a module of `grader.commands`. Without one of these words, submissions are graded.
COMMANDS = {
    "regrade": "judge recordings again, without ROS",
    "report": "the page over a class and its grades.csv, from results that are there",
    "export": "write results in the forms of CI systems and learning platforms",
    "selftest": "grade submissions whose verdict is known, and compare",
    "doctor": "examine this machine: can it grade, how well does it confine, how quiet is it",
    "checks": "list the checks that a rubric can use",
    "rubric": "check a rubric, or print its JSON Schema for an editor",
}

_EXIT_STATUS = """\
exit status:
  0  graded, whatever the score    1  below --fail-under         2  wrong usage
  3  no usable submission          4  rubric or overrides wrong  5  platform not supported
  6  recording not readable        7  confinement not to be had  70 other trouble
  130 interrupted                  of several submissions: the highest
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    console = _Console(highlight=False)
    try:
        if arguments and arguments[0] in COMMANDS:
            command = importlib.import_module(f"grader.commands.{arguments[0]}")
            return int(command.run(arguments[1:], console))
        status = grade.run(arguments, console, epilog=_epilog())
        if status == SubmissionError.exit_status and (meant := _command_meant(arguments[0])):
            print(f"  If the command was meant: grade {meant}", file=sys.stderr)
        return status
    except GraderError as error:
        print_error(error)
        return error.exit_status
    except BrokenPipeError:
        _discard_output()
        return GraderError.exit_status
    except OSError as error:
        print_error(described(error))
        return GraderError.exit_status
    except KeyboardInterrupt as interrupt:
        print(f"grade: interrupted; there is no result of this submission\n  {interrupt}".rstrip(), file=sys.stderr)
        return 130
    except Exception:
        # Not 1, with which Python would end: that is a score below --fail-under.
        traceback.print_exc()
        print("grade: this is a defect of the grader; there is no result", file=sys.stderr)
        return GraderError.exit_status


class _Console(Console):
    """Goes on without a reader: with `grade ... | head` the results are written all the same."""

    def on_broken_pipe(self) -> None:
        """Print nothing more; rich would end with 1, which is a score below --fail-under."""
        self.quiet = True
        _discard_output()


def _discard_output() -> None:
    """Lead the standard output to where nothing breaks, also for what is written when Python ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)


def _command_meant(word: str) -> str:
    near = difflib.get_close_matches(word, COMMANDS, n=1, cutoff=0.75)
    return near[0] if near and not Path(word).exists() else ""


def _epilog() -> str:
    lines = [f"  grade {name:<10}{text}" for name, text in COMMANDS.items()]
    return "other commands (each with --help):\n" + "\n".join(lines) + "\n\n" + _EXIT_STATUS


if __name__ == "__main__":
    sys.exit(main())

"""The `grade` command: finds the command meant, runs it, and catches errors, once."""

from __future__ import annotations

import atexit
import gc
import importlib
import os
import sys
import traceback
from collections.abc import Sequence

from rich.console import Console

from grader.commands import COMMANDS
from grader.errors import GraderError, described
from grader.live.process.priority import going_first
from grader.plain_output import write_to_any_terminal

_EXIT_STATUS = """\
exit status:
  0  graded, whatever the score    1  below --fail-under         2  wrong usage
  3  no usable submission          4  rubric or overrides wrong  5  platform not supported
  6  recording not readable        7  code cannot be confined    70 other trouble
  130 interrupted                  of several submissions: the highest
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    write_to_any_terminal()
    console = _Console(highlight=False)
    # What is imported stays: looking for garbage in it took a sixth of the start, and 0.16 s at the end.
    gc.set_threshold(200_000, 20, 100)
    atexit.register(gc.freeze)
    try:
        if arguments and arguments[0] in COMMANDS:
            command = importlib.import_module(f"grader.commands.{arguments[0]}")
            return int(command.run(arguments[1:], console))
        with going_first():
            grade = importlib.import_module("grader.commands.grade")
            return int(grade.run(arguments, console, epilog=_epilog()))
    except BrokenPipeError:
        _discard_output()
        return GraderError.exit_status
    except (GraderError, OSError) as error:
        # Late: what it imports takes a fifth of a second, which is for when this process goes before others.
        from grader.commands.arguments import print_error

        print_error(described(error))
        return described(error).exit_status
    except KeyboardInterrupt as interrupt:
        print(
            f"grade: interrupted; there is no result of this submission\n  {interrupt}".rstrip(),
            file=sys.stderr,
        )
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


def _epilog() -> str:
    width = max(map(len, COMMANDS))
    lines = [f"  grade {name:<{width}}  {text}" for name, text in COMMANDS.items()]
    return "other commands (each with --help):\n" + "\n".join(lines) + "\n\n" + _EXIT_STATUS


if __name__ == "__main__":
    sys.exit(main())

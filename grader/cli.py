"""The `grade` command: finds the command meant, runs it, and catches errors, once."""

from __future__ import annotations

import atexit
import gc
import importlib
import os
import sys
import threading
import traceback
from collections.abc import Sequence
from enum import Enum

from rich.console import Console

from confine.limits import limit_behind
from confine.priority import going_first
from grader.commands import COMMANDS
from grader.commands.usage import WrongUsage
from grader.errors import GraderError, PlatformError, UsageError, described
from grader.extras import EXTRAS, missing_extra
from grader.plain_output import write_to_any_terminal


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status, or ends the process with it if the arguments are the process's."""
    if argv is not None:
        return _status_of(list(argv))
    status = _status_of(sys.argv[1:])
    _end(status)
    return status


def _end(status: int) -> None:
    """End the process without Python's own end, which takes all modules apart in 30 ms."""
    # Python would wait for other threads.
    if threading.active_count() > 1:
        return
    atexit._run_exitfuncs()
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except (OSError, ValueError):
        # Python's own end reports it.
        return
    os._exit(status)


def _status_of(arguments: list[str]) -> int:
    """Run the command, and report its errors; returns the exit status."""
    write_to_any_terminal()
    console = _Console(highlight=False, emoji=False)
    # Imported modules stay: looking for garbage in them took a sixth of the start, and 0.16 s at the end.
    gc.set_threshold(200_000, 20, 100)
    atexit.register(gc.freeze)
    try:
        return _run(_in_full(arguments), console)
    except BrokenPipeError:
        _discard_output()
        return GraderError.exit_status
    except (GraderError, OSError) as error:
        return _print_error(described(error))
    except KeyboardInterrupt as interrupt:
        print(
            f"grade: interrupted; there is no result of this submission\n  {interrupt}".rstrip(),
            file=sys.stderr,
        )
        return 130
    except Exception as error:
        return _report_unexpected(error)


def _print_error(error: GraderError) -> int:
    """Print an error; return its exit status."""
    # Imported late, because its imports take a fifth of a second.
    from grader.commands.arguments import print_error

    print_error(error)
    return error.exit_status


def _report_unexpected(error: Exception) -> int:
    """Explain an exception: a missing extra, a limit of the machine, or a defect; return the exit status."""
    if isinstance(error, ModuleNotFoundError):
        if error.name in EXTRAS:
            return _print_error(missing_extra(error.name))
    traceback.print_exc()
    limit = limit_behind(f"{type(error).__name__}: {error}")
    if limit is not None:
        print(f"grade: {limit.present}, which can be the cause\n  {limit.remedy}", file=sys.stderr)
        return PlatformError.exit_status
    print("grade: this is a defect of the grader; there is no result", file=sys.stderr)
    # Not 1, with which Python would end: that is a score below --fail-under.
    return GraderError.exit_status


def _in_full(arguments: list[str]) -> list[str]:
    """Return the options that `grade help`, `grade help COMMAND` and `grade version` stand for.

    Raises UsageError for help with something that is not a command.
    """
    match arguments:
        case ["help" | "version" as word]:
            return [f"--{word}"]
        case ["help", "help" | "version" | "grade"]:
            return ["--help"]
        case ["help", command] if command in COMMANDS:
            return [command, "--help"]
        case ["help", other] if _is_unknown(other):
            raise UsageError(f"there is no command {other!r}", remedy="`grade help` lists them.")
    return arguments


def _is_unknown(word: str) -> bool:
    """Tell whether a word after `help` is not an option, and `help` is not a folder to grade."""
    if word.startswith("-"):
        return False
    return not os.path.lexists("help")


def _run(arguments: list[str], console: Console) -> int:
    word = arguments[0] if arguments else ""
    if word not in COMMANDS:
        return _grade(arguments, console)
    meaning = _meaning(arguments)
    if meaning is _Meaning.COMMAND_AND_FOLDER:
        _note_folder(word)
    command = importlib.import_module(f"grader.commands.{word}")
    try:
        status = int(command.run(arguments[1:], console))
    except WrongUsage as usage:
        if meaning is _Meaning.FOLDER_IF_NO_COMMAND:
            text = f"{word!r} is the folder here, because the options are those of grading."
            print(f"grade: {text}", file=sys.stderr)
            return _grade(arguments, console)
        usage.print()
        raise
    if meaning is _Meaning.FOLDER_IF_NO_COMMAND:
        _note_folder(word)
    return status


class _Meaning(Enum):
    """The possible meanings of arguments that start with the name of a command."""

    COMMAND = "the command"
    COMMAND_AND_FOLDER = "the command, although a folder of that name could be graded"
    FOLDER_IF_NO_COMMAND = "the folder, if the command does not take these options"


def _meaning(arguments: list[str]) -> _Meaning:
    if not os.path.lexists(arguments[0]):
        return _Meaning.COMMAND
    if not importlib.import_module("grader.commands.grade").takes(arguments):
        return _Meaning.COMMAND
    if any(argument.startswith("-") for argument in arguments):
        return _Meaning.FOLDER_IF_NO_COMMAND
    return _Meaning.COMMAND_AND_FOLDER


def _note_folder(word: str) -> None:
    text = f"{word!r} is the command here. To grade the folder of this name: grade ./{word}"
    print(f"grade: {text}", file=sys.stderr)


def _grade(arguments: list[str], console: Console) -> int:
    try:
        with going_first():
            grade = importlib.import_module("grader.commands.grade")
            return int(grade.run(arguments, console))
    except WrongUsage as usage:
        usage.print()
        raise


class _Console(Console):
    """Goes on without a reader: with `grade ... | head` the results are written all the same."""

    def on_broken_pipe(self) -> None:
        """Print nothing more; rich would end with 1, which is a score below --fail-under."""
        self.quiet = True
        _discard_output()


def _discard_output() -> None:
    """Discard further standard output, so that no later write breaks, not even at the end of Python."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)


if __name__ == "__main__":
    sys.exit(main())

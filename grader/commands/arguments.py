"""Functions shared by the commands: options, printing of notes and errors, and a loop over submissions."""

from __future__ import annotations

import argparse
import difflib
import errno
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rich.console import Console
from rich.text import Text

from grader.commands.usage import Parser
from grader.errors import GraderError, PlatformError, RubricError, UsageError
from grader.lab.kept_lab import RUBRIC_FILE
from grader.lab.shipped_labs import shipped_labs
from grader.lab.similar_words import meant
from grader.report.escape import terminal_text

if TYPE_CHECKING:
    from argparse import _ActionsContainer

    from grader.lab.rubric import Rubric
    from grader.live.sandbox.installation import Installation

_Submission = TypeVar("_Submission")

#: Exit status when the score is below --fail-under.
BELOW = 1
_TRUE = ("1", "true", "yes")


def parser_of(
    command: str, description: str, epilog: str = "", examples: str = ""
) -> argparse.ArgumentParser:
    """Return the parser of a command; its help keeps the line breaks of description, epilog and examples."""
    form = argparse.RawDescriptionHelpFormatter
    parser = Parser(prog=command, description=description, epilog=epilog, formatter_class=form)
    if examples:
        parser.examples = f"examples:\n{examples}\n"
    return parser


def as_sentence(words: str) -> str:
    """Write words as a sentence: "list the checks" becomes "List the checks."."""
    return f"{words[:1].upper()}{words[1:]}."


def add_path(parser: _ActionsContainer, option: str, words: str, metavar: str = "FILE") -> None:
    """Add an option that names a file or a folder."""
    parser.add_argument(option, type=Path, metavar=metavar, help=words)


def add_lab(parser: _ActionsContainer, words: str) -> None:
    """Add `--lab`, also called `--rubric`: a lab's folder, or a rubric."""
    words = f"name of a shipped lab, folder of a lab, or its rubric.yaml ({words})"
    parser.add_argument(
        "--lab", "--rubric", dest="rubric", action=_NameLab, metavar="LAB", help=words
    )


class _NameLab(argparse.Action):
    """Stores the path of the rubric; raises RubricError with the option's name if there is no such lab."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        path = rubric_path(str(values))
        if not path.exists():
            reason = os.strerror(errno.ENOENT)
            near = meant(str(values), list(shipped_labs()))
            remedy = f"Check {option_string}{near or '.'} `grade lab list` names the shipped labs."
            raise RubricError(
                "the rubric cannot be read", [reason], location=str(path), remedy=remedy
            )
        setattr(namespace, self.dest, path)


def rubric_path(text: str) -> Path:
    """Return the path of a rubric, given by the name of a shipped lab, by its folder, or by itself.

    The name counts first: in a CI job, the working folder is a student's, and can have a folder of that name.
    """
    path = Path(text)
    shipped = shipped_labs().get(text)
    if shipped is not None:
        if path.exists():
            print(
                f"grade: {text!r} is the shipped lab here. The folder of this name: ./{text}",
                file=sys.stderr,
            )
        path = shipped
    if path.is_dir():
        return path / RUBRIC_FILE
    return path


def require_unused(folder: Path) -> None:
    """Raise UsageError if a folder exists and is not empty."""
    is_used = folder.exists()
    if folder.is_dir():
        is_used = any(folder.iterdir())
    if is_used:
        raise UsageError(
            "this folder exists and is not empty",
            location=str(folder),
            remedy="Name another folder.",
        )


def add_flag(parser: _ActionsContainer, option: str, words: str) -> None:
    """Add an option without a value."""
    parser.add_argument(option, action="store_true", help=words)


def add_jobs(parser: _ActionsContainer, words: str) -> None:
    """Add `--jobs`."""
    parser.add_argument("-j", "--jobs", type=count, metavar="N", help=words)


def add_fail_under(parser: _ActionsContainer) -> None:
    """Add `--fail-under`."""
    parser.add_argument(
        "--fail-under", type=points, metavar="N", help="exit with 1 if a score is below N points"
    )


def add_isolation(parser: _ActionsContainer) -> None:
    """Add `--require-isolation` and `--trust-code`."""
    parser.add_argument(
        "--require-isolation",
        choices=("full", "no-cgroup", "reduced"),
        metavar="LEVEL",
        help="required level of confinement: full, no-cgroup or reduced; below it nothing runs (default: no-cgroup "
        "for several submissions and in CI jobs, reduced for one; `grade doctor` shows the level of this machine)",
    )
    add_flag(parser, "--trust-code", "run the code even without confinement, because I trust it")


def least_isolation(options: argparse.Namespace, *, several: bool) -> str:
    """Return the required level of confinement: the option's, or else a level by the kind of run."""
    if options.trust_code:
        return "none"
    if options.require_isolation is not None:
        return str(options.require_isolation)
    if several or os.environ.get("CI", "").lower() in _TRUE:
        return "no-cgroup"
    return "reduced"


def interpreter_of(chosen: Path | None) -> Path:
    """Return the interpreter for students' code, by default that of the grader.

    Raises PlatformError if the interpreter is missing.
    """
    if chosen is not None and not chosen.is_file():
        raise PlatformError(
            "there is no such interpreter", location=str(chosen), remedy="Check --python."
        )
    if chosen is None:
        return Path(sys.executable)
    return chosen.absolute()


#: Word for an environment with the lab's requirements, in place of an interpreter.
_OF_LAB = Path("lab")


def interpreter_for(chosen: Path | None, read_rubric: Callable[[], Rubric]) -> Path:
    """Return the interpreter for students' code; `lab` stands for an environment with the lab's requirements.

    The rubric is read for this word alone.

    Raises PlatformError if the interpreter is missing or the environment cannot be made.
    """
    if chosen != _OF_LAB:
        return interpreter_of(chosen)
    from grader.live.sandbox.students_python import students_python

    return students_python(read_rubric().lab.requirements)


def likely_interpreter(chosen: Path | None) -> Path:
    """Return the interpreter that `interpreter_for` will probably return, before the rubric is read."""
    if chosen == _OF_LAB:
        return interpreter_of(None)
    return interpreter_of(chosen)


def add_ros(parser: _ActionsContainer) -> None:
    """Add `--ros`."""
    words = (
        "installation of ROS 2 for students' programs, launch files and builds: a folder such as /opt/ros/jazzy, the "
        "`install` folder of a workspace, or a virtual environment of wheels (default: the rubric's `lab.environment`, "
        "or grade's own wheels)"
    )
    add_path(parser, "--ros", words, "PREFIX")


def students_side(
    chosen: Path | None, rubric: Rubric, prefix: Path | None = None
) -> tuple[Path, Installation | None]:
    """Return the interpreter of students' code and the installation of ROS: the option's, or else the lab's.

    Parameters
    ----------
    chosen
        Value of `--python`, see `interpreter_for`.
    prefix
        Value of `--ros`.

    Returns
    -------
    No installation stands for the wheels of the interpreter. That is so if an interpreter was chosen without `--ros`,
    or if neither the option nor the lab names an installation.

    Raises
    ------
    PlatformError
        There is no such interpreter or installation, or students' nodes do not run on it.
    """
    from grader.live.sandbox.course_ros import installation_at, require_usable

    interpreter = interpreter_for(chosen, lambda: rubric)
    own = None
    named = rubric.lab.environment
    if chosen is not None:
        own = interpreter
    elif prefix is None:
        prefix = _folder_at(named)
    if prefix is None:
        return interpreter, None
    installation = installation_at(prefix, own)
    require_usable(installation)
    return installation.interpreter, installation


def _folder_at(named: str | None) -> Path | None:
    """Return the path of a folder that a lab names, if it names one."""
    if named is None:
        return None
    return Path(named)


def points(text: str) -> Decimal:
    """Return the number of points in an argument, e.g. `2.5`."""
    with suppress(InvalidOperation):
        if (number := Decimal(text)).is_finite():
            return number
    raise argparse.ArgumentTypeError(f"{text!r} is not a number of points")


def count(text: str) -> int:
    """Return the whole number in an argument, 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of 1 or more, not {text!r}")
    return int(text)


def print_note(console: Console, text: str, style: str = "yellow") -> None:
    """Print a note; its text may hold any characters."""
    console.print(Text(terminal_text(text), style), soft_wrap=True)


def print_error(error: GraderError) -> None:
    """Print problem, location and remedy to standard error."""
    location = ""
    if error.location:
        location = f"{terminal_text(error.location)}: "
    print(f"grade: {location}{terminal_text(error.problem)}", file=sys.stderr)
    for mistake in error.mistakes if isinstance(error, RubricError) else ():
        print(f"  {terminal_text(mistake)}", file=sys.stderr)
    if error.remedy:
        print(f"  {terminal_text(error.remedy)}", file=sys.stderr)
    for near in _near_paths(Path(error.location)):
        print(f"  Did you mean {terminal_text(str(near))}?", file=sys.stderr)


def _near_paths(path: Path) -> list[Path]:
    """Return an existing path with a similar name for a missing one, e.g. `results/alice` for `results/alcie`."""
    if os.path.lexists(path):
        return []
    beside: list[str] = []
    with suppress(OSError):
        beside = [entry.name for entry in path.parent.iterdir()]
    return [path.with_name(name) for name in difflib.get_close_matches(path.name, beside, n=1)]


def each(
    submissions: Sequence[_Submission],
    work: Callable[[_Submission], Decimal],
    least: Decimal | None = None,
) -> int:
    """Do the work for each submission, also after an error; returns the highest exit status."""
    statuses = []
    for submission in submissions:
        try:
            earned = work(submission)
        except GraderError as error:
            print_error(error)
            statuses.append(error.exit_status)
        else:
            if below := least is not None and earned < least:
                print(
                    f"grade: {earned.normalize():f} points are below {least} (--fail-under)",
                    file=sys.stderr,
                )
            statuses.append(BELOW if below else 0)
    return max(statuses)

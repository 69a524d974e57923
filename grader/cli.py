"""The `grade` command: arguments → pipeline → print → exit status. Errors are caught here, once."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path

from rich.console import Console

from grader import __version__
from grader.errors import GraderError, RubricError
from grader.report.plain import terminal_text

#: Exit status when the score is below --fail-under.
BELOW = 1

_EPILOG = """\
other commands:
  grade regrade RESULTS_DIR     judge recordings again, without ROS
  grade checks                  list the checks that a rubric can use

exit status:
  0 graded, whatever the score    1 below --fail-under    2 wrong usage
  3 no such submission            4 rubric not usable     5 platform not supported
  6 recording not readable        7 isolation not to be had  70 other trouble
"""


def _grade_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="grade",
        description="Grade ROS 2 lab submissions on a live ROS graph.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("submissions", nargs="+", type=Path, metavar="PATH", help="folder of a student's files")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("results"),
        metavar="DIR",
        help="where results go (default: results)",
    )
    parser.add_argument(
        "--rubric",
        type=Path,
        metavar="FILE",
        help="rubric (default: that of the lab which travels with grade)",
    )
    parser.add_argument("--sessions", metavar="A,B", help="run only these sessions of the rubric")
    parser.add_argument(
        "--python", type=Path, metavar="FILE", help="interpreter for students' code (default: grade's own)"
    )
    parser.add_argument("--seed", type=int, help="seed of the stimuli (default: drawn anew)")
    parser.add_argument(
        "-j", "--jobs", type=_count, metavar="N", help="sessions side by side (default: as the cores allow)"
    )
    parser.add_argument(
        "--launch",
        choices=("standin", "native", "auto"),
        default="standin",
        help="what evaluates launch files: grade's own stand-in (default), the real launch of a sourced ROS "
        "installation, or the real one where there is one",
    )
    _add_fail_under(parser)
    parser.add_argument("--version", action="version", version=f"grade {__version__}")
    return parser


def _regrade_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="grade regrade", description="Judge recordings again; needs no ROS.")
    parser.add_argument(
        "results",
        nargs="+",
        type=Path,
        metavar="RESULTS_DIR",
        help="results of a submission, e.g. results/alice",
    )
    parser.add_argument("--rubric", type=Path, metavar="FILE", help="rubric (default: the one it was recorded with)")
    _add_fail_under(parser)
    return parser


def _add_fail_under(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--fail-under", type=_points, metavar="N", help="exit with 1 if a score is below N points")


def _points(text: str) -> Decimal:
    try:
        return Decimal(text)
    except InvalidOperation:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of points") from None


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no number from 1 on")
    return int(text)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    console = Console(highlight=False)
    commands = {"regrade": _regrade, "checks": _checks}
    try:
        command = commands.get(arguments[0]) if arguments else None
        return command(arguments[1:], console) if command is not None else _grade(arguments, console)
    except GraderError as error:
        _print_error(error)
        return error.exit_status
    except OSError as error:
        _print_error(GraderError(error.strerror or str(error), where=str(error.filename or ""), remedy="Check -o."))
        return GraderError.exit_status
    except KeyboardInterrupt:
        print("grade: interrupted; there is no result of this submission", file=sys.stderr)
        return 130


def _print_error(error: GraderError) -> None:
    where = f"{terminal_text(error.where)}: " if error.where else ""
    print(f"grade: {where}{terminal_text(error.problem)}", file=sys.stderr)
    for mistake in error.mistakes if isinstance(error, RubricError) else ():
        print(f"  {terminal_text(mistake)}", file=sys.stderr)
    if error.remedy:
        print(f"  {terminal_text(error.remedy)}", file=sys.stderr)


def _grade(arguments: Sequence[str], console: Console) -> int:
    from grader import pipeline
    from grader.report.terminal import ProgressDisplay, print_result

    parser = _grade_parser()
    options = parser.parse_args(arguments)
    rubric = pipeline.read_rubric(options.rubric)
    chosen = [s for s in options.sessions.split(",") if s] if options.sessions is not None else None
    live = pipeline.Options(_interpreter(options.python), chosen, options.seed, options.jobs, options.launch)
    names = [folder.resolve().name for folder in options.submissions]
    for name in names:
        if names.count(name) > 1:
            parser.error(f"two submissions are named {name}; their results would overwrite each other")

    def grade_one(folder: Path) -> Decimal:
        name = folder.resolve().name
        with ProgressDisplay(console, name, chosen if chosen is not None else list(rubric.sessions)) as display:
            result = pipeline.grade(
                folder,
                rubric,
                options.output / name,
                live,
                lambda p: display.update(p.session, p.text, p.step, p.steps, p.ended),
            )
        print_result(console, result)
        console.print(f"Report: {options.output / name / pipeline.REPORT_FILE}", soft_wrap=True)
        return result.score.earned

    return _each(options.submissions, grade_one, options.fail_under)


def _each(folders: Sequence[Path], work: Callable[[Path], Decimal], least: Decimal | None) -> int:
    """Do the work for each folder; one that cannot be graded does not keep the others from it."""
    statuses = []
    for folder in folders:
        try:
            earned = work(folder)
        except GraderError as error:
            _print_error(error)
            statuses.append(error.exit_status)
        else:
            statuses.append(BELOW if least is not None and earned < least else 0)
    return max(statuses)


def _interpreter(chosen: Path | None) -> Path:
    from grader.errors import PlatformError

    if chosen is None:
        return Path(sys.executable)
    if not chosen.is_file():
        raise PlatformError("there is no such interpreter", where=str(chosen), remedy="Check --python.")
    return chosen.absolute()


def _regrade(arguments: Sequence[str], console: Console) -> int:
    from grader import pipeline
    from grader.report.terminal import print_result

    options = _regrade_parser().parse_args(arguments)

    def regrade_one(folder: Path) -> Decimal:
        result = pipeline.regrade(folder, options.rubric)
        print_result(console, result)
        return result.score.earned

    return _each(options.results, regrade_one, options.fail_under)


def _checks(arguments: Sequence[str], console: Console) -> int:
    from grader.checks import REGISTRY

    argparse.ArgumentParser(prog="grade checks", description="List the checks that a rubric can use.").parse_args(
        arguments
    )
    for name, check in REGISTRY.items():
        console.print(f"[bold]{name}[/]: {' '.join((check.parameters.__doc__ or '').split())}")
        for key, field in check.parameters.model_fields.items():
            kind = getattr(field.annotation, "__name__", str(field.annotation)).replace("typing.", "")
            need = "required" if field.is_required() else f"default {field.get_default(call_default_factory=True)!r}"
            console.print(f"    {key}: {kind}, {need}. {field.description or ''}".rstrip(), markup=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())

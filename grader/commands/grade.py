"""`grade PATH...`: grade submissions on a live ROS graph."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

from rich.console import Console

from grader import __version__
from grader.commands.arguments import add_fail_under, add_isolation, count, each, least_isolation
from grader.commands.export import add_exports


def _parser(epilog: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="grade",
        description="Grade ROS 2 lab submissions on a live ROS graph.",
        epilog=epilog,
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
        "-j", "--jobs", type=count, metavar="N", help="sessions side by side (default: as the cores allow)"
    )
    parser.add_argument(
        "--launch",
        choices=("standin", "native", "auto"),
        default="standin",
        help="what evaluates launch files: grade's own stand-in (default), the real launch of a sourced ROS "
        "installation, or the real one where there is one",
    )
    add_isolation(parser)
    add_exports(parser, "--export")
    add_fail_under(parser)
    parser.add_argument("--version", action="version", version=f"grade {__version__}")
    return parser


def run(arguments: Sequence[str], console: Console, epilog: str = "") -> int:
    """Grade the submissions; returns the exit status."""
    from grader import pipeline
    from grader.report.terminal import ProgressDisplay, print_result

    options = _parser(epilog).parse_args(arguments)
    rubric = pipeline.read_rubric(options.rubric)
    chosen = [s for s in options.sessions.split(",") if s] if options.sessions is not None else None
    live = pipeline.Options(
        _interpreter(options.python),
        chosen,
        options.seed,
        options.jobs,
        options.launch,
        least_isolation(options, several=len(options.submissions) > 1),
        exports=options.exports,
        path_prefix=options.path_prefix,
        live_exports=len(options.submissions) == 1,
    )
    if len(options.submissions) > 1 and any(target.file is not None for target in options.exports):
        _parser(epilog).error("the exports of several submissions go into their results folders; leave out the file")
    names = [folder.resolve().name for folder in options.submissions]
    for name in names:
        if names.count(name) > 1:
            _parser(epilog).error(f"two submissions are named {name}; their results would overwrite each other")

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

    return each(options.submissions, grade_one, options.fail_under)


def _interpreter(chosen: Path | None) -> Path:
    from grader.errors import PlatformError

    if chosen is None:
        return Path(sys.executable)
    if not chosen.is_file():
        raise PlatformError("there is no such interpreter", where=str(chosen), remedy="Check --python.")
    return chosen.absolute()

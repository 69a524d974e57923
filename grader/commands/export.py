"""`grade export RESULTS_DIR...`: write results in the forms of CI systems and learning platforms."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

from rich.console import Console

from grader.commands.arguments import add_flag, each, parser_of
from grader.errors import RecordingError
from grader.report.escape import terminal_text
from grader.report.exports import EXPORTS
from grader.report.exports.writing import STANDARD_OUTPUT, ExportTarget, write_exports
from grader.result import load_result


def add_exports(parser: argparse.ArgumentParser, option: str) -> None:
    """Add the option that chooses exports, and `--path-prefix`."""
    parser.add_argument(
        option,
        type=_target,
        action="append",
        default=[],
        dest="exports",
        metavar="NAME[=FILE]",
        help=f"write the result in another system's form: {', '.join(EXPORTS)} (FILE: by default one in the "
        "results folder; several times for several)",
    )
    parser.add_argument(
        "--path-prefix",
        type=_below_here,
        default="",
        metavar="DIR",
        help="folder of the submission in its repository (an absolute one: below the working folder), for forms that "
        "point at lines of files",
    )


def _below_here(text: str) -> str:
    """Return a path as jobs name it, whose working folder is the repository."""
    return os.path.relpath(text) if Path(text).is_absolute() else text


def _target(text: str) -> ExportTarget:
    try:
        return ExportTarget.parse(text)
    except ValueError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None


def _parser() -> argparse.ArgumentParser:
    forms = "\n".join(f"  {export.name:<19}{export.description} ({export.file_name})" for export in EXPORTS.values())
    words = "Write results in the forms of CI systems and learning platforms."
    parser = parser_of("grade export", words, f"forms (and their files):\n{forms}")
    results = "results of a submission, e.g. results/alice"
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULTS_DIR", help=results)
    add_exports(parser, "--to")
    parser.add_argument("-o", "--output", metavar="FILE", help="the file for a single form; - is the standard output")
    add_flag(parser, "--so-far", "of a grading that still runs: judge what has been recorded until now")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Write the exports; returns the exit status."""
    parser = _parser()
    options = parser.parse_args(arguments)
    targets = _targets(parser, options)
    return each(options.results, lambda results: _export(results, targets, options, console))


def _export(results: Path, targets: Sequence[ExportTarget], options: argparse.Namespace, console: Console) -> Decimal:
    from grader.pipeline import judge_so_far
    from grader.result_folder import RESULT_FILE

    try:
        result = judge_so_far(results) if options.so_far else load_result(results / RESULT_FILE)
    except FileNotFoundError as problem:
        remedy = "Give the folder of one submission's results, e.g. results/alice."
        raise RecordingError(f"there is no {RESULT_FILE} to export", location=str(results), remedy=remedy) from problem
    written = write_exports(targets, result, results, options.path_prefix)
    if not any(target.file == STANDARD_OUTPUT for target in targets):
        for path in written:
            console.print(terminal_text(str(path)), soft_wrap=True, markup=False)
    return result.final


def _targets(parser: argparse.ArgumentParser, options: argparse.Namespace) -> list[ExportTarget]:
    targets: list[ExportTarget] = options.exports
    if not targets:
        parser.error("name the form with --to")
    if options.output is not None:
        if len(targets) > 1 or targets[0].file is not None:
            parser.error("-o needs a single --to NAME")
        try:
            targets = [ExportTarget.parse(f"{targets[0].name}={options.output}")]
        except ValueError as problem:
            parser.error(str(problem))
    if len(options.results) > 1 and any(t.file not in (None, STANDARD_OUTPUT) for t in targets):
        parser.error("of several results, each is written into its own folder; leave out the file")
    return targets

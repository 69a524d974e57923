"""`grade export RESULTS_DIR...`: write results in the forms of CI systems, learning platforms and mail programs."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grader.commands.arguments import add_flag, add_path, each, parser_of, print_note
from grader.errors import RecordingError
from grader.report.escape import terminal_text
from grader.report.exports import CLASS_EXPORTS, EXPORTS, ClassExport, Export
from grader.report.exports.writing import (
    FORMS,
    STANDARD_OUTPUT,
    ExportTarget,
    write_class_export,
    write_exports,
)
from grader.result import load_result
from grader.result_folder import RESULT_FILE

if TYPE_CHECKING:
    from grader.cohort.entries import ClassEntry

#: Submissions that a note names.
_MOST_NAMED = 10
_EPILOG = """
example:
  grade export results/ --to canvas --column 'Lab 9 (4711)'
  The folder is a class's, or one submission's. Who is who is known from the download that was graded, and from the
  class list that was given then; --class-list adds to it, also with what the grade book itself exports.
  A new column is made unless --column has the heading of one, as the grade book's own export writes it.
"""


def add_exports(
    parser: argparse.ArgumentParser,
    option: str,
    forms: Mapping[str, Export | ClassExport] = EXPORTS,
) -> None:
    """Add the option that chooses exports among some forms, and `--path-prefix`."""
    parser.add_argument(
        option,
        type=partial(_target, forms=forms),
        action="append",
        default=[],
        dest="exports",
        metavar="NAME[=FILE]",
        help=f"write the result in another system's form: {', '.join(forms)} (FILE: by default one in the "
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


def _target(text: str, forms: Mapping[str, Export | ClassExport] = FORMS) -> ExportTarget:
    try:
        return ExportTarget.parse(text, forms)
    except ValueError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None


def _address(text: str) -> str:
    if "@" not in text or not text.isprintable():
        raise argparse.ArgumentTypeError(f"{text!r} is not an address, as in Lab <lab@uni.example>")
    return text


def _parser() -> argparse.ArgumentParser:
    forms: dict[str, Mapping[str, Export | ClassExport]] = {
        "forms of a submission": EXPORTS,
        "forms of a class": CLASS_EXPORTS,
    }
    lines = [
        f"{title} (and their files):\n"
        + "\n".join(f"  {e.name:<19}{e.description} ({e.file_name})" for e in of.values())
        for title, of in forms.items()
    ]
    words = "Write results in the forms of CI systems, learning platforms and mail programs."
    parser = parser_of("grade export", words, "\n\n".join(lines) + "\n" + _EPILOG)
    results = "results of a submission, e.g. results/alice, or of a class, e.g. results/"
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULTS_DIR", help=results)
    add_exports(parser, "--to", FORMS)
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help="the file for a single form; - is the standard output",
    )
    add_flag(
        parser, "--so-far", "of a grading that still runs: judge what has been recorded until now"
    )
    group = parser.add_argument_group("of a class")
    add_path(
        group,
        "--class-list",
        "who is in the class, as for `grade`, or a grade book's own export",
        "CSV",
    )
    group.add_argument(
        "--column", default="", metavar="HEADING", help="heading of the grade book's column"
    )
    group.add_argument(
        "--from", dest="sender", metavar="ADDRESS", type=_address, help="from whom mails come"
    )
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Write the exports; returns the exit status."""
    parser = _parser()
    options = parser.parse_args(arguments)
    targets = _targets(parser, options)
    if targets[0].name in CLASS_EXPORTS:
        return each(
            options.results, lambda results: _export_class(results, targets, options, console)
        )
    return each(options.results, lambda results: _export(results, targets, options, console))


def _export_class(
    results: Path, targets: Sequence[ExportTarget], options: argparse.Namespace, console: Console
) -> Decimal:
    """Write forms of a class; returns no points, since there are none of a class."""
    from grader.cohort.entries import NOTHING_SUBMITTED, entries_in, entry_in, with_roster
    from grader.report.exports.returned import ReturnedClass
    from grader.submission.roster import read_class_list

    single = (results / RESULT_FILE).is_file()
    entries = [entry_in(results.resolve())] if single else entries_in(results)
    if options.class_list is not None:
        entries = with_roster(entries, read_class_list(options.class_list))
        entries = [entry for entry in entries if entry.problem != NOTHING_SUBMITTED]
    if not any(entry.result for entry in entries):
        remedy = "Give the folder of a class's results, e.g. results/, or of one submission's."
        raise RecordingError("there are no results to export", location=str(results), remedy=remedy)
    labs = sorted(
        {entry.result.provenance.get("lab", "") for entry in entries if entry.result is not None}
    )
    if len(labs) > 1:
        remedy = "A column is of one lab: move the results of each into a folder of its own."
        raise RecordingError(
            f"these are results of Labs {' and '.join(labs)}", location=str(results), remedy=remedy
        )
    given = ReturnedClass(
        entries,
        results.resolve().parent if single else results,
        options.column,
        options.sender or "",
    )
    notes = _standing_of(entries)
    beside = any(target.file == STANDARD_OUTPUT for target in targets)
    display = Console(stderr=True) if beside else console
    reaches_nobody = []
    for target in targets:
        returned = CLASS_EXPORTS[target.name].render(given)
        for why, names in returned.left_out.items():
            notes[f"{target.name}: left out, because {why}"] = names
        if not returned.count:
            reaches_nobody.append(target.name)
            continue
        for path, part in write_class_export(target, results, returned):
            display.print(f"{terminal_text(str(path))}: {part.count}", soft_wrap=True, markup=False)
        for part in (returned, *returned.further):
            notes |= {f"{target.name}: {note}": names for note, names in part.notes.items()}
    _print_notes(notes)
    if reaches_nobody:
        raise RecordingError(
            f"nothing was written for {', '.join(reaches_nobody)}: nobody of these results can be reached so",
            location=str(results),
            remedy="The notes above say why. --class-list adds what is known of students; a grade book's own export is one.",
        )
    return Decimal(0)


def _standing_of(entries: Sequence[ClassEntry]) -> dict[str, list[str]]:
    """Return notes on submissions without a result, and on points that are still undecided."""
    ungraded = [entry.name for entry in entries if entry.result is None]
    still_open = [entry.name for entry in entries if entry.result and entry.result.still_undecided]
    notes = {
        "Not graded, so left out": ungraded,
        "Points of these are still undecided, and not in what is exported": still_open,
    }
    return {words: names for words, names in notes.items() if names}


def _print_notes(notes: Mapping[str, Sequence[str]]) -> None:
    """Print each note, with the submissions that it is about."""
    for words, names in notes.items():
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        listed = f": {', '.join(names[:_MOST_NAMED])}{more}" if names else ""
        print_note(Console(stderr=True), f"{words}{listed}")


def _export(
    results: Path, targets: Sequence[ExportTarget], options: argparse.Namespace, console: Console
) -> Decimal:
    from grader.judging.result_files import judge_so_far

    try:
        result = judge_so_far(results) if options.so_far else load_result(results / RESULT_FILE)
    except FileNotFoundError as problem:
        remedy = "Give the folder of one submission's results, e.g. results/alice."
        raise RecordingError(
            f"there is no {RESULT_FILE} to export", location=str(results), remedy=remedy
        ) from problem
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
            targets = [ExportTarget.parse(f"{targets[0].name}={options.output}", FORMS)]
        except ValueError as problem:
            parser.error(str(problem))
    if len({target.name in CLASS_EXPORTS for target in targets}) > 1:
        parser.error("forms of a submission and forms of a class are written one after the other")
    if len(options.results) > 1 and any(t.file not in (None, STANDARD_OUTPUT) for t in targets):
        parser.error("of several results, each is written into its own folder; leave out the file")
    return targets

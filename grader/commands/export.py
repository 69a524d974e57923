"""`grade export RESULTS_DIR...`: write results for CI systems, learning platforms and mail programs."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grader.commands.arguments import add_flag, add_path, each, parser_of, print_note
from grader.commands.export_options import add_exports
from grader.errors import RecordingError
from grader.report.escape import terminal_text
from grader.report.exports import CLASS_EXPORTS, EXPORTS, Forms
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

#: Maximum number of submissions named in a note.
_MOST_NAMED = 10
_EPILOG = """
example:
  grade export results/ --to canvas --column 'Lab 9 (4711)'
  Students are identified by the graded download and its class list. --class-list adds data, for example an export of
  the grade book. Without --column a new column is made; for an existing one, copy its heading from that export.
"""


def _address(text: str) -> str:
    if "@" not in text or not text.isprintable():
        raise argparse.ArgumentTypeError(
            f"{text!r} is not an address such as Lab <lab@uni.example>"
        )
    return text


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    forms: dict[str, Forms] = {
        "forms of a submission": EXPORTS,
        "forms of a class": CLASS_EXPORTS,
    }
    lists = [_list_of(title, of) for title, of in forms.items()]
    words = "Write results for CI systems, learning platforms and mail programs."
    parser = parser_of("grade export", words, "\n\n".join(lists) + "\n" + _EPILOG)
    results = "results of a submission, e.g. results/alice, or of a class, e.g. results/"
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULTS_DIR", help=results)
    add_exports(parser, "--to", FORMS)
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help="file for a single form; - means the standard output",
    )
    add_flag(parser, "--so-far", "judge the recordings so far of a grading that is still running")
    group = parser.add_argument_group("options for forms of a class")
    add_path(
        group,
        "--class-list",
        "class list, as for `grade`, or an export of the grade book",
        "CSV",
    )
    group.add_argument(
        "--column",
        default="",
        metavar="HEADING",
        help="heading of an existing column in the grade book",
    )
    group.add_argument(
        "--from", dest="sender", metavar="ADDRESS", type=_address, help="sender of mails"
    )
    return parser


def _list_of(title: str, forms: Forms) -> str:
    """List forms for the help, with a line each, e.g. `  junit  JUnit XML (junit.xml)`."""
    lines = [f"{title} (and their files):"]
    for form in forms.values():
        lines.append(f"  {form.name:<19}{form.description} ({form.file_name})")
    return "\n".join(lines)


def run(arguments: Sequence[str], console: Console) -> int:
    """Write the exports; returns the exit status."""
    parser = make_parser()
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
    """Write forms of a class; returns 0, because a class has no points."""
    is_single = (results / RESULT_FILE).is_file()
    entries = _entries_of(results, options.class_list, is_single=is_single)
    _require_one_lab(entries, results)
    return_entries(
        entries, results, targets, console, column=options.column, sender=options.sender or ""
    )
    return Decimal(0)


def return_entries(
    entries: Sequence[ClassEntry],
    results: Path,
    targets: Sequence[ExportTarget],
    console: Console,
    *,
    column: str = "",
    sender: str = "",
) -> None:
    """Write forms of a class for some entries of it; raises RecordingError if a form reaches no student."""
    from grader.judging.languages import languages_of_class
    from grader.report.exports.returned import ReturnedClass

    folder = results
    if (results / RESULT_FILE).is_file():
        folder = results.resolve().parent
    given = ReturnedClass(entries, folder, column, sender, languages_of_class(folder, entries))
    notes = _standing_of(entries)
    prints_a_form = any(target.file == STANDARD_OUTPUT for target in targets)
    display = Console(stderr=True) if prints_a_form else console
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
            for note, names in part.notes.items():
                notes[f"{target.name}: {note}"] = names
    _print_notes(notes)
    if reaches_nobody:
        raise RecordingError(
            f"nothing was written for {', '.join(reaches_nobody)}: these forms reach no student of these results",
            location=str(results),
            remedy="The notes above have the reasons. A --class-list adds data, for example an export of the grade book.",
        )


def write_mails(results: Path, names: Collection[str], folder: Path, console: Console) -> None:
    """Write a mailbox with the reports of some submissions of a class into a folder of results.

    Addresses come from the download and the kept class list. Raises RecordingError if there are none.
    """
    from grader.cohort.entries import entries_in, with_roster
    from grader.commands.report import class_list_of
    from grader.submission.roster import read_class_list

    entries = entries_in(results)
    listed = class_list_of(results, entries, None)
    if listed is not None:
        entries = with_roster(entries, read_class_list(listed))
    wanted = [entry for entry in entries if entry.name in names]
    return_entries(wanted, folder, [ExportTarget.parse("mail", FORMS)], console)


def _entries_of(results: Path, class_list: Path | None, *, is_single: bool) -> list[ClassEntry]:
    """Return the submissions of a class, or a single one, with the facts of a class list.

    Raises RecordingError if there is no result.
    """
    from grader.cohort.entries import NOTHING_SUBMITTED, entries_in, entry_in, with_roster
    from grader.submission.roster import read_class_list

    if is_single:
        entries = [entry_in(results.resolve())]
    else:
        entries = entries_in(results)
    if class_list is not None:
        entries = with_roster(entries, read_class_list(class_list))
        entries = [entry for entry in entries if entry.problem != NOTHING_SUBMITTED]
    if not any(entry.result for entry in entries):
        raise RecordingError(
            "there are no results to export",
            location=str(results),
            remedy="Name the results of a class, e.g. results/, or of one submission, e.g. results/alice.",
        )
    return entries


def _require_one_lab(entries: Sequence[ClassEntry], results: Path) -> None:
    """Raise RecordingError if results belong to several labs."""
    labs = set()
    for entry in entries:
        if entry.result is not None:
            labs.add(entry.result.provenance.get("lab", ""))
    if len(labs) > 1:
        raise RecordingError(
            f"these are results of Labs {' and '.join(sorted(labs))}",
            location=str(results),
            remedy="A grade book has a column per lab: move the results of each lab into a folder of its own.",
        )


def _standing_of(entries: Sequence[ClassEntry]) -> dict[str, list[str]]:
    """Return notes on submissions without a result and on undecided points, each with the submissions."""
    ungraded = [entry.name for entry in entries if entry.result is None]
    still_open = [entry.name for entry in entries if entry.result and entry.result.still_undecided]
    notes = {
        "Left out, because not graded": ungraded,
        "Exported without their undecided points": still_open,
    }
    return {words: names for words, names in notes.items() if names}


def _print_notes(notes: Mapping[str, Sequence[str]]) -> None:
    """Print each note with its submissions."""
    for words, names in notes.items():
        listed = ", ".join(names[:_MOST_NAMED])
        if len(names) > _MOST_NAMED:
            listed += f" and {len(names) - _MOST_NAMED} more"
        if listed:
            words = f"{words}: {listed}"
        print_note(Console(stderr=True), words)


def _export(
    results: Path, targets: Sequence[ExportTarget], options: argparse.Namespace, console: Console
) -> Decimal:
    from grader.judging.result_files import judge_so_far

    try:
        if options.so_far:
            result = judge_so_far(results)
        else:
            result = load_result(results / RESULT_FILE)
    except FileNotFoundError as problem:
        remedy = "Name the results of one submission, e.g. results/alice."
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
        parser.error("name a form with --to")
    if options.output is not None:
        targets = [_target_at(options.output, targets, parser)]
    is_of_class = {target.name in CLASS_EXPORTS for target in targets}
    if len(is_of_class) > 1:
        parser.error("forms of a submission and forms of a class need a command each")
    named_files = [target for target in targets if target.file not in (None, STANDARD_OUTPUT)]
    if len(options.results) > 1 and named_files:
        parser.error("several results are each written into their own folder; leave out the file")
    return targets


def _target_at(
    output: str, targets: Sequence[ExportTarget], parser: argparse.ArgumentParser
) -> ExportTarget:
    """Return the single form with the file of `-o`; ends with an error of usage if there are several forms."""
    if len(targets) > 1 or targets[0].file is not None:
        parser.error("-o needs a single --to NAME")
    try:
        return ExportTarget.parse(f"{targets[0].name}={output}", FORMS)
    except ValueError as problem:
        parser.error(str(problem))

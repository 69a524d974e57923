"""`grade open RESULTS_DIR`: open a report or the page of a class in the browser."""

from __future__ import annotations

import argparse
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from grader.commands.arguments import as_sentence, parser_of, print_note
from grader.errors import RecordingError
from grader.result_folder import CLASS_PAGE, REPORT_FILE

_WORDS = "open a report or the page of a class in the browser"
#: Exit status without a browser.
_NOT_OPENED = 1


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    epilog = "The exit status is 1 if no browser could be started."
    parser = parser_of("grade open", as_sentence(_WORDS), epilog)
    results = "results of a submission, e.g. results/alice, or of a class (default: results)"
    parser.add_argument(
        "results",
        nargs="?",
        type=Path,
        default=Path("results"),
        metavar="RESULTS_DIR",
        help=results,
    )
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Open the page; returns the exit status."""
    options = make_parser().parse_args(arguments)
    page = page_of(options.results)
    console.print(str(page), soft_wrap=True, markup=False)
    if webbrowser.open(page.resolve().as_uri()):
        return 0
    print_note(console, "No browser could be started here; open this file yourself.")
    return _NOT_OPENED


def page_of(results: Path) -> Path:
    """Return the report of a submission or the page of a class; raises RecordingError if there is none.

    If a folder of a class has no class page and one submission, it is the report of that submission.
    """
    for page in (results / REPORT_FILE, results / CLASS_PAGE):
        if page.is_file():
            return page
    reports = sorted(results.glob(f"*/{REPORT_FILE}"))
    if len(reports) == 1:
        return reports[0]
    problem = "there is no such folder"
    remedy = "Name the results of a submission, e.g. results/alice, or of a class, e.g. results/."
    if results.is_dir():
        problem = "there is no page in it"
    if reports:
        remedy = f"`grade report {results}` writes the class page."
    raise RecordingError(problem, location=str(results), remedy=remedy)

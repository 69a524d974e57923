"""`grade review RESULTS_DIR`: the review desk, in the browser."""

from __future__ import annotations

import argparse
import getpass
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grader.commands.arguments import add_lab, add_path, parser_of, print_note

if TYPE_CHECKING:
    from grader.desk.decisions import Desk

_DESCRIPTION = """\
Decide the open questions of a class in the browser, each beside its evidence: appeals, undecided points, checks graded
by a person, interference with the grader, and notes.

Decisions are written at once to overrides.yaml beside the submissions' folders, and comments in that file stay. Results
and reports follow. The desk answers only on this machine, at the printed address. Ctrl-C ends it.
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade review", _DESCRIPTION)
    parser.add_argument(
        "results", type=Path, metavar="RESULTS_DIR", help="results of a class, e.g. results/"
    )
    parser.add_argument(
        "--who",
        metavar="NAME",
        default=login(),
        help="your name, for the decisions (default: %(default)s)",
    )
    parser.add_argument(
        "--port", type=int, default=0, metavar="N", help="port on 127.0.0.1 (default: a free one)"
    )
    add_path(
        parser, "--overrides", "decisions by people (default: overrides.yaml beside the results)"
    )
    add_lab(parser, "default: the rubric of most results")
    return parser


def login() -> str:
    """Return the user's name for decisions, or `instructor`."""
    with suppress(OSError, KeyError):
        return getpass.getuser()
    return "instructor"


def run(arguments: Sequence[str], console: Console) -> int:
    """Serve the desk until Ctrl-C; returns the exit status."""
    options = make_parser().parse_args(arguments)
    from grader.desk.server import serve

    desk = desk_of(options.results, options.rubric, options.overrides, options.who)

    def ready(address: str) -> None:
        left = sum(not item.is_decided for item in desk.queue())
        console.print(
            f"{left} to decide. Open this address, and keep it to yourself; Ctrl-C ends the desk:"
        )
        console.print(address, soft_wrap=True, markup=False)

    with suppress(KeyboardInterrupt):
        serve(desk, options.port, ready)
    print_note(console, "Writing the changed results ...", "dim")
    for name in desk.close():
        print_note(
            console,
            f"{name} could not be written; `grade regrade {desk.results / name}` shows the reason.",
        )
    if desk.written:
        number = f"{len(desk.written)} decision{'s' * (len(desk.written) != 1)}"
        console.print(
            f"{number} written to {desk.overrides_file}; `grade report {desk.results}` renews the class page."
        )
    return 0


def desk_of(
    results: Path, rubric: Path | None, overrides: Path | None, who: str, command: str = "review"
) -> Desk:
    """Return the desk of a class for a command.

    Raises GraderError if there are no results, or if overrides beside them do not count.
    """
    from grader.cohort.entries import entries_in
    from grader.desk.decisions import Desk
    from grader.errors import SubmissionError, UsageError
    from grader.judging.rubrics import rubric_of_class
    from grader.result_folder import OVERRIDES_FILE, RECORDINGS
    from grader.submission.separation import lies_within, made_from

    results = results.resolve()
    entries = entries_in(results)
    if not entries or (results / RECORDINGS).is_dir():
        remedy = "Name the folder with a folder of results for each submission, e.g. results/."
        raise SubmissionError(
            "there are no results of a class in it", location=str(results), remedy=remedy
        )
    sources = [made_from(results / entry.name) for entry in entries]
    if overrides is None and lies_within(results, sources):
        problem = "these results lie in a submission, where overrides.yaml may be a student's and does not count"
        raise UsageError(
            problem, location=str(results), remedy="Name a file of your own with --overrides."
        )
    used = rubric_of_class(results, entries, rubric)
    desk = Desk(
        results,
        used,
        (overrides or results / OVERRIDES_FILE).resolve(),
        " ".join(who.split()) or "instructor",
        command,
    )
    desk.overrides()  # Raises for mistakes in the file before the first decision.
    return desk

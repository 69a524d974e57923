"""`grade report RESULTS_DIR`: the class page and the table of grades, from results that are there."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grader.files import replace_file
from grader.result_folder import (
    ANONYMOUS_GRADES_FILE,
    ANONYMOUS_PAGE,
    CLASS_PAGE,
    GRADES_FILE,
    RECORDINGS,
    REPORT_FILE,
)

if TYPE_CHECKING:
    from grader.cohort.entries import ClassEntry
    from grader.cohort.summary import ClassSummary
    from grader.rubric import Rubric

_DESCRIPTION = """\
Write index.html, a page over a class, and grades.csv, a line a student, into the folder of a class's results.

They are made of the results that are there, without ROS; links on the page lead to the submissions' reports.
grades.csv is UTF-8 with a byte order mark, for spreadsheet programs; programs read it as utf-8-sig.
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="grade report", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path, metavar="RESULTS_DIR", help="results of a class, e.g. results/")
    parser.add_argument(
        "--anonymous",
        action="store_true",
        help="write index-anonymous.html and grades-anonymous.csv instead: pseudonyms, no links, student ids or times",
    )
    parser.add_argument(
        "--class-list",
        type=Path,
        metavar="CSV",
        help="columns name, student_id and submitted_at; who is on it without a result is listed as not graded",
    )
    parser.add_argument(
        "--rubric", type=Path, metavar="FILE", help="rubric (default: the one that most were judged by)"
    )
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Write page and table; returns the exit status."""
    from grader import rubrics
    from grader.cohort.entries import entries_in
    from grader.cohort.roster import read_class_list, with_roster
    from grader.errors import SubmissionError
    from grader.report.views import tenths

    options = _parser().parse_args(arguments)
    entries = entries_in(options.results)
    if not entries:
        remedy = "Give the folder that holds a folder of results for each submission, e.g. results/."
        if (options.results / RECORDINGS).is_dir():
            remedy = f"These are the results of one submission, whose page is {REPORT_FILE}. {remedy}"
        raise SubmissionError(
            "there are no results of submissions in it" if options.results.is_dir() else "there is no such folder",
            where=str(options.results),
            remedy=remedy,
        )
    copy = None if options.rubric else rubrics.rubric_of_class(options.results, entries)
    rubric = rubrics.recorded_rubric(copy) if copy else rubrics.read_rubric(options.rubric)
    for entry in entries:
        rubrics.require_lab(options.results / entry.name, rubric, "Part the results of the labs into two folders.")
    if options.class_list is not None:
        entries = with_roster(entries, read_class_list(options.class_list))
    summary = report_class(options.results, entries, rubric, anonymous=options.anonymous)
    graded = sum(row.result is not None for row in summary.rows)
    needy = len({todo.row for todo in summary.todos})
    median = f", median {tenths(summary.spread.median)} of {tenths(summary.spread.possible)}" if summary.spread else ""
    attention = f"{needy} need{'s' * (needy == 1)} attention"
    console.print(f"{len(entries)} submission{'s' * (len(entries) != 1)}, {graded} graded{median}; {attention}.")
    print_class_files(options.results, console, anonymous=options.anonymous)
    return 0


def report_class(
    results: Path, entries: Sequence[ClassEntry], rubric: Rubric, *, anonymous: bool = False
) -> ClassSummary:
    """Sum up a class and write its page and its table of grades, or both under pseudonyms and names of their own."""
    from grader.cohort.anonymous import anonymous as under_pseudonyms
    from grader.cohort.summary import summarise
    from grader.report import class_page, grades_csv

    summary = summarise(under_pseudonyms(entries, rubric) if anonymous else entries, rubric)
    page, grades = _class_files(results, anonymous)
    replace_file(page, class_page.render(summary, anonymous=anonymous))
    replace_file(grades, grades_csv.render(summary))
    return summary


def _class_files(results: Path, anonymous: bool) -> tuple[Path, Path]:
    names = (ANONYMOUS_PAGE, ANONYMOUS_GRADES_FILE) if anonymous else (CLASS_PAGE, GRADES_FILE)
    return results / names[0], results / names[1]


def print_class_files(results: Path, console: Console, *, anonymous: bool = False) -> None:
    """Print where the page over a class and the table of grades lie."""
    page, grades = _class_files(results, anonymous)
    console.print(f"Class: {page}", soft_wrap=True, markup=False)
    console.print(f"Grades: {grades}", soft_wrap=True, markup=False)

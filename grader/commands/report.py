"""`grade report RESULTS_DIR`: write the class page and the table of grades from existing results."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grader.commands.arguments import add_flag, add_lab, add_path, parser_of
from grader.files import replace_file
from grader.languages.catalogue import NAMES
from grader.result_folder import (
    ANONYMOUS_GRADES_FILE,
    ANONYMOUS_PAGE,
    CLASS_LIST_FILE,
    CLASS_PAGE,
    GRADES_FILE,
    RECORDINGS,
    REPORT_FILE,
)

if TYPE_CHECKING:
    from grader.cohort.entries import ClassEntry
    from grader.cohort.statistics import ClassSummary
    from grader.lab.rubric import Rubric

_DESCRIPTION = """\
Write the class page (index.html) and a table with a line per student (grades.csv) into a class's results.

Both are made from the existing results, without ROS. Links on the page lead to the submissions' reports. grades.csv is
UTF-8 with a byte order mark, for spreadsheet programs; other programs read it as utf-8-sig.
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade report", _DESCRIPTION)
    parser.add_argument(
        "results", type=Path, metavar="RESULTS_DIR", help="results of a class, e.g. results/"
    )
    words = "write index-anonymous.html and grades-anonymous.csv instead, with pseudonyms, without links, ids and times"
    add_flag(parser, "--anonymous", words)
    listed = "class list, as for `grade` (default: the latest); lists students without a result as not graded"
    add_path(parser, "--class-list", listed, "CSV")
    words = "earlier results of the class, e.g. of the first due date: show the changes since then"
    add_path(parser, "--before", words, "RESULTS_DIR")
    parser.add_argument(
        "--language",
        choices=tuple(NAMES),
        default="",
        help="first language of the page (default: the lab's)",
    )
    add_lab(parser, "default: the rubric of most results")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Write page and table; returns the exit status."""
    options = make_parser().parse_args(arguments)
    from grader.cohort.entries import compared_with, entries_in
    from grader.judging import rubrics

    entries = _require_results(entries_in(options.results), options.results)
    if options.before is not None:
        entries = compared_with(
            entries, _require_results(entries_in(options.before), options.before)
        )
    rubric = rubrics.rubric_of_class(options.results, entries, options.rubric)
    remedy = "Move the results of each lab into a folder of its own."
    for entry in entries:
        rubrics.require_lab(options.results / entry.name, rubric, remedy)
    report_class(
        options.results,
        entries,
        rubric,
        console,
        options.class_list,
        anonymous=options.anonymous,
        counted=True,
        language=options.language,
    )
    return 0


def _require_results(entries: Sequence[ClassEntry], results: Path) -> Sequence[ClassEntry]:
    from grader.errors import SubmissionError

    if not entries:
        remedy = "Name the folder with a folder of results for each submission, e.g. results/."
        if (results / RECORDINGS).is_dir():
            remedy = f"These are the results of one submission; its page is {REPORT_FILE}. {remedy}"
        problem = "there is no such folder"
        if results.is_dir():
            problem = "there are no results of submissions in it"
        raise SubmissionError(problem, location=str(results), remedy=remedy)
    return entries


def report_class(
    results: Path,
    entries: Sequence[ClassEntry],
    rubric: Rubric,
    console: Console,
    class_list: Path | None,
    *,
    anonymous: bool = False,
    counted: bool = False,
    language: str = "",
) -> ClassSummary:
    """Write the page and the table of grades of a class; returns the summary.

    Anonymous ones get pseudonyms and file names of their own.
    """
    from grader.classroom.similarity import read_similarity
    from grader.cohort.anonymous import anonymous as under_pseudonyms
    from grader.cohort.entries import in_zone, with_roster
    from grader.cohort.statistics import summarise
    from grader.judging.languages import languages_of
    from grader.report import class_page, grades_csv
    from grader.submission.roster import read_class_list

    listed = class_list_of(results, entries, class_list)
    if listed is not None:
        entries = with_roster(entries, read_class_list(listed))
    entries = in_zone(entries, rubric.policy)
    if anonymous:
        entries = under_pseudonyms(entries, rubric)
    summary = summarise(entries, rubric)
    page = results / (ANONYMOUS_PAGE if anonymous else CLASS_PAGE)
    grades = results / (ANONYMOUS_GRADES_FILE if anonymous else GRADES_FILE)
    similarity = None if anonymous else read_similarity(results)
    if not language:
        language = rubric.lab.language
    languages = languages_of(rubric, language)
    text = class_page.render(summary, similarity, anonymous=anonymous, languages=languages)
    replace_file(page, text)
    replace_file(grades, grades_csv.render(summary))
    if counted:
        console.print(f"{_counts(summary)}.")
    console.print(f"Class: {page}\nGrades: {grades}", soft_wrap=True, markup=False)
    return summary


def _counts(summary: ClassSummary) -> str:
    """Count a class, e.g. `3 submissions, 2 graded, median 81 of 100; 1 needs attention`."""
    from grader.report.views import tenths

    count = len(summary.rows)
    graded = sum(row.result is not None for row in summary.rows)
    need_attention = len({todo.row for todo in summary.todos})
    words = f"{count} submission{'s' * (count != 1)}, {graded} graded"
    spread = summary.spread
    if spread:
        words += f", median {tenths(spread.median)} of {tenths(spread.possible)}"
    return f"{words}; {need_attention} need{'s' * (need_attention == 1)} attention"


def class_list_of(results: Path, entries: Sequence[ClassEntry], given: Path | None) -> Path | None:
    """Return the given class list and keep a copy, or return the kept one; None if there is neither.

    A kept list within a submission may be a student's and does not count.
    """
    from grader.submission.separation import lies_within, made_from

    kept = results / CLASS_LIST_FILE
    if given is not None:
        if given.resolve() != kept.resolve():
            replace_file(kept, given.read_bytes())
        return given
    sources = [made_from(results / entry.name) for entry in entries]
    if kept.is_file() and not lies_within(results, sources):
        return kept
    return None

"""`grade similarity RESULTS_DIR`: find code in common in the submissions of a class."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from grader.commands.arguments import add_lab, parser_of, print_note

if TYPE_CHECKING:
    from grader.cohort.similarity import Similarity

_DESCRIPTION = """\
Compare the Python files of a class's submissions, and all files byte for byte; needs neither ROS nor a network.

Names, texts, numbers, comments, order of definitions and layout make no difference. Code of the handout and the solution
(lab.handout and lab.solution of the rubric), and code that more than a tenth of the class has, do not count. The
findings are facts without a verdict, and no points depend on them. They are printed and kept in similarity.json, and
`grade report` shows them on the class page, with the lines side by side.
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade similarity", _DESCRIPTION)
    parser.add_argument(
        "results", type=Path, metavar="RESULTS_DIR", help="results of a class, e.g. results/"
    )
    words = "folder with more code given to all students; may be repeated"
    parser.add_argument(
        "--common", type=Path, action="append", default=[], metavar="FOLDER", help=words
    )
    add_lab(parser, "default: the rubric of most results")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Compare a class and write the findings; returns the exit status."""
    options = make_parser().parse_args(arguments)
    from grader.classroom.regrade import recorded_in
    from grader.classroom.similarity import common_folders, compare, write_similarity
    from grader.cohort.entries import entries_in
    from grader.errors import SubmissionError
    from grader.judging.rubrics import rubric_of_class

    folders = recorded_in(options.results)
    if len(folders) < 2:
        remedy = "Name the folder with a folder of results for each submission, e.g. results/."
        raise SubmissionError(
            "there are fewer than two submissions in it",
            location=str(options.results),
            remedy=remedy,
        )
    rubric = rubric_of_class(options.results, entries_in(options.results), options.rubric)
    common = common_folders(folders, rubric, options.common)
    if not common:
        print_note(
            console,
            "Note: neither the lab's handout nor its solution is here, so code given to all counts as the students' own. "
            "Name the folders with --common.",
        )
    found = compare(folders, common)
    file = write_similarity(options.results, found)
    _print(console, found)
    console.print(
        f"Kept: {file}\nTo see the lines: grade report {options.results}",
        soft_wrap=True,
        markup=False,
    )
    return 0


def _print(console: Console, found: Similarity) -> None:
    from grader.report.escape import terminal_text

    def shown(text: str) -> str:
        return terminal_text(text, 60)

    for name, problem in found.problems.items():
        print_note(console, f"{name}: {problem}")
    if found.pairs:
        table = Table(
            "Share code",
            "",
            "of the own code",
            "lines",
            box=None,
            padding=(0, 1),
            header_style="bold",
        )
        for pair in found.pairs:
            shares = " and ".join(f"{share:.0%}" for share in pair.shares)
            table.add_row(*map(shown, pair.names), shares, str(max(pair.lines)))
        console.print(table, "", sep="\n")
    for names in found.clusters:
        console.print(f"Connected: {', '.join(map(shown, names))}", soft_wrap=True, markup=False)
    for copies in found.copies:
        where = ", ".join(f"{shown(name)}: {shown(path)}" for name, path in copies.found)
        console.print(f"The same file: {where}", soft_wrap=True, markup=False)
    pairs, same = len(found.pairs), len(found.copies)
    console.print(
        f"Of {len(found.compared)} submissions, {pairs} pair{' shares' if pairs == 1 else 's share'} code of their own, "
        f"and {same} file{' was' if same == 1 else 's were'} handed in by several.",
        soft_wrap=True,
    )

"""`grade lab`: make a lab, examine it before anything runs, and grade its solution and fixtures."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from grader.commands.arguments import add_flag, parser_of, print_note
from grader.errors import UsageError
from grader.json_text import json_text
from grader.report.escape import terminal_text

_DESCRIPTION = """\
Make a lab of your own, and see whether it works.

A lab is a folder with a rubric.yaml and all that this names. `grade --lab DIR submissions/` grades by it.
"""
_EPILOG = """\
exit status:
  0 all in order    1 something is not as expected, or undecided
  2 wrong usage     4 there are mistakes, listed with file and line
"""
_COMMANDS = {
    "new": "make the smallest lab that works, to be changed into one's own",
    "check": "find every mistake that can be known before a run, and checks that nobody can fail",
    "try": "grade its solution and fixtures, and compare with what must come of them",
}
#: Beside the rubric: where `grade lab try` keeps what it graded.
TRIED = "tried"
_TEMPLATE = Path(__file__).parents[1] / "lab/template"
_STYLES = {"✓": "green", "!": "yellow"}


def _parser() -> argparse.ArgumentParser:
    parser = parser_of("grade lab", _DESCRIPTION, _EPILOG)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    new, check, trying = (
        commands.add_parser(name, help=words, description=f"{words[:1].upper()}{words[1:]}.")
        for name, words in _COMMANDS.items()
    )
    new.add_argument("folder", type=Path, metavar="DIR", help="folder to make, e.g. labs/09-03")
    for command in (check, trying):
        command.add_argument(
            "folder",
            nargs="?",
            type=Path,
            default=Path(),
            metavar="DIR",
            help="default: this folder",
        )
    trying.add_argument(
        "names", nargs="*", metavar="NAME", help="only these: solution, or names of fixtures"
    )
    add_flag(trying, "--quick", "only a few")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Make, examine or try a lab; returns the exit status."""
    options = _parser().parse_args(arguments)
    if options.command == "new":
        return _new(options.folder, console)
    rubric = options.folder / "rubric.yaml"
    if not rubric.is_file():
        remedy = "Name a lab's folder; `grade lab new DIR` makes one."
        raise UsageError(
            "there is no rubric.yaml in it", location=str(options.folder), remedy=remedy
        )
    return _check(rubric, console) if options.command == "check" else _try(options, console)


def _new(folder: Path, console: Console) -> int:
    from grader.judging.rubrics import rubric_kinds
    from grader.lab.rubric import json_schema

    if folder.exists() and any(folder.iterdir() if folder.is_dir() else [folder]):
        raise UsageError(
            "it is there already, and not empty",
            location=str(folder),
            remedy="Give another folder.",
        )
    shutil.copytree(
        _TEMPLATE, folder, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True
    )
    rubric, name = folder / "rubric.yaml", json.dumps(folder.resolve().name)
    text = rubric.read_text(encoding="utf-8").replace('"template"', name, 1)
    rubric.write_text(text, encoding="utf-8")
    (folder / "rubric.schema.json").write_text(
        json_text(json_schema(rubric_kinds())), encoding="utf-8"
    )
    console.print(
        f"A lab with one node, two checks, a solution and a fixture: {folder}",
        markup=False,
        soft_wrap=True,
    )
    for command, words in (
        (f"grade lab check {folder}", "finds mistakes, at once"),
        (f"grade lab try {folder}", "grades its solution and its fixture"),
        (f"grade --lab {folder} submissions/", "grades submissions"),
    ):
        console.print(Text(f"  {command}   {words}"), soft_wrap=True)
    console.print(
        f"{folder / 'README.md'} says what is where, and what to change first.",
        markup=False,
        soft_wrap=True,
    )
    return 0


def _check(rubric_file: Path, console: Console) -> int:
    from grader.classroom.lab_examination import examine
    from grader.judging.rubrics import read_rubric

    rubric = read_rubric(rubric_file)
    for remark in examine(rubric, rubric_file, rubric_file.parent / TRIED / "solution"):
        line = Text(f"{remark.sign} ", _STYLES[remark.sign]).append(
            terminal_text(remark.text), "default"
        )
        console.print(line, soft_wrap=True)
    return 0


def _try(options: argparse.Namespace, console: Console) -> int:
    from grader.commands import selftest

    tried = options.folder / TRIED
    quick = ["--quick"] if options.quick else []
    status = selftest.run(
        ["--lab", str(options.folder), "-o", str(tried), *quick, *options.names], console
    )
    print_note(console, f"Reports of all: {tried}/*/report.html", "")
    return status

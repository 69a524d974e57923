"""`grade lab`: list and copy shipped labs; make a lab, check it without a run, try its solution and fixtures."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from grader.commands.arguments import add_flag, as_sentence, parser_of, print_note, require_unused
from grader.errors import UsageError
from grader.json_text import json_text
from grader.report.escape import terminal_text

_DESCRIPTION = """\
Make a lab of your own, check it, and try it.

A lab is a folder with a rubric.yaml and the files that it names. `grade --lab DIR submissions/` grades by it.
"""
_EPILOG = """\
exit status:
  0 all in order    1 a fixture is undecided or differs from its verdict
  2 wrong usage     4 mistakes, listed with file and line
"""
_COMMANDS = {
    "new": "make the smallest working lab, as a start for your own",
    "check": "find mistakes without a run, including checks that nobody can fail",
    "try": "grade its solution and fixtures, and compare with their verdicts",
    "list": "list the labs that are shipped with grade",
    "copy": "copy a shipped lab with its solution, as a start for your own",
}
#: Folder beside the rubric for the results of `grade lab try`.
TRIED = "tried"
_TEMPLATE = Path(__file__).parents[1] / "lab/template"
_STYLES = {"✓": "green", "!": "yellow"}
#: Kinds of remarks in JSON.
_KINDS = {"✓": "in order", "!": "warning"}


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade lab", _DESCRIPTION, _EPILOG)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    parsers = []
    for name, words in _COMMANDS.items():
        description = as_sentence(words)
        parsers.append(commands.add_parser(name, help=words, description=description))
    new, check, trying, listing, copying = parsers
    add_flag(listing, "--json", "print JSON")
    copying.add_argument("name", metavar="NAME", help="name of a shipped lab")
    copying.add_argument("folder", type=Path, metavar="DIR", help="new folder")
    new.add_argument("folder", type=Path, metavar="DIR", help="new folder, e.g. labs/09-03")
    for command in (check, trying):
        command.add_argument(
            "folder",
            nargs="?",
            type=Path,
            default=Path(),
            metavar="DIR",
            help="folder of the lab (default: this folder)",
        )
    trying.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="fixtures to grade; solution means the lab's solution (default: all)",
    )
    add_flag(check, "--json", "print JSON; mistakes too")
    add_flag(trying, "--quick", "grade only a few")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Make, check or try a lab; returns the exit status."""
    options = make_parser().parse_args(arguments)
    if options.command == "new":
        return _new(options.folder, console)
    if options.command == "list":
        return _list(options, console)
    if options.command == "copy":
        return _copy(options.name, options.folder, console)
    rubric = options.folder / "rubric.yaml"
    if not rubric.is_file():
        remedy = "Name a lab's folder; `grade lab new DIR` makes one."
        raise UsageError(
            "there is no rubric.yaml in it", location=str(options.folder), remedy=remedy
        )
    if options.command == "check":
        if options.json:
            return _check_for_programs(rubric)
        return _check(rubric, console)
    return _try(options, console)


def _new(folder: Path, console: Console) -> int:
    from grader.judging.rubrics import rubric_kinds
    from grader.lab.rubric import json_schema

    require_unused(folder)
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
    _print_next(folder, console)
    console.print(
        f"{folder / 'README.md'} explains the files, and the first changes.",
        markup=False,
        soft_wrap=True,
    )
    return 0


def _print_next(folder: Path, console: Console) -> None:
    """Print the next commands for a new lab."""
    for command, words in (
        (f"grade lab check {folder}", "finds mistakes without a run"),
        (f"grade lab try {folder}", "grades its solution and its fixtures"),
        (f"grade --lab {folder} submissions/", "grades submissions"),
    ):
        console.print(Text(f"  {command}   {words}"), soft_wrap=True)


def _list(options: argparse.Namespace, console: Console) -> int:
    from grader.judging.rubrics import read_rubric
    from grader.lab.kept_lab import RUBRIC_FILE
    from grader.lab.shipped_labs import shipped_labs

    labs = []
    for name, folder in shipped_labs().items():
        lab = read_rubric(folder / RUBRIC_FILE).lab
        labs.append({"name": name, "title": lab.title, "points": str(lab.points)})
    if options.json:
        print(json.dumps(labs, indent=1))
        return 0
    width = max(len(each["name"]) for each in labs)
    for each in labs:
        line = Text(f"{each['name']:<{width}}", "bold")
        line.append(f"  {each['title']}, {each['points']} points", "not bold")
        console.print(line, soft_wrap=True)
    words = "\nThe first is the default. `grade --lab NAME PATH` grades by another; `grade lab copy NAME DIR` copies it."
    console.print(Text(words, "dim"), soft_wrap=True)
    return 0


def _copy(name: str, folder: Path, console: Console) -> int:
    from grader.lab.shipped_labs import copy_lab, shipped_labs
    from grader.lab.similar_words import meant

    labs = list(shipped_labs())
    if name not in labs:
        raise UsageError(
            f"there is no shipped lab {name!r}{meant(name, labs)}",
            remedy="`grade lab list` lists them.",
        )
    require_unused(folder)
    copy_lab(name, folder)
    console.print(f"A copy of Lab {name}: {folder}", markup=False, soft_wrap=True)
    _print_next(folder, console)
    return 0


def _check(rubric_file: Path, console: Console) -> int:
    from grader.classroom.lab_examination import examine
    from grader.judging.rubrics import read_rubric

    rubric = read_rubric(rubric_file)
    for remark in examine(rubric, rubric_file, rubric_file.parent / TRIED / "solution"):
        line = Text(f"{remark.sign} ", _STYLES[remark.sign])
        line.append(terminal_text(remark.text), "default")
        console.print(line, soft_wrap=True)
    return 0


def _check_for_programs(rubric_file: Path) -> int:
    """Print remarks and mistakes as JSON; returns the exit status."""
    from grader.classroom.lab_examination import examine
    from grader.errors import RubricError
    from grader.judging.rubrics import read_rubric

    remarks: list[dict[str, str]] = []
    mistakes: list[str] = []
    status = 0
    try:
        rubric = read_rubric(rubric_file)
        for remark in examine(rubric, rubric_file, rubric_file.parent / TRIED / "solution"):
            remarks.append({"kind": _KINDS[remark.sign], "text": remark.text})
    except RubricError as error:
        mistakes = [error.problem, *error.mistakes]
        status = error.exit_status
    print(json.dumps({"remarks": remarks, "mistakes": mistakes}, indent=1))
    return status


def _try(options: argparse.Namespace, console: Console) -> int:
    from grader.commands import selftest

    tried = options.folder / TRIED
    arguments = ["--lab", str(options.folder), "-o", str(tried)]
    if options.quick:
        arguments.append("--quick")
    status = selftest.run([*arguments, *options.names], console)
    print_note(console, f"Reports of all: {tried}/*/report.html", "")
    return status

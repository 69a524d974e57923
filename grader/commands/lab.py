"""`grade lab`: make a lab, check it without a run, and try its solution and fixtures."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from grader.commands.arguments import add_flag, as_sentence, parser_of, print_note
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
}
#: Folder beside the rubric for the results of `grade lab try`.
TRIED = "tried"
_TEMPLATE = Path(__file__).parents[1] / "lab/template"
_STYLES = {"✓": "green", "!": "yellow"}


def _parser() -> argparse.ArgumentParser:
    parser = parser_of("grade lab", _DESCRIPTION, _EPILOG)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    parsers = []
    for name, words in _COMMANDS.items():
        description = as_sentence(words)
        parsers.append(commands.add_parser(name, help=words, description=description))
    new, check, trying = parsers
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
    add_flag(trying, "--quick", "grade only a few")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Make, check or try a lab; returns the exit status."""
    options = _parser().parse_args(arguments)
    if options.command == "new":
        return _new(options.folder, console)
    rubric = options.folder / "rubric.yaml"
    if not rubric.is_file():
        remedy = "Name a lab's folder; `grade lab new DIR` makes one."
        raise UsageError(
            "there is no rubric.yaml in it", location=str(options.folder), remedy=remedy
        )
    if options.command == "check":
        return _check(rubric, console)
    return _try(options, console)


def _new(folder: Path, console: Console) -> int:
    from grader.judging.rubrics import rubric_kinds
    from grader.lab.rubric import json_schema

    is_used = folder.exists()
    if folder.is_dir():
        is_used = any(folder.iterdir())
    if is_used:
        raise UsageError(
            "this folder exists and is not empty",
            location=str(folder),
            remedy="Name another folder.",
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
        (f"grade lab check {folder}", "finds mistakes without a run"),
        (f"grade lab try {folder}", "grades its solution and its fixture"),
        (f"grade --lab {folder} submissions/", "grades submissions"),
    ):
        console.print(Text(f"  {command}   {words}"), soft_wrap=True)
    console.print(
        f"{folder / 'README.md'} explains the files, and the first changes.",
        markup=False,
        soft_wrap=True,
    )
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


def _try(options: argparse.Namespace, console: Console) -> int:
    from grader.commands import selftest

    tried = options.folder / TRIED
    arguments = ["--lab", str(options.folder), "-o", str(tried)]
    if options.quick:
        arguments.append("--quick")
    status = selftest.run([*arguments, *options.names], console)
    print_note(console, f"Reports of all: {tried}/*/report.html", "")
    return status

"""`grade try`: write a sample submission, and grade it."""

from __future__ import annotations

import argparse
import importlib
import shutil
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from confine.priority import going_first
from grader.commands.arguments import as_sentence, parser_of, print_note, require_unused
from grader.lab.kept_lab import RUBRIC_FILE, lab_folder
from grader.lab.shipped_labs import require_extras, sample_submission

_WORDS = "write a sample submission into this folder, and grade it"
#: Folder of the results, which `grade` uses by default.
_RESULTS = "results"


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade try", as_sentence(_WORDS))
    parser.add_argument(
        "folder",
        nargs="?",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="empty or new folder for the submission and its results (default: this folder)",
    )
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Write the sample and grade it; returns the exit status."""
    folder: Path = make_parser().parse_args(arguments).folder
    require_unused(folder)
    # A memory limit can prevent the imports below.
    importlib.import_module("grader.live.sandbox.enough").require_limits()
    rubrics = importlib.import_module("grader.judging.rubrics")
    # A missing extra is named before anything is written; then the same command works once it is installed.
    require_extras(rubrics.read_rubric(lab_folder() / RUBRIC_FILE))
    source = sample_submission()
    sample = folder / source.name
    shutil.copytree(source, sample, ignore=shutil.ignore_patterns("__pycache__"))
    print_note(console, f"A sample submission with some faults: {sample}", "")
    grade = importlib.import_module("grader.commands.grade")
    with going_first():
        status = int(grade.run([str(sample), "-o", str(folder / _RESULTS)], console))
    if status == 0:
        results = folder / _RESULTS / source.name
        print_note(
            console,
            f"Next: grade open {results}; fix a fault in {sample}, then: grade {sample}",
            "",
        )
    return status

"""The options for exports, of `grade` and of `grade export`; a module alone, because parsing them needs no results."""

from __future__ import annotations

import argparse
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from grader.report.exports import EXPORTS, Forms
from grader.report.exports.writing import FORMS, ExportTarget

if TYPE_CHECKING:
    from argparse import _ActionsContainer


def add_exports(
    parser: _ActionsContainer,
    option: str,
    forms: Forms = EXPORTS,
) -> None:
    """Add the option that chooses exports, and `--path-prefix`."""
    parser.add_argument(
        option,
        type=partial(_target, forms=forms),
        action="append",
        default=[],
        dest="exports",
        metavar="NAME[=FILE]",
        help=f"form of another system: {', '.join(forms)} (FILE: by default a file in the results folder; repeat the "
        "option for several forms)",
    )
    parser.add_argument(
        "--path-prefix",
        type=_below_here,
        default="",
        metavar="DIR",
        help="folder of the submission in its repository, for forms with lines of files (an absolute path must lie in "
        "the working folder)",
    )


def _below_here(text: str) -> str:
    """Return a path relative to the working folder, which is the repository in a CI job."""
    if Path(text).is_absolute():
        return os.path.relpath(text)
    return text


def _target(text: str, forms: Forms = FORMS) -> ExportTarget:
    try:
        return ExportTarget.parse(text, forms)
    except ValueError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None

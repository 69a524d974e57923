"""What else than submissions a path of `grade PATH...` may be meant to be: a command, or results."""

from __future__ import annotations

import difflib
import os
from collections.abc import Sequence
from pathlib import Path

from grader.commands import COMMANDS
from grader.errors import UsageError
from grader.lab.rubric import Rubric
from grader.recording.submission import SUBMISSION_FILE
from grader.result_folder import HISTORY, RECORDINGS
from grader.submission.file_names import is_packed


def require_submissions(paths: Sequence[Path], rubric: Rubric) -> None:
    """Raise UsageError if a path is no submission, but a word like a command, or a folder of results."""
    for path in paths:
        near = difflib.get_close_matches(str(path), COMMANDS, n=1, cutoff=0.75)
        if near and not path.exists():
            remedy = f"If you mean the command, write it first: grade {near[0]} ..."
            raise UsageError(f"there is neither a submission nor a command {str(path)!r}", remedy=remedy)
        if is_results(path, rubric):
            remedy = f"`grade regrade {path}` judges them again, without ROS."
            if not _is_recorded(path):
                remedy += f" `grade report {path}` writes the class page again."
            raise UsageError("these are results, not submissions", location=str(path), remedy=remedy)


def is_results(path: Path, rubric: Rubric) -> bool:
    """Whether a folder holds results of a submission, or of a class, and nothing that a student hands in."""
    if not path.is_dir():
        return False
    inner = [entry for entry in path.iterdir() if not entry.name.startswith(".") and entry.name != HISTORY]
    folders = [path] if _is_recorded(path) else [entry for entry in inner if entry.is_dir()]
    if not folders or not all(map(_is_recorded, folders)) or any(is_packed(entry.name) for entry in inner):
        return False
    wanted = {artifact.file for artifact in rubric.artifacts.values()}
    return not any(wanted.intersection(files) for folder in folders for _, _, files in os.walk(folder))


def _is_recorded(folder: Path) -> bool:
    return (folder / RECORDINGS / SUBMISSION_FILE).is_file()

"""Separation of an instructor's decisions and results from a student's submission.

In a student's repository, results are within the submission, and any file there can be part of the submission. No such
file counts as an instructor's decision, and nothing is written through its links. Because a submission chooses its own
name, results record the path of their submission, and results of another path do not replace them unnoticed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from grader.errors import UsageError
from grader.recording.submission import SUBMISSION_FILE, Identity, SubmissionRecord, read_submission
from grader.result_folder import OVERRIDES_FILE, RECORDINGS
from grader.submission.beneath import is_regular_beneath

if TYPE_CHECKING:
    from grader.submission.extraction import SubmissionSource


def lies_within(folder: Path, sources: Iterable[str]) -> bool:
    """Return whether a folder is in one of the submissions, or behind a link in one."""
    known = list(filter(None, sources))
    return any(_is_below(place, known) for place in _way_to(folder))


def _is_below(place: Path, folders: Iterable[str]) -> bool:
    return any(place.is_relative_to(folder) for folder in folders)


def _way_to(folder: Path) -> Iterator[Path]:
    """Yield a folder and the folders above it, each without links before its own name."""
    whole = Path(os.path.abspath(folder))  # noqa: PTH100 - `resolve` follows links
    for path in (whole, *whole.parents):
        yield Path(os.path.realpath(path.parent)) / path.name


def require_no_links(results: Path, sources: Iterable[str], *, inside: bool = True) -> None:
    """Raise UsageError if a submission has a link on the way to its results, or anywhere `inside` of them."""
    known = list(filter(None, sources))
    if not lies_within(results, known):
        return
    paths = [place for place in _way_to(results) if _is_below(place, known)]
    if inside:
        paths += _paths_below(results)
    for path in paths:
        if path.is_symlink():
            raise UsageError(
                "the submission holds a link where its results are to be written",
                location=str(path),
                remedy="Write results to another folder with -o, or remove the link.",
            )


def _paths_below(folder: Path) -> Iterator[Path]:
    """Yield the folders and files in a folder, at any depth."""
    for above, folders, files in os.walk(folder):
        for name in (*folders, *files):
            yield Path(above, name)


def uncounted_overrides(results: Path, sources: Iterable[str]) -> str | None:
    """Name a file of overrides that does not count, because it can be part of the submission; None if there is none."""
    path = results / OVERRIDES_FILE
    if not os.path.lexists(path) or not lies_within(results, sources):
        return None
    return f"{path} lies in the submission itself and does not count; --overrides {path} would apply it."


def made_from(folder: Path) -> str:
    """Return the path of the submission that results were made from; empty if it is unknown."""
    record = _record_of(folder)
    return record.source if record is not None else ""


def _record_of(folder: Path) -> SubmissionRecord | None:
    # In a submission, this file too can be anything.
    if not is_regular_beneath(folder, f"{RECORDINGS}/{SUBMISSION_FILE}"):
        return None
    try:
        return read_submission(folder / RECORDINGS)
    except (OSError, ValueError, RecursionError):
        return None


def with_earlier(source: SubmissionSource, results: Path) -> SubmissionSource:
    """Return a submission with the identity in its earlier results, if they were made from its path."""
    record = _record_of(results / source.name)
    if record is None or record.source != source.origin:
        return source
    if lies_within(results, [source.origin]):
        return source
    identity = Identity(record.identity.people).completed(source.identity)
    known = next((person.student_id for person in identity.people[:1]), "")
    return replace(source, identity=identity, student_id=known or source.student_id)


def require_same_source(folder: Path, source: str) -> None:
    """Raise UsageError if a submission's results were made from another path."""
    before = made_from(folder)
    if before and source and before != source:
        raise UsageError(
            f"there are results of {folder.name} that were made from {before}, and this is another submission",
            location=source,
            remedy="If they are of the same student, --replace replaces them; if this is a part of one submission, "
            "--one grades that under its own name; else write results to another folder with -o.",
        )

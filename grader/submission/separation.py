"""Keeps what a grader decides and writes apart from what a student handed in.

In a student's repository, results lie within the submission. What lies there may have come with it: nothing in it is
taken for anybody's decision, and no link in it is written through. And since a submission says itself what it is
called, results remember the path that they were made from, and another path's do not take their place unawares.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path

from grader.errors import UsageError
from grader.lab.overrides import OVERRIDES_FILE
from grader.recording.submission import SUBMISSION_FILE, Identity, SubmissionRecord, read_submission
from grader.result_folder import RECORDINGS
from grader.submission.beneath import is_regular_beneath
from grader.submission.extraction import SubmissionSource


def lies_within(folder: Path, sources: Iterable[str]) -> bool:
    """Whether a folder lies in one of the submissions; so does one that a link in a submission leads to."""
    known = [source for source in sources if source]
    return any(place.is_relative_to(source) for place in _way_to(folder) for source in known)


def _way_to(folder: Path) -> Iterator[Path]:
    """Yield a folder and those above it as they lie, each without links before its own name."""
    whole = Path(os.path.abspath(folder))  # noqa: PTH100 - `resolve` follows links
    for path in (whole, *whole.parents):
        yield Path(os.path.realpath(path.parent)) / path.name


def require_no_links(results: Path, sources: Iterable[str], *, inside: bool = True) -> None:
    """Raise UsageError if a submission brought a link along where results go, or anywhere `inside` of that."""
    known = [source for source in sources if source]
    if not lies_within(results, known):
        return
    way = [
        place for place in _way_to(results) if any(place.is_relative_to(source) for source in known)
    ]
    below = (
        Path(above, name)
        for above, folders, files in os.walk(results)
        for name in (*folders, *files)
    )
    link = next(
        (str(path) for path in (chain(way, below) if inside else way) if path.is_symlink()), None
    )
    if link is not None:
        raise UsageError(
            "the submission holds a link where its results are to be written",
            location=link,
            remedy="Write results to another folder with -o, or remove the link.",
        )


def uncounted_overrides(results: Path, sources: Iterable[str]) -> str | None:
    """Say which file of overrides is there and does not count, since it may have come with the submission."""
    path = results / OVERRIDES_FILE
    if not os.path.lexists(path) or not lies_within(results, sources):
        return None
    return f"{path} lies in the submission itself and does not count; --overrides {path} would apply it."


def made_from(folder: Path) -> str:
    """Return the path that a submission's results were made from; empty where that is not known."""
    record = _record_of(folder)
    return record.source if record is not None else ""


def _record_of(folder: Path) -> SubmissionRecord | None:
    # Where results lie in a submission, this too may be anything.
    if not is_regular_beneath(folder, f"{RECORDINGS}/{SUBMISSION_FILE}"):
        return None
    try:
        return read_submission(folder / RECORDINGS)
    except (OSError, ValueError, RecursionError):
        return None


def with_earlier(source: SubmissionSource, results: Path) -> SubmissionSource:
    """Return a submission with what its earlier results know of who handed it in, if they were made from its path."""
    record = _record_of(results / source.name)
    if record is None or record.source != source.origin or lies_within(results, [source.origin]):
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

"""Finds the rubric that counts: the user's, the one of the shipped lab, or the copy beside results."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from grader.errors import RecordingError, RubricError, UsageError
from grader.judging.validated import validated
from grader.lab import kept_lab
from grader.lab.kept_lab import has_text, is_shipped, lab_folder, lab_id
from grader.lab.overrides import Overrides, load_overrides
from grader.lab.references import Kinds
from grader.lab.rubric import Rubric
from grader.result_folder import OVERRIDES_FILE, RECORDINGS, RUBRIC_COPY
from grader.submission.separation import lies_within

if TYPE_CHECKING:
    from grader.cohort.entries import ClassEntry


def read_rubric(path: Path | None, kept: Path | None = None) -> Rubric:
    """Load a rubric that the user names, by default the one of the shipped lab.

    A copy elsewhere finds its files beside `kept`, the copy of a rubric among results, or in the shipped lab, if both
    are of the same lab. Raises RubricError with all its mistakes.
    """
    path = path or lab_folder() / "rubric.yaml"
    if (path.parent / kept_lab.KEPT).is_dir():
        return recorded_rubric(path)
    folders = [path.resolve().parent]
    if kept is not None and _keeps_files(kept, lab_id(path)):
        kept_lab.require_known(kept)
        folders.append(kept.parent / kept_lab.KEPT)
    elif is_shipped(path):
        folders.append(lab_folder())
    rubric = validated(path, rubric_kinds, *folders)
    kept_lab.trust(kept_lab.files_of(rubric))
    return rubric


def _keeps_files(copy: Path, lab: str) -> bool:
    """Tell whether files of a lab lie beside the copy of its rubric."""
    return lab_id(copy) == lab and bool(kept_lab.kept_files(copy))


def recorded_rubric(copy: Path, *, trusted: bool = False) -> Rubric:
    """Load the copy of a rubric beside results, with its files from the same place.

    Raises
    ------
    RubricError
        The copy has mistakes; the error lists all.
    RecordingError
        The files may not be executed: they are neither known here nor `trusted` (see `grader.lab.kept_lab`), or an
        earlier version of the grader did not keep them.
    """
    files = kept_lab.kept_files(copy)
    if trusted:
        kept_lab.trust(files)
    elif files:
        kept_lab.require_known(copy)
    # Earlier versions kept no files and used those of the shipped lab; these would be wrong for another lab.
    folder = copy.parent / kept_lab.KEPT
    remedy = "`--rubric rubric.yaml` judges by the present rubric."
    if not files and is_shipped(copy):
        folder = lab_folder()
    elif not files:
        remedy = "The recordings are without the files of their lab; give its rubric by --rubric."
    try:
        return validated(copy, rubric_kinds, folder)
    except RubricError as error:
        error.remedy = remedy
        raise


def rubric_kinds() -> Kinds:
    """Return the checks and figures that a rubric can use."""
    from grader.checks.registry import REGISTRY, former_checks
    from grader.report.figures.kinds import FIGURES

    checks = {name: check.parameters for name, check in REGISTRY.items()}
    return Kinds(checks, FIGURES, former_checks)


def read_overrides(
    path: Path | None, results: Path, rubric: Rubric, sources: Iterable[str] = ()
) -> Overrides:
    """Load the given file of overrides, or else the one beside the results.

    Without either there are no overrides. If the results lie in one of the `sources` of the submissions, the file
    beside the results may be a student's and does not count. Raises RubricError with all its mistakes.
    """
    if path is not None:
        return load_overrides(path, rubric)
    beside = results / OVERRIDES_FILE
    if lies_within(results, sources):
        return Overrides()
    if beside.is_file():
        return load_overrides(beside, rubric)
    misnamed = beside.with_suffix(".yml")
    if misnamed.is_file():
        problem = f"the file of overrides is called {OVERRIDES_FILE}; under this name it would have no effect"
        remedy = f"Rename it, or give it with --overrides {misnamed}."
        raise RubricError(problem, [], location=str(misnamed), remedy=remedy)
    return Overrides()


def chosen_rubric(folders: Sequence[Path], path: Path) -> Rubric:
    """Load a rubric that the user names for results; see `read_rubric`."""
    for folder in folders:
        for copy in _rubric_copies(folder):
            return read_rubric(path, copy)
    return read_rubric(path)


def require_lab(
    results: Path, rubric: Rubric, remedy: str = "Name a rubric of that lab, or none."
) -> None:
    """Raise UsageError if results are of another lab than a rubric."""
    recorded = ""
    for copy in _rubric_copies(results)[:1]:
        if not has_text(copy, rubric):
            recorded = lab_id(copy)
    if recorded not in ("", rubric.lab.id):
        problem = f"these are results of Lab {recorded}, and the rubric is of Lab {rubric.lab.id}"
        raise UsageError(problem, location=str(results), remedy=remedy)


def rubric_copy(results: Path) -> Path:
    """Return the rubric of the last judgement of a results folder; raises RecordingError if the folder holds none."""
    for copy in _rubric_copies(results):
        return copy
    problem = "there are no recordings to judge" if results.is_dir() else "there is no such folder"
    remedy = (
        "Give a folder of results, e.g. results/ for a class or results/alice for one submission."
    )
    raise RecordingError(problem, location=str(results), remedy=remedy)


def _rubric_copies(results: Path) -> list[Path]:
    """Return the rubric of the last judgement, if it differs from the recorded one, and then the recorded one."""
    copies = (results / RUBRIC_COPY, results / RECORDINGS / RUBRIC_COPY)
    return [copy for copy in copies if copy.is_file()]


def rubric_files_of_result(results: Path, rubric: Rubric) -> dict[Path, str | None]:
    """Return the texts of the files beside a result of its rubric, by their places; None for a file to be removed."""
    copy = results / RUBRIC_COPY
    files: dict[Path, str | None] = {}
    for name in kept_lab.kept_files(copy):
        files[results / kept_lab.KEPT / name] = None
    if _is_recorded(results, rubric):
        files[copy] = None
    else:
        files.update(rubric_files(results, rubric))
    return files


def _is_recorded(results: Path, rubric: Rubric) -> bool:
    """Tell whether a rubric and its files equal those beside the recordings."""
    recorded = results / RECORDINGS / RUBRIC_COPY
    if not recorded.is_file() or recorded.read_bytes().decode() != rubric.text:
        return False
    # Earlier versions kept no files.
    return kept_lab.kept_files(recorded) in ({}, kept_lab.files_of(rubric))


def rubric_files(folder: Path, rubric: Rubric) -> dict[Path, str | None]:
    """Return the texts of a rubric and its files, by their places, and create the folders of these places."""
    files: dict[Path, str | None] = {folder / RUBRIC_COPY: rubric.text}
    for name, text in kept_lab.files_of(rubric).items():
        place = folder / kept_lab.KEPT / name
        place.parent.mkdir(parents=True, exist_ok=True)
        files[place] = text
    return files


def rubric_of_class(results: Path, entries: Sequence[ClassEntry], path: Path | None) -> Rubric:
    """Load the rubric that the user names for a class, by default a copy of the one that judged most submissions."""
    if path is not None:
        return read_rubric(path)
    judged_by = Counter(entry.result.rubric_sha256 for entry in entries if entry.result is not None)
    copies = _copies_by_hash(results, entries)
    for sha256, _ in judged_by.most_common():
        if sha256 in copies:
            return recorded_rubric(copies[sha256])
    return read_rubric(None)


def _copies_by_hash(results: Path, entries: Iterable[ClassEntry]) -> dict[str, Path]:
    """Return the first copy of each rubric in the results of a class, by its hash."""
    copies: dict[str, Path] = {}
    for entry in entries:
        for copy in _rubric_copies(results / entry.name):
            copies.setdefault(hashlib.sha256(copy.read_bytes()).hexdigest(), copy)
    return copies

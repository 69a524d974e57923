"""Finds the rubric that counts: the user's, that of the grader's own lab, or the copy that lies with results."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from grader.checks.registry import REGISTRY, former_checks
from grader.cohort.entries import ClassEntry
from grader.errors import RecordingError, RubricError, UsageError
from grader.lab import kept_lab
from grader.lab.kept_lab import is_shipped, lab_folder, lab_id
from grader.lab.overrides import OVERRIDES_FILE, Overrides, load_overrides
from grader.lab.references import Kinds
from grader.lab.rubric import Rubric, load_rubric
from grader.report.figures import FIGURES
from grader.result_folder import RECORDINGS, RUBRIC_COPY
from grader.submission.separation import lies_within


def read_rubric(path: Path | None, kept: Path | None = None) -> Rubric:
    """Load a rubric that the user names, by default that of the lab which travels with the grader.

    A copy that lies elsewhere finds its files beside `kept`, the copy of a rubric among results, or in the grader's own
    lab, if these are of the same lab. Raises RubricError with all its mistakes.
    """
    path = path or lab_folder() / "rubric.yaml"
    if (path.parent / kept_lab.KEPT).is_dir():
        return recorded_rubric(path)
    folders = [path.resolve().parent]
    if kept is not None and lab_id(kept) == lab_id(path) and kept_lab.kept_files(kept):
        kept_lab.require_known(kept)
        folders.append(kept.parent / kept_lab.KEPT)
    elif is_shipped(path):
        folders.append(lab_folder())
    rubric = load_rubric(path, rubric_kinds(), *folders)
    kept_lab.trust(kept_lab.files_of(rubric))
    return rubric


def recorded_rubric(copy: Path, *, trusted: bool = False) -> Rubric:
    """Load the copy of a rubric that lies with results, and the files that it names from beside it.

    Raises RubricError with all its mistakes, and RecordingError if the files may not be executed: they are not known
    here, and not `trusted` (see `grader.lab.kept_lab`), or an earlier version of the grader has not kept them.
    """
    files = kept_lab.kept_files(copy)
    if trusted:
        kept_lab.trust(files)
    elif files:
        kept_lab.require_known(copy)
    # Before they were kept, those of the grader's own lab were used; for another lab they would be the wrong ones.
    shipped = not files and is_shipped(copy)
    try:
        return load_rubric(
            copy, rubric_kinds(), lab_folder() if shipped else copy.parent / kept_lab.KEPT
        )
    except RubricError as error:
        error.remedy = "`--rubric rubric.yaml` judges by today's."
        if not files and not shipped:
            error.remedy = (
                "The recordings are without the files of their lab; give its rubric by --rubric."
            )
        raise


def rubric_kinds() -> Kinds:
    """Return the checks and figures that a rubric can use."""
    checks = {name: check.parameters for name, check in REGISTRY.items()}
    return Kinds(checks, FIGURES, former_checks)


def read_overrides(
    path: Path | None, results: Path, rubric: Rubric, sources: Iterable[str] = ()
) -> Overrides:
    """Load the file of overrides that is given, or else the one beside the results, if there is one.

    If the results lie in one of the `sources`, which are where the submissions lie, the file beside them may be a
    student's, and does not count. Raises RubricError with all its mistakes.
    """
    default = results / OVERRIDES_FILE
    if path is None and (lies_within(results, sources) or not default.is_file()):
        misnamed = default.with_suffix(".yml")
        if misnamed.is_file() and not lies_within(results, sources):
            problem = f"the file of overrides is called {OVERRIDES_FILE}; under this name it would have no effect"
            remedy = f"Rename it, or give it with --overrides {misnamed}."
            raise RubricError(problem, [], location=str(misnamed), remedy=remedy)
        return Overrides()
    return load_overrides(path or default, rubric)


def chosen_rubric(folders: Sequence[Path], path: Path) -> Rubric:
    """Load a rubric that the user names for results; see `read_rubric`."""
    copies = (copy for folder in folders for copy in _rubric_copies(folder))
    return read_rubric(path, next(copies, None))


def require_lab(
    results: Path, rubric: Rubric, remedy: str = "Name a rubric of that lab, or none."
) -> None:
    """Raise UsageError if results are of another lab than a rubric."""
    recorded = next(map(lab_id, _rubric_copies(results)), "")
    if recorded not in ("", rubric.lab.id):
        problem = f"these are results of Lab {recorded}, and the rubric is of Lab {rubric.lab.id}"
        raise UsageError(problem, location=str(results), remedy=remedy)


def rubric_copy(results: Path) -> Path:
    """Return the rubric by which a results folder was judged last; raises RecordingError if it is none."""
    for copy in _rubric_copies(results):
        return copy
    problem = "there are no recordings to judge" if results.is_dir() else "there is no such folder"
    remedy = (
        "Give a folder of results, e.g. results/ for a class or results/alice for one submission."
    )
    raise RecordingError(problem, location=str(results), remedy=remedy)


def _rubric_copies(results: Path) -> list[Path]:
    """Return the rubric of a result, if it was judged by another since, and the one that it was recorded with."""
    return [
        copy
        for copy in (results / RUBRIC_COPY, results / RECORDINGS / RUBRIC_COPY)
        if copy.is_file()
    ]


def rubric_files_of_result(results: Path, rubric: Rubric) -> dict[Path, str | None]:
    """Return what is to lie beside a result of its rubric, by its place; None for what is not to."""
    recorded, files = results / RECORDINGS / RUBRIC_COPY, kept_lab.files_of(rubric)
    before = {
        results / kept_lab.KEPT / name: None for name in kept_lab.kept_files(results / RUBRIC_COPY)
    }
    same = recorded.is_file() and recorded.read_bytes().decode() == rubric.text
    # Earlier versions kept no files.
    if same and kept_lab.kept_files(recorded) in (files, {}):
        return {results / RUBRIC_COPY: None, **before}
    return {**before, **rubric_files(results, rubric)}


def rubric_files(folder: Path, rubric: Rubric) -> dict[Path, str | None]:
    """Return the texts of a rubric and of what it names, by their places, in folders that are there."""
    files = {
        folder / kept_lab.KEPT / name: text for name, text in kept_lab.files_of(rubric).items()
    }
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
    return {folder / RUBRIC_COPY: rubric.text, **files}


def rubric_of_class(results: Path, entries: Sequence[ClassEntry], path: Path | None) -> Rubric:
    """Load the rubric that the user names for a class, by default the copy of that by which most were judged."""
    if path is not None:
        return read_rubric(path)
    judged_by = Counter(entry.result.rubric_sha256 for entry in entries if entry.result is not None)
    copies = [copy for entry in entries for copy in _rubric_copies(results / entry.name)]
    hashes = {hashlib.sha256(copy.read_bytes()).hexdigest(): copy for copy in reversed(copies)}
    copy = next((hashes[sha256] for sha256, _ in judged_by.most_common() if sha256 in hashes), None)
    return recorded_rubric(copy) if copy is not None else read_rubric(None)

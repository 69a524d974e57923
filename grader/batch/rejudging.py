"""A class's recordings judged again, side by side: first what would change, then, if wanted, the new results.

No result is touched before all have been judged.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from grader import judgement, rubrics
from grader.batch.audit import Occasion, note_replaced, text_of
from grader.batch.order import problem_of
from grader.bounded import in_processes
from grader.cohort.changes import Changes, changes_between
from grader.cohort.overrides import Overrides
from grader.desk import made_from, uncounted_overrides
from grader.errors import GraderError, RecordingError, UsageError
from grader.kept_lab import kept_files
from grader.replacing import replace_files, uninterrupted
from grader.result import read_result, result_of_text
from grader.result_folder import RECORDINGS, REPORT_FILE, RESULT_FILE
from grader.rubric import Rubric

_NEW = ".new"
_FILES = (REPORT_FILE, RESULT_FILE)

#: What to judge by: a rubric, and what people decided.
Measure = tuple[Rubric, Overrides]


def is_class(folder: Path) -> bool:
    """Whether a folder holds results of submissions, and is not itself those of one."""
    return not (folder / RECORDINGS).is_dir() and bool(recorded_in(folder))


def recorded_in(results: Path) -> list[Path]:
    """Return the folders of the submissions that were recorded, in the order of their names."""
    if not results.is_dir():
        return []
    return sorted(p for p in results.iterdir() if not p.name.startswith(".") and (p / RECORDINGS).is_dir())


@dataclass(frozen=True)
class Rejudging:
    """What judging a class again comes to.

    Attributes
    ----------
    changes : mapping
        Name of the submission's folder -> what changes for it.
    failed : mapping
        Name of the submission's folder -> why it could not be judged.
    overrides : Overrides
        What was applied.
    rubrics : mapping
        Name of the submission's folder -> by which rubric it is judged.
    """

    results: Path
    changes: Mapping[str, Changes]
    failed: Mapping[str, GraderError]
    overrides: Overrides
    rubrics: Mapping[str, Rubric]

    def apply(self, occasion: Occasion) -> None:
        """Put the new results, which were prepared, in place of the old, and note it in the trail."""
        for name in self.changes:
            folder = self.results / name
            before = text_of(folder / RESULT_FILE)
            after = (folder / (RESULT_FILE + _NEW)).read_text(encoding="utf-8")
            with uninterrupted():
                replace_files(rubrics.rubric_files_of_result(folder, self.rubrics[name]))
                for file in _FILES:
                    (folder / (file + _NEW)).replace(folder / file)
                note_replaced(self.results, name, before, after, occasion)

    def remarks(self) -> list[str]:
        """Say which overrides do nothing, and where other files of the lab judge than those it was recorded with."""
        names = [changes.submission for changes in self.changes.values()]
        late = any(rubric.policy.late is not None for rubric in self.rubrics.values())
        told: dict[str, list[str]] = {}
        for name in self.changes:
            for remark in rubrics.lab_remarks(self.results / name, self.rubrics[name]):
                told.setdefault(remark, []).append(name)
        overrides = self.overrides.remarks([*names, *self.failed], times_matter=late)
        ignored = uncounted_overrides(self.results, [made_from(self.results / name) for name in self.rubrics])
        overrides += [ignored] if ignored is not None and not self.overrides.sha256 else []
        return [*overrides, *(f"{', '.join(of)}: {remark}" for remark, of in told.items())]


def rejudge(
    results: Path,
    rubric: Path | None,
    overrides: Path | None,
    *,
    prepare: bool,
    trusted: bool = False,
    jobs: int | None = None,
    on_judged: Callable[[str], None] = lambda name: None,
) -> Rejudging:
    """Judge all recordings of a class again.

    Parameters
    ----------
    rubric : Path or None
        By default, each is judged by the rubric by which it was judged last.
    overrides : Path or None
        By default `overrides.yaml` in the folder, if there is one.
    prepare : bool
        Whether to write the new results beside the old, for `Rejudging.apply`.
    trusted : bool
        Whether files of the lab that came with the recordings may be executed though they are not known here.
    jobs : int, optional
        Processes side by side; as many as there are cores by default.

    Raises
    ------
    RubricError
        If the rubric given, or the overrides, cannot be used.
    RecordingError
        If there is nothing to judge.
    """
    folders = recorded_in(results)
    if not folders:
        raise RecordingError(
            "there are no recordings to judge",
            where=str(results),
            remedy="Give a folder of results, e.g. results/ for a class or results/alice for one submission.",
        )
    measures, chosen, failed = _measures(results, folders, rubric, overrides, trusted=trusted)
    changes: dict[str, Changes] = {}
    try:
        for name, ending in _judged(measures, chosen, prepare, jobs):
            if isinstance(ending, Changes):
                changes[name] = ending
            else:
                failed[name] = ending
            on_judged(name)
    except BaseException:
        _discard(folders)
        raise
    by_name = [folder.name for folder in folders]
    return Rejudging(
        results,
        {name: changes[name] for name in by_name if name in changes},
        {name: failed[name] for name in by_name if name in failed},
        next((overrides for _, overrides in measures.values()), Overrides()),
        {folder.name: measures[key][0] for folder, key in chosen.items()},
    )


def _discard(folders: Sequence[Path]) -> None:
    """Remove what was prepared."""
    for folder in folders:
        for file in _FILES:
            (folder / (file + _NEW)).unlink(missing_ok=True)


def _measures(
    results: Path, folders: Sequence[Path], rubric: Path | None, overrides: Path | None, *, trusted: bool
) -> tuple[dict[str, Measure], dict[Path, str], dict[str, GraderError]]:
    """Load each rubric once: all of them by their text, which one each folder is judged by, and which cannot be."""
    sources = [made_from(folder) for folder in folders]
    measures: dict[str, Measure] = {}
    chosen: dict[Path, str] = {}
    failed: dict[str, GraderError] = {}
    if rubric is not None:
        whole = rubrics.chosen_rubric(folders, rubric)
        measures[""] = whole, rubrics.read_overrides(overrides, results, whole, sources)
        for folder in folders:
            try:
                rubrics.require_lab(folder, whole)
                chosen[folder] = ""
            except UsageError as error:
                failed[folder.name] = problem_of(error)
        return measures, chosen, failed
    for folder in folders:
        try:
            copy = rubrics.rubric_copy(folder)
            # Equal texts are one rubric only with equal files beside them.
            key = repr((copy.read_text(encoding="utf-8"), kept_files(copy)))
            if key not in measures:
                measures[key] = rubrics.recorded_rubric(copy, trusted=trusted), Overrides()
            chosen[folder] = key
        except (GraderError, OSError, UnicodeDecodeError) as error:
            failed[folder.name] = problem_of(error)
    for key, (own, _) in measures.items():
        measures[key] = own, rubrics.read_overrides(overrides, results, own, sources)
    return measures, chosen, failed


def _judged(
    measures: Mapping[str, Measure], chosen: Mapping[Path, str], prepare: bool, jobs: int | None
) -> Iterator[tuple[str, Changes | GraderError]]:
    """Judge each folder by its rubric, in any order."""
    works = {folder: partial(_judge, folder, measures[key], prepare) for folder, key in chosen.items()}
    for folder, outcome in in_processes(works, judgement.JUDGING_BOUND, jobs or _cores()):
        yield folder.name, problem_of(outcome) if isinstance(outcome, Exception) else outcome


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _judge(folder: Path, measure: Measure, prepare: bool) -> Changes:
    """Judge one folder; returns what changes."""
    new = judgement.judge_recordings(folder / RECORDINGS, *measure, page=prepare)
    if prepare:
        pages = {REPORT_FILE: new.page, RESULT_FILE: new.text}
        replace_files({folder / (name + _NEW): text for name, text in pages.items()})
    return changes_between(result_of_text(text_of(folder / RESULT_FILE)), read_result(json.loads(new.text)))

"""Recordings judged again, side by side: first what would change, then, if wanted, the new results.

No result is touched before all have been judged.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from grader import pipeline
from grader.batch.audit import Occasion, note_replaced, text_of
from grader.bounded import in_processes
from grader.cohort.changes import Changes, changes_between
from grader.cohort.overrides import Overrides
from grader.desk import made_from, uncounted_overrides
from grader.errors import GraderError, RecordingError, described
from grader.files import replace_files, uninterrupted
from grader.judging import open_recordings
from grader.kept_lab import kept_files
from grader.result import Result, result_of_text, to_json
from grader.rubric import Rubric

_NEW = ".new"
_FILES = (pipeline.REPORT_FILE, pipeline.RESULT_FILE)

#: What to judge by: a rubric, and what people decided.
Measure = tuple[Rubric, Overrides]


def is_class(folder: Path) -> bool:
    """Whether a folder holds results of submissions, and is not itself those of one."""
    return not (folder / pipeline.RECORDINGS).is_dir() and bool(recorded_in(folder))


def recorded_in(results: Path) -> list[Path]:
    """Return the folders of the submissions that were recorded, in the order of their names."""
    if not results.is_dir():
        return []
    return sorted(p for p in results.iterdir() if not p.name.startswith(".") and (p / pipeline.RECORDINGS).is_dir())


@dataclass(frozen=True)
class Judged:
    """A submission that was judged again, by what, and what changes for it."""

    result: Result
    changes: Changes
    rubric: Rubric
    overrides: Overrides


@dataclass(frozen=True)
class Regrade:
    """What judging submissions again comes to, each under the name of its folder.

    Attributes
    ----------
    failed : mapping
        Why those that could not be judged could not.
    """

    results: Path
    judged: Mapping[str, Judged]
    failed: Mapping[str, GraderError]

    @property
    def changes(self) -> dict[str, Changes]:
        """What changes for each that was judged."""
        return {name: judged.changes for name, judged in self.judged.items()}

    def apply(self, occasion: Occasion) -> None:
        """Put the new results, which were prepared, in place of the old, and note it in the trail."""
        for name, judged in self.judged.items():
            folder = self.results / name
            before = text_of(folder / pipeline.RESULT_FILE)
            with uninterrupted():  # so that no result is replaced without being kept
                pipeline.keep_rubric(folder, judged.rubric)
                for file in _FILES:
                    (folder / (file + _NEW)).replace(folder / file)
                note_replaced(self.results, name, before, to_json(judged.result), occasion)

    @property
    def overrides(self) -> Overrides:
        """What people decided, and was applied."""
        return next((judged.overrides for judged in self.judged.values()), Overrides())

    def remarks(self, *, whole_class: bool = True) -> list[str]:
        """Say which overrides do nothing, and where other files of the lab judge than those it was recorded with."""
        remarks: list[str] = []
        if whole_class:
            names = [*(changes.submission for changes in self.changes.values()), *self.failed]
            late = any(judged.rubric.policy.late is not None for judged in self.judged.values())
            remarks += self.overrides.remarks(names, times_matter=late)
        ignored = uncounted_overrides(self.results, [made_from(self.results / name) for name in self.judged])
        remarks += [ignored] if ignored is not None and not self.overrides.sha256 else []
        about: dict[str, list[str]] = {}
        for name, judged in self.judged.items():
            for remark in pipeline.lab_remarks(self.results / name, judged.rubric):
                about.setdefault(remark, []).append(name)
        return remarks + [f"{', '.join(of)}: {remark}" if whole_class else remark for remark, of in about.items()]


def regrade(
    folders: Sequence[Path],
    rubric: Path | None = None,
    overrides: Path | None = None,
    *,
    prepare: bool,
    trusted: bool = False,
    jobs: int | None = None,
    on_judged: Callable[[str], None] = lambda name: None,
) -> Regrade:
    """Judge the recordings of one submission or many again.

    Parameters
    ----------
    folders : sequence of Path
        Results of submissions, all in one folder.
    rubric : Path or None
        By default, each is judged by the rubric by which it was judged last.
    overrides : Path or None
        By default `overrides.yaml` beside the folders, if there is one.
    prepare : bool
        Whether to write the new results beside the old, for `Regrade.apply`.
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
    if not folders:
        raise RecordingError(
            "there are no recordings to judge",
            remedy="Give a folder of results, e.g. results/ for a class or results/alice for one submission.",
        )
    results = folders[0].resolve().parent
    measures, failed = _measures(results, folders, rubric, overrides, trusted=trusted)
    works = {folder: partial(_judge, folder, measure, prepare) for folder, measure in measures.items()}
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    judged: dict[Path, Judged] = {}
    try:
        for folder, outcome in in_processes(works, pipeline.JUDGING_BOUND, jobs or cores):
            if isinstance(outcome, Exception):
                failed[folder] = described(outcome)
            else:
                judged[folder] = Judged(*outcome, *measures[folder])
            on_judged(folder.name)
    except BaseException:
        for path in (folder / (file + _NEW) for folder in folders for file in _FILES):
            path.unlink(missing_ok=True)
        raise
    return Regrade(
        results,
        {folder.resolve().name: judged[folder] for folder in folders if folder in judged},
        {folder.resolve().name: failed[folder] for folder in folders if folder in failed},
    )


def _measures(
    results: Path, folders: Sequence[Path], rubric: Path | None, overrides: Path | None, *, trusted: bool
) -> tuple[dict[Path, Measure], dict[Path, GraderError]]:
    """Load each rubric once; returns by what each folder is judged, and why which cannot be."""
    given = pipeline.chosen_rubric(folders, rubric) if rubric is not None else None
    rubrics: dict[str, Rubric] = {} if given is None else {"": given}
    chosen: dict[Path, str] = {}
    failed: dict[Path, GraderError] = {}
    for folder in folders:
        try:
            key = ""
            if given is not None:
                pipeline.require_lab(folder, given)
            else:
                copy = pipeline.rubric_copy(folder)
                # Equal texts are one rubric only with equal files beside them.
                key = repr((copy.read_text(encoding="utf-8"), kept_files(copy)))
                if key not in rubrics:
                    rubrics[key] = pipeline.recorded_rubric(copy, trusted=trusted)
            chosen[folder] = key
        except (GraderError, OSError, UnicodeDecodeError) as error:
            failed[folder] = described(error)
    sources = [made_from(folder) for folder in folders]
    measures = {k: (own, pipeline.read_overrides(overrides, results, own, sources)) for k, own in rubrics.items()}
    return {folder: measures[key] for folder, key in chosen.items()}, failed


def _judge(folder: Path, measure: Measure, prepare: bool) -> tuple[Result, Changes]:
    """Judge one folder; returns its result now, and what that changes."""
    rubric, overrides = measure
    recordings = open_recordings(folder / pipeline.RECORDINGS, rubric)
    result = pipeline.judge_with_policy(recordings, rubric, overrides)
    text = to_json(result)
    if prepare:
        page = pipeline.report_page(result, recordings, rubric)
        replace_files({folder / (pipeline.REPORT_FILE + _NEW): page, folder / (pipeline.RESULT_FILE + _NEW): text})
    written = result_of_text(text)
    assert written is not None
    return result, changes_between(result_of_text(text_of(folder / pipeline.RESULT_FILE)), written)

"""Recordings judged again, side by side: first what would change, then, if wanted, the new results.

No result is touched before all have been judged.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from grader import judgement
from grader.batch.audit import Occasion, note_replaced, text_of
from grader.bounded import in_processes
from grader.cohort.changes import Changes, changes_between
from grader.cohort.overrides import Overrides
from grader.desk import made_from, uncounted_overrides
from grader.errors import GraderError, RecordingError, described
from grader.files import replace_files, uninterrupted
from grader.kept_lab import kept_files
from grader.kept_lab import remarks as remarks_on_lab
from grader.result import Result, result_of_text, to_json
from grader.result_folder import RECORDINGS, REPORT_FILE, RESULT_FILE
from grader.rubric import Rubric
from grader.rubrics import (
    chosen_rubric,
    read_overrides,
    recorded_rubric,
    require_lab,
    rubric_copy,
    rubric_files_of_result,
)

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
            before = text_of(folder / RESULT_FILE)
            with uninterrupted():  # so that no result is replaced without being kept
                replace_files(rubric_files_of_result(folder, judged.rubric))
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
            for remark in remarks_on_lab(self.results / name / RECORDINGS, judged.rubric):
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
    found = judge_again(results, measures, prepare=prepare, jobs=jobs, on_judged=on_judged)
    return replace(found, failed=dict(sorted({**failed, **found.failed}.items())))


def judge_again(
    results: Path,
    measures: Mapping[Path, Measure],
    *,
    prepare: bool,
    jobs: int | None = None,
    on_judged: Callable[[str], None] = lambda name: None,
) -> Regrade:
    """Judge recordings, each by its measure; see `regrade`."""
    works = {folder: partial(_judge, folder, measure, prepare) for folder, measure in measures.items()}
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    outcomes: dict[Path, tuple[Result, Changes] | Exception] = {}
    try:
        for folder, outcome in in_processes(works, judgement.JUDGING_BOUND, jobs or cores):
            outcomes[folder] = outcome
            on_judged(folder.name)
    except BaseException:
        for path in (folder / (file + _NEW) for folder in measures for file in _FILES):
            path.unlink(missing_ok=True)
        raise
    judged, failed = {}, {}
    for folder, measure in measures.items():
        outcome, name = outcomes[folder], folder.resolve().name
        if isinstance(outcome, Exception):
            failed[name] = described(outcome)
        else:
            judged[name] = Judged(*outcome, *measure)
    return Regrade(results, judged, failed)


def _measures(
    results: Path, folders: Sequence[Path], rubric: Path | None, overrides: Path | None, *, trusted: bool
) -> tuple[dict[Path, Measure], dict[str, GraderError]]:
    """Load each rubric once; returns by what each folder is judged, and why which, by its name, cannot be."""
    given = chosen_rubric(folders, rubric) if rubric is not None else None
    rubrics: dict[str, Rubric] = {} if given is None else {"": given}
    chosen: dict[Path, str] = {}
    failed: dict[str, GraderError] = {}
    for folder in folders:
        try:
            key = ""
            if given is not None:
                require_lab(folder, given)
            else:
                copy = rubric_copy(folder)
                # Equal texts are one rubric only with equal files beside them.
                key = repr((copy.read_text(encoding="utf-8"), kept_files(copy)))
                if key not in rubrics:
                    rubrics[key] = recorded_rubric(copy, trusted=trusted)
            chosen[folder] = key
        except (GraderError, OSError, UnicodeDecodeError) as error:
            failed[folder.resolve().name] = described(error)
    sources = [made_from(folder) for folder in folders]
    measures = {k: (own, read_overrides(overrides, results, own, sources)) for k, own in rubrics.items()}
    return {folder: measures[key] for folder, key in chosen.items()}, failed


def _judge(folder: Path, measure: Measure, prepare: bool) -> tuple[Result, Changes]:
    """Judge one folder; returns its result now, and what that changes."""
    new = judgement.judge_recordings(folder / RECORDINGS, *measure, page=prepare)
    if prepare:
        replace_files({folder / (REPORT_FILE + _NEW): new.page, folder / (RESULT_FILE + _NEW): new.text})
    written = result_of_text(new.text)
    assert written is not None
    return new.result, changes_between(result_of_text(text_of(folder / RESULT_FILE)), written)

"""Recordings judged again, side by side: first what would change, then, if wanted, the new results.

No result is touched before all have been judged.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from grader.bounded import in_processes
from grader.classroom.audit import note_replaced
from grader.cohort.changes import Changes, changes_between
from grader.errors import BoundError, GraderError, RecordingError, RubricError, described
from grader.files import replace_files, text_of, uninterrupted
from grader.judging import judgement
from grader.judging.judge import FULL, Effort
from grader.judging.judgement import Judgement
from grader.judging.result_files import files_of
from grader.judging.rubrics import (
    chosen_rubric,
    read_overrides,
    recorded_rubric,
    require_lab,
    rubric_copy,
)
from grader.lab.kept_lab import kept_files
from grader.lab.kept_lab import remarks as remarks_on_lab
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric
from grader.recording.bag import METADATA_FILE
from grader.result import Result, load_result, result_of_text
from grader.result_folder import RECORDINGS, RESULT_FILE
from grader.submission.separation import made_from, uncounted_overrides

#: What to judge by: a rubric, and what people decided.
Measure = tuple[Rubric, Overrides]


def is_class(folder: Path) -> bool:
    """Whether a folder holds results of submissions, and is not itself those of one."""
    return not (folder / RECORDINGS).is_dir() and bool(recorded_in(folder))


def recorded_in(results: Path) -> list[Path]:
    """Return the folders of the submissions that were recorded, in the order of their names."""
    if not results.is_dir():
        return []
    return sorted(
        p for p in results.iterdir() if not p.name.startswith(".") and (p / RECORDINGS).is_dir()
    )


@dataclass(frozen=True)
class Judged:
    """A submission that was judged again, by what, and what changes for it."""

    judgement: Judgement
    changes: Changes
    rubric: Rubric
    overrides: Overrides

    @property
    def result(self) -> Result:
        """Its result now."""
        return self.judgement.result


@dataclass(frozen=True)
class Regrade:
    """What judging submissions again comes to, each under the name of its folder."""

    results: Path
    judged: Mapping[str, Judged]
    #: Why those that could not be judged could not.
    failed: Mapping[str, GraderError]

    @property
    def changes(self) -> dict[str, Changes]:
        """What changes for each that was judged."""
        return {name: judged.changes for name, judged in self.judged.items()}

    def apply(self, command: str = "regrade") -> None:
        """Put the new results, which were made with their pages, in place of the old, and note it in the trail."""
        for name, judged in self.judged.items():
            folder = self.results / name
            before, sha256 = text_of(folder / RESULT_FILE), judged.overrides.sha256
            with uninterrupted():  # so that no result is replaced without being kept
                replace_files(files_of(judged.judgement, folder, judged.rubric))
                note_replaced(self.results, name, before, command, overrides_sha256=sha256)

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
        ignored = uncounted_overrides(
            self.results, [made_from(self.results / name) for name in self.judged]
        )
        remarks += [ignored] if ignored is not None and not self.overrides.sha256 else []
        about: dict[str, list[str]] = {}
        for name, judged in self.judged.items():
            for remark in remarks_on_lab(self.results / name / RECORDINGS, judged.rubric):
                about.setdefault(remark, []).append(name)
        return remarks + [
            f"{', '.join(of)}: {remark}" if whole_class else remark for remark, of in about.items()
        ]


def regrade(
    folders: Sequence[Path],
    rubric: Path | None = None,
    overrides: Path | None = None,
    *,
    pages: bool,
    trusted: bool = False,
    again: bool = True,
    jobs: int | None = None,
    on_judged: Callable[[str], None] = lambda name: None,
) -> Regrade:
    """Judge the recordings of one submission or many again, whose results lie all in one folder.

    By default, each is judged by the rubric by which it was judged last, with the `overrides.yaml` beside the folders,
    and as many side by side as there are cores. `pages` makes the reports too, for `Regrade.apply`, and `trusted` lets
    files of the lab that came with the recordings be executed though they are not known here. Without `again`, what was
    judged stays, and only people's decisions are applied to it anew. Raises RubricError if
    the rubric given, or the overrides, cannot be used, and RecordingError if there is nothing to judge.
    """
    if not folders:
        raise RecordingError(
            "there are no recordings to judge",
            remedy="Give a folder of results, e.g. results/ for a class or results/alice for one submission.",
        )
    results = folders[0].resolve().parent
    measures, failed = _measures(results, folders, rubric, overrides, trusted=trusted)
    found = regrade_all(results, measures, pages=pages, again=again, jobs=jobs, on_judged=on_judged)
    return replace(found, failed=dict(sorted({**failed, **found.failed}.items())))


def regrade_all(
    results: Path,
    measures: Mapping[Path, Measure],
    *,
    pages: bool,
    again: bool = True,
    jobs: int | None = None,
    on_judged: Callable[[str], None] = lambda name: None,
) -> Regrade:
    """Judge recordings, each by its measure; see `regrade`."""
    if len(measures) > 1:
        folder, (rubric, _) = next(iter(measures.items()))
        judgement.prepare(rubric, (folder / RECORDINGS).glob(f"*/{METADATA_FILE}"))
    works = {
        folder: partial(_judge, folder, measure, pages, again)
        for folder, measure in measures.items()
    }
    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    judged, failed = {}, {}
    for folder, outcome in in_processes(works, judgement.JUDGING_BOUND, jobs or cores):
        name = folder.resolve().name
        if isinstance(outcome, BoundError):
            outcome = _judge_sparingly(works[folder], measures[folder][0])
        if isinstance(outcome, Exception):
            failed[name] = described(outcome)
        else:
            judged[name] = Judged(*outcome, *measures[folder])
        on_judged(folder.name)
    return Regrade(results, dict(sorted(judged.items())), failed)


def _measures(
    results: Path,
    folders: Sequence[Path],
    rubric: Path | None,
    overrides: Path | None,
    *,
    trusted: bool,
) -> tuple[dict[Path, Measure], dict[str, GraderError]]:
    """Load each rubric once; returns by what each folder is judged, and why which, by its name, cannot be."""
    given = chosen_rubric(folders, rubric) if rubric is not None else None
    rubrics: dict[object, Rubric] = {}
    rubric_of: dict[Path, Rubric] = {}
    failed: dict[str, GraderError] = {}
    for folder in folders:
        try:
            if given is not None:
                require_lab(folder, given)
                rubric_of[folder] = given
                continue
            copy = rubric_copy(folder)
            # Equal texts are one rubric only with equal files beside them.
            key = (copy.read_text(encoding="utf-8"), tuple(kept_files(copy).items()))
            if key not in rubrics:
                rubrics[key] = recorded_rubric(copy, trusted=trusted)
            rubric_of[folder] = rubrics[key]
        except RubricError as error:
            mistake = next(iter(error.mistakes), error.problem)
            problem = f"the rubric kept with it does not fit this version of the grader: {mistake}"
            failed[folder.resolve().name] = RubricError(
                problem, [], location=str(folder), remedy=error.remedy
            )
        except (GraderError, OSError, UnicodeDecodeError) as error:
            failed[folder.resolve().name] = described(error)
    sources = [made_from(folder) for folder in folders]
    decided = {
        id(own): read_overrides(overrides, results, own, sources) for own in rubric_of.values()
    }
    return {folder: (own, decided[id(own)]) for folder, own in rubric_of.items()}, failed


def _judge_sparingly(
    work: Callable[[Effort], tuple[Judgement, Changes]], rubric: Rubric
) -> tuple[Judgement, Changes] | Exception:
    try:
        return judgement.judge_sparingly(work, rubric)
    except Exception as error:
        return error


def _judge(
    folder: Path, measure: Measure, pages: bool, again: bool, effort: Effort = FULL
) -> tuple[Judgement, Changes]:
    """Judge one folder; returns what it comes to now, and what that changes."""
    earlier = None if again else load_result(folder / RESULT_FILE)
    new = judgement.judge_recordings(
        folder / RECORDINGS, *measure, page=pages, earlier=earlier, effort=effort
    )
    written = result_of_text(new.text)
    assert written is not None
    return new, changes_between(result_of_text(text_of(folder / RESULT_FILE)), written)

"""Regrading of recordings, several at a time: first the changes, then, on request, the new results.

No result is replaced before all have been judged.
"""

from __future__ import annotations

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
from grader.result import Result, load_result, result_of_text
from grader.result_folder import RECORDINGS, RESULT_FILE
from grader.submission.separation import made_from, uncounted_overrides
from ros_bag.writing import METADATA_FILE

#: A rubric and the overrides for judging.
Measure = tuple[Rubric, Overrides]
#: Rubrics by their texts, and by the names and texts of the files beside them.
LoadedRubrics = dict[tuple[str, tuple[tuple[str, str], ...]], Rubric]


def is_class(folder: Path) -> bool:
    """Return whether a folder holds results of several submissions, and not of a single one."""
    if (folder / RECORDINGS).is_dir():
        return False
    return bool(recorded_in(folder))


def recorded_in(results: Path) -> list[Path]:
    """Return the folders of recorded submissions, in the order of their names."""
    found: list[Path] = []
    if results.is_dir():
        for folder in results.iterdir():
            if not folder.name.startswith(".") and (folder / RECORDINGS).is_dir():
                found.append(folder)
    return sorted(found)


@dataclass(frozen=True)
class Judged:
    """A submission that was judged again, with the rubric, the overrides, and the changes."""

    judgement: Judgement
    changes: Changes
    rubric: Rubric
    overrides: Overrides

    @property
    def result(self) -> Result:
        """The new result."""
        return self.judgement.result


@dataclass(frozen=True)
class Regrade:
    """Regraded submissions, by the names of their folders."""

    results: Path
    judged: Mapping[str, Judged]
    #: Submissions that could not be judged.
    failed: Mapping[str, GraderError]

    @property
    def changes(self) -> dict[str, Changes]:
        """The changes of each judged submission."""
        return {name: judged.changes for name, judged in self.judged.items()}

    def apply(self, command: str = "regrade") -> None:
        """Replace the results and pages by the new ones, and add the old results to the audit trail."""
        for name, judged in self.judged.items():
            folder = self.results / name
            before = text_of(folder / RESULT_FILE)
            sha256 = judged.overrides.sha256
            # No result is replaced without being kept.
            with uninterrupted():
                replace_files(files_of(judged.judgement, folder, judged.rubric))
                note_replaced(self.results, name, before, command, overrides_sha256=sha256)

    @property
    def overrides(self) -> Overrides:
        """The overrides that were applied."""
        for judged in self.judged.values():
            return judged.overrides
        return Overrides()

    def remarks(self, *, whole_class: bool = True) -> list[str]:
        """Report overrides without an effect, and recordings that are judged by other files of the lab."""
        remarks: list[str] = []
        if whole_class:
            names = [*(changes.submission for changes in self.changes.values()), *self.failed]
            late = any(judged.rubric.policy.late is not None for judged in self.judged.values())
            remarks += self.overrides.remarks(names, times_matter=late)
        sources = [made_from(self.results / name) for name in self.judged]
        ignored = uncounted_overrides(self.results, sources)
        if ignored is not None and not self.overrides.sha256:
            remarks.append(ignored)
        about: dict[str, list[str]] = {}
        for name, judged in self.judged.items():
            for remark in remarks_on_lab(self.results / name / RECORDINGS, judged.rubric):
                about.setdefault(remark, []).append(name)
        for remark, names in about.items():
            if whole_class:
                remark = f"{', '.join(names)}: {remark}"
            remarks.append(remark)
        return remarks


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
    loaded: LoadedRubrics | None = None,
) -> Regrade:
    """Judge the recordings of one submission or several again; their results lie in one folder.

    By default, each submission is judged by its last rubric and the `overrides.yaml` beside the folders, and as many
    at a time as there are cores. `pages` makes the reports too, for `Regrade.apply`. `trusted` allows executing
    unknown files of the lab that came with the recordings. Without `again`, findings stay, and only the overrides are
    applied again. Several calls share the rubrics in `loaded`, and the preparation of this process.

    Raises RubricError if the given rubric, or the overrides, cannot be used, and RecordingError if there is nothing
    to judge.
    """
    if not folders:
        raise RecordingError(
            "there are no recordings to judge",
            remedy="Give a folder of results, e.g. results/ for a class or results/alice for one submission.",
        )
    results = folders[0].resolve().parent
    rubrics: LoadedRubrics = {}
    if loaded is not None:
        rubrics = loaded
    measures, failed = _measures(results, folders, rubric, overrides, rubrics, trusted=trusted)
    if loaded is not None:
        _prepare(measures)
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
        _prepare(measures)
    works = {
        folder: partial(_judge, folder, measure, pages, again)
        for folder, measure in measures.items()
    }
    judged, failed = {}, {}
    for folder, outcome in in_processes(works, judgement.JUDGING_BOUND, jobs):
        name = folder.resolve().name
        if isinstance(outcome, BoundError):
            outcome = _judge_sparingly(works[folder], measures[folder][0])
        if isinstance(outcome, Exception):
            failed[name] = described(outcome)
        else:
            judged[name] = Judged(*outcome, *measures[folder])
        on_judged(folder.name)
    return Regrade(results, dict(sorted(judged.items())), failed)


def _prepare(measures: Mapping[Path, Measure]) -> None:
    """Prepare this process, by the first submission, for its judging forks."""
    for folder, (rubric, _) in measures.items():
        judgement.prepare(rubric, (folder / RECORDINGS).glob(f"*/{METADATA_FILE}"))
        break


def _measures(
    results: Path,
    folders: Sequence[Path],
    rubric: Path | None,
    overrides: Path | None,
    rubrics: LoadedRubrics,
    *,
    trusted: bool,
) -> tuple[dict[Path, Measure], dict[str, GraderError]]:
    """Load each rubric once; returns the rubric and overrides of each folder, and errors by the folder's name."""
    given = chosen_rubric(folders, rubric) if rubric is not None else None
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
            wrong = RubricError(problem, [], location=str(folder), remedy=error.remedy)
            failed[folder.resolve().name] = wrong
        except (GraderError, OSError, UnicodeDecodeError) as error:
            failed[folder.resolve().name] = described(error)
    sources = [made_from(folder) for folder in folders]
    decided = {
        id(own): read_overrides(overrides, results, own, sources) for own in rubric_of.values()
    }
    measures = {folder: (own, decided[id(own)]) for folder, own in rubric_of.items()}
    return measures, failed


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
    """Judge one folder; returns the judgement and its changes."""
    earlier = None if again else load_result(folder / RESULT_FILE)
    new = judgement.judge_recordings(
        folder / RECORDINGS, *measure, page=pages, earlier=earlier, effort=effort
    )
    written = result_of_text(new.text)
    assert written is not None
    return new, changes_between(result_of_text(text_of(folder / RESULT_FILE)), written)

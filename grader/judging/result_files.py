"""The files of a judged submission, and the judgement of a submission that is still being graded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from grader.files import UNFINISHED
from grader.judging.judgement import Judgement, judge_bounded
from grader.judging.rubrics import (
    read_overrides,
    recorded_rubric,
    rubric_copy,
    rubric_files_of_result,
)
from grader.lab.rubric import Rubric
from grader.result import CheckResult, Result
from grader.result_folder import LAYOUT_FILE, RECORDINGS, REPORT_FILE, RESULT_FILE
from grader.submission.separation import made_from


def files_of(judgement: Judgement, results: Path, rubric: Rubric) -> dict[Path, str | None]:
    """Return the text of each file of a submission's results; None for a file that must not exist."""
    files = dict(rubric_files_of_result(results, rubric))
    for session, layout in judgement.layouts.items():
        files[results / RECORDINGS / session / LAYOUT_FILE] = layout
    files[results / REPORT_FILE] = judgement.page
    files[results / RESULT_FILE] = judgement.text
    return files


def judge_so_far(results: Path) -> Result:
    """Judge the sessions recorded until now of a submission that is still being graded, and write nothing.

    Checks of sessions that have not ended are undecided, and say so. Raises RecordingError if nothing has begun there.
    """
    folder = results / UNFINISHED
    if not (folder / RECORDINGS).is_dir():
        folder = results
    rubric = recorded_rubric(rubric_copy(folder))
    overrides = read_overrides(None, results.resolve().parent, rubric, [made_from(folder)])
    result = judge_bounded(folder / RECORDINGS, rubric, overrides, page=False).result
    recorded = result.provenance["sessions"]

    def shown(check: CheckResult) -> CheckResult:
        if check.outcome.decided or check.session in (None, *recorded):
            return check
        return replace(check, reason=f"Not yet run: the session '{check.session}' has not ended.")

    criteria = []
    for criterion in result.criteria:
        checks = tuple(map(shown, criterion.checks))
        criteria.append(replace(criterion, checks=checks))
    return replace(result, criteria=tuple(criteria))

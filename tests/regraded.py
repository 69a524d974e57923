"""Recordings judged again as the command does it, for tests of the results."""

from __future__ import annotations

from pathlib import Path

from grader.classroom.regrade import regrade
from grader.files import replace_files
from grader.judging.judgement import judge_bounded
from grader.judging.result_files import files_of
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric
from grader.result import Result
from grader.result_folder import RECORDINGS


def judge_results(results: Path, rubric: Rubric, overrides: Overrides | None = None) -> Result:
    """Judge the recordings of one submission by a rubric, and write its result, as the end of a grading does."""
    judgement = judge_bounded(results / RECORDINGS, rubric, overrides or Overrides())
    replace_files(files_of(judgement, results, rubric))
    return judgement.result


def regraded(results: Path, rubric: Path | None = None) -> Result:
    """Judge one submission again, and write its result."""
    found = regrade([results], rubric, pages=True)
    for error in found.failed.values():
        raise error
    found.apply()
    (judged,) = found.judged.values()
    return judged.result

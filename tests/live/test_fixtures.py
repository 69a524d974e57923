"""Every fixture gets the verdict that its expected.yaml states, graded live on a real ROS graph."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from grader import pipeline, result_folder
from grader.classroom.expectations import compare, load_fixture
from grader.judging import rubrics
from grader.judging.judge import judge, open_recordings
from grader.lab.rubric import Rubric
from grader.live.session.runner import Progress
from grader.submission.artifacts import read_submission_folder
from tests.machine import MACHINE, Others, alone
from tests.thorough import EVERY_FIXTURE, part

ROOT = Path(__file__).parents[2]
#: Most gradings of a fixture; each grading repeats undecided sessions by itself.
MOST_GRADINGS = 3
#: Share of the machine taken by others above which undecided checks are no fault of the grader's.
BUSY = 0.1
EVERY = sorted(path.parent for path in (ROOT / "fixtures").glob("*/expected.yaml"))
#: Fixtures judged by a teacher too; tests/judging/test_teacher.py judges their recordings in every
#: run.
RECORDED = [
    path for path in EVERY if (ROOT / f"tests/teacher_recordings/{path.name}.tar.xz").is_file()
]
#: All of them would take too long for every run: each commit has a part of them, as its name has it.
FIXTURES = [
    *part([path for path in EVERY if path not in RECORDED], 32, EVERY_FIXTURE),
    *part(RECORDED, 40, EVERY_FIXTURE),
]


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return rubrics.read_rubric(None)


@pytest.mark.live
@pytest.mark.parametrize("folder", FIXTURES, ids=lambda path: path.name)
def test_fixture_gets_its_verdict(folder: Path, tmp_path: Path, rubric: Rubric) -> None:
    """A fixture loses points where its expected.yaml says, and nowhere else."""
    fixture = load_fixture(folder)
    submission = fixture.lay_out(tmp_path)
    results = tmp_path / "results"
    record = read_submission_folder(submission, rubric)
    record.sessions = list(fixture.expectation.sessions)
    options = pipeline.Options(Path(sys.executable), record.sessions, jobs=1)
    begun: list[str] = []
    with ExitStack() as to_the_end:

        def on_progress(progress: Progress) -> None:
            # Several tests at a time can be too much for the machine: undecided sessions are then
            # repeated alone.
            if progress.text != "starting":
                return
            if begun.count(progress.session) == 1 and len(set(begun)) == len(begun):
                to_the_end.enter_context(alone())
            begun.append(progress.session)

        for _ in range(MOST_GRADINGS):
            others = Others()
            pipeline.Grading(submission, record, rubric, results, options, on_progress).record()
            result = judge(open_recordings(results / result_folder.RECORDINGS, rubric), rubric)
            verdict = compare(fixture.expectation, result, rubric)
            if not verdict.undecided:
                break
    excused = []
    for criterion in result.criteria:
        for check in criterion.checks:
            if check.outcome.decided or others.share <= BUSY:
                continue
            if check.reason.startswith(MACHINE):
                excused.append(check.id)
    assert [
        text
        for text in verdict.differences
        if not text.startswith(tuple(f"{name} " for name in excused))
    ] == []

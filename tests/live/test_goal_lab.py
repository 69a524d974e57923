"""Another kind of lab, graded live: a robot driven to a goal, and the cost of each defect."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from grader import pipeline, result_folder
from grader.judging import rubrics
from grader.judging.judge import judge, open_recordings
from grader.result import CheckResult, Result
from grader.submission.artifacts import read_submission_folder
from tests.live.shared_server import scheduler
from tests.thorough import EVERY_FIXTURE, part

pytestmark = pytest.mark.live

ROOT = Path(__file__).parents[2]
LAB = ROOT / "tests/labs/goal"
#: Most gradings of a submission that other work on the machine leaves undecided.
MOST_GRADINGS = 3
#: A defect of the solution's text -> points that each check has then, where these are not all.
DEFECTS = {
    "solution": ({}, {}),
    "too fast": ({"FASTEST = 0.4": "FASTEST = 0.8"}, {"limits"}),
    "does not stop": ({"SLOWEST = 0.0": "SLOWEST = 0.3"}, {"arrives"}),
    "slow to answer": ({"DELAY_S = 0.0": "DELAY_S = 0.06"}, {"prompt"}),
    "another gain": ({"GAIN = 0.8": "GAIN = 0.6"}, {"law"}),
}
#: The solution, and every second defect; `make fixtures` grades all.
TRIED = ["solution", *part(list(DEFECTS)[1:], 2, EVERY_FIXTURE)]


def graded(folder: Path, text: str) -> Result:
    """Grade a controller in the lab."""
    lab, submission, results = folder / "lab", folder / "submission", folder / "results"
    shutil.copytree(LAB, lab)
    submission.mkdir()
    (submission / "controller.py").write_text(text, encoding="utf-8")
    rubric = rubrics.read_rubric(lab / "rubric.yaml")
    record = read_submission_folder(submission, rubric)
    for _ in range(MOST_GRADINGS):
        pipeline.Grading(
            submission,
            record,
            rubric,
            results,
            pipeline.Options(Path(sys.executable)),
            lambda _: None,
            scheduler=scheduler(),
        ).record()
        result = judge(open_recordings(results / result_folder.RECORDINGS, rubric), rubric)
        if not result.score.undecided:
            break
    return result


def checks_of(result: Result) -> dict[str, CheckResult]:
    """Give the results of all checks by their ids."""
    return {check.id: check for check in result.checks}


@pytest.mark.parametrize("name", TRIED)
def test_each_defect_costs_points_where_it_is_and_nowhere_else(tmp_path: Path, name: str) -> None:
    """The solution has all; each controller with one defect loses points in one check, which shows its proof."""
    changes, lost = DEFECTS[name]
    text = (LAB / "solution/controller.py").read_text(encoding="utf-8")
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    result = graded(tmp_path, text)
    checks = checks_of(result)
    charged = {id_ for id_, check in checks.items() if check.earned < check.possible}
    said = {
        id_: (check.outcome.value, check.measured, check.reason) for id_, check in checks.items()
    }
    assert charged == set(lost), said
    assert result.problems == ()
    for id_ in lost:
        assert checks[id_].reason
        assert checks[id_].where
        assert checks[id_].earned < checks[id_].possible

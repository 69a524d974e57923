"""Parts that the rubric leaves to a person: `by: person`, undecided until graded, by levels."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest
import yaml

from grader.desk.queue import Kind, queue_of
from grader.errors import RubricError
from grader.judging.adjust import adjust
from grader.judging.judge import judge, open_recordings
from grader.judging.judgement import report_page
from grader.judging.rubrics import rubric_kinds
from grader.lab.kept_lab import lab_folder
from grader.lab.overrides import parse_overrides
from grader.lab.rubric import Rubric, load_rubric
from grader.result import Result

SOLUTION = Path(__file__).resolve().parents[1] / "recordings/solution"
LEVELS = [
    {"title": "Clear", "credit": "100%"},
    {"title": "In part", "credit": 0.6},
    {"title": "Not", "credit": 0},
]
CRITERION = {
    "id": "design",
    "title": "The design is explained",
    "points": 5,
    "by": "person",
    "levels": LEVELS,
}


def rubric_with(folder: Path, criterion: dict[str, object]) -> Rubric:
    """Load the lab's rubric with one more criterion."""
    plain = yaml.safe_load((lab_folder() / "rubric.yaml").read_text(encoding="utf-8"))
    plain["lab"]["points"] += 5
    plain["criteria"].append(criterion)
    file = folder / "rubric.yaml"
    file.write_text(yaml.safe_dump(plain, sort_keys=False), encoding="utf-8")
    return load_rubric(file, rubric_kinds(), lab_folder())


@pytest.mark.parametrize("whole", [True, False], ids=["a criterion", "a check"])
def test_its_points_are_open_until_somebody_grades_it(tmp_path: Path, whole: bool) -> None:
    """The points are undecided and not lost; the levels are the choices, and `set` decides."""
    inner = {**CRITERION, "id": "design.why", "read": ["publisher"]}
    rubric = rubric_with(
        tmp_path,
        CRITERION if whole else {"id": "design", "title": "D", "points": 5, "checks": [inner]},
    )
    (spec,) = [check for check in rubric.checks() if check.by_person]
    assert [(level.title, level.credit) for level in spec.levels] == [
        ("Clear", 1.0),
        ("In part", 0.6),
        ("Not", 0.0),
    ]
    result = judge(open_recordings(SOLUTION, rubric), rubric)
    read = [] if whole else ["joint_publisher.py"]
    require_open(result, rubric, spec.id, read)
    facts = "reason: r, comment: as agreed, who: w, when: 2026-11-21"
    entry = f"overrides: [{{submission: a, check: {spec.id}, set: 3, {facts}}}]"
    decided = adjust(result, parse_overrides(tmp_path / "overrides.yaml", entry, rubric).entries)
    require_decided(decided, rubric)


def require_open(result: Result, rubric: Rubric, name: str, read: list[str]) -> None:
    """Require that the five points of a check wait in the queue, with the files to read."""
    (check,) = result.open_checks
    assert (check.id, check.undecided, check.lost) == (name, Decimal(5), Decimal(0))
    assert [place.file for place in check.where] == read
    (item,) = queue_of({"a": result}, rubric)
    queued = (item.kind, item.part.id, item.points, item.is_decided)
    assert queued == (Kind.TO_GRADE, name, Decimal(5), False)


def require_decided(decided: Result, rubric: Rubric) -> None:
    """Require that three points were given, and that the report shows the comment once."""
    assert (decided.final, decided.still_undecided) == (Decimal(103), Decimal(0))
    assert decided.final_of(decided.criteria[-1]) == Decimal(3)
    assert [each.is_decided for each in queue_of({"a": decided}, rubric)] == [True]
    page = report_page(decided, open_recordings(SOLUTION, rubric), rubric)
    assert page.count('<p class="comment">as agreed</p>') == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"by": "nobody"}, "by"),
        ({"levels": [{"title": "A", "credit": 2}]}, "share"),
        ({"levles": []}, "levles"),
    ],
)
def test_mistakes_are_reported(tmp_path: Path, change: dict[str, object], words: str) -> None:
    """Mistakes in `by`, in the levels and in keys are reported."""
    with pytest.raises(RubricError) as caught:
        rubric_with(tmp_path, {**CRITERION, **change})
    assert any(words in mistake for mistake in caught.value.mistakes)

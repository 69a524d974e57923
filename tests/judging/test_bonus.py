"""Extensions: beside the points where they were handed in, nowhere where they were not."""

from __future__ import annotations

import json
from decimal import Decimal
from pathlib import Path

import pytest

from grader.classroom.expectations import fixtures_in
from grader.errors import RubricError
from grader.judging.adjust import adjust
from grader.judging.judge import Recordings, judge
from grader.judging.rubrics import read_rubric, rubric_kinds
from grader.lab.overrides import load_overrides
from grader.lab.rubric import Rubric, load_rubric
from grader.recording.submission import ArtifactFact
from grader.report.exports.graded import graded
from grader.report.exports.returned import comment
from grader.report.views import bonus_lines
from grader.result import Outcome, Result, read_result, to_json
from grader.submission.artifacts import read_submission_folder
from tests.synthetic import Session, evenly, submission

ROOT = Path(__file__).resolve().parents[2]
RUBRIC = """\
lab: {id: "1", title: One, points: 2}
artifacts: {it: {file: it.py}, more: {file: more_or.py, contains: [Beyond, LAB]}}
sessions:
  experiment: {steps: [{start: {student: it}}]}
  beyond: {steps: [{start: {student: more}}]}
criteria:
  - id: all
    title: All
    points: 2
    checks:
      - {id: size, points: 2, session: experiment, check: field_range, with: {topic: /x, field: data, high: 1.0}}
bonus:
  - id: beyond
    title: Beyond
    points: 3
    checks:
      - {id: larger, points: 3, session: beyond, check: field_range, with: {topic: /y, field: data, high: 2.0}}
"""


def rubric(folder: Path, text: str = RUBRIC) -> Rubric:
    """Give a lab with an extension."""
    (folder / "lab.yaml").write_text(text, encoding="utf-8")
    return load_rubric(folder / "lab.yaml", rubric_kinds())


def judged(folder: Path, beyond: float | None, *, handed_in: bool = True) -> Result:
    """Judge a right submission with an extension that publishes a number.

    None leaves the extension's session unrecorded.
    """
    sessions = {}
    for name, topic, value in (("experiment", "/x", 0.5), ("beyond", "/y", beyond)):
        if value is not None:
            session = Session(folder / name).process()
            session.typed(topic, "std_msgs/msg/Float64", [{"data": value}] * 5, evenly(1, 4))
            sessions[name] = session.recorded()
    of = submission()
    of.artifacts = [ArtifactFact("it", "it.py", "it.py", "name")]
    of.artifacts += (
        [ArtifactFact("more", "more_or.py", "more_or.py", "name", bonus=True)] if handed_in else []
    )
    return judge(Recordings(of, sessions), rubric(folder))


@pytest.mark.parametrize(("beyond", "earned"), [(1.0, 3), (5.0, 0)])
def test_its_points_are_beside_the_sum(tmp_path: Path, beyond: float, earned: int) -> None:
    """Earned or not, bonus points change neither the total nor the possible points."""
    result = judged(tmp_path, beyond)
    assert [*map(int, (result.score.earned, result.score.possible, result.final))] == [2, 2, 2]
    assert [criterion.id for criterion in result.criteria] == ["all"]
    assert [(c.id, int(c.earned), int(c.possible)) for c in result.bonus] == [("beyond", earned, 3)]
    assert read_result(json.loads(to_json(result))) == result
    assert f"Beyond: {earned} of 3" in comment(result)
    assert not [check for check in graded(result).lossy if check.id == "larger"]


def test_what_was_not_handed_in_is_not_missed(tmp_path: Path) -> None:
    """A missing extension is neither judged nor shown."""
    result = judged(tmp_path, None, handed_in=False)
    assert int(result.score.earned) == 2
    assert not result.bonus
    assert not bonus_lines(result)


def test_what_the_machine_left_open_is_recorded_again(tmp_path: Path) -> None:
    """Only the bonus is undecided, and no check of the lab."""
    result = judged(tmp_path, None)
    assert result.score.undecided == 0
    assert [check.outcome for check in result.every_check] == [Outcome.PASSED, Outcome.INCONCLUSIVE]
    assert bonus_lines(result) == ["Beyond: 0 of 3 (3 undecided)"]


def test_a_file_of_another_name_is_found_by_what_it_holds(tmp_path: Path) -> None:
    """A file of another name is found by its content, and a missing file is no artifact."""
    lab, folder = rubric(tmp_path), tmp_path / "handed"
    folder.mkdir()
    (folder / "it.py").write_text("LAB = 1\n")
    (folder / "more_or_less.py").write_text("LAB = 2\n")
    assert [fact.name for fact in read_submission_folder(folder, lab).artifacts] == ["it"]
    (folder / "own.py").write_text("class Beyond:\n    LAB = 1\n")
    facts = read_submission_folder(folder, lab).artifacts
    assert [(fact.name, fact.path, fact.bonus) for fact in facts] == [
        ("it", "it.py", False),
        ("more", "own.py", True),
    ]


def test_each_extension_is_found_and_nothing_else_is_taken_for_one(tmp_path: Path) -> None:
    """A fixture of Lab 09-01 has the extensions of its listed sessions, under any file name.

    Most have none.
    """
    lab = read_rubric(None)
    wrong, without = {}, 0
    for fixture in fixtures_in(ROOT / "fixtures"):
        named = lab.bonus_artifacts & {*(fixture.expectation.sessions or ())}
        found = set()
        for a in read_submission_folder(fixture.lay_out(tmp_path), lab).artifacts:
            if a.bonus:
                found.add(a.name)
        without += not named
        if found != named:
            wrong[fixture.name] = found
    assert without > 100
    assert wrong == {}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("points: 3, session", "points: 2, session", "the checks' points add up to 2, not to 3"),
        ("id: beyond\n", "id: all\n", "stands here twice"),
        ("session: beyond, check", "session: beyon, check", "beyon"),
        (
            "[{start: {student: more}}]",
            "[{observe: {duration_s: 1}}]",
            "needs a session that starts an artifact",
        ),
    ],
)
def test_its_mistakes_are_told_by_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    """Mistakes are reported by line, like those in criteria."""
    with pytest.raises(RubricError) as error:
        rubric(tmp_path, RUBRIC.replace(old, new))
    assert any(words in mistake for mistake in error.value.mistakes)


def test_nobody_sets_its_points(tmp_path: Path) -> None:
    """Bonus checks cannot be set; a person gives a bonus instead."""
    lab, file = rubric(tmp_path), tmp_path / "overrides.yaml"
    entry = "overrides:\n- {submission: a, WHAT, reason: r, who: w, when: 2026-11-21}\n"
    file.write_text(entry.replace("WHAT", "check: larger, set: 3"))
    with pytest.raises(RubricError) as error:
        load_overrides(file, lab)
    assert "is beside the points" in str(error.value.mistakes)
    file.write_text(entry.replace("WHAT", "bonus: 3"))
    result = adjust(judged(tmp_path, 1.0), load_overrides(file, lab).entries)
    assert result.final == Decimal(5)

"""Expectations of fixtures: strict reading, layout, and comparison with a result."""

from __future__ import annotations

import copy
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from grader.classroom.expectations import Expectation, compare, fixtures_in, load_fixture, solution
from grader.classroom.selftest import quick
from grader.errors import RubricError, SubmissionError
from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric, rubric_kinds
from grader.lab.kept_lab import lab_folder
from grader.lab.rubric import Rubric, load_rubric
from grader.result import Result, read_result, to_plain
from tests.plain_results import checks_of

ROOT = Path(__file__).resolve().parents[2]
SOLUTION = lab_folder() / "reference/solution"


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


@pytest.fixture(scope="module")
def judged(rubric: Rubric) -> dict[str, Any]:
    """Give the solution's result as plain data."""
    return to_plain(judge(open_recordings(ROOT / "tests/recordings/solution", rubric), rubric))


def expecting(**parts: Any) -> Expectation:
    """Give an expectation."""
    return Expectation.model_validate(
        {"about": "It is so.", "sessions": ["publisher"], "criteria": {}, **parts}
    )


def read(result: dict[str, Any], identity: str = "", **change: Any) -> Result:
    """Give a result with one check changed."""
    changed = copy.deepcopy(result)
    for check in checks_of(changed):
        if check["id"] == identity:
            check |= change
    return read_result(changed)


# -- reading ---------------------------------------------------------------------------------------


def test_all_fixtures_fit_the_rubric(rubric: Rubric) -> None:
    """Each names only sessions, criteria and checks that there are, and files that it can be laid out from."""
    found = fixtures_in(ROOT / "fixtures")
    assert len(found) >= 117
    assert {
        fixture.name: fixture.expectation.unfit(rubric)
        for fixture in found
        if fixture.expectation.unfit(rubric)
    } == {}
    for fixture in found:
        assert fixture.layers, fixture.name
        for layer in fixture.layers:
            assert layer.is_dir(), fixture.name


def written(folder: Path, text: str, name: str = "one") -> Path:
    """Write a fixture's expected.yaml."""
    (folder / name / "submission").mkdir(parents=True)
    (folder / name / "expected.yaml").write_text(text, encoding="utf-8")
    return folder / name


def test_all_mistakes_are_reported_at_once_with_their_lines(tmp_path: Path) -> None:
    """An expected.yaml is read as strictly as a rubric."""
    text = """\
sessions: [publisher]
colour: red
criteria:
  publisher:
    checks:
      publisher.rate: {outcome: inconclusive}
      publisher.steady: {outcome: failed, earned: [2, 1]}
"""
    with pytest.raises(RubricError, match="what one expects has 4 mistakes") as caught:
        load_fixture(written(tmp_path, text))
    assert [line.split(": ")[0] for line in caught.value.mistakes] == [
        "expected.yaml:1",
        "expected.yaml:2",
        "expected.yaml:6",
        "expected.yaml:7",
    ]


@pytest.mark.parametrize("text", ["", "- a", "about: [", "about: a\nsessions: []\ncriteria: {}\n"])
def test_what_asserts_nothing_is_refused(tmp_path: Path, text: str) -> None:
    """An expectation names a criterion or the total, or it is none."""
    with pytest.raises(RubricError):
        load_fixture(written(tmp_path, text))


def test_a_folder_without_fixtures(tmp_path: Path) -> None:
    """A folder without fixtures is an error, with a remedy that names `--fixtures`."""
    with pytest.raises(SubmissionError, match="no fixtures") as caught:
        fixtures_in(tmp_path)
    assert "--fixtures" in caught.value.remedy


def test_a_fixture_is_laid_out_over_what_it_builds_on(tmp_path: Path) -> None:
    """Its own files win, files can be left out, and nothing that Python made comes along."""
    base = tmp_path / "root/base"
    (base / "__pycache__").mkdir(parents=True)
    for name in ("a.py", "b.py", "README.md"):
        (base / name).write_text("base")
    text = "about: a\nsessions: []\nwith_files_of: base\nwithout: [README.md]\ncriteria:\n  publisher: {}\n"
    fixture = written(tmp_path / "root/fixtures", text)
    (fixture / "submission/b.py").write_text("own")
    submission = load_fixture(fixture).lay_out(tmp_path / "out")
    assert submission.name == "one"
    assert {p.name: p.read_text() for p in submission.iterdir()} == {"a.py": "base", "b.py": "own"}


def test_the_solution_is_a_fixture_too(
    tmp_path: Path, rubric: Rubric, judged: dict[str, Any]
) -> None:
    """The solution is laid out from its own folder, and expects all points of every check."""
    fixture = solution(SOLUTION, rubric)
    assert (fixture.lay_out(tmp_path) / "robot_service.py").is_file()
    assert compare(fixture.expectation, read(judged), rubric).differences == ()
    less = compare(
        fixture.expectation, read(judged, "qos.honest", outcome="partial", earned=3), rubric
    )
    assert [line.split(" | ")[0].split(":")[0] for line in less.differences] == [
        "qos.honest is partial, not passed"
    ]


# -- comparing -------------------------------------------------------------------------------------


def differences(expectation: Expectation, result: Result, rubric: Rubric) -> list[str]:
    """Give the differences, each without its measurement."""
    return [line.split(":")[0] for line in compare(expectation, result, rubric).differences]


def test_what_is_not_named_must_pass(judged: dict[str, Any], rubric: Rubric) -> None:
    """A criterion without checks is demanded in full; another criterion is nobody's matter."""
    result = read(
        judged, "publisher.rate", outcome="failed", earned=0, reason="slow", measured="90 Hz"
    )
    assert compare(expecting(criteria={"publisher": {}}), result, rubric).differences == (
        "publisher.rate is failed, not passed: 90 Hz | slow",
    )
    assert (
        compare(expecting(criteria={"subscriber": {"checks": {}}}), result, rubric).differences
        == ()
    )


@pytest.mark.parametrize(
    ("wanted", "change", "found"),
    [
        ({"outcome": "failed"}, {"outcome": "failed", "earned": 0}, []),
        ({"outcome": "failed"}, {}, ["publisher.rate is passed, not failed"]),
        (
            {"outcome": "failed"},
            {"outcome": "failed", "earned": 1},
            ["publisher.rate earns 1, not 0"],
        ),
        ({"outcome": "partial", "earned": [1, 5]}, {"outcome": "partial", "earned": 5}, []),
        (
            {"outcome": "partial", "earned": [1, 5]},
            {"outcome": "partial", "earned": 5.1},
            ["publisher.rate earns 5.1, not from 1 to 5"],
        ),
        ({"outcome": "partial"}, {"outcome": "partial", "earned": 0.1}, []),
        (
            {"outcome": "failed", "reason_has": "TIMER"},
            {"outcome": "failed", "earned": 0, "hint": "a timer"},
            [],
        ),
        (
            {"outcome": "failed", "reason_has": "timer"},
            {"outcome": "failed", "earned": 0, "reason": "slow", "hint": ""},
            ["publisher.rate does not mention 'timer'"],
        ),
        (
            {"outcome": "not_reached"},
            {"outcome": "failed", "earned": 0},
            ["publisher.rate is failed, not not reached"],
        ),
    ],
)
def test_a_check_that_is_named(
    judged: dict[str, Any],
    rubric: Rubric,
    wanted: dict[str, Any],
    change: dict[str, Any],
    found: list[str],
) -> None:
    """Outcome, points and words of a check are as expected, or each difference is told."""
    expectation = expecting(criteria={"publisher": {"checks": {"publisher.rate": wanted}}})
    assert differences(expectation, read(judged, "publisher.rate", **change), rubric) == found


def test_checks_by_the_files_alone_are_asserted_where_they_are_named(
    judged: dict[str, Any], rubric: Rubric
) -> None:
    """A check without a session counts only if it is named, or if its criterion has no other."""
    result = read(judged, "qos.explains", outcome="failed", earned=0)
    assert differences(expecting(criteria={"qos": {}}), result, rubric) == []
    named = expecting(criteria={"qos": {"checks": {"qos.explains": {"outcome": "passed"}}}})
    assert differences(named, result, rubric) == ["qos.explains is failed, not passed"]
    result = read(judged, "documentation.readme", outcome="failed", earned=0)
    assert differences(expecting(criteria={"documentation": {}}), result, rubric) == [
        "documentation.readme is failed, not passed"
    ]


def test_the_total(judged: dict[str, Any], rubric: Rubric) -> None:
    """The points of all that is judged lie within the bounds, both ends included."""
    assert differences(expecting(total=[100, 100]), read(judged), rubric) == []
    assert differences(expecting(total=[0, 99.9]), read(judged), rubric) == [
        "it earns 100 points in all, not from 0 to 99.9"
    ]


def test_what_was_not_judged_is_a_difference(judged: dict[str, Any], rubric: Rubric) -> None:
    """A session that did not run cannot pass for one that did."""
    partial = copy.deepcopy(judged)
    partial["criteria"] = [c for c in partial["criteria"] if c["id"] != "service"]
    expectation = expecting(
        criteria={"service": {"checks": {"service.offers": {"outcome": "passed"}}}}
    )
    assert differences(expectation, read(partial), rubric) == [
        "service.offers is expected, but was not judged",
        "service is expected, but nothing of it was judged",
    ]


def test_what_is_undecided_may_be_run_again(judged: dict[str, Any], rubric: Rubric) -> None:
    """Only an undecided check that is asserted calls for another run."""
    result = read(judged, "publisher.rate", outcome="inconclusive", earned=0)
    assert compare(expecting(criteria={"publisher": {}}), result, rubric).undecided
    assert not compare(expecting(criteria={"service": {}}), result, rubric).undecided
    open_score = copy.deepcopy(judged)
    open_score["score"]["undecided"] = 6
    assert compare(expecting(total=[0, 100]), read(open_score), rubric).undecided


def test_an_expectation_of_another_rubric_is_reported_before_anything_runs(rubric: Rubric) -> None:
    """Names missing in the rubric are listed, each with its kind, place and nearest known name."""
    checks = {"publisher.rat": {"outcome": "failed"}}
    expectation = expecting(
        sessions=["publisher", "night"], criteria={"publisher": {"checks": checks}, "fame": {}}
    )
    found = [(loc, words.partition(";")[0]) for loc, words in expectation.unfit(rubric)]
    assert found == [
        (("sessions", 1), "the rubric has no session 'night'"),
        (
            ("criteria", "publisher", "checks", "publisher.rat"),
            "the rubric's criterion 'publisher' has no check 'publisher.rat'",
        ),
        (("criteria", "fame"), "the rubric has no criterion 'fame'"),
    ]


# -- choosing a few --------------------------------------------------------------------------------


def test_a_quick_choice_says_something_of_every_criterion(rubric: Rubric) -> None:
    """A quick choice has few fixtures, but one with lost points for each criterion.

    The solution and the starter are always in it.
    """
    every = [solution(SOLUTION, rubric), *fixtures_in(ROOT / "fixtures")]
    chosen = quick(every, rubric)
    assert {"solution", "empty_starter"} < {fixture.name for fixture in chosen}
    assert len(chosen) < len(every) / 3
    assert chosen == [fixture for fixture in every if fixture in chosen]
    for criterion in rubric.criteria:
        assert any(fixture.expectation.loses_in(criterion.id) for fixture in chosen), criterion.id


def test_the_floor_is_stated() -> None:
    """The empty starter runs all sessions, and its total is stated to the point."""
    expectation = load_fixture(ROOT / "fixtures/empty_starter").expectation
    assert expectation.total == (Decimal(0), Decimal(0))
    assert len(expectation.sessions) == 5


BY_PERSON = """
  - id: questions
    title: Written questions
    points: 5
    by: person
"""


def test_what_a_person_grades_is_left_out(judged: dict[str, Any], tmp_path: Path) -> None:
    """The solution is as expected with points that are open for a person; a fixture cannot expect anything of them."""
    text = (lab_folder() / "rubric.yaml").read_text(encoding="utf-8")
    text = text.replace("\n  points: 100\n", "\n  points: 105\n", 1)
    head, bonus, rest = text.partition("\nbonus:")
    (tmp_path / "rubric.yaml").write_text(f"{head}{BY_PERSON}{bonus}{rest}", encoding="utf-8")
    rubric = load_rubric(tmp_path / "rubric.yaml", rubric_kinds(), lab_folder())
    recordings = open_recordings(ROOT / "tests/recordings/solution", rubric)
    result = judge(recordings, rubric)
    assert result.still_undecided == 5
    verdict = compare(solution(SOLUTION, rubric).expectation, result, rubric)
    assert (verdict.differences, verdict.undecided) == ((), False)
    aimed = expecting(criteria={"questions": {"checks": {"questions": {"outcome": "passed"}}}})
    ((loc, words),) = aimed.unfit(rubric)
    assert loc == ("criteria", "questions", "checks", "questions")
    assert "a person grades 'questions'" in words

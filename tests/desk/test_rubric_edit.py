"""A rubric edited beside a class: only numbers move, changes are shown, the saved file works."""

from __future__ import annotations

import difflib
import json
import shlex
from decimal import Decimal
from pathlib import Path

import pytest
import yaml
from rich.console import Console

from grader.commands import regrade
from grader.desk.rubric_edit import edited, limits_of, save, would_change
from grader.errors import RubricError
from grader.judging.rubrics import read_rubric
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric
from grader.result import load_result
from grader.result_folder import EDITED_RUBRIC, RESULT_FILE
from tests.desk.made_class import add_alike, serve
from tests.plain_results import checks_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's rubric."""
    return read_rubric(None)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Lay out a class of two: a right solution, and a subscriber that prints signed means."""
    folder = tmp_path_factory.mktemp("class") / "results"
    add_alike(folder, ["alice"], "solution")
    add_alike(folder, ["bob"], "signed_mean_statistics")
    return folder


def place(rubric: Rubric, check: str, key: str) -> str:
    """Give the place of a number."""
    return next(limit.id for limit in limits_of(rubric) if (limit.check, limit.key) == (check, key))


def test_a_number_is_moved_alone(rubric: Rubric) -> None:
    """An edited number changes its line and the sums, and no comment, order or spelling.

    Every seventh number is tried.
    """
    limits = limits_of(rubric)
    assert {limit.check for limit in limits} == {
        check.id for criterion in rubric.criteria for check in criterion.checks
    }
    for limit in limits[::7]:
        value = "17%" if limit.value.endswith("%") else "17"
        text = edited(rubric.text, {limit.id: value})
        differences = difflib.ndiff(rubric.text.splitlines(), text.splitlines())
        new = [line for line in differences if line.startswith("+")]
        most = 3 if limit.key == "points" else 1
        assert 1 <= len(new) <= most, new
        assert value_of(text, limit.id) == value


def value_of(text: str, place: str) -> str:
    """Return the number at a place such as `1/0/points`, read from a rubric's text."""
    criterion, number, key = place.split("/")
    plain = yaml.load(text, yaml.CSafeLoader)
    check = plain["criteria"][int(criterion)]["checks"][int(number)]
    return str(check["points"] if key == "points" else check["with"][key])


def test_a_number_that_others_share_moves_for_all(rubric: Rubric) -> None:
    """The anchor stays, and is listed once."""
    text = edited(rubric.text, {place(rubric, "publisher.motion", "reach"): "2.5"})
    assert "reach: &reach 2.5" in text
    checks = {check["id"]: check for check in checks_of(yaml.safe_load(text))}
    assert (
        checks["publisher.values"]["with"]["reach"]
        == checks["publisher.motion"]["with"]["reach"]
        == 2.5
    )
    assert [limit.check for limit in limits_of(rubric) if limit.key == "reach"] == [
        "publisher.motion"
    ]


@pytest.mark.parametrize("value", ["", "five", "1e3", "5; import os", "5\n  x: 1", "nan", "5%"])
def test_what_is_no_number_is_refused(rubric: Rubric, value: str) -> None:
    """As points; nothing else can come into the text that way."""
    with pytest.raises(RubricError, match="is not a number"):
        edited(rubric.text, {place(rubric, "publisher.rate", "points"): value})
    with pytest.raises(RubricError, match="no such number"):
        edited(rubric.text, {"0/99/points": "5"})


def test_a_rubric_that_cannot_be_used_is_not_saved(rubric: Rubric, made: Path) -> None:
    """All its mistakes are told."""
    text = edited(rubric.text, {place(rubric, "publisher.rate", "points"): "-5"})
    for use in (lambda: would_change(made, text, Overrides()), lambda: save(made, text)):
        with pytest.raises(RubricError) as caught:
            use()
        assert any("points" in mistake for mistake in caught.value.mistakes)
    assert not (made / EDITED_RUBRIC).exists()


def require_command(command: str, results: Path) -> None:
    """Fail unless a command applies the edited rubric, after a question, with mails."""
    words = ["grade", "regrade", str(results), "--rubric", str(results / EDITED_RUBRIC)]
    assert shlex.split(command) == [*words, "--ask", "--mail"]


def test_who_would_change_and_by_how_much(rubric: Rubric, made: Path) -> None:
    """A preview changes nothing; after saving, `grade regrade --rubric` gives the same points."""
    before = {path: path.read_bytes() for path in made.rglob("*") if path.is_file()}
    bob = load_result(made / "bob" / RESULT_FILE)
    points, possible = bob.final, bob.score.possible
    moved = {place(rubric, "subscriber.mean", "points"): "4"}
    desk = serve(made)
    try:
        status, body, _ = desk.ask("POST", "rubric/preview", moved)
        plain = json.loads(body)
        assert (status, plain["judged"], plain["failed"]) == (200, 2, [])
        row = next(row for row in plain["changes"] if row["name"] == "alice")
        assert (row["difference"], row["parts"]) == ("+2", ["Mean error at Ctrl-C +2"])
        assert {path: path.read_bytes() for path in made.rglob("*") if path.is_file()} == before
        status, body, _ = desk.ask("POST", "rubric/save", moved)
        plain = json.loads(body)
        assert (status, plain["saved"]) == (200, str(made / EDITED_RUBRIC))
        require_command(plain["command"], made)
    finally:
        desk.kill()
    console = Console(record=True, width=200)
    assert regrade.run([str(made), "--rubric", str(made / EDITED_RUBRIC), "--apply"], console) == 0
    after = {name: load_result(made / name / RESULT_FILE) for name in ("alice", "bob")}
    assert (after["alice"].final, after["bob"].final) == (Decimal(102), points)
    assert after["bob"].score.possible == possible + 2

"""Orders and endings as they travel between processes."""

from __future__ import annotations

import json
import sys
from decimal import Decimal
from pathlib import Path

import pytest

from grader.batch.order import Graded, NotGraded, Order
from grader.errors import GraderError, RubricError, SubmissionError
from grader.intake import Handed
from grader.live.isolation import Isolation, Level
from grader.pipeline import Options
from grader.rubrics import read_rubric


def test_an_order_arrives_as_it_was_sent(tmp_path: Path) -> None:
    """Rubric, options and submission are the same on the other side."""
    handed = Handed.of(tmp_path)
    order = Order(handed, tmp_path, read_rubric(None), Options(Path(sys.executable), ["qos"]), Isolation(Level.FULL))
    order.write(tmp_path / "order")
    assert Order.read(tmp_path / "order") == order


def test_points_arrive_exactly() -> None:
    """Points keep all their digits."""
    graded = Graded(Decimal("84.6"), Decimal(100), Decimal("0.1"))
    assert Graded.from_plain(json.loads(json.dumps(graded.to_plain()))) == graded


def test_problems_arrive() -> None:
    """What went wrong arrives, and without end it does not."""
    problem = NotGraded("it broke", "a.py", "mend it", 3)
    assert NotGraded.from_plain(json.loads(json.dumps(problem.to_plain()))) == problem
    assert len(json.dumps(NotGraded("x" * 10**6).to_plain())) < 10_000


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (SubmissionError("it is empty", where="ann", remedy="fill it"), NotGraded("it is empty", "ann", "fill it", 3)),
        (GraderError("it broke"), NotGraded("it broke", "", "", 70)),
        (
            RubricError("two mistakes", ["a.yaml:1: one", "a.yaml:2: two"], where="a.yaml"),
            NotGraded("two mistakes; a.yaml:1: one; a.yaml:2: two", "a.yaml", "", 4),
        ),
    ],
)
def test_errors_keep_their_words_and_their_exit_status(error: GraderError, expected: NotGraded) -> None:
    """An error of a submission says the same in a class as it does alone."""
    assert NotGraded.from_error(error) == expected


def test_a_full_disk_is_named() -> None:
    """Of an error of the system the reason and the file are told, and what to look at."""
    told = NotGraded.from_error(OSError(28, "No space left on device", "/results/ann"))
    assert (told.problem, told.where, told.exit_status) == ("No space left on device", "/results/ann", 70)
    assert "disk" in told.remedy


def test_a_mistake_of_the_grader_is_called_one() -> None:
    """Anything unforeseen is told with its kind."""
    told = NotGraded.from_error(KeyError("x"))
    assert "KeyError" in told.problem
    assert "mistake in grade" in told.remedy

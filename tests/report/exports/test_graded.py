"""The exports' view of `result.json`: complete data, sound places, and people's decisions."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import pytest

from grader.errors import RecordingError
from grader.report.exports.graded import graded as graded_of
from grader.result import Location
from tests.report.exports.sample_results import (
    adjusted_and_tampered,
    check,
    criterion,
    every_outcome,
    of_recording,
    read,
    result,
)


def test_points_are_read_as_they_are_written() -> None:
    """Sums are exact, and undecided points are not lost."""
    graded = graded_of(read(every_outcome()))
    assert [graded.score.earned, graded.score.possible, graded.still_undecided, graded.final] == [
        Decimal(n) for n in ("7.5", "20", "5", "7.5")
    ]
    assert [each.id for each in graded.lossy] == ["b.failed", "a.partial", "b.missed"]
    assert [each.lost for each in graded.checks] == [0, Decimal("2.5"), 3, 2, 0, 0]
    assert [each.id for each in graded.checks if each.open] == ["b.open", "b.broken"]


def test_a_real_result_is_read() -> None:
    """The result of a recording has the same points in each of its parts."""
    graded = graded_of(read(of_recording("wrong_topic")))
    assert graded.score.earned == sum(each.earned for each in graded.checks)
    assert graded.lossy
    for session in graded.sessions.values():
        assert session["duration_s"] > 0


def test_what_a_person_decided_is_neither_lost_nor_open() -> None:
    """An excused check loses nothing, and one that was given points is not undecided any more."""
    graded = graded_of(read(adjusted_and_tampered()))
    found = {each.id: each for each in graded.checks}
    assert found["a.partial"].lost == 0
    assert not found["b.open"].open
    assert [found["b.open"].lost, found["b.open"].given] == [1, 2]
    assert graded.still_undecided == 2
    assert graded.final == 11


@pytest.mark.parametrize(("kind", "lost"), [("excused", 0), ("points", 3)])
def test_a_criterion_that_a_person_decided_is_not_open(kind: str, lost: int) -> None:
    """In an excused criterion no check loses points.

    After another decision, the points of its single checks are unknown.
    """
    plain = result(criterion("a", check("a.f", "failed", 0, 3), check("a.o", "inconclusive", 0, 2)))
    plain["adjustments"] = [{"kind": kind, "what": "a", "points": 5}]
    graded = graded_of(read(plain))
    assert [each.open for each in graded.checks] == [False, False]
    assert sum(each.lost for each in graded.checks) == lost


def test_unknown_keys_are_passed_over() -> None:
    """A result of a later version can be exported, as can one of an earlier version without adjustments."""
    plain = every_outcome()
    plain["later"] = {"x": 1}
    plain["criteria"][0]["later"] = plain["criteria"][0]["checks"][0]["later"] = "x"
    plain["criteria"][0]["checks"][0]["where"][0]["later"] = "x"
    del plain["adjustments"], plain["violations"], plain["score"]["final"]
    assert graded_of(read(plain)) == graded_of(read(every_outcome()))


@pytest.mark.parametrize(
    "broken",
    [
        {},
        {"schema": "other/v1"},
        {"score": {}},
        {"criteria": [{"id": "a"}]},
        {"score": {"earned": "NaN", "possible": 1, "undecided": 0}},
        {"criteria": 3},
        {"provenance": []},
    ],
)
def test_what_is_no_result_is_refused(broken: dict[str, Any]) -> None:
    """Anything else ends with a message, not with a traceback."""
    plain = every_outcome() | broken if broken else {}
    with pytest.raises(RecordingError) as told:
        graded_of(read(plain))
    assert "grade regrade" in told.value.remedy


@pytest.mark.parametrize(
    ("file", "line", "prefix", "expected"),
    [
        ("a.py", 3, "", Location("a.py", 3)),
        ("src/a.py", None, "labs/09", Location("labs/09/src/a.py", 1)),
        ("./a.py", 0, "./x/", Location("x/a.py", 1)),
        ("../a.py", 3, "x", None),
        ("/etc/passwd", 3, "x", None),
        ("", 3, "x", None),
        ("\x1b[2Ja.py", 3, "", None),
        ("a\nb.py", 3, "", None),
        ("\udcff.py", 3, "", None),
        ("my  Größe.py", 3, "", Location("my  Größe.py", 3)),
    ],
)
def test_a_file_is_in_the_repository_or_not_named(
    file: str, line: int, prefix: str, expected: Location | None
) -> None:
    """Paths are the repository's, never lead out of it, and can be shown as they are."""
    plain = result(
        criterion("a", check("a.f", "failed", 0, 3, where=[{"file": file, "line": line}]))
    )
    assert graded_of(read(plain), prefix).checks[0].location == expected

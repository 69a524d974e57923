"""Gradescope's results.json by the rules of its documentation."""

from __future__ import annotations

import json
from decimal import Decimal
from typing import Any

import jsonschema
from hypothesis import HealthCheck, given, settings

from tests.report.exports.sample_results import (
    adjusted_and_tampered,
    every_outcome,
    exported,
    hostile_results,
    of_recording,
)

_FORMAT = {"enum": ["text", "simple_format", "html", "md", "ansi"]}
_VISIBILITY = {"enum": ["hidden", "after_due_date", "after_published", "visible"]}
#: "Autograder Specifications", output format: every key, and its permitted values. A score is
#: required on top, or on each test; a file without is no result: "The autograder failed to execute
#: correctly".
SCHEMA = {
    "type": "object",
    "additionalProperties": False,
    "required": ["tests"],
    "anyOf": [
        {"required": ["score"]},
        {"properties": {"tests": {"minItems": 1, "items": {"required": ["score"]}}}},
    ],
    "properties": {
        "score": {"type": "number", "minimum": 0},
        "execution_time": {"type": "number", "minimum": 0},
        "output": {"type": "string"},
        "output_format": _FORMAT,
        "test_output_format": _FORMAT,
        "test_name_format": _FORMAT,
        "visibility": _VISIBILITY,
        "stdout_visibility": _VISIBILITY,
        "extra_data": {"type": "object"},
        "leaderboard": {"type": "array"},
        "tests": {
            "type": "array",
            "items": {
                "type": "object",
                "additionalProperties": False,
                "properties": {
                    "score": {"type": "number", "minimum": 0},
                    "max_score": {"type": "number", "minimum": 0},
                    "status": {"enum": ["passed", "failed"]},
                    "name": {"type": "string", "minLength": 1},
                    "name_format": _FORMAT,
                    "number": {"type": "string"},
                    "output": {"type": "string", "minLength": 1},
                    "output_format": _FORMAT,
                    "tags": {"type": "array", "items": {"type": "string"}},
                    "visibility": _VISIBILITY,
                    "extra_data": {"type": "object"},
                },
            },
        },
    },
}


def valid(plain: dict[str, Any]) -> dict[str, Any]:
    """Export, and return the data if they are valid."""
    data: dict[str, Any] = json.loads(exported("gradescope", plain))
    jsonschema.validate(data, SCHEMA)
    # If one test is hidden, Gradescope hides the total; and any format but plain text would be
    # rendered.
    assert {test["visibility"] for test in data["tests"]} | {data["visibility"]} == {"visible"}
    assert {test["output_format"] for test in data["tests"]} == {"text"}
    assert {data["output_format"], data["test_output_format"], data["test_name_format"]} == {"text"}
    for test in data["tests"]:
        assert ("score" in test) == ("max_score" in test) == ("status" in test)
        assert test.get("score", 0) <= test.get("max_score", 0)
    return data


def test_points_and_verdicts() -> None:
    """Each check is a test with its points and its proof, and the total is the score."""
    data = valid(every_outcome())
    assert (data["score"], data["execution_time"]) == (7.5, 10.5)
    assert data["extra_data"] == {"earned": 7.5, "possible": 20, "undecided": 5}
    tests = {test["number"]: test for test in data["tests"]}
    assert list(tests) == ["1.1", "1.2", "2.1", "2.2", "2.3", "2.4"]
    assert [(t.get("score"), t.get("max_score"), t.get("status")) for t in tests.values()] == [
        (4, 4, "passed"),
        (2.5, 5, "failed"),
        (0, 3, "failed"),
        (0, 2, "failed"),
        (None, None, None),
        (None, None, None),
    ]
    assert tests["1.2"]["name"] == "Criterion a: Title of a.partial"
    assert tests["1.2"]["output"].splitlines()[:2] == ["Reason of a.partial.", "Expected: 100 Hz"]


def test_what_is_undecided_is_said_and_neither_passed_nor_failed() -> None:
    """The text on top and the test say so; it has no score that could count against anyone."""
    data = valid(every_outcome())
    assert "5 points are undecided, and not earned before they are" in data["output"]
    assert data["tests"][4]["name"].endswith("(undecided)")
    assert data["tests"][4]["output"].startswith("Undecided, 3 points are not earned")


def test_adjustments_are_in_the_total_and_reported() -> None:
    """The total is final, and its adjustments are explained to the reader."""
    data = valid(adjusted_and_tampered())
    assert data["score"] == 11
    assert (
        "- +2.5 Title of a.partial: excused: The handout was wrong. (prof@lab.example, 2026-06-01)"
        in data["output"]
    )
    assert "- There was a second server." in data["output"]
    assert (data["tests"][1]["score"], data["tests"][1]["status"]) == (5, "passed")


def test_the_scores_of_real_results_add_up() -> None:
    """The tests' points add up exactly to the total, for a recording without undecided points."""
    for name in ("solution", "wrong_topic", "signed_mean_statistics"):
        data = json.loads(exported("gradescope", of_recording(name)), parse_float=Decimal)
        decided = [test for test in data["tests"] if "score" in test]
        assert sum(Decimal(str(test["score"])) for test in decided) == data["score"]


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(hostile_results())
def test_hostile_texts_keep_it_valid(plain: dict[str, Any]) -> None:
    """Whatever a student wrote, the file is valid, and holds nothing that a database cannot store."""
    data = valid(plain)
    assert "\\u0000" not in json.dumps(data)
    assert len(data["tests"]) == 6

"""GitLab's code quality report: every finding passes its schema, and is known again by its fingerprint."""

from __future__ import annotations

import json
from typing import Any

import jsonschema
from hypothesis import HealthCheck, given, settings

from tests.report.exports.sample_results import (
    check,
    criterion,
    every_outcome,
    exported,
    hostile_results,
    of_recording,
    result,
)

#: GitLab's documentation of the format; its parser stops at the first finding that is not so.
_SCHEMA = {
    "type": "array",
    "items": {
        "type": "object",
        "required": ["description", "check_name", "fingerprint", "severity", "location"],
        "properties": {
            "description": {"type": "string", "minLength": 1},
            "check_name": {"type": "string", "minLength": 1},
            "fingerprint": {"type": "string", "minLength": 1},
            "severity": {"enum": ["info", "minor", "major", "critical", "blocker"]},
            "location": {
                "type": "object",
                "required": ["path", "lines"],
                "properties": {
                    # Relative to the repository, without `./` before it.
                    "path": {
                        "type": "string",
                        "pattern": r"^(?!\.?/)(?!.*(^|/)\.\.(/|$))",
                        "minLength": 1,
                    },
                    "lines": {
                        "type": "object",
                        "required": ["begin"],
                        "properties": {"begin": {"type": "integer", "minimum": 1}},
                    },
                },
            },
        },
    },
}


def findings_of(plain: dict[str, Any], path_prefix: str = "") -> list[dict[str, Any]]:
    """Export, and return the findings if they are valid."""
    findings: list[dict[str, Any]] = json.loads(
        exported("gitlab-codequality", plain, path_prefix=path_prefix)
    )
    jsonschema.validate(findings, _SCHEMA)
    prints = [finding["fingerprint"] for finding in findings]
    assert len(set(prints)) == len(prints)
    return findings


def test_lost_points_are_findings_on_files() -> None:
    """Checks that point at no file, and those that lost nothing, are left out."""
    plain = every_outcome()
    plain["criteria"][1]["checks"][0]["where"] = [{"topic": "/a"}, {"file": "b.py"}]
    findings = findings_of(plain, "ann")
    assert [(f["check_name"], f["severity"], f["location"]) for f in findings] == [
        ("b.failed", "major", {"path": "ann/b.py", "lines": {"begin": 1}}),
        ("a.partial", "minor", {"path": "ann/a.partial.py", "lines": {"begin": 3}}),
    ]
    assert (
        findings[0]["description"]
        == "Title of b.failed (−3 points): Reason of b.failed. Use a timer."
    )


def test_a_finding_is_known_again_after_the_line_has_moved() -> None:
    """Its fingerprint depends on neither line nor measurement nor points, but on check and file."""

    def fingerprint(**more: Any) -> str:
        plain = result(criterion("a", check("a.rate", "partial", 1, 3) | more))
        return str(findings_of(plain)[0]["fingerprint"])

    first = fingerprint()
    moved = [{"file": "a.rate.py", "line": 40}]
    assert (
        fingerprint(where=moved, measured="91 Hz", reason="Other.", earned=2, outcome="failed")
        == first
    )
    assert fingerprint(where=[{"file": "other.py", "line": 3}]) != first
    assert fingerprint(id="a.other") != first


def test_a_real_result_is_valid() -> None:
    """A full score has no finding, and the results of kept recordings are valid."""
    assert findings_of(of_recording("solution")) == []
    assert findings_of(of_recording("best_effort_publisher"))


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(hostile_results())
def test_hostile_texts_keep_it_valid(plain: dict[str, Any]) -> None:
    """Paths stay within the repository, and texts have only characters that PostgreSQL stores."""
    for finding in findings_of(plain):
        assert "\0" not in finding["description"] + finding["location"]["path"]

"""GitLab's code quality report: the checks that lost points, each at a line of the student's file.

Checks without a file are left out, because GitLab shows findings on files alone; the JUnit report has them.
A finding's fingerprint depends on check and file, and is the same after the student has moved the line.

References
----------
GitLab: code quality report format. Its parser stops at the first finding that its schema refuses.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from grader.json_text import json_text
from grader.report.escape import line
from grader.report.exports.graded import Graded, GradedCheck
from grader.report.views import points
from grader.result import Outcome

_SEVERITIES = {Outcome.FAILED: "major", Outcome.PARTIAL: "minor"}


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the report."""
    return json_text([_finding(check) for check in graded.lossy if check.location is not None])


def _finding(check: GradedCheck) -> dict[str, Any]:
    location = check.location
    assert location is not None
    parts = [f"{check.title} (−{points(check.lost)} points):", check.reason, check.hint]
    key = f"{check.id}\0{location.file}"
    hashed = hashlib.sha256(key.encode("utf-8", "backslashreplace"))
    return {
        "description": line(" ".join(parts), 1000),
        "check_name": line(check.id),
        "fingerprint": hashed.hexdigest(),
        "severity": _SEVERITIES.get(check.outcome, "info"),
        "location": {"path": location.file, "lines": {"begin": location.line}},
    }

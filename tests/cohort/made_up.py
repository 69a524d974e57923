"""Rubrics and results of a few numbers, for expectations worked out by hand."""

from __future__ import annotations

import json
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

from grader.cohort.entries import ClassEntry
from grader.json_text import json_text
from grader.lab.rubric import CheckSpec, CriterionSpec, LabSpec, Rubric
from grader.result import RESULT_SCHEMA, read_result


def rubric_of(
    *checks: tuple[str, int], requires: dict[str, tuple[str, ...]] | None = None
) -> Rubric:
    """Give a rubric with checks `criterion.name` of some points."""
    specs = [
        CheckSpec.model_validate(
            {
                "id": name,
                "title": name.upper(),
                "points": Decimal(points),
                "check": "any",
                "requires": (requires or {}).get(name, ()),
            }
        )
        for name, points in checks
    ]
    names = list(dict.fromkeys(name.partition(".")[0] for name, _ in checks))
    criteria = []
    for name in names:
        own = tuple(spec for spec in specs if spec.id.startswith(f"{name}."))
        total = sum((c.points for c in own), Decimal(0))
        criteria.append(CriterionSpec(id=name, title=name.title(), points=total, checks=own))
    total = sum((c.points for c in criteria), Decimal(0))
    lab = LabSpec(id="1", title="Nodes", points=total)
    return Rubric(lab=lab, criteria=tuple(criteria), folder=Path(), text="text")


def plain_check(
    spec: CheckSpec, credit: float | None, reason: str = "", outcome: str = ""
) -> dict[str, Any]:
    """Give a check as it stands in result.json; a credit of None leaves it undecided."""
    if credit is None:
        worked_out = "inconclusive"
    elif credit == 1:
        worked_out = "passed"
    elif credit:
        worked_out = "partial"
    else:
        worked_out = "failed"
    return {
        "id": spec.id,
        "title": spec.title,
        "outcome": outcome or worked_out,
        "earned": float(spec.points) * (credit or 0),
        "possible": float(spec.points),
        "undecided": float(spec.points) if credit is None else 0,
        "reason": reason,
        "hint": "",
    }


def result_of(
    rubric: Rubric, credits: Sequence[float | None], reasons: dict[str, str] | None = None
) -> dict[str, Any]:
    """Give the plain data of a result with some credit for each check, in the rubric's order."""
    given = dict(zip((spec.id for spec in rubric.checks()), credits, strict=True))
    criteria = []
    for criterion in rubric.criteria:
        checks = []
        for spec in criterion.checks:
            checks.append(plain_check(spec, given[spec.id], (reasons or {}).get(spec.id, "")))
        sums = {
            key: sum(check[key] for check in checks) for key in ("earned", "possible", "undecided")
        }
        criteria.append({"id": criterion.id, "title": criterion.title, "checks": checks, **sums})
    score = {}
    for key in ("earned", "possible", "undecided"):
        score[key] = sum(c[key] for c in criteria)
    return {
        "schema": RESULT_SCHEMA,
        "submission": "a",
        "lab": "Lab 1: Nodes",
        "score": score,
        "criteria": criteria,
        "provenance": {"rubric_sha256": rubric.sha256},
    }


def entry_of(name: str, plain: dict[str, Any], *more: Any, **known: Any) -> ClassEntry:
    """Return a student with the result of this plain data."""
    return ClassEntry(name, read_result(json.loads(json_text(plain))), *more, **known)


def entries_of(rubric: Rubric, *credits: Sequence[float | None]) -> list[ClassEntry]:
    """Give a class of students a, b, c, ... with some credit for each check."""
    return [entry_of(chr(97 + n), result_of(rubric, each)) for n, each in enumerate(credits)]

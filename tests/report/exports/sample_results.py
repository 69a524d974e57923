"""Results to export: one with every outcome, real ones of kept recordings, and hostile ones."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from grader.json_text import json_text
from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.report.exports import render_export
from grader.result import Result, read_result, to_json
from tests.report.untrusted_texts import MEGABYTE, hostile

ROOT = Path(__file__).resolve().parents[3]
#: Variables set by Classroom 50's runner.
VARIABLES = {
    "CLASSROOM": "robotics",
    "ASSIGNMENT": "lab",
    "SUBMISSION_TAG": "submit/2026-06-01T14-32-05Z-a1b2c3d",
    "COMMIT_URL": "https://git.example/o/r/commit/1",
    "RELEASE_URL": "https://git.example/o/r/releases/tag/1",
}
#: Keys with a check or a criterion as their value, and keys with values that no student can have
#: written.
_IDS = ("id", "what")
_FIXED = ("schema", "outcome", "kind", "rubric_sha256", "isolation")


def check(name: str, outcome: str, earned: float, possible: float, **more: Any) -> dict[str, Any]:
    """Give a check of `result.json`; points neither decided nor earned are undecided."""
    if outcome in ("inconclusive", "error"):
        undecided = possible - earned
    else:
        undecided = 0
    plain = {
        "id": name,
        "title": f"Title of {name}",
        "outcome": outcome,
        "earned": earned,
        "possible": possible,
        "undecided": undecided,
        "expected": "100 Hz",
        "measured": "90 Hz",
        "reason": "" if outcome == "passed" else f"Reason of {name}.",
        "hint": "" if outcome == "passed" else "Use a timer.",
        "where": [
            {"file": f"{name}.py", "line": 3},
            {"session": "one", "topic": "/a", "start_s": 1.0, "end_s": 2.0},
        ],
        "notes": [],
    }
    return plain | more


def criterion(name: str, *checks: dict[str, Any]) -> dict[str, Any]:
    """Give a criterion of `result.json` with the sums over its checks."""
    sums = {}
    for key in ("earned", "possible", "undecided"):
        sums[key] = sum(each[key] for each in checks)
    return {"id": name, "title": f"Criterion {name}", **sums, "checks": list(checks)}


def result(*criteria: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Give a `result.json` with the sums over its criteria."""
    sums = {}
    for key in ("earned", "possible", "undecided"):
        sums[key] = sum(each[key] for each in criteria)
    plain = {
        "schema": "ros-lab-grader/result/v1",
        "submission": "ann",
        "lab": "Lab 1: One",
        "score": {**sums, "final": sums["earned"]},
        "criteria": list(criteria),
        "adjustments": [],
        "violations": [],
        "advisories": ["It ends twice."],
        "problems": ["two: the recording was cut off."],
        "provenance": {
            "lab": "1",
            "rubric_sha256": "ab" * 32,
            "sessions": {
                "one": {
                    "started_ns": 1_700_000_000_000_000_000,
                    "duration_s": 7.2941,
                    "seed": 1,
                    "isolation": "full",
                },
                "two": {
                    "started_ns": 1_700_000_001_000_000_000,
                    "duration_s": 9.5,
                    "seed": 1,
                    "isolation": "full",
                },
            },
        },
    }
    return plain | more


def read(plain: Mapping[str, Any]) -> Result:
    """Give the result that the file with this plain data is read as."""
    return read_result(plain)


def exported(name: str, plain: Mapping[str, Any], **options: Any) -> str:
    """Give the export of the result with this plain data."""
    return render_export(name, read(plain), **options)


def every_outcome() -> dict[str, Any]:
    """Give a result with every outcome; it earned 7.5 of 20, and 5 are undecided."""
    return result(
        criterion(
            "a", check("a.passed", "passed", 4, 4), check("a.partial", "partial", 2.5, 5, hint="")
        ),
        criterion(
            "b",
            check("b.failed", "failed", 0, 3, where=[]),
            check("b.missed", "not_reached", 0, 2, where=[{"session": "two"}]),
            check("b.open", "inconclusive", 1, 4, reason="The machine was busy."),
            check("b.broken", "error", 0, 2),
        ),
    )


def of_recording(name: str) -> dict[str, Any]:
    """Give the result of a kept recording."""
    return copy.deepcopy(_judged(name))


@cache
def _judged(name: str) -> dict[str, Any]:
    rubric = read_rubric(None)
    recordings = open_recordings(ROOT / "tests/recordings" / name, rubric)
    plain: dict[str, Any] = json.loads(to_json(judge(recordings, rubric)))
    return plain


def with_texts(plain: Any, text_of: Callable[[str, str], str], key: str = "") -> Any:
    """Replace every text, by its key and its old value."""
    if isinstance(plain, str):
        return plain if key in _FIXED else text_of(key, plain)
    if isinstance(plain, Mapping):
        return {each: with_texts(value, text_of, each) for each, value in plain.items()}
    if isinstance(plain, list):
        return [with_texts(value, text_of, key) for value in plain]
    return plain


def adjusted_and_tampered() -> dict[str, Any]:
    """Give a result with adjustments and a violation."""
    plain = every_outcome()
    person = {"who": "prof@lab.example", "when": "2026-06-01"}
    plain["adjustments"] = [
        {
            "kind": "excused",
            "what": "a.partial",
            "points": 2.5,
            "reason": "The handout was wrong.",
            **person,
        },
        {"kind": "points", "what": "b.open", "points": 2, "reason": "Seen in the lab.", **person},
        {
            "kind": "late",
            "what": "score",
            "points": -1,
            "reason": "A day late.",
            "who": "",
            "when": "",
        },
    ]
    plain["violations"] = [
        {
            "kind": "second_server",
            "session": "two",
            "text": "There was a second server.",
            "evidence": ["node /x"],
            "where": {},
            "certain": False,
            "checks": ["b.failed"],
        }
    ]
    plain["score"]["final"] = plain["score"]["earned"] + 3.5
    return plain


@st.composite
def hostile_results(draw: st.DrawFn) -> dict[str, Any]:
    """Give results with hostile texts only; ids differ, as they do in every rubric."""
    texts = draw(st.lists(hostile, min_size=1, max_size=6))
    count = iter(range(10_000))

    def text_of(key: str, text: str) -> str:
        if key in _IDS:
            return f"{texts[0]}{text}"
        return texts[next(count) % len(texts)]

    plain = with_texts(adjusted_and_tampered(), text_of)
    written: dict[str, Any] = json.loads(json_text(plain))
    return written


def megabyte_result() -> dict[str, Any]:
    """Give a result with many remarks, and with texts longer than any sink should take."""
    plain = adjusted_and_tampered()
    plain["advisories"] = plain["advisories"] * 500
    plain["problems"] = plain["problems"] * 500
    long: dict[str, Any] = with_texts(plain, lambda key, text: text if key in _IDS else MEGABYTE)
    return long

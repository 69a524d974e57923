"""`--launch native` grades with the real `launch`, and says the same as the stand-in."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))

from tests.launch_plan.evaluations import ORIGINAL, needs_the_original  # noqa: E402
from tests.plain_results import checks_of  # noqa: E402

pytestmark = [pytest.mark.live, needs_the_original]


def grade(submission: Path, out: Path, launch: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The result and the record of the launch session."""
    if launch == "native":
        found = {"PYTHONPATH": str(ORIGINAL), "AMENT_PREFIX_PATH": str(ORIGINAL / "prefix")}
    else:
        found = {}
    command = [sys.executable, "-m", "grader.cli", str(submission), "-o", str(out)]
    done = subprocess.run(
        [*command, "--sessions", "launch", "--launch", launch],
        capture_output=True,
        text=True,
        env={**os.environ, **found},
        cwd=ROOT,
        timeout=240,
        check=False,
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    (result,) = out.rglob("result.json")
    (record,) = out.rglob("launch/session.json")
    return json.loads(result.read_text()), json.loads(record.read_text())


def plans(record: dict[str, Any]) -> list[dict[str, Any]]:
    """The plans of the session."""
    found = []
    for step in record["steps"]:
        if "plan" in (step.get("result") or {}):
            found.append(step["result"]["plan"])
    assert found
    return found


@pytest.mark.parametrize(
    "submission", ["reference/solution", "fixtures/launch_wrong_executable/submission"]
)
def test_the_real_launch_gives_the_same_plan_and_outcome(submission: str, tmp_path: Path) -> None:
    """The real launch gives the stand-in's processes, parameters, problems and points.

    This goes for a launch file with a mistake too.
    """
    (ours, our_record), (theirs, their_record) = (
        grade(ROOT / submission, tmp_path / launch, launch) for launch in ("standin", "native")
    )
    assert their_record["versions"]["launch"] == "native"
    for plan, other in zip(plans(our_record), plans(their_record), strict=True):
        assert (plan["outcome"], plan["problem"]) == (other["outcome"], other["problem"])
        assert plan["processes"] == other["processes"]
    findings = []
    for result in (ours, theirs):
        findings.append({(c["id"], c["outcome"], c["earned"]) for c in checks_of(result)})
    assert findings[0] == findings[1]

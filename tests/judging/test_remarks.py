"""Remarks that cost nothing, about settings of the session and prefixes of launch files."""

from __future__ import annotations

from pathlib import Path

from grader.judging.remarks import advisories_of
from grader.recording.session import SESSION_VARIABLE, Claim
from launch_plan.format import SCHEMA
from tests.synthetic import Session, submission


def _process(id_: str, **facts: object) -> dict[str, object]:
    return {"id": id_, "path": f"/lib/{id_}", "file": "it.launch.py", "line": 4, **facts}


def test_a_prefix_that_was_left_out_is_named_with_its_line(tmp_path: Path) -> None:
    """The step of the start has the prefix, the plan its place."""
    made = Session(tmp_path).process("xterm-1")
    made.record.plan = {"schema": SCHEMA, "outcome": "ok", "processes": [_process("xterm-1")]}
    made.step("start", "start", processes=["xterm-1"], without_prefix={"xterm-1": "xterm -e"})
    (remark,) = advisories_of([made.recorded()], submission(), [])
    assert remark.startswith("it.launch.py, line 4 starts xterm-1 by the prefix `xterm -e`.")
    assert remark.endswith("That costs no points.")


def test_a_setting_of_the_session_is_named_once(tmp_path: Path) -> None:
    """Only a domain can cost points; its remark promises nothing."""
    made = Session(tmp_path).process()
    for name, value in (("RMW_IMPLEMENTATION", "rmw_x"), ("ROS_DOMAIN_ID", "7")) * 2:
        claim = Claim("it", SESSION_VARIABLE, name, file="it.py", line=3, value=value)
        made.record.claims.append(claim)
    rmw, domain = advisories_of([made.recorded()], submission(), [])
    assert rmw.startswith("it.py, line 3 sets RMW_IMPLEMENTATION to rmw_x.")
    assert rmw.endswith("That costs no points.")
    assert domain.startswith("it.py, line 3 sets ROS_DOMAIN_ID to 7.")
    assert "costs no points" not in domain

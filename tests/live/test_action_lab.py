"""The lab with an action, live: the solution, and servers with mistakes that show late."""

from __future__ import annotations

import sys
from decimal import Decimal
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("test_msgs")
sys.path.append(str(Path(__file__).parents[2]))

from tests.labs.fibonacci.defects import DEFECTS
from tests.labs.fibonacci.record import judged, record
from tests.live.shared_server import scheduler

pytestmark = pytest.mark.live


@pytest.mark.parametrize("name", ["solution", "blocked", "late_cancel"])
def test_a_server_earns_live_what_its_recording_does(name: str, tmp_path: Path) -> None:
    """A right, a wrong and a partly right server earn live the same as in their recordings.

    Points that the machine's delays put in doubt may be open, but are never lost.
    """
    result = judged(record(name, tmp_path, scheduler()))
    assert not result.problems
    lost = {check: Decimal(points) for check, points in DEFECTS[name].lost}
    for check in result.checks:
        if not check.undecided:
            assert check.possible - check.earned == lost.get(check.id, 0), check.reason

"""The scheduler of a single grading."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from grader.live.session.scheduler import LocalScheduler


def test_another_interpreter_has_a_test_of_its_own(tmp_path: Path) -> None:
    """The sandbox is tested with the interpreter of students' code, which is known for sure after its beginning."""
    own = Path(sys.executable)
    other = tmp_path / "python"
    other.symlink_to(own)
    with LocalScheduler(own) as local:
        assert local.for_interpreter(own) is local
        later = local.for_interpreter(other)
        assert later is not local
        assert later.isolation.form is local.isolation.form

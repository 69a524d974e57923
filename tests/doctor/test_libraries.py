"""The libraries that `grade doctor` states for students' programs."""

from __future__ import annotations

import venv
from pathlib import Path

import numpy

from grader.doctor.examination import students_libraries
from grader.doctor.status import Verdict


def test_a_missing_scipy_is_named_with_its_extra(tmp_path: Path) -> None:
    """An environment with NumPy alone gets a warning, with the way to SciPy."""
    venv.create(tmp_path, symlinks=True)
    (packages,) = tmp_path.glob("lib/python*/site-packages")
    found = Path(numpy.__file__).parent
    for part in (found, found.with_name("numpy.libs")):
        (packages / part.name).symlink_to(part)
    status = students_libraries(tmp_path / "bin/python")
    assert status.verdict is Verdict.WARNING
    assert status.found == f"NumPy {numpy.__version__}, SciPy missing"
    assert "ros-lab-grader[scipy]" in status.remedy

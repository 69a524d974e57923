"""The registry of checks."""

from __future__ import annotations

import subprocess
import sys

_LOOK = """\
import sys
from grader.checks.registry import REGISTRY

assert "topic_rate" in REGISTRY
print(*(name for name in sys.modules if name.startswith("grader.checks.")))
"""


def test_only_the_modules_of_used_checks_are_imported() -> None:
    """A grading imports no module for checks of other labs."""
    told = subprocess.run(
        [sys.executable, "-I", "-c", _LOOK], capture_output=True, text=True, check=True
    )
    imported = told.stdout.split()
    assert "grader.checks.publisher" in imported
    assert "grader.checks.transforms" not in imported
    assert "grader.checks.action" not in imported

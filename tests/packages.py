"""The packages that the wheel holds, and their modules."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NAMES = ("confine", "grader", "launch_plan", "ros_bag")


def modules() -> list[Path]:
    """Return the Python files of all packages."""
    return sorted(path for name in NAMES for path in (ROOT / name).rglob("*.py"))

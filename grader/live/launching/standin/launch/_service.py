"""Launching from a script, which is not evaluated, and launch descriptions as text."""

from __future__ import annotations

from typing import Any

from ._base import UnsupportedByStandin


class LaunchService:
    """Runs launch descriptions; here it only says that it does not."""

    def __init__(self, *, argv: Any = None, noninteractive: bool = False, debug: bool = False) -> None:
        self.argv = argv

    def include_launch_description(self, launch_description: Any) -> None:
        """Not evaluated."""
        raise UnsupportedByStandin("launch.LaunchService is not evaluated by this grader", name="launch")

    def run(self, *, shutdown_when_idle: bool = True) -> int:
        """Not evaluated."""
        raise UnsupportedByStandin("launch.LaunchService is not evaluated by this grader", name="launch")


class LaunchIntrospector:
    """Shows launch descriptions to people."""

    def format_launch_description(self, launch_description: Any) -> str:
        """One line for each entity, indented by its depth."""
        return "\n".join(_lines(launch_description, 0))


def _lines(entity: Any, depth: int) -> list[str]:
    lines = [f"{'    ' * depth}{entity.describe()}"]
    for inner in entity.describe_sub_entities() if depth < 20 else []:
        lines += _lines(inner, depth + 1)
    return lines

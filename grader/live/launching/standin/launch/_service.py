"""Launching from a script, which is not evaluated."""

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

"""Stand-in for the ROS 2 package `launch_yaml`."""

from __future__ import annotations

from typing import Any

from launch._catalogue import missing_name
from launch.frontend._parser import Entity, Parser

__all__ = ["Entity", "Parser"]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)

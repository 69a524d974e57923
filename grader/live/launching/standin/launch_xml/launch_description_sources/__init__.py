"""XML launch files as sources of launch descriptions."""

from __future__ import annotations

from typing import Any

from launch._catalogue import missing_name
from launch._sources import XMLLaunchDescriptionSource

__all__ = ["XMLLaunchDescriptionSource"]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)

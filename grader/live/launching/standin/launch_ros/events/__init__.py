"""Events of ROS nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch._catalogue import missing_name_of

from . import lifecycle

__all__ = ["lifecycle", "matches_node_name"]
__getattr__ = missing_name_of(__name__)


def matches_node_name(node_name: str) -> Callable[[Any], bool]:
    """A matcher of one node."""
    wanted = node_name if node_name.startswith("/") else f"/{node_name}"
    return lambda action: bool(action.node_name == wanted)

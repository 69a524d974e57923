"""Events of ROS nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from . import lifecycle


def matches_node_name(node_name: str) -> Callable[[Any], bool]:
    wanted = node_name if node_name.startswith("/") else f"/{node_name}"
    return lambda action: bool(action.node_name == wanted)

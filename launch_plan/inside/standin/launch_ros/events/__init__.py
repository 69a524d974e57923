"""Events of ROS nodes."""

from __future__ import annotations

from . import lifecycle
from .lifecycle import matches_node_name

"""Actions on ROS nodes."""

from __future__ import annotations

from launch._catalogue import exported, missing_name_of

from ._lifecycle import *  # noqa: F403
from ._node import *  # noqa: F403
from ._scopes import *  # noqa: F403

__all__ = exported(__name__)
__getattr__ = missing_name_of(__name__)

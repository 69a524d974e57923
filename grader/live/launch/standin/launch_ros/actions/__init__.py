"""Actions on ROS nodes."""

from __future__ import annotations

from ._lifecycle import *  # noqa: F403
from ._node import *  # noqa: F403
from ._scopes import *  # noqa: F403

"""Actions: what a launch description can do."""

from __future__ import annotations

from ._configurations import *  # noqa: F403
from ._processes import *  # noqa: F403

"""Actions: what a launch description can do."""

from __future__ import annotations

from .._catalogue import exported, missing_name_of
from ._configurations import *  # noqa: F403
from ._processes import *  # noqa: F403

__all__ = exported(__name__)
__getattr__ = missing_name_of(__name__)

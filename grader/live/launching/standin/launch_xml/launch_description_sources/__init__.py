"""XML launch files as sources of launch descriptions."""

from launch._sources import XMLLaunchDescriptionSource

__all__ = ["XMLLaunchDescriptionSource"]

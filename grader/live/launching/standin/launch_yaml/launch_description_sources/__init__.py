"""YAML launch files as sources of launch descriptions."""

from launch._sources import YAMLLaunchDescriptionSource

__all__ = ["YAMLLaunchDescriptionSource"]

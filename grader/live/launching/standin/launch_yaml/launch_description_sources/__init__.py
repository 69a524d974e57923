"""YAML launch files as sources of launch descriptions."""

from launch._catalogue import missing_name_of
from launch._sources import YAMLLaunchDescriptionSource

__all__ = ["YAMLLaunchDescriptionSource"]
__getattr__ = missing_name_of(__name__)

"""Stand-in for the ROS 2 package `launch_yaml`."""

from launch._catalogue import missing_name_of
from launch.frontend._parser import Entity, Parser

__all__ = ["Entity", "Parser"]
__getattr__ = missing_name_of(__name__)

"""Starts the talker."""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Return the node."""
    return LaunchDescription([Node(package="c_talker", executable="talker", output="screen")])

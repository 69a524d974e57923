"""Starts the camera's mount, the arm's frames and the listener."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    """Describe the three nodes and the argument."""
    camera = {"camera_frame": LaunchConfiguration("camera")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("camera", default_value="camera_link", description="name of the camera's frame"),
            Node(
                package="frames_lab",
                executable="camera_mount",
                name="camera_mount",
                output="screen",
                parameters=[camera],
            ),
            Node(package="frames_lab", executable="arm_broadcaster", name="arm_broadcaster", output="screen"),
            Node(
                package="frames_lab",
                executable="target_listener",
                name="target_listener",
                output="screen",
                parameters=[camera],
            ),
        ]
    )

"""Starts the controller, slowly."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    speed = ParameterValue(LaunchConfiguration("max_speed"), value_type=float)
    return LaunchDescription(
        [
            DeclareLaunchArgument("max_speed", default_value="0.3"),
            Node(
                package="go_to_goal_lab",
                executable="go_to_goal",
                name="go_to_goal",
                output="screen",
                parameters=[{"max_speed": speed}],
            ),
        ]
    )

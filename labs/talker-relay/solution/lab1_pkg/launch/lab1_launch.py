"""Starts the talker and the relay; `v:=2.0 d:=0.1` gives the talker other values."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    talker = Node(
        package="lab1_pkg",
        executable="talker",
        name="talker",
        output="screen",
        parameters=[{"v": LaunchConfiguration("v"), "d": LaunchConfiguration("d")}],
    )
    relay = Node(package="lab1_pkg", executable="relay", name="relay", output="screen")
    return LaunchDescription(
        [
            DeclareLaunchArgument("v", default_value="1.0", description="speed in m/s"),
            DeclareLaunchArgument("d", default_value="0.2", description="steering angle in rad"),
            talker,
            relay,
        ]
    )

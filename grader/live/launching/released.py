"""Packages of ROS that launch files start nodes of, and that are not where the grader runs."""

from __future__ import annotations

import re

# Packages that a ROS machine has or can install, and that are not here: what a launch file starts of them is
# noted and not started, and a file of theirs cannot be read.
_RELEASED = re.compile(
    r"rviz2|rviz_.*|robot_state_publisher|joint_state_publisher(_gui)?|rclcpp_components|rclcpp_lifecycle|rclpy_components"
    r"|turtlesim|turtle_tf2_.*|demo_nodes_(cpp|py)|examples_.*|composition|lifecycle(_py)?|image_tools|tf2_ros(_py)?"
    r"|tf2_tools|xacro|rqt.*|teleop_twist_(keyboard|joy)|joy(_linux|_teleop)?|twist_(mux|stamper)|topic_tools"
    r"|ros2(bag|cli|topic|node|service|param|launch|run)|rosbag2.*|rosbridge_.*|rosapi|foxglove_bridge|plotjuggler(_ros)?"
    r"|ros_(gz|ign)(_.*)?|gz_ros2_control|ign_ros2_control|gazebo_(ros|plugins|msgs).*|webots_ros2.*|controller_manager"
    r"|ros2_control.*|ros2_controllers.*|.*_controllers?|joint_state_broadcaster|nav2_.*|navigation2|slam_toolbox"
    r"|cartographer_ros|robot_localization|moveit.*|ur_(robot_driver|description|moveit_config|simulation_gz)|franka_.*"
    r"|turtlebot[34].*|urdf_(tutorial|launch)|usb_cam|v4l2_camera|realsense2_.*|velodyne.*|depthimage_to_laserscan"
    r"|image_(proc|view|transport|publisher)|apriltag_ros|cv_bridge|pcl_ros|robot_calibration|diagnostic_aggregator"
    r"|action_tutorials_(cpp|py)|dummy_robot_bringup|dummy_.*|micro_ros_agent|domain_bridge|imu_tools|imu_filter_madgwick"
)


def is_released(package: str) -> bool:
    """Whether a package of this name can be had on a ROS machine."""
    return _RELEASED.fullmatch(package) is not None

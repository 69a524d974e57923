"""Start publisher, subscriber and service together.

Use: `ros2 launch physical_ai_textbook robot_launch.py use_sim:=false control_rate:=50.0`
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

PACKAGE = "physical_ai_textbook"


def generate_launch_description():
    """Describe the two arguments and the three nodes."""
    # A launch argument is always a string. Stating the type here makes `control_rate:=50` a float as well,
    # which the publisher insists on.
    use_sim = ParameterValue(LaunchConfiguration("use_sim"), value_type=bool)
    control_rate = ParameterValue(LaunchConfiguration("control_rate"), value_type=float)

    return LaunchDescription(
        [
            # Simulation time makes timers wait for /clock. Without a simulator the publisher stays silent.
            DeclareLaunchArgument("use_sim", default_value="true", description="use simulation time"),
            DeclareLaunchArgument(
                "control_rate", default_value="100.0", description="control loop rate in Hz"
            ),
            Node(
                package=PACKAGE,
                executable="joint_publisher",
                name="joint_command_publisher",
                output="screen",
                parameters=[{"use_sim_time": use_sim, "publish_rate": control_rate}],
            ),
            Node(
                package=PACKAGE,
                executable="joint_subscriber",
                name="joint_state_subscriber",
                output="screen",
                parameters=[{"use_sim_time": use_sim}],
            ),
            # The service answers when asked and has no timers, so it needs no simulation time.
            Node(
                package=PACKAGE,
                executable="robot_service",
                name="robot_mode_service",
                output="screen",
                parameters=[{"max_velocity": 1.5, "safety_enabled": True}],
            ),
        ]
    )

# Lab 09-01, part 4: launch file
# Alice M.

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    use_sim_arg = DeclareLaunchArgument(
        'use_sim', default_value='true', description='use simulation time')

    control_rate_arg = DeclareLaunchArgument(
        'control_rate', default_value='100.0', description='control loop rate in Hz')

    publisher = Node(
        package='physical_ai_textbook',
        executable='joint_publisher',
        name='joint_command_publisher',
        output='screen',
        parameters=[{'use_sim_time': LaunchConfiguration('use_sim')}],
    )

    subscriber = Node(
        package='physical_ai_textbook',
        executable='joint_subscriber',
        name='joint_state_subscriber',
        output='screen',
        parameters=[{'use_sim_time': LaunchConfiguration('use_sim')}],
    )

    service = Node(
        package='physical_ai_textbook',
        executable='robot_service',
        name='robot_mode_service',
        output='screen',
        parameters=[{
            'max_velocity': 1.5,
            'safety_enabled': True,
        }],
    )

    return LaunchDescription([
        use_sim_arg,
        control_rate_arg,
        publisher,
        subscriber,
        service,
    ])

"""Launch files in the manner of students' repositories, each with the plan that ROS 2 Jazzy gives it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tests.launch_plan.launch_cases import Case

PARAMS = """\
/**:
  ros__parameters:
    use_sim_time: true
talker:
  ros__parameters:
    rate: 10.0
    limits:
      upper: 2
robot1:
  talker:
    ros__parameters:
      rate: 20.0
"""


def python(
    name: str,
    text: str,
    /,
    _files: Mapping[str, str] | None = None,
    _arguments: Any = None,
    **more: Any,
) -> Case:
    """A case that is a Python launch file."""
    expect = {"outcome": "ok", **more.pop("expect", {})}
    return Case(name, text, expect, _arguments or {}, _files or {})


BRINGUP = python(
    "bringup of nav2's style: a stack of declared arguments, a group with conditions, a remapped set",
    """\
import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node, PushRosNamespace, SetParameter
from launch_ros.descriptions import ParameterFile


def generate_launch_description():
    bringup_dir = get_package_share_directory('demo')
    namespace = LaunchConfiguration('namespace')
    use_namespace = LaunchConfiguration('use_namespace')
    use_composition = LaunchConfiguration('use_composition')
    params_file = LaunchConfiguration('params_file')
    log_level = LaunchConfiguration('log_level')
    lifecycle_nodes = ['talker', 'listener']
    remappings = [('/tf', 'tf'), ('/tf_static', 'tf_static')]
    configured_params = ParameterFile(os.path.join(os.path.dirname(__file__), 'params.yaml'), allow_substs=True)

    stdout_linebuf_envvar = SetEnvironmentVariable('RCUTILS_LOGGING_BUFFERED_STREAM', '1')
    load_nodes = GroupAction(
        condition=IfCondition(PythonExpression(['not ', use_composition])),
        actions=[
            SetParameter('use_sim_time', LaunchConfiguration('use_sim_time')),
            PushRosNamespace(condition=IfCondition(use_namespace), namespace=namespace),
            Node(
                package='demo', executable='talker', output='screen', respawn=True, respawn_delay=2.0,
                parameters=[configured_params], arguments=['--ros-args', '--log-level', log_level],
                remappings=remappings),
            Node(
                package='demo', executable='listener', name='lifecycle_manager', output='screen',
                arguments=['--ros-args', '--log-level', log_level],
                parameters=[{'autostart': True}, {'node_names': lifecycle_nodes}]),
        ],
    )
    ld = LaunchDescription()
    ld.add_action(stdout_linebuf_envvar)
    for name, default in (('namespace', ''), ('use_namespace', 'false'), ('use_sim_time', 'false'),
                          ('params_file', os.path.join(bringup_dir, 'params', 'nav2_params.yaml')),
                          ('use_composition', 'False'), ('log_level', 'info')):
        ld.add_action(DeclareLaunchArgument(name, default_value=default))
    ld.add_action(load_nodes)
    return ld
""",
    {"params.yaml": "talker:\n  ros__parameters:\n    level: $(var log_level)\n"},
    _arguments={"namespace": "robot1", "use_namespace": "true", "use_sim_time": "true"},
    expect={
        "len processes": 2,
        "processes.0.argv": [
            "--ros-args", "--log-level", "info", "--ros-args", "-r", "__ns:=/robot1", "-p", "use_sim_time:=True",
            "--params-file", "{parameters}/params_1.yaml", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static",
        ],
        "processes.0.respawn_delay_s": 2.0,
        "processes.0.env": {"RCUTILS_LOGGING_BUFFERED_STREAM": "1"},
        "parameter_files.params_1|yaml": "talker:\n  ros__parameters:\n    level: info\n",
        "parameter 1 node_names": ["talker", "listener"],
        "processes.1.namespace": "/robot1",
    },
)  # fmt: skip

MULTISIM = python(
    "the tutorial of the turtles",
    """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([
        Node(package='turtlesim', namespace='turtlesim1', executable='turtlesim_node', name='sim'),
        Node(package='turtlesim', namespace='turtlesim2', executable='turtlesim_node', name='sim'),
        Node(
            package='turtlesim',
            executable='mimic',
            name='mimic',
            remappings=[
                ('/input/pose', '/turtlesim1/turtle1/pose'),
                ('/output/cmd_vel', '/turtlesim2/turtle1/cmd_vel'),
            ]
        )
    ])
""",
    expect={
        "len processes": 3,
        "processes.0.absent has": "turtlesim",
        "processes.1.namespace": "/turtlesim2",
        "processes.2.remappings.0": ["/input/pose", "/turtlesim1/turtle1/pose"],
        "warnings": [],
    },
)

EXAMPLE_SUBSTITUTIONS = python(
    "the tutorial of the substitutions",
    """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, TimerAction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

def generate_launch_description():
    turtlesim_ns = LaunchConfiguration('turtlesim_ns')
    use_provided_red = LaunchConfiguration('use_provided_red')
    new_background_r = LaunchConfiguration('new_background_r')
    spawn_turtle = ExecuteProcess(
        cmd=[[
            'ros2 service call ',
            turtlesim_ns,
            '/spawn ',
            'turtlesim/srv/Spawn ',
            '"{x: 2, y: 2, theta: 0.2}"'
        ]],
        shell=True
    )
    change = ExecuteProcess(
        cmd=[['ros2 param set ', turtlesim_ns, '/sim background_r ', '120']], shell=True)
    conditioned = ExecuteProcess(
        condition=IfCondition(PythonExpression([new_background_r, ' == 200', ' and ', use_provided_red])),
        cmd=[['ros2 param set ', turtlesim_ns, '/sim background_r ', new_background_r]], shell=True)
    return LaunchDescription([
        DeclareLaunchArgument('turtlesim_ns', default_value='turtlesim1'),
        DeclareLaunchArgument('use_provided_red', default_value='False'),
        DeclareLaunchArgument('new_background_r', default_value='200'),
        Node(package='turtlesim', namespace=turtlesim_ns, executable='turtlesim_node', name='sim'),
        spawn_turtle,
        change,
        TimerAction(period=2.0, actions=[conditioned]),
    ])
""",
    _arguments={"use_provided_red": "True", "new_background_r": "200"},
    expect={
        "len processes": 4,
        "processes.1.path": 'ros2 service call turtlesim1/spawn turtlesim/srv/Spawn "{x: 2, y: 2, theta: 0.2}"',
        "processes.1.shell": True,
        "processes.3.when": {"after_s": 2.0},
        "processes.3.path": "ros2 param set turtlesim1/sim background_r 200",
    },
)

EVENT_HANDLERS = python(
    "the tutorial of the event handlers",
    """\
from launch import LaunchDescription
from launch.actions import EmitEvent, ExecuteProcess, LogInfo, RegisterEventHandler, TimerAction
from launch.event_handlers import OnExecutionComplete, OnProcessExit, OnProcessIO, OnProcessStart, OnShutdown
from launch.events import Shutdown
from launch.substitutions import EnvironmentVariable, FindExecutable, LocalSubstitution
from launch_ros.actions import Node

def generate_launch_description():
    sim = Node(package='demo', executable='talker', name='sim')
    spawn = ExecuteProcess(cmd=[[FindExecutable(name='sh'), ' -c true']], shell=True)
    change = ExecuteProcess(cmd=['sh', '-c', 'true'])
    return LaunchDescription([
        sim,
        RegisterEventHandler(OnProcessStart(target_action=sim, on_start=[LogInfo(msg='started, spawning'), spawn])),
        RegisterEventHandler(OnProcessIO(
            target_action=spawn, on_stdout=lambda event: LogInfo(msg=event.text.decode().strip()))),
        RegisterEventHandler(OnExecutionComplete(
            target_action=spawn, on_completion=[LogInfo(msg='Spawn finished'), change])),
        RegisterEventHandler(OnProcessExit(target_action=sim, on_exit=[
            LogInfo(msg=[EnvironmentVariable(name='NO_USER', default_value='nobody'), ' closed the window']),
            EmitEvent(event=Shutdown(reason='Window closed'))])),
        RegisterEventHandler(OnShutdown(on_shutdown=[
            LogInfo(msg=['Launch was asked to shutdown: ', LocalSubstitution('event.reason')])])),
    ])
""",
    expect={
        "processes.0.id": "talker-1",
        "processes.1.when": {"on_start_of": "talker-1"},
        "logs.0.message": "started, spawning",
        "logs.1.message": "nobody closed the window",
        "logs.2.message": "Spawn finished",
        "processes.2.when": {"on_exit_of": "sh -c true-2"},
        "logs.3.message": "Launch was asked to shutdown: Window closed",
        "shutdowns.0.when": {"on_exit_of": "talker-1"},
    },
)

LOOP = python(
    "robots in a loop, each in a group of its own",
    """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, PushRosNamespace

ROBOTS = [{'name': 'robot1', 'x': 0.0}, {'name': 'robot2', 'x': 1.5}]

def launch_setup(context, *args, **kwargs):
    count = int(context.launch_configurations['count'])
    actions = []
    for robot in ROBOTS[:count]:
        actions.append(GroupAction([
            PushRosNamespace(robot['name']),
            Node(package='demo', executable='talker', name='talker', output='screen',
                 parameters=[{'x': robot['x'], 'frame': robot['name'] + '/base'}],
                 remappings=[('/tf', 'tf')]),
        ]))
    return actions

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('count', default_value='2'),
        OpaqueFunction(function=launch_setup),
        Node(package='demo', executable='listener'),
    ])
""",
    expect={
        "len processes": 3,
        "processes.0.namespace": "/robot1",
        "processes.1.namespace": "/robot2",
        "processes.1.argv.2": "__node:=talker",
        "parameter_files.talker_2|yaml": "/robot2/talker:\n  ros__parameters:\n    frame: robot2/base\n    x: 1.5\n",
        "processes.2.namespace": None,
    },
)

NAMESPACED_PARAMS = python(
    "one parameter file for nodes in and out of a namespace",
    """\
import os
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    config = os.path.join(os.path.dirname(os.path.realpath(__file__)), 'config', 'params.yaml')
    return LaunchDescription([
        Node(package='demo', executable='talker', name='talker', parameters=[config]),
        Node(package='demo', executable='talker', name='talker', namespace='robot1', parameters=[config]),
        Node(package='demo', executable='talker', name='other', parameters=[config, {'rate': 5.0}]),
    ])
""",
    {"config/params.yaml": PARAMS},
    expect={
        "len processes": 3,
        "effective 0": {"use_sim_time": True, "rate": 10.0, "limits.upper": 2},
        "effective 1": {"use_sim_time": True, "rate": 20.0},
        "effective 2": {"use_sim_time": True, "rate": 5.0},
    },
)

MEDLEY = [
    python(
        "everything by star imports and by module names at once",
        """\
from launch import *
from launch.actions import *
from launch_ros.actions import *
import launch
import launch_ros.actions

def generate_launch_description():
    return launch.LaunchDescription([
        launch.actions.DeclareLaunchArgument(name='who', default_value='world', description='whom to greet'),
        launch_ros.actions.Node(
            package='demo', executable='talker', name='node',
            parameters=[{'who': launch.substitutions.LaunchConfiguration('who')}]),
        LogInfo(msg=launch.substitutions.LaunchConfiguration('who')),
    ])
""",
        expect={
            "parameter 0 who": "world",
            "arguments.0.description": "whom to greet",
            "logs.0.message": "world",
        },
    ),
    python(
        "actions added one by one, an argument used before it is declared",
        """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

def generate_launch_description():
    ld = LaunchDescription()
    node = Node(package='demo', executable='talker', name=LaunchConfiguration('name'))
    ld.add_action(node)
    ld.add_action(DeclareLaunchArgument('name', default_value='late'))
    return ld
""",
        expect={"outcome": "error", "problem.kind": "undefined_configuration", "problem.line": 8},
    ),
    python(
        "xacro that is not here, in a command that is resolved only when launching",
        """\
from launch import LaunchDescription
from launch.substitutions import Command, FindExecutable, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

def generate_launch_description():
    robot_description_content = Command([
        PathJoinSubstitution([FindExecutable(name='cat')]), ' ',
        PathJoinSubstitution([FindPackageShare('demo'), 'urdf', 'robot.urdf'])])
    robot_description = {'robot_description': ParameterValue(robot_description_content, value_type=str)}
    return LaunchDescription([
        Node(package='robot_state_publisher', executable='robot_state_publisher', parameters=[robot_description]),
    ])
""",
        expect={"outcome": "error", "problem.kind": "command_failed"},
    ),
    python(
        "gazebo, which is not here, beside one's own node",
        """\
import os
from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node

def generate_launch_description():
    pkg_gazebo_ros = get_package_share_directory('gazebo_ros')
    gazebo = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(os.path.join(pkg_gazebo_ros, 'launch', 'gazebo.launch.py')))
    return LaunchDescription([gazebo, Node(package='demo', executable='talker')])
""",
        expect={
            "outcome": "not_assessable",
            "problem.kind": "missing_package",
            "problem.module": "gazebo_ros",
            "problem.line": 9,
        },
    ),
    python(
        "gazebo by FindPackageShare",
        """\
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

def generate_launch_description():
    return LaunchDescription([
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource([PathJoinSubstitution([FindPackageShare('ros_gz_sim'), 'launch',
                                                                 'gz_sim.launch.py'])]),
            launch_arguments={'gz_args': '-r empty.sdf'}.items(),
        ),
    ])
""",
        expect={"outcome": "not_assessable", "problem.module": "ros_gz_sim"},
    ),
    python(
        "a spawner after the end of another, and rviz behind a condition",
        """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, RegisterEventHandler
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

def generate_launch_description():
    gui = LaunchConfiguration('gui')
    broadcaster = Node(package='controller_manager', executable='spawner', arguments=['joint_state_broadcaster'])
    rviz = Node(package='rviz2', executable='rviz2', name='rviz2', output='log', condition=IfCondition(gui))
    delay_rviz = RegisterEventHandler(event_handler=OnProcessExit(target_action=broadcaster, on_exit=[rviz]))
    return LaunchDescription(
        [DeclareLaunchArgument('gui', default_value='true', description='start RViz2')] +
        [broadcaster, delay_rviz])
""",
        expect={
            "processes.0.id": "spawner-1",
            "processes.1.when": {"on_exit_of": "spawner-1"},
            "processes.1.absent has": "rviz2",
            "processes.1.condition_note has": "holds",
        },
    ),
    python(
        "an argument chosen in Python by the environment",
        """\
import os
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

MODEL = os.environ.get('NO_SUCH_MODEL', 'burger')

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('model', default_value=MODEL, choices=['burger', 'waffle']),
        DeclareLaunchArgument('user', default_value=[EnvironmentVariable('NO_SUCH_USER', default_value='me'), '_x']),
        Node(package='demo', executable='talker', name=['node_', LaunchConfiguration('model')],
             namespace=LaunchConfiguration('user')),
    ])
""",
        expect={"processes.0.name": "node_burger", "processes.0.namespace": "/me_x"},
    ),
    python(
        "context.launch_configurations is read where an argument was never declared",
        """\
from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

def setup(context):
    return [Node(package='demo', executable='talker', name=context.launch_configurations['name'])]

def generate_launch_description():
    return LaunchDescription([OpaqueFunction(function=setup)])
""",
        expect={
            "outcome": "error",
            "problem.kind": "undefined_configuration",
            "problem.line": 6,
            "problem.message has": "launch configuration 'name'",
        },
    ),
    python(
        "an argument that is always text, compared as a bool in Python",
        """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

def setup(context):
    sim = LaunchConfiguration('sim').perform(context)
    nodes = [Node(package='demo', executable='talker')]
    if sim:
        nodes.append(Node(package='demo', executable='listener'))
    return nodes

def generate_launch_description():
    return LaunchDescription([DeclareLaunchArgument('sim', default_value='false'), OpaqueFunction(function=setup)])
""",
        expect={"len processes": 2},
    ),
    python(
        "parameters loaded from YAML in Python and given as a dict",
        """\
import os
import yaml
from launch import LaunchDescription
from launch_ros.actions import Node

def load(name):
    with open(os.path.join(os.path.dirname(__file__), name)) as file:
        return yaml.safe_load(file)

def generate_launch_description():
    params = load('params.yaml')['talker']['ros__parameters']
    return LaunchDescription([Node(package='demo', executable='talker', name='talker', parameters=[params])])
""",
        {"params.yaml": PARAMS},
        expect={"parameter 0 rate": 10.0, "parameter 0 limits.upper": 2},
    ),
    python(
        "a whole parameter file given as a dict, which makes names of its levels",
        """\
import os
import yaml
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    with open(os.path.join(os.path.dirname(__file__), 'params.yaml')) as file:
        params = yaml.safe_load(file)
    return LaunchDescription([Node(package='demo', executable='talker', parameters=[params])])
""",
        {"params.yaml": "talker:\n  ros__parameters:\n    rate: 10.0\n"},
        expect={"parameter 0 talker.ros__parameters.rate": 10.0},
    ),
    python(
        "the file's own name is used as the path of the package",
        """\
from pathlib import Path
from launch import LaunchDescription
from launch_ros.actions import Node

HERE = Path(__file__).resolve().parent

def generate_launch_description():
    return LaunchDescription([
        Node(package='demo', executable='talker', parameters=[str(HERE / 'params.yaml')], output='screen',
             emulate_tty=True, arguments=['--ros-args', '--log-level', 'DEBUG']),
    ])
""",
        {"params.yaml": PARAMS},
        expect={"processes.0.emulate_tty": True, "processes.0.output": "screen", "warnings": []},
    ),
    python(
        "a python script by ExecuteProcess",
        """\
import os
from launch import LaunchDescription
from launch.actions import ExecuteProcess

def generate_launch_description():
    script = os.path.join(os.path.dirname(__file__), 'joint_publisher.py')
    return LaunchDescription([ExecuteProcess(cmd=['python3', script], output='screen', name='publisher')])
""",
        {"joint_publisher.py": ""},
        expect={"processes.0.id": "publisher-1", "processes.0.argv.0 ends": "/joint_publisher.py"},
    ),
    python(
        "ros2 run by ExecuteProcess, with the name as a rule",
        """\
from launch import LaunchDescription
from launch.actions import ExecuteProcess

def generate_launch_description():
    return LaunchDescription([
        ExecuteProcess(cmd=['ros2', 'run', 'demo', 'talker', '--ros-args', '-r', '__node:=t', '-p', 'rate:=5.0']),
        ExecuteProcess(cmd='ros2 run demo listener'.split(), output='screen'),
    ])
""",
        expect={
            "processes.0.argv": [
                "run",
                "demo",
                "talker",
                "--ros-args",
                "-r",
                "__node:=t",
                "-p",
                "rate:=5.0",
            ]
        },
    ),
    python(
        "rosbag and a topic, as extra processes",
        """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('record', default_value='false'),
        DeclareLaunchArgument('bag', default_value='/tmp/bag'),
        ExecuteProcess(cmd=['ros2', 'bag', 'record', '-a', '-o', LaunchConfiguration('bag')],
                       condition=IfCondition(LaunchConfiguration('record'))),
    ])
""",
        _arguments={"record": "true", "bag": "/tmp/other"},
        expect={"processes.0.argv": ["bag", "record", "-a", "-o", "/tmp/other"]},
    ),
    python(
        "an included file with its own arguments, twice, and what leaks",
        """\
import os
from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription, LogInfo
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

HERE = os.path.dirname(__file__)

def robot(name):
    return IncludeLaunchDescription(
        PythonLaunchDescriptionSource(os.path.join(HERE, 'robot.launch.py')), launch_arguments={'name': name}.items())

def generate_launch_description():
    return LaunchDescription([
        GroupAction([robot('a')]), LogInfo(msg=LaunchConfiguration('name', default='nothing')),
        robot('b'), LogInfo(msg=LaunchConfiguration('name', default='nothing'))])
""",
        {
            "robot.launch.py": (
                "from launch import LaunchDescription\nfrom launch.actions import DeclareLaunchArgument\n"
                "from launch.substitutions import LaunchConfiguration\nfrom launch_ros.actions import Node\n"
                "def generate_launch_description():\n    return LaunchDescription([\n"
                "        DeclareLaunchArgument('name', default_value='robot'),\n"
                "        Node(package='demo', executable='talker', name=LaunchConfiguration('name'))])\n"
            )
        },
        expect={
            "processes.0.name": "a",
            "processes.1.name": "b",
            "logs.0.message": "nothing",
            "logs.1.message": "b",
            "len includes": 2,
            "arguments.0.included": True,
        },
    ),
    python(
        "a static transform the old and the new way",
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([
        Node(package='tf2_ros', executable='static_transform_publisher',
             arguments=['0', '0', '0.1', '0', '0', '0', 'base_link', 'laser']),
        Node(package='tf2_ros', executable='static_transform_publisher', name='camera',
             arguments=['--x', str(0.2), '--frame-id', 'base_link', '--child-frame-id', 'camera']),
    ])
""",
        expect={"processes.0.argv.0": "0", "processes.1.argv.1": "0.2", "len processes": 2},
    ),
    python(
        "numbers among the arguments",
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([
        Node(
            package='tf2_ros',
            executable='static_transform_publisher',
            arguments=[0, 0, 0.1, 0, 0, 0, 'base_link', 'laser']),
    ])
""",
        expect={"outcome": "error", "problem.kind": "bad_text", "problem.line": 6},
    ),
    python(
        "two executables for one node's name",
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    nodes = [Node(package='demo', executable=executable, name='node', namespace='')
             for executable in ('talker', 'listener')]
    return LaunchDescription(nodes)
""",
        expect={"len processes": 2, "len warnings": 1, "warnings.0.message has": "'/node'"},
    ),
    python(
        "a helper that makes nodes, with keywords from a dict",
        """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

COMMON = dict(package='demo', output='screen', parameters=[{'use_sim_time': LaunchConfiguration('use_sim_time')}])

def make(executable, **more):
    return Node(executable=executable, **{**COMMON, **more})

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('use_sim_time', default_value='False'),
        make('talker', name='a'), make('listener', parameters=COMMON['parameters'] + [{'rate': 5}])])
""",
        expect={
            "parameter 0 use_sim_time": False,
            "parameter 1 use_sim_time": False,
            "parameter 1 rate": 5,
            "processes.0.line": 9,
        },
    ),
    python(
        "both kinds of condition with words of Python",
        """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

def generate_launch_description():
    mode = LaunchConfiguration('mode')
    is_sim = PythonExpression(["'", mode, "' == 'sim'"])
    return LaunchDescription([
        DeclareLaunchArgument('mode', default_value='sim'),
        Node(package='demo', executable='talker', condition=IfCondition(is_sim)),
        Node(package='demo', executable='listener', condition=UnlessCondition(is_sim)),
        Node(package='demo', executable='listener', name='fast',
             condition=IfCondition(PythonExpression(["'", mode, "' in ['real', 'fast']"]))),
    ])
""",
        _arguments={"mode": "fast"},
        expect={
            "len processes": 2,
            "processes.0.executable": "listener",
            "processes.1.name": "fast",
        },
    ),
    python(
        "a condition on an argument that says yes",
        """\
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('sim', default_value='yes'),
        Node(package='demo', executable='talker', condition=IfCondition(LaunchConfiguration('sim')))])
""",
        expect={"outcome": "error", "problem.kind": "bad_condition", "problem.line": 10},
    ),
    python(
        "chained with timers, as students wait for a simulator",
        """\
from launch import LaunchDescription
from launch.actions import TimerAction
from launch_ros.actions import Node

def generate_launch_description():
    first = Node(package='demo', executable='talker')
    second = TimerAction(period=3.0, actions=[Node(package='demo', executable='listener')])
    third = TimerAction(period=5.0, actions=[Node(package='demo', executable='listener', name='third'), second])
    return LaunchDescription([first, third])
""",
        expect={"processes.1.when": {"after_s": 5.0}, "processes.2.when": {"after_s": 8.0}},
    ),
    python(
        "a lone function, not called generate_launch_description, in camel case",
        "from launch import LaunchDescription\n\ndef generateLaunchDescription():\n    return LaunchDescription([])\n",
        expect={"outcome": "error", "problem.kind": "no_generate_function"},
    ),
    python(
        "a return inside the loop, which starts one node only",
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    for executable in ['talker', 'listener']:
        return LaunchDescription([Node(package='demo', executable=executable)])
""",
        expect={"len processes": 1},
    ),
    python(
        "a trailing comma that makes a tuple of a node",
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    talker = Node(package='demo', executable='talker'),
    return LaunchDescription([talker])
""",
        expect={
            "outcome": "error",
            "problem.kind": "not_an_action",
            "problem.message has": "tuple",
        },
    ),
    python(
        "nodes without a list around them",
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription(Node(package='demo', executable='talker'))
""",
        expect={"outcome": "error", "problem.kind": "not_a_list", "problem.line": 5},
    ),
    python(
        "nodes given one after the other without a list",
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription(
        Node(package='demo', executable='talker'),
        Node(package='demo', executable='listener'))
""",
        expect={"outcome": "error", "problem.kind": "positional_argument"},
    ),
    python(
        "an executable with its ending, as the file is called",
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([Node(package='demo', executable='listener.py')])
""",
        expect={
            "outcome": "error",
            "problem.kind": "unknown_executable",
            "problem.message has": "did you mean 'listener'",
        },
    ),
    python(
        "ROS 1's habits: type=, args=",
        """\
from launch import LaunchDescription
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([Node(package='demo', executable='talker', args=['-v'])])
""",
        expect={
            "outcome": "error",
            "problem.kind": "unknown_keyword",
            "problem.remedy has": "'arguments='",
        },
    ),
    python(
        "the launch service run from the file itself, under a guard",
        """\
import sys
from launch import LaunchDescription, LaunchService
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([Node(package='demo', executable='talker')])

def main(argv=sys.argv[1:]):
    service = LaunchService(argv=argv)
    service.include_launch_description(generate_launch_description())
    return service.run()

if __name__ == '__main__':
    sys.exit(main())
""",
        expect={"len processes": 1},
    ),
]

MARKUP = [
    Case(
        "XML of a student: arguments, groups of robots, a parameter file",
        """\
<?xml version="1.0"?>
<launch>
  <!-- the robots -->
  <arg name="use_sim_time" default="true" description="simulation time"/>
  <arg name="config" default="$(dirname)/params.yaml"/>
  <group>
    <push_ros_namespace namespace="robot1"/>
    <node pkg="demo" exec="talker" name="talker" output="screen">
      <param from="$(var config)"/>
      <param name="use_sim_time" value="$(var use_sim_time)"/>
      <remap from="/tf" to="tf"/>
    </node>
  </group>
  <node pkg="demo" exec="listener" if="$(eval '$(var use_sim_time)')" respawn="true" respawn_delay="1.5"/>
</launch>
""",
        {
            "outcome": "error",
            "problem.kind": "bad_expression",
            "problem.line": 14,
            "problem.message has": "name 'true' is not defined",
        },
        files={"params.yaml": PARAMS},
        filename="robots.launch.xml",
    ),
    Case(
        "XML that includes Python with an argument of the outer file",
        """\
<launch>
  <arg name="name" default="outer"/>
  <include file="$(dirname)/robot.launch.py">
    <arg name="name" value="$(var name)_inner"/>
  </include>
  <executable cmd="echo $(var name)" output="screen" shell="true"/>
</launch>
""",
        {"outcome": "ok", "processes.0.name": "outer_inner", "processes.1.argv": ["outer_inner"]},
        files={
            "robot.launch.py": (
                "from launch import LaunchDescription\nfrom launch.substitutions import LaunchConfiguration\n"
                "from launch_ros.actions import Node\ndef generate_launch_description():\n"
                "    return LaunchDescription([Node(package='demo', executable='talker', "
                "name=LaunchConfiguration('name'))])\n"
            )
        },
        filename="robots.launch.xml",
    ),
    Case(
        "YAML of a student",
        """\
launch:

# arguments
- arg:
    name: "rate"
    default: "50.0"
- arg: {name: "ns", default: "robot"}

- group:
  - push_ros_namespace: {namespace: "$(var ns)"}
  - node:
      pkg: "demo"
      exec: "talker"
      name: "talker"
      output: "screen"
      param:
      - name: "rate"
        value: $(var rate)
      - from: "$(dirname)/params.yaml"
      remap:
      - {from: "/a", to: "/b"}
- node: {pkg: "demo", exec: "listener", namespace: "other"}
""",
        {
            "outcome": "ok",
            "processes.0.namespace": "/robot",
            "parameter 0 rate": 50.0,
            "processes.0.remappings": [["/a", "/b"]],
            "processes.1.namespace": "/other",
            "processes.1.line": 22,
        },
        files={"params.yaml": PARAMS},
        filename="robots.launch.yaml",
    ),
]

CASES = [
    BRINGUP,
    MULTISIM,
    EXAMPLE_SUBSTITUTIONS,
    EVENT_HANDLERS,
    LOOP,
    NAMESPACED_PARAMS,
    *MEDLEY,
    *MARKUP,
]

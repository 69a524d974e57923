"""Launch files of a course, compared with the original, each with parts of its plan."""

# ruff: noqa: E501 - launch files of students have long lines

from __future__ import annotations

from tests.launch_plan.launch_cases import Case

IMPORTS = """\
from launch import LaunchDescription
from launch.actions import *
from launch.substitutions import *
from launch.conditions import *
from launch.event_handlers import *
from launch.events import *
from launch_ros.actions import *
from launch_ros.descriptions import *
from launch_ros.substitutions import *
from launch_ros.parameter_descriptions import ParameterValue
"""

CASES = [
    Case(
        "YAML: a default without a value",
        """\
launch:
- arg:
    name: a
    default:
- node: {pkg: demo, exec: talker}
""",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 2},
        filename="x.launch.yaml",
    ),
    Case(
        "YAML: a name without a value",
        """\
launch:
- node:
    pkg: demo
    exec: talker
    name:
""",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 2},
        filename="x.launch.yaml",
    ),
    Case(
        "YAML: a parameter without a value",
        """\
launch:
- node:
    pkg: demo
    exec: talker
    param:
    - name: x
      value:
""",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 6},
        filename="x.launch.yaml",
    ),
    Case(
        "YAML: a condition without a value",
        """\
launch:
- node:
    pkg: demo
    exec: talker
    if:
""",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 2},
        filename="x.launch.yaml",
    ),
    Case(
        "YAML: two keys at the outermost level",
        """\
launch:
- node: {pkg: demo, exec: talker}
other: 1
""",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 3},
        filename="x.launch.yaml",
    ),
    Case(
        "YAML: value-sep, which only XML has",
        """\
launch:
- node:
    pkg: demo
    exec: talker
    param:
    - name: x
      value: "1;2"
      value-sep: ";"
""",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 2},
        filename="x.launch.yaml",
    ),
    Case(
        "XML: lists by value-sep",
        """\
<launch><node pkg="demo" exec="talker"><param name="x" value="1;2;3" value-sep=";"/><param name="y" value="a, b" value-sep=", "/><param name="z" value="1.5" value-sep=";"/></node></launch>
""",
        {"outcome": "ok", "len processes": 1},
        filename="x.launch.xml",
    ),
    Case(
        "XML: a list of names",
        """\
<launch><node pkg="demo" exec="talker" name="a;b" name-sep=";"/></launch>
""",
        {"outcome": "error", "problem.kind": "bad_type", "problem.line": 1},
        filename="x.launch.xml",
    ),
    Case(
        "XML: a list of mixed items by value-sep",
        """\
<launch><node pkg="demo" exec="talker"><param name="x" value="1;2.5" value-sep=";"/></node></launch>
""",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 1},
        filename="x.launch.xml",
    ),
    Case(
        "XML: a container named by an argument",
        """\
<launch><arg name="c" default="/box"/><load_composable_node target="$(var c)"><composable_node pkg="p" plugin="p::N" name="n"><param name="a" value="1"/><extra_arg name="use_intra_process_comms" value="true"/></composable_node></load_composable_node></launch>
""",
        {"outcome": "ok", "len processes": 0, "loaded_components.0.container": "/box"},
        filename="x.launch.xml",
    ),
    Case(
        "YAML: a container named by an argument",
        """\
launch:
- arg: {name: c, default: /box}
- load_composable_node:
    target: $(var c)
    composable_node:
    - pkg: p
      plugin: p::N
      name: n
      remap:
      - from: a
        to: b
""",
        {"outcome": "ok", "len processes": 0, "loaded_components.0.container": "/box"},
        filename="x.launch.yaml",
    ),
    Case(
        "nodes are loaded into one container twice",
        IMPORTS
        + """\
def generate_launch_description():
    c = ComposableNodeContainer(name='box', namespace='', package='demo', executable='talker', composable_node_descriptions=[ComposableNode(package='p', plugin='p::A', name='a')])
    l = LoadComposableNodes(target_container=c, composable_node_descriptions=[ComposableNode(package='p', plugin='p::B', name='b', parameters=[{'x': [1, 2]}])])
    l2 = LoadComposableNodes(target_container='box', composable_node_descriptions=[ComposableNode(package='p', plugin='p::C', name='c')])
    return LaunchDescription([c, l, l2])
""",
        {
            "outcome": "ok",
            "len processes.0.components": 2,
            "processes.0.components.1.plugin": "p::B",
            "len processes": 1,
            "processes.0.name": "box",
            "processes.0.namespace": "/",
            "loaded_components.0.container": "box",
        },
        filename="x.launch.py",
    ),
    Case(
        "a name with and without a slash in parameter files",
        IMPORTS
        + """\
def generate_launch_description():
    import os
    d = os.path.dirname(__file__)
    return LaunchDescription([Node(package='demo', executable='talker', name='talker', parameters=[d + '/a.yaml', d + '/b.yaml', d + '/a.yaml'])])
""",
        {
            "outcome": "ok",
            "effective 0": {"x": 2},
            "len processes": 1,
            "processes.0.name": "talker",
        },
        files={
            "a.yaml": "talker:\n  ros__parameters:\n    x: 1\n",
            "b.yaml": "/talker:\n  ros__parameters:\n    x: 2\n",
        },
        filename="x.launch.py",
    ),
    Case(
        "XML: nothing to load",
        """\
<launch><load_composable_node target="c"></load_composable_node></launch>
""",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 1},
        filename="x.launch.xml",
    ),
    Case(
        "XML: a node to load has no name",
        """\
<launch><load_composable_node target="c"><composable_node pkg="p" plugin="q"/></load_composable_node></launch>
""",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 1},
        filename="x.launch.xml",
    ),
    Case(
        "a node after the start and a delay of another",
        """\
from launch import LaunchDescription
from launch.actions import *
from launch.substitutions import *
from launch.conditions import *
from launch.event_handlers import *
from launch.events import Shutdown
from launch_ros.actions import *
from launch_ros.descriptions import *
from launch_ros.substitutions import *
from launch_ros.parameter_descriptions import ParameterValue
def generate_launch_description():
    a = Node(package='demo', executable='talker', name='a', output='screen')
    b = Node(package='demo', executable='listener', name='b', output={'both': ['screen', 'log']})
    return LaunchDescription([
      DeclareLaunchArgument('delay', default_value='2.0', description='s'),
      a,
      RegisterEventHandler(OnProcessStart(target_action=a, on_start=[LogInfo(msg=['started ', LaunchConfiguration('delay')]), TimerAction(period=LaunchConfiguration('delay'), actions=[b])])),
      RegisterEventHandler(OnProcessExit(target_action=b, on_exit=[LogInfo(msg='bye'), EmitEvent(event=Shutdown(reason='done'))])),
      RegisterEventHandler(OnShutdown(on_shutdown=[LogInfo(msg=['down ', LocalSubstitution('event.reason')])])),
    ])
""",
        {
            "outcome": "ok",
            "len processes": 2,
            "len logs": 3,
            "processes.0.name": "a",
            "processes.1.name": "b",
            "processes.1.when": {"after_s": 2.0, "since": {"on_start_of": "talker-1"}},
        },
        filename="x.launch.py",
    ),
    Case(
        "a fleet by an opaque function",
        IMPORTS
        + """\

def setup(context, *args, **kwargs):
    n = int(LaunchConfiguration('n').perform(context))
    ns = context.launch_configurations['ns']
    out = [SetLaunchConfiguration('made', str(n)), LogInfo(msg=LaunchConfiguration('made'))]
    for i in range(n):
        out.append(GroupAction([PushRosNamespace(f'{ns}{i}'), SetParameter('use_sim_time', True), Node(package='demo', executable='talker', name='talker', parameters=[{'id': i, 'k': kwargs['k']}], remappings=[('/chatter', 'chatter')])]))
    return out

def generate_launch_description():
    return LaunchDescription([DeclareLaunchArgument('n', default_value='2'), DeclareLaunchArgument('ns', default_value='robot'), OpaqueFunction(function=setup, kwargs={'k': 3})])
""",
        {
            "outcome": "ok",
            "len processes": 2,
            "len logs": 1,
            "processes.0.name": "talker",
            "processes.0.namespace": "/robot0",
            "processes.1.name": "talker",
            "processes.1.namespace": "/robot1",
        },
        filename="x.launch.py",
    ),
    Case(
        "groups with and without a scope",
        IMPORTS
        + """\
def generate_launch_description():
    return LaunchDescription([
      SetLaunchConfiguration('x', '1'),
      GroupAction([SetLaunchConfiguration('x', '2'), SetEnvironmentVariable('V', 'in'), Node(package='demo', executable='talker', name=['n', LaunchConfiguration('x')])]),
      GroupAction(scoped=False, actions=[SetLaunchConfiguration('y', '3'), PushRosNamespace('a')]),
      GroupAction(forwarding=False, launch_configurations={'z': '9'}, actions=[LogInfo(msg=LaunchConfiguration('x', default='none')), LogInfo(msg=LaunchConfiguration('z')), Node(package='demo', executable='talker')]),
      Node(package='demo', executable='talker', name=['n', LaunchConfiguration('x'), LaunchConfiguration('y')], namespace='b', additional_env={'W': EnvironmentVariable('V', default_value='out')}),
    ])
""",
        {
            "outcome": "ok",
            "len processes": 3,
            "len logs": 2,
            "processes.0.name": "n2",
            "processes.2.name": "n13",
            "processes.2.namespace": "/a/b",
        },
        filename="x.launch.py",
    ),
    Case(
        "conditions of all kinds",
        IMPORTS
        + """\
def generate_launch_description():
    sim = LaunchConfiguration('sim')
    return LaunchDescription([
      DeclareLaunchArgument('sim', default_value='true', choices=['true', 'false']),
      DeclareLaunchArgument('mode', default_value='fast'),
      Node(package='demo', executable='talker', name='s', condition=IfCondition(sim)),
      Node(package='demo', executable='talker', name='r', condition=UnlessCondition(sim)),
      Node(package='demo', executable='talker', name='f', condition=IfCondition(PythonExpression(["'", LaunchConfiguration('mode'), "' == 'fast' and ", "'", sim, "' == 'true'"]))),
      Node(package='demo', executable='talker', name='q', condition=IfCondition(EqualsSubstitution(LaunchConfiguration('mode'), 'slow'))),
      Node(package='demo', executable='talker', name='o', condition=IfCondition(OrSubstitution(NotSubstitution(sim), AndSubstitution('true', sim)))),
      Node(package='demo', executable='talker', name='c', condition=LaunchConfigurationEquals('mode', 'fast')),
      Node(package='demo', executable='talker', name=IfElseSubstitution(sim, 'yes', 'no'), parameters=[{'p': IfElseSubstitution(sim, '1.5', '2')}]),
    ])
""",
        {
            "outcome": "ok",
            "len processes": 5,
            "processes.0.name": "s",
            "processes.1.name": "f",
            "processes.2.name": "o",
            "processes.3.name": "c",
        },
        filename="x.launch.py",
    ),
    Case(
        "includes of Python and XML with arguments",
        """\
from launch import LaunchDescription
from launch.actions import *
from launch.substitutions import *
from launch.conditions import *
from launch.event_handlers import *
from launch_ros.actions import *
from launch_ros.descriptions import *
from launch_ros.substitutions import *
from launch_ros.parameter_descriptions import ParameterValue
from launch.launch_description_sources import *
def generate_launch_description():
    import os
    here = os.path.dirname(os.path.realpath(__file__))
    return LaunchDescription([
      GroupAction([PushRosNamespace('left'), SetRemap('/scan', 'scan'),
        IncludeLaunchDescription(PythonLaunchDescriptionSource(os.path.join(here, 'inner.launch.py')), launch_arguments={'rate': '5', 'frame': ['l_', 'base']}.items())]),
      IncludeLaunchDescription(PythonLaunchDescriptionSource([ThisLaunchFileDir(), '/inner.launch.py'])),
      IncludeLaunchDescription(AnyLaunchDescriptionSource(PathJoinSubstitution([ThisLaunchFileDir(), 'inner.launch.xml'])), launch_arguments=[('a', 'b')]),
      LogInfo(msg=LaunchConfiguration('rate')),
    ])
""",
        {
            "outcome": "ok",
            "len processes": 3,
            "len logs": 1,
            "processes.0.namespace": "/left",
            "processes.2.name": "b",
        },
        files={
            "inner.launch.py": IMPORTS
            + """\
def generate_launch_description():
    return LaunchDescription([DeclareLaunchArgument('rate', default_value='10'), DeclareLaunchArgument('frame', default_value='base'), Node(package='demo', executable='listener', parameters=[{'rate': LaunchConfiguration('rate'), 'frame': ParameterValue(LaunchConfiguration('frame'), value_type=str)}])])
""",
            "inner.launch.xml": '<launch><arg name="a" default="x"/><node pkg="demo" exec="talker" name="$(var a)" args="--flag $(var a) \'two words\'"><env name="E" value="$(dirname)"/></node></launch>',
        },
        filename="x.launch.py",
    ),
    Case(
        "XML of a workshop",
        """\
<launch>
  <arg name="robot" default="arm"/><arg name="use" default="true" description="d"><choice value="true"/><choice value="false"/></arg>
  <let name="full" value="$(var robot)_1"/>
  <group if="$(var use)"><push_ros_namespace namespace="$(var full)"/>
    <set_parameter name="use_sim_time" value="true"/><set_remap from="a" to="b"/>
    <node pkg="demo" exec="talker" name="t" output="screen" respawn="true" respawn_delay="1.5" ros_args="--log-level debug">
      <param name="rate" value="10"/><param name="s" value="10" type="str"/><param name="l" value="1.0, 2.0" value-sep=", "/>
      <param name="g"><param name="h" value="$(eval '1 + 2')"/></param><param from="$(dirname)/p.yaml"/>
      <remap from="x" to="y"/><env name="A" value="1"/></node>
  </group>
  <group scoped="false"><let name="after" value="1"/></group>
  <executable cmd="echo $(var full) 'a b' $(env HOME)" cwd="/tmp" name="e" shell="false" output="both"><env name="B" value="$(var after)"/></executable>
  <timer period="2.5"><log message="now $(var after)"/><node pkg="demo" exec="listener" if="$(not $(var use))"/></timer>
  <set_env name="Q" value="z"/><append_env name="Q" value="y" prepend="true" separator=":"/><unset_env name="Q"/>
  <shutdown reason="r" if="false"/>
</launch>
""",
        {
            "outcome": "ok",
            "len processes": 2,
            "len logs": 1,
            "processes.0.name": "t",
            "processes.0.namespace": "/arm_1",
        },
        files={
            "p.yaml": "/**:\n  ros__parameters:\n    from_file: 1\n",
        },
        filename="x.launch.xml",
    ),
    Case(
        "YAML of a workshop",
        """\
launch:
- arg: {name: robot, default: arm}
- arg: {name: n, default: "2", description: count}
- let: {name: full, value: "$(var robot)_$(var n)"}
- group:
    scoped: true
    children:
    - push_ros_namespace: {namespace: $(var full)}
    - node:
        pkg: demo
        exec: talker
        name: t
        output: screen
        args: --a "b c" $(var n)
        param:
        - {name: rate, value: 10}
        - {name: x, value: 1.0e-3}
        - {name: l, value: [1, 2]}
        - {name: s, value: "10"}
        - {name: b, value: true}
        - {from: $(dirname)/p.yaml}
        remap: [{from: a, to: b}]
        env: [{name: A, value: "1"}]
        if: $(eval '$(var n) == 2')
- executable: {cmd: ls -l $(env HOME), name: l, env: [{name: Q, value: "1"}]}
- timer:
    period: 2.5
    children:
    - log: {message: hello}
- include:
    file: $(dirname)/i.launch.yaml
    arg: [{name: q, value: "5"}]
""",
        {
            "outcome": "ok",
            "len processes": 3,
            "len logs": 1,
            "processes.0.name": "t",
            "processes.0.namespace": "/arm_2",
            "processes.2.name": "l5",
        },
        files={
            "p.yaml": "/**:\n  ros__parameters:\n    from_file: 1\n",
            "i.launch.yaml": 'launch:\n- arg: {name: q, default: "1"}\n- node: {pkg: demo, exec: listener, name: "l$(var q)"}\n',
        },
        filename="x.launch.yaml",
    ),
    Case(
        "programs with shells and environments",
        IMPORTS
        + """\
def generate_launch_description():
    return LaunchDescription([
      ExecuteProcess(cmd=['ls', '-l', [LaunchConfiguration('d', default='/tmp'), '/x']], cwd='/tmp', name='ls', output='screen', env={'ONLY': '1'}),
      ExecuteProcess(cmd=['echo "a b" && sleep 1'], shell=True, additional_env={'Z': '2'}, on_exit=LogInfo(msg='x')),
      ExecuteProcess(cmd=[[FindExecutable(name='sh'), ' -c ', '"true"']], shell=True, sigterm_timeout='3', respawn=True, respawn_delay=1.0, respawn_max_retries=2),
      ExecuteProcess(cmd='true'),
    ])
""",
        {"outcome": "ok", "len processes": 4, "len logs": 1},
        filename="x.launch.py",
    ),
    Case(
        "a lifecycle node that a handler activates",
        IMPORTS
        + """\
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch.events import matches_action
def generate_launch_description():
    import lifecycle_msgs.msg
    n = LifecycleNode(package='demo', executable='talker', name='lc', namespace='')
    conf = EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(n), transition_id=lifecycle_msgs.msg.Transition.TRANSITION_CONFIGURE))
    act = RegisterEventHandler(OnStateTransition(target_lifecycle_node=n, start_state='configuring', goal_state='inactive', entities=[LogInfo(msg='configured'), EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(n), transition_id=3))]))
    return LaunchDescription([n, act, conf])
""",
        {
            "outcome": "ok",
            "len processes": 1,
            "len logs": 1,
            "processes.0.name": "lc",
            "processes.0.namespace": "/",
        },
        filename="x.launch.py",
    ),
    Case(
        "a description by a command",
        IMPORTS
        + """\
def generate_launch_description():
    from ament_index_python.packages import get_package_share_directory
    import os
    share = get_package_share_directory('demo')
    desc = ParameterValue(Command(['cat ', os.path.join(os.path.dirname(__file__), 'r.urdf')]), value_type=str)
    return LaunchDescription([Node(package='demo', executable='talker', parameters=[{'robot_description': desc, 'share': share}]), Node(package='demo', executable='listener', arguments=['-d', PathJoinSubstitution([FindPackageShare('demo'), 'rviz', 'x.rviz'])])])
""",
        {"outcome": "ok", "len processes": 2},
        files={
            "r.urdf": '<robot name="r"/>',
        },
        filename="x.launch.py",
    ),
    Case(
        "parameters by files, dicts and arguments",
        IMPORTS
        + """\
def generate_launch_description():
    return LaunchDescription([
     DeclareLaunchArgument('gain', default_value='1.5'),
     SetParametersFromFile(PathJoinSubstitution([ThisLaunchFileDir(), 'p.yaml'])),
     SetParameter(name='all', value=LaunchConfiguration('gain')),
     Node(package='demo', executable='talker', name='t', parameters=[{'a': {'b': 1, 'c': [1.0, 2]}}, PathJoinSubstitution([ThisLaunchFileDir(), 'p.yaml']), {'gain': LaunchConfiguration('gain'), 'txt': ['x', LaunchConfiguration('gain')], 'list': [LaunchConfiguration('gain'), '2.0'], 'flag': 'true', 'num': '5', 'pv': ParameterValue(LaunchConfiguration('gain'), value_type=float)}, ParameterFile(PathJoinSubstitution([ThisLaunchFileDir(), 's.yaml']), allow_substs=True)]),
    ])
""",
        {"outcome": "ok", "len processes": 1, "processes.0.name": "t"},
        files={
            "p.yaml": "t:\n  ros__parameters:\n    a.b: 7\n    q: 1\n",
            "s.yaml": '/**:\n  ros__parameters:\n    sub: $(var gain)\n    txt: "$(var gain)s"\n',
        },
        filename="x.launch.py",
    ),
    Case(
        "handlers of output and ends",
        IMPORTS
        + """\
def generate_launch_description():
    a = Node(package='demo', executable='talker', name='a')
    def seen(event):
        return LogInfo(msg=event.text.decode())
    return LaunchDescription([a,
      RegisterEventHandler(OnProcessIO(target_action=a, on_stdout=seen, on_stderr=lambda event: LogInfo(msg='err'))),
      RegisterEventHandler(OnExecutionComplete(target_action=a, on_completion=[LogInfo(msg='complete')])),
      RegisterEventHandler(event_handler=OnProcessExit(on_exit=lambda event, context: [LogInfo(msg=event.process_name), Shutdown(reason='x')])),
    ])
""",
        {"outcome": "ok", "len processes": 1, "len logs": 1, "processes.0.name": "a"},
        filename="x.launch.py",
    ),
    Case(
        "texts by substitutions",
        IMPORTS
        + """\
def generate_launch_description():
    return LaunchDescription([
      DeclareLaunchArgument('name', default_value=TextSubstitution(text='bob')),
      DeclareLaunchArgument('opt', default_value=['a', LaunchConfiguration('name')]),
      DeclareLaunchArgument('e', default_value=EnvironmentVariable('NOPE', default_value='dflt')),
      LogInfo(msg=['hi ', LaunchConfiguration('opt'), ' ', LaunchConfiguration('e'), ' ', PythonExpression(['2 * 3']), ' ', PythonExpression(['math.pi > 3'], python_modules=['math'])]),
      UnsetLaunchConfiguration('opt'),
      Node(package='demo', executable=['talk', 'er'], name=[LaunchConfiguration('name'), '_node'], namespace=['/', LaunchConfiguration('name')], arguments=[['--', LaunchConfiguration('name')], '5'], ros_arguments=['--log-level', 'info'], exec_name='x', prefix=['nice -n ', '5'], emulate_tty=True),
    ])
""",
        {
            "outcome": "ok",
            "len processes": 1,
            "len logs": 1,
            "processes.0.name": "bob_node",
            "processes.0.namespace": "/bob",
        },
        filename="x.launch.py",
    ),
    Case(
        "a description by add_action",
        IMPORTS
        + """\
def generate_launch_description():
    ld = LaunchDescription()
    arg = DeclareLaunchArgument('rate', default_value='10')
    ld.add_action(arg)
    for i in range(3):
        ld.add_action(Node(package='demo', executable='talker', name='t%d' % i, parameters=[{'rate': LaunchConfiguration('rate')}]))
    ld.add_entity(LogInfo(msg='end'))
    return ld
""",
        {
            "outcome": "ok",
            "len processes": 3,
            "len logs": 1,
            "processes.0.name": "t0",
            "processes.1.name": "t1",
            "processes.2.name": "t2",
        },
        filename="x.launch.py",
    ),
    Case(
        "a period that is an int",
        IMPORTS
        + """\
from launch.events import Shutdown as ShutdownE
def generate_launch_description():
    h = OnShutdown(on_shutdown=[LogInfo(msg='never')])
    h2 = OnShutdown(on_shutdown=lambda event, context: [LogInfo(msg='s ' + event.reason)])
    return LaunchDescription([RegisterEventHandler(h), RegisterEventHandler(h2), UnregisterEventHandler(h), TimerAction(period=1.0, actions=[Node(package='demo', executable='talker')], cancel_on_shutdown=False), TimerAction(period=3.0, actions=[EmitEvent(event=ShutdownE(reason='t'))]), TimerAction(period=4, actions=[LogInfo(msg='late')])])
""",
        {"outcome": "error", "problem.kind": "bad_period", "problem.line": 15},
        filename="x.launch.py",
    ),
    Case(
        "timers before and behind a shutdown",
        IMPORTS
        + """\
from launch.events import Shutdown as ShutdownE
def generate_launch_description():
    return LaunchDescription([TimerAction(period=3.0, actions=[EmitEvent(event=ShutdownE(reason='t'))]), TimerAction(period=4.0, actions=[LogInfo(msg='late')]), ROSTimer(period=5.0, actions=[LogInfo(msg='ros')])])
""",
        {"outcome": "ok", "len processes": 0},
        filename="x.launch.py",
    ),
    Case(
        "a container with intra-process communication",
        IMPORTS
        + """\
def generate_launch_description():
    c = ComposableNodeContainer(name='box', namespace='/ns', package='demo', executable='talker', composable_node_descriptions=[
      ComposableNode(package='p', plugin='p::A', name='a', namespace='in', remappings=[('x', 'y')], parameters=[{'k': LaunchConfiguration('k')}], extra_arguments=[{'use_intra_process_comms': True}], condition=IfCondition(LaunchConfiguration('k')))], output='screen')
    return LaunchDescription([DeclareLaunchArgument('k', default_value='1'), PushRosNamespace('outer'), c, LoadComposableNodes(target_container=['/ns/', 'box'], composable_node_descriptions=[ComposableNode(package='p', plugin='p::B')], condition=UnlessCondition('true'))])
""",
        {
            "outcome": "ok",
            "len processes": 1,
            "processes.0.name": "box",
            "processes.0.namespace": "/ns",
        },
        filename="x.launch.py",
    ),
    Case(
        "a domain and a terminal",
        IMPORTS
        + """\
def generate_launch_description():
    return LaunchDescription([SetUseSimTime(True), SetROSLogDir('/tmp/l'), SetEnvironmentVariable('ROS_DOMAIN_ID', '30'), SetEnvironmentVariable('RCUTILS_COLORIZED_OUTPUT', '1'), Node(package='demo', executable='talker', prefix='xterm -e'), AppendEnvironmentVariable('PATH', '/x'), Node(package='demo', executable='talker', prefix='gdb -ex run --args')])
""",
        {"outcome": "ok", "len processes": 2},
        filename="x.launch.py",
    ),
    Case(
        "an import of a name that a module only uses",
        """\
from launch.actions import LaunchConfiguration
from launch import LaunchDescription
from launch.actions import *
from launch.substitutions import *
from launch.conditions import *
from launch.event_handlers import *
from launch.events import *
from launch_ros.actions import *
from launch_ros.descriptions import *
from launch_ros.substitutions import *
from launch_ros.parameter_descriptions import ParameterValue
def generate_launch_description():
    return LaunchDescription([])
""",
        {"outcome": "error", "problem.kind": "unknown_import", "problem.line": 1},
        filename="x.launch.py",
    ),
    Case(
        "imports from sub-modules",
        """\
from launch.actions.execute_process import ExecuteProcess
from launch.actions.timer_action import LaunchContext, List
from launch_ros.actions.node import Node, os
import launch, launch_ros
import launch.actions as act
from launch.some_substitutions_type import SomeSubstitutionsType
def generate_launch_description():
    return launch.LaunchDescription([launch_ros.actions.Node(package="demo", executable="talker"), act.LogInfo(msg=launch.substitutions.LaunchConfiguration("x", default="d")), launch.actions.DeclareLaunchArgument("q", default_value="1")])
""",
        {"outcome": "ok", "len processes": 1, "len logs": 1},
        filename="x.launch.py",
    ),
]

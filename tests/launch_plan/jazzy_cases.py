"""More launch files and their plans by ROS 2 Jazzy: changes of patch releases, and corner cases."""

# ruff: noqa: E501 - a table: a launch file in one line reads better than one cut in the middle

from __future__ import annotations

from tests.launch_plan.launch_cases import (
    BODY_LINE,
    FOOTER,
    HEADER,
    NODE,
    OTHER,
    Case,
    body,
    fails,
    whole,
)

WILD = "/**:\n  ros__parameters:\n    {}\n"
LIFECYCLE = (
    "from launch_ros.events.lifecycle import ChangeState, matches_node_name\n"
    "from launch_ros.event_handlers import OnStateTransition\n"
    "from launch.events import matches_action\n"
)


def lifecycle(name: str, entities: str, **expect: object) -> Case:
    """A case with the names of lifecycle nodes."""
    wanted: dict[str, object] = {"outcome": "ok"}
    wanted.update(expect.pop("expect", {}))  # type: ignore[call-overload]
    return Case(name, LIFECYCLE + HEADER + entities + FOOTER, wanted)


PATHS = [
    body(
        "a part of a path may be a list",
        "Arg('m', default_value='arm'), LogInfo(msg=PathJoinSubstitution(['urdf', [Value('m'), '.xacro']]))",
        expect={"logs.0.message": "urdf/arm.xacro"},
    ),
    body(
        "a slash joins paths",
        "LogInfo(msg=PathJoinSubstitution(['a', 'b']) / 'c.x'), LogInfo(msg=PathSubstitution('a') / ['b', 'c'])",
        expect={"logs.0.message": "a/b/c.x", "logs.1.message": "a/bc"},
    ),
    body(
        "a slash behind a package's share folder",
        "LogInfo(msg=FindPackageShare('demo') / 'launch' / 'x.py')",
        expect={"logs.0.message ends": "/share/demo/launch/x.py"},
    ),
    body(
        "a slash behind the folder of the file",
        "LogInfo(msg=ThisLaunchFileDir() / 'p.yaml')",
        expect={"logs.0.message ends": "/p.yaml"},
    ),
    body(
        "a pathlib path where text can stand",
        "LogInfo(msg=__import__('pathlib').Path('a') / 'b'), Arg('p', default_value=__import__('pathlib').Path('/q'))",
        expect={"logs.0.message": "a/b", "configurations.p": "/q"},
    ),
    body(
        "an include by a pathlib path",
        "IncludeLaunchDescription(PythonLaunchDescriptionSource(__import__('pathlib').Path(HERE) / 'other.py'))",
        _files={"other.py": OTHER},
        expect={"processes.0.name": "n1"},
    ),
    body(
        "an include by the source that launch_xml has",
        "IncludeLaunchDescription(__import__('launch_xml.launch_description_sources', fromlist=['x'])"
        ".XMLLaunchDescriptionSource(HERE + '/o.launch.xml'), launch_arguments={'a': '1'}.items())",
        _files={"o.launch.xml": "<launch><let name='b' value='n$(var a)'/></launch>"},
        expect={"configurations.b": "n1"},
    ),
    body(
        "an include by the source that launch_yaml has",
        "IncludeLaunchDescription(__import__('launch_yaml.launch_description_sources', fromlist=['x'])"
        ".YAMLLaunchDescriptionSource(HERE + '/o.launch.yaml'))",
        _files={"o.launch.yaml": "launch:\n- let: {name: b, value: n1}\n"},
        expect={"configurations.b": "n1"},
    ),
    body(
        "a pathlib path as a file of parameters",
        "talker(parameters=[__import__('pathlib').Path(HERE) / 'p.yaml'])",
        _files={"p.yaml": WILD.format("a: 1")},
        expect={"processes.0.parameters.0.content": {"/**": {"ros__parameters": {"a": 1}}}},
    ),
    fails(
        "a pathlib path as a value",
        "talker(parameters=[{'a': __import__('pathlib').Path('/x')}])",
        "bad_parameter_value",
    ),
    fails(
        "a path of one substitution without a list",
        "PathJoinSubstitution(Value('a'))",
        "not_a_list",
    ),
]

TIMERS = [
    body(
        "a timer in a scoped group keeps the group's configurations",
        "GroupAction([SetLaunchConfiguration('a', '2'), TimerAction(period=1.0, actions=[talker(name=['n', Value('a')])])])",
        expect={"processes.0.name": "n2", "processes.0.when": {"after_s": 1.0}},
    ),
    body(
        "a timer in a namespace keeps it",
        "GroupAction([PushROSNamespace('r'), TimerAction(period=1.0, actions=[talker(name='t')])]), talker(name='u')",
        expect={"processes.0.namespace": None, "processes.1.namespace": "/r"},
    ),
    body(
        "what a timer sets stays in it",
        "Arg('a', default_value='1'), TimerAction(period=1.0, actions=[SetLaunchConfiguration('a', '2')]), "
        "TimerAction(period=2.0, actions=[talker(name=['n', Value('a')])])",
        expect={"processes.0.name": "n1", "configurations.a": "1"},
    ),
    body(
        "global parameters reach into a timer",
        "SetParameter('a', 5), TimerAction(period=1.0, actions=[talker()])",
        expect={"parameter 0 a": 5},
    ),
    body(
        "a timer's period from a scope that has ended is never resolved",
        "GroupAction([SetLaunchConfiguration('p', '1.0'), TimerAction(period=Value('p'), actions=[talker()])])",
        expect={"processes": [], "len warnings": 1, "warnings.0.line": BODY_LINE},
    ),
    body(
        "a period as text is read as a number",
        "TimerAction(period='2', actions=[talker()])",
        expect={"processes.0.when": {"after_s": 2.0}},
    ),
    body(
        "a timer that is cancelled before it fires",
        "*(lambda t: [t, OpaqueFunction(function=lambda c: t.cancel())])(TimerAction(period=1.0, actions=[talker()]))",
        expect={"processes": []},
    ),
    body(
        "a timer of the ROS clock",
        "ROSTimer(period=1.5, actions=[talker()])",
        expect={"processes.0.when": {"after_s": 1.5}},
    ),
    fails("a timer without a list", "TimerAction(period=1.0, actions=talker())", "bad_type"),
    body(
        "emulate_tty is looked up when the whole file was read",
        "talker(), SetLaunchConfiguration('emulate_tty', 'true')",
        expect={"processes.0.emulate_tty": True},
    ),
]

SCOPES = [
    body(
        "a configuration that is not set may be unset",
        "UnsetLaunchConfiguration('none')",
        expect={"processes": []},
    ),
    body(
        "ResetLaunchConfigurations keeps what it is given",
        "Arg('a', default_value='1'), ResetLaunchConfigurations({'b': Value('a'), 'c': 'x'}), "
        "LogInfo(msg=[Value('b'), Value('c'), Value('a', default='-')])",
        expect={"logs.0.message": "1x-"},
    ),
    body(
        "a group without forwarding keeps its own configurations",
        "Arg('a', default_value='1'), GroupAction([LogInfo(msg=[Value('b'), Value('a', default='-')])], "
        "forwarding=False, launch_configurations={'b': Value('a')})",
        expect={"logs.0.message": "1-"},
    ),
    body(
        "a group without forwarding has the environment of the beginning",
        "SetEnvironmentVariable('A_B', 'c'), GroupAction([talker()], forwarding=False), talker()",
        expect={"processes.0.env": {}, "processes.1.env": {"A_B": "c"}},
    ),
    body(
        "push and pop by hand",
        "Arg('a', default_value='1'), PushLaunchConfigurations(), SetLaunchConfiguration('a', '2'), "
        "PopLaunchConfigurations(), LogInfo(msg=Value('a'))",
        expect={"logs.0.message": "1"},
    ),
    body(
        "the environment, pushed and popped by hand",
        "PushEnvironment(), SetEnvironmentVariable('A_B', 'c'), PopEnvironment(), talker()",
        expect={"processes.0.env": {}},
    ),
    body(
        "a variable with another one put before it",
        "SetEnvironmentVariable('A_B', 'c'), AppendEnvironmentVariable('A_B', 'd', prepend=True, separator=';'), talker()",
        expect={"processes.0.env": {"A_B": "d;c"}},
    ),
    body(
        "SetROSLogDir joins a relative folder",
        "SetEnvironmentVariable('ROS_LOG_DIR', '/logs'), SetROSLogDir('mine'), talker()",
        expect={"processes.0.env": {"ROS_LOG_DIR": "/logs/mine"}},
    ),
    body(
        "an anonymous name is another one after its scope",
        "GroupAction([LogInfo(msg=AnonName('a'))]), LogInfo(msg=AnonName('a')), LogInfo(msg=AnonName('a'))",
        expect={"len logs": 3},
    ),
    body(
        "SetRemap and PushROSNamespace of a group end with it",
        "GroupAction([PushROSNamespace('r'), SetRemap('a', 'b'), talker(name='t')]), talker(name='t')",
        expect={
            "processes.0.argv": ["--ros-args", "-r", "__node:=t", "-r", "__ns:=/r", "-r", "a:=b"],
            "processes.1.argv": ["--ros-args", "-r", "__node:=t"],
        },
    ),
    body(
        "an inner SetParameter leaks out where there was one before, as in the real one",
        "SetParameter('a', 1), GroupAction([SetParameter('b', 2), talker()]), talker()",
        expect={"parameter 1 b": 2},
    ),
    fails("a pop without a push", "PopLaunchConfigurations()", "exception"),
    fails("a pushed namespace that is none", "PushROSNamespace('a b')", "bad_name"),
]

VALUES = [
    body(
        "an exponent without a dot is text to YAML, and a number to the node",
        "Arg('a', default_value='1e3'), Arg('b', default_value='1.0e+3'), talker(parameters=[{'a': Value('a'), 'b': Value('b')}])",
        expect={
            "parameter 0 a": 1000.0,
            "parameter 0 b": 1000.0,
            "parameter_files.node_name_unspecified_1|yaml has": "a: 1e3\n",
            "warnings.0.message has": "reads it as double",
        },
    ),
    body(
        "a configuration is read as YAML: octal, hexadecimal, underscores",
        "talker(parameters=[{'a': [TextSubstitution(text='010')], 'b': [TextSubstitution(text='0x1F')], 'c': [TextSubstitution(text='1_000')]}])",
        expect={"parameter 0 a": 8, "parameter 0 b": 31, "parameter 0 c": 1000},
    ),
    body(
        "a configuration is read as YAML: on, off, no",
        "talker(parameters=[{n: [TextSubstitution(text=n)] for n in ('on', 'off', 'no')}])",
        expect={"parameter 0 on": True, "parameter 0 off": False, "parameter 0 no": False},
    ),
    body(
        "a configuration is read as YAML: sexagesimal",
        "talker(parameters=[{'a': [TextSubstitution(text='1:30')]}])",
        expect={"parameter 0 a": 90},
    ),
    body(
        "texts in a list keep their quotes",
        "talker(parameters=[{'a': ['1', 'yes', '']}])",
        expect={"parameter 0 a": ["1", "yes", ""], "processes.0.parameters.0.type": "string_array"},
    ),
    body(
        "a list of configurations, each in a list, is read as YAML item by item",
        "Arg('a', default_value='1'), talker(parameters=[{'v': [[Value('a')], [Value('a'), '0']]}])",
        expect={"parameter 0 v": [1, 10], "processes.0.parameters.0.type": "integer_array"},
    ),
    body(
        "value_type may be list[...] of Python",
        "Arg('a', default_value='[1.5, 2.5]'), talker(parameters=[{'a': ParameterValue(Value('a'), value_type=list[float])}])",
        expect={"parameter 0 a": [1.5, 2.5]},
    ),
    body(
        "a ParameterValue of plain text is not read as YAML",
        "talker(parameters=[{'a': ParameterValue('1')}])",
        expect={"parameter 0 a": "1"},
    ),
    body(
        "value_type=bool reads YAML's words",
        "talker(parameters=[{'a': ParameterValue([TextSubstitution(text='yes')], value_type=bool)}])",
        expect={"parameter 0 a": True},
    ),
    body(
        "a value made of a command",
        "talker(parameters=[{'a': ParameterValue(Command(['echo ', 'x: y']), value_type=str)}])",
        expect={"parameter 0 a": "x: y\n"},
    ),
    body(
        "SetParameter loses the quotes of text on the command line",
        "SetParameter('a', '1'), talker()",
        expect={"processes.0.argv": ["--ros-args", "-p", "a:=1"], "parameter 0 a": 1},
    ),
    body(
        "a global parameter is for any node of the process",
        "SetParameter('a', 1), talker(parameters=[P('b', 'x')])",
        expect={
            "processes.0.parameters": [
                {"name": "a", "value": 1, "type": "integer", "wildcard": True},
                {"name": "b", "value": "x", "type": "string", "wildcard": True},
            ]
        },
    ),
    body(
        "substitutions in a file are replaced in its text, quotes and all",
        "Arg('a', default_value='7'), talker(parameters=[ParameterFile(os.path.join(HERE, 'p.yaml'), allow_substs=True)])",
        _files={"p.yaml": WILD.format('a: "$(var a)"')},
        expect={"processes.0.parameters.0.content": {"/**": {"ros__parameters": {"a": "7"}}}},
    ),
    fails(
        "substitutions in a file's comments are resolved too",
        "talker(parameters=[ParameterFile(os.path.join(HERE, 'p.yaml'), allow_substs=True)])",
        "undefined_variable",
        _files={"p.yaml": WILD.format("a: 1  # $(env NO_SUCH_ONE)")},
    ),
    fails(
        "allow_substs must be a bool",
        "talker(parameters=[ParameterFile('/x', allow_substs=Value('a'))])",
        "bad_type",
    ),
    body(
        "files, dicts, and files again keep their order",
        "talker(parameters=[os.path.join(HERE, 'p.yaml'), {'a': 2}, os.path.join(HERE, 'q.yaml')])",
        _files={"p.yaml": WILD.format("a: 1"), "q.yaml": WILD.format("a: 3")},
        expect={
            "processes.0.parameters.0.content": {"/**": {"ros__parameters": {"a": 1}}},
            "processes.0.parameters.1": {"name": "a", "value": 2, "type": "integer"},
            "processes.0.parameters.2.content": {"/**": {"ros__parameters": {"a": 3}}},
        },
    ),
    body(
        "a parameter file that is no YAML warns, and the node gets it",
        "talker(parameters=[os.path.join(HERE, 'p.yaml')])",
        _files={"p.yaml": "a: [1\n"},
        expect={"len warnings": 1, "processes.0.parameters.0.content": None},
    ),
    body(
        "a SetParametersFromFile that no node follows is not looked at",
        "SetParametersFromFile('/no/such.yaml')",
        expect={"processes": []},
    ),
    fails(
        "a SetParametersFromFile whose file is missing",
        "SetParametersFromFile('/no/such.yaml'), talker()",
        "file_not_found",
    ),
    body(
        "a default for a global parameter",
        "import_ if False else LogInfo(msg=__import__('launch_ros').substitutions.Parameter('none', default='d'))",
        expect={"logs.0.message": "d"},
    ),
    fails("a list with None", "talker(parameters=[{'a': [1, None]}])", "bad_parameter_value"),
    fails("a list in a list of numbers", "talker(parameters=[{'a': [[1, 2], [3]]}])", "bad_text"),
    fails("a set", "talker(parameters=[{'a': {1, 2}}])", "bad_parameter_value"),
    fails("a complex number", "talker(parameters=[{'a': 1j}])", "bad_parameter_value"),
    fails(
        "an array of numpy",
        "talker(parameters=[{'a': __import__('numpy').zeros(2)}])",
        "bad_parameter_value",
    ),
    body(
        "a float of numpy, which a node cannot read",
        "talker(parameters=[{'a': __import__('numpy').float64(1.5)}])",
        expect={"len warnings": 1, "warnings.0.message has": "numpy"},
    ),
    fails("None among the parameters", "talker(parameters=[None])", "bad_parameter_value"),
    fails("a number as a parameter's name", "talker(parameters=[{1: 2}])", "bad_text"),
    fails(
        "a whole number where a list of floats is wanted",
        "talker(parameters=[{'a': ParameterValue([1, 2], value_type=List[float])}])",
        "bad_parameter_value",
    ),
    fails(
        "true where a number is wanted",
        "Arg('a', default_value='true'), talker(parameters=[{'a': ParameterValue(Value('a'), value_type=int)}])",
        "bad_parameter_value",
    ),
    fails(
        "an uneven list in a configuration",
        "Arg('a', default_value='[1, x]'), talker(parameters=[{'a': Value('a')}])",
        "bad_parameter_value",
    ),
    fails(
        "an empty list in a configuration",
        "Arg('a', default_value='[]'), talker(parameters=[{'a': Value('a')}])",
        "bad_parameter_value",
    ),
    fails(
        "a date in a configuration",
        "Arg('a', default_value='2024-01-01'), talker(parameters=[{'a': Value('a')}])",
        "bad_parameter_value",
    ),
    fails(
        "null in a configuration",
        "Arg('a', default_value='null'), talker(parameters=[{'a': Value('a')}])",
        "bad_parameter_value",
    ),
    fails(
        "a colon and a blank in a configuration",
        "Arg('a', default_value='x: y'), talker(parameters=[{'a': Value('a')}])",
        "bad_parameter_value",
        expect={"problem.remedy has": "value_type=str"},
    ),
]

TEXT_TRAPS = [
    body(
        "an f-string makes text of a substitution too early",
        "talker(arguments=[f\"--file={Value('a')}\"])",
        expect={"len warnings": 1, "warnings.0.message has": "f-string"},
    ),
    fails(
        "a name made with an f-string",
        "talker(name=f\"{Value('a')}_node\")",
        "bad_name",
        expect={"problem.remedy has": "f-string"},
    ),
    body(
        "a command as one text falls apart into letters",
        "ExecuteProcess(cmd='ls -l')",
        expect={"processes.0.argv": ["s", " ", "-", "l"], "warnings.0.message has": "each letter"},
    ),
    body(
        "a command in one item of a shell",
        "ExecuteProcess(cmd=['echo a && echo b'], shell=True)",
        expect={"processes.0.path": "echo a && echo b", "processes.0.id": "echo a && echo b-1"},
    ),
    body(
        "a configuration is an object to Python",
        "Arg('a', default_value='false'), *([talker()] if LaunchConfiguration('a') else [])",
        expect={"len processes": 1},
    ),
    body(
        "a configuration compared with text is never equal",
        "Arg('a', default_value='x'), *([talker()] if LaunchConfiguration('a') == 'x' else [])",
        expect={"processes": []},
    ),
]

HANDLERS = [
    body(
        "a handler by a function of the action",
        "talker(name='a'), RegisterEventHandler(OnProcessExit(target_action=lambda action: action.node_name.endswith('a'), on_exit=[talker(name='b')]))",
        expect={"len processes": 2, "processes.1.when": {"on_exit_of": "talker-1"}},
    ),
    body(
        "a handler of any process, once",
        "talker(name='a'), talker(name='b'), RegisterEventHandler(OnProcessStart(handle_once=True, on_start=[LogInfo(msg='one')]))",
        expect={"len logs": 1, "logs.0.when": {"on_start_of": "talker-1"}},
    ),
    body(
        "a function of a handler may return None among actions",
        "talker(on_exit=lambda event, context: [None, LogInfo(msg='done')])",
        expect={"logs.0.message": "done"},
    ),
    body(
        "a chain of three",
        "*(lambda a, b, c: [a, RegisterEventHandler(OnProcessExit(target_action=a, on_exit=[b])), "
        "RegisterEventHandler(OnProcessExit(target_action=b, on_exit=[c]))])(talker(name='a'), talker(name='b'), talker(name='c'))",
        expect={
            "processes.1.when": {"on_exit_of": "talker-1"},
            "processes.2.when": {"on_exit_of": "talker-2"},
        },
    ),
    body(
        "a handler that was unregistered does nothing",
        "*(lambda h: [RegisterEventHandler(h), UnregisterEventHandler(h), talker()])(OnProcessStart(on_start=[LogInfo(msg='no')]))",
        expect={"logs": []},
    ),
    body(
        "on the completion of an action",
        "*(lambda a: [RegisterEventHandler(OnExecutionComplete(target_action=a, on_completion=[talker()])), a])(LogInfo(msg='x'))",
        expect={"processes.0.when": {"on_completion_of": "LogInfo"}},
    ),
    body(
        "a process is told to end",
        "*(lambda t: [t, TimerAction(period=1.0, actions=[EmitEvent(event=ShutdownProcess(process_matcher=matches_action(t)))])])(talker())",
        expect={"signals.0.signal": "SIGINT", "signals.0.when": {"after_s": 1.0}},
    ),
    body(
        "a handler under a condition",
        "*(lambda t: [t, RegisterEventHandler(OnProcessExit(target_action=t, on_exit=[talker(name='b')]), condition=IfCondition('false'))])(talker())",
        expect={"len processes": 1},
    ),
    body(
        "the end of the launch once a needed process ends",
        "talker(on_exit=[LogInfo(msg='gone'), Shutdown(reason='needed')])",
        expect={"logs.0.message": "gone", "shutdowns.0.reason": "needed"},
    ),
    fails(
        "a handler with a keyword of another",
        "RegisterEventHandler(OnProcessStart(target_action=talker(), on_exit=[talker()]))",
        "missing_keyword",
    ),
]

LIFECYCLES = [
    body(
        "autostart configures and activates",
        "LifecycleNode(package='demo', executable='talker', name='t', namespace='', autostart=True)",
        expect={
            "processes.0.autostart": True,
            "transitions.0.transition": "configure",
            "transitions.1.transition": "activate",
            "transitions.1.when": {"on_transition_of": "talker-1", "state": "inactive"},
        },
    ),
    lifecycle(
        "a node that waits for another to be active",
        "*(lambda t: [t, EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(t), transition_id=1)), "
        "RegisterEventHandler(OnStateTransition(target_lifecycle_node=t, goal_state='inactive', entities=["
        "EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(t), transition_id=3))])), "
        "RegisterEventHandler(OnStateTransition(target_lifecycle_node=t, start_state='activating', goal_state='active', entities=["
        "talker(name='listener')]))])(LifecycleNode(package='demo', executable='talker', name='t', namespace=''))",
        expect={
            "processes.1.name": "listener",
            "processes.1.when": {"on_transition_of": "talker-1", "state": "active"},
            "len transitions": 2,
        },
    ),
    body(
        "LifecycleTransition leads through transitions",
        "LifecycleNode(package='demo', executable='talker', name='t', namespace='r'), "
        "LifecycleTransition(lifecycle_node_names=['/r/t'], transition_ids=[1, 3])",
        expect={"len transitions": 2, "transitions.1.transition": "activate"},
    ),
    lifecycle(
        "a node is asked by its name, with or without its namespace",
        "LifecycleNode(package='demo', executable='talker', name='t', namespace=''), "
        "*[EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_node_name(name), transition_id=number)) "
        "for name, number in (('t', 1), ('/t', 3))]",
        expect={"len transitions": 2, "len warnings": 0},
    ),
    body(
        "nodes of one name are counted",
        "*[Node(package='demo', executable='talker', name='t', namespace='') for _ in range(2)], "
        "OpaqueFunction(function=lambda context: ["
        "Node(package='demo', executable='talker', name=f'x{n}', namespace='') "
        "for n in range(__import__('launch_ros').utilities.get_node_name_count(context, '/t'))])",
        expect={"len processes": 4},
    ),
    lifecycle(
        "a transition that the state does not allow is warned of",
        "*(lambda t: [t, EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(t), transition_id=3))])("
        "LifecycleNode(package='demo', executable='talker', name='t', namespace=''))",
        expect={"len warnings": 1, "len transitions": 1},
    ),
    fails(
        "a handler of a state for a node that has none",
        "__import__('launch_ros').event_handlers.OnStateTransition(target_lifecycle_node=talker(), goal_state='active', entities=[])",
        "bad_target",
    ),
    fails(
        "LifecycleTransition of nothing",
        "LifecycleTransition(lifecycle_node_names=[], transition_ids=[1])",
        "exception",
    ),
    Case(
        "a lifecycle node in XML",
        "<launch>\n<lifecycle_node pkg='demo' exec='talker' name='t' namespace='' autostart='true'/>\n</launch>",
        {
            "outcome": "ok",
            "processes.0.kind": "lifecycle_node",
            "processes.0.autostart": True,
            "len transitions": 2,
        },
        filename="x.launch.xml",
    ),
    body(
        "composable nodes take part in namespaces, parameters and remappings of their scope",
        "PushROSNamespace('r'), SetParameter('g', 1), SetRemap('a', 'b'), "
        "ComposableNodeContainer(name='c', namespace='', package='demo', executable='talker', composable_node_descriptions=["
        "ComposableNode(package='p', plugin='p::N', name='n', namespace='s', remappings=[('c', 'd')]), "
        "ComposableNode(package='p', plugin='p::M', name='m', condition=IfCondition('false'))])",
        expect={
            "len processes.0.components": 1,
            "processes.0.components.0.namespace": "/r/s",
            "processes.0.components.0.parameters": [{"name": "g", "value": 1, "type": "integer"}],
            "processes.0.components.0.remappings": [["a", "b"], ["c", "d"]],
        },
    ),
    body(
        "nodes are loaded into a container by its name",
        "LoadComposableNodes(target_container='/r/c', composable_node_descriptions=[ComposableNode(package='p', plugin='p::N')])",
        expect={
            "loaded_components.0.container": "/r/c",
            "loaded_components.0.components.0.plugin": "p::N",
        },
    ),
]


def xml(name: str, text: str, /, _files: dict[str, str] | None = None, **expect: object) -> Case:
    """A case that is an XML launch file."""
    wanted = {"outcome": "ok", **expect.pop("expect", {})}  # type: ignore[dict-item]
    return Case(
        name, f"<launch>\n{text}\n</launch>", wanted, files=_files or {}, filename="x.launch.xml"
    )


def yaml(name: str, text: str, /, **expect: object) -> Case:
    """A case that is a YAML launch file."""
    wanted = {"outcome": "ok", **expect.pop("expect", {})}  # type: ignore[dict-item]
    return Case(name, f"launch:\n{text}", wanted, filename="x.launch.yaml")


def bad(kind: str, line: int = 2, /, **expect: object) -> dict[str, object]:
    """Return the expected plan of a markup file with a mistake."""
    return {"outcome": "error", "problem.kind": kind, "problem.line": line, **expect}


MARKUP = [
    xml(
        "XML: types of parameters",
        "<node pkg='demo' exec='talker'><param name='a' value='010'/><param name='b' value='yes'/><param name='c' value=\"'1'\"/>"
        "<param name='d' value='1.' type='float'/><param name='e' value='1' type='bool'/><param name='f' value='[1, 2]'/>"
        "<param name='g' value='a;b' value-sep=';'/><param name='h' value=''/><param name='i' value='x, y' type='yaml'/></node>",
        expect={
            "parameter 0 a": 8,
            "parameter 0 b": True,
            "parameter 0 c": "1",
            "parameter 0 d": 1.0,
            "parameter 0 e": True,
            "parameter 0 f": [1, 2],
            "parameter 0 g": ["a", "b"],
            "parameter 0 h": "",
            "parameter 0 i": "x, y",
        },
    ),
    xml(
        "XML: an argument's text becomes a typed parameter",
        "<arg name='r' default='50.0'/><arg name='s' default='true'/>"
        "<node pkg='demo' exec='talker'><param name='r' value='$(var r)'/><param name='s' value='$(var s)'/>"
        "<param name='t' value='$(var r)' type='str'/></node>",
        expect={"parameter 0 r": 50.0, "parameter 0 s": True, "parameter 0 t": "50.0"},
    ),
    xml(
        "XML: a condition of an expression",
        "<arg name='mode' default='sim'/>"
        "<node pkg='demo' exec='talker' if=\"$(eval '\\'$(var mode)\\' == \\'sim\\'')\"/><node pkg='demo' exec='listener' unless='true'/>",
        expect={"len processes": 1, "processes.0.executable": "talker"},
    ),
    xml(
        "XML: boolean substitutions",
        "<log message='$(not true)$(and true 1)$(or false 0)$(equals 1 1.0)$(any false true)$(all false true)$(if true a b)'/>",
        expect={"logs.0.message": "falsetruefalsetruetruefalsea"},
    ),
    xml(
        "XML: a default of an environment variable, and a quoted argument",
        "<log message=\"$(env NO_SUCH 'two words') $(env NO_SUCH '')|\"/>",
        expect={"logs.0.message": "two words |"},
    ),
    xml(
        "XML: scopes",
        "<let name='a' value='1'/><group><let name='a' value='2'/></group><group scoped='false'><let name='b' value='$(var a)'/></group>"
        "<log message='$(var a)$(var b)'/>",
        expect={"logs.0.message": "11"},
    ),
    xml(
        "XML: an include with arguments by arg and by let",
        "<include file='$(dirname)/o.xml'><arg name='x' value='1'/></include><include file='$(dirname)/o.xml'><let name='x' value='2'/></include>",
        {"o.xml": "<launch><arg name='x' default='0'/><log message='$(var x)'/></launch>"},
        expect={"logs.0.message": "1", "logs.1.message": "2"},
    ),
    xml(
        "XML: a Python file is included",
        "<include file='$(dirname)/other.py'/>",
        {"other.py": OTHER},
        expect={"processes.0.name": "n1"},
    ),
    xml(
        "XML: an empty args is one empty argument",
        "<node pkg='demo' exec='talker' args=''/><node pkg='demo' exec='talker' args='-a  $(env NO_SUCH b) $(env NO_SUCH c)d'/>",
        expect={
            "processes.0.argv": ["", "--ros-args"],
            "processes.1.argv": ["-a", "b", "cd", "--ros-args"],
        },
    ),
    xml(
        "XML: a needed process",
        "<node pkg='demo' exec='talker' on_exit='shutdown' respawn='$(env NO_SUCH true)' respawn_delay='2' output='both'/>",
        expect={
            "shutdowns.0.when": {"on_exit_of": "talker-1"},
            "processes.0.respawn": True,
            "processes.0.respawn_delay_s": 2.0,
            "processes.0.output": "both",
        },
    ),
    xml(
        "XML: text for shell is true whatever it says",
        "<executable cmd='echo a' shell='$(env NO_SUCH false)'/>",
        expect={"processes.0.shell": True},
    ),
    xml(
        "XML: globals of the scope",
        "<set_parameter name='a' value='1'/><set_remap from='x' to='y'/><set_env name='A_B' value='c'/><append_env name='A_B' value='d'/>"
        "<push-ros-namespace namespace='r'/><node pkg='demo' exec='talker' name='t'/>",
        expect={
            "processes.0.argv": [
                "--ros-args",
                "-r",
                "__node:=t",
                "-r",
                "__ns:=/r",
                "-p",
                "a:=1",
                "-r",
                "x:=y",
            ],
            "processes.0.env": {"A_B": "c:d"},
        },
    ),
    xml(
        "XML: choices",
        "<arg name='a' default='x'><choice value='x'/><choice value='y'/></arg>",
        expect={"arguments.0.choices": ["x", "y"]},
    ),
    xml(
        "XML: a parameter file with substitutions",
        "<arg name='r' default='5'/><node pkg='demo' exec='talker'><param from='$(dirname)/p.yaml' allow_substs='true'/></node>",
        {"p.yaml": WILD.format("a: $(var r)")},
        expect={"processes.0.parameters.0.content": {"/**": {"ros__parameters": {"a": 5}}}},
    ),
    xml(
        "XML: an unknown word for on_exit",
        "<node pkg='demo' exec='talker' on_exit='die'/>",
        expect=bad("bad_markup"),
    ),
    xml(
        "XML: both if and unless",
        "<log message='x' if='true' unless='false'/>",
        expect=bad("bad_markup"),
    ),
    xml(
        "XML: a substitution that is not closed",
        "<log message='$(var a'/>",
        expect=bad("bad_markup"),
    ),
    xml("XML: a substitution without a name", "<log message='$()'/>", expect=bad("bad_markup")),
    xml(
        "XML: a type and parameters inside",
        "<node pkg='demo' exec='talker'>\n<param name='a' type='int'>\n<param name='b' value='1'/></param></node>",
        expect=bad("bad_markup", 3),
    ),
    xml(
        "XML: an unknown type",
        "<node pkg='demo' exec='talker'>\n<param name='a' type='double' value='1'/></node>",
        expect=bad("bad_markup", 3),
    ),
    xml(
        "XML: a mapping as a value",
        "<node pkg='demo' exec='talker'>\n<param name='a' value='{b: 1}'/></node>",
        expect=bad("bad_markup", 3),
    ),
    xml(
        "XML: the name of a node as ROS 1 and Dashing wrote it",
        "<node pkg='demo' exec='talker' node-name='t'/>",
        expect=bad("bad_markup"),
    ),
    xml("XML: a node without exec", "<node pkg='demo'/>", expect=bad("bad_markup")),
    xml(
        "XML: an unknown package",
        "<node pkg='demmo' exec='talker'/>",
        expect=bad("unknown_package"),
    ),
    Case(
        "XML in a file called .launch",
        "<launch><log message='x'/></launch>",
        {"outcome": "ok", "logs.0.message": "x"},
        filename="robot.launch",
    ),
    Case(
        "XML with a deprecation",
        "<launch deprecated='use another'></launch>",
        {"outcome": "ok", "len warnings": 1},
        filename="x.launch.xml",
    ),
    Case(
        "another root than launch",
        "<robot></robot>",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 1},
        filename="x.xml",
    ),
    yaml(
        "YAML: types of values are YAML's own",
        "- node: {pkg: demo, exec: talker, param: [{name: a, value: 1}, {name: b, value: '1'}, {name: c, value: [1, 2]}, {name: d, value: 1.5}]}\n",
        expect={
            "parameter 0 a": 1,
            "parameter 0 b": "1",
            "parameter 0 c": [1, 2],
            "parameter 0 d": 1.5,
        },
    ),
    yaml(
        "YAML: a timer, a group, an include",
        "- let: {name: a, value: '1'}\n- timer:\n    period: 2.0\n    children:\n    - log: {message: $(var a)}\n"
        "- group:\n    scoped: true\n    children:\n    - let: {name: a, value: '2'}\n- log: {message: $(var a)}\n",
        expect={"logs.0.message": "1", "logs.1.when": {"after_s": 2.0}},
    ),
    yaml(
        "YAML: a whole number where a float is wanted",
        "- timer: {period: 2, children: [{log: {message: x}}]}\n",
        expect=bad("bad_markup"),
    ),
    yaml(
        "YAML: a bool where text is wanted",
        "- node: {pkg: demo, exec: talker, if: true}\n",
        expect={**bad("bad_markup"), "problem.message has": "quotes"},
    ),
    xml(
        "XML: text without quotes in an expression",
        "<arg name='a' default='x'/>\n<node pkg='demo' exec='talker' if=\"$(eval '$(var a) == \\'x\\'')\"/>",
        expect={
            **bad("bad_expression", 3),
            "problem.remedy has": "$(eval '\\'$(var name)\\' == \\'x\\'')",
        },
    ),
    xml(
        "XML: true in an expression of Python",
        "<node pkg='demo' exec='talker' if=\"$(eval 'true')\"/>",
        expect={**bad("bad_expression", 2), "problem.remedy has": "True and False"},
    ),
    yaml("YAML: a number as a name", "- let: {name: a, value: 1}\n", expect=bad("bad_markup")),
    yaml(
        "YAML: an item with two keys",
        "- log: {message: x}\n  let: {name: a, value: b}\n",
        expect=bad("bad_markup"),
    ),
]

#: Texts that `launch` refuses with an error of its grammar, and words of our message.
_REFUSED = {
    "two blanks": ("$(var  k)", "one blank too many"),
    "a blank before the end": ("$(var k )", "one blank too many"),
    "a blank before the name": ("$( var k)", "a name is missing"),
    "a parenthesis without quotes": ("$(eval 1+(2))", "needs quotes"),
    "text behind a closing quote": ("$(eval 'a'b)", "is not closed"),
    "a quote inside an argument": ("$(env X it's)", "is not closed"),
    "a quote that is not closed": ("$(eval 'a)", "a quote is not closed"),
}

#: Texts that `launch` accepts, and their values; `k` is `v`.
_TAKEN = {
    "a dollar without a parenthesis": ("$HOME costs 5$ $$(var k)", "$HOME costs 5$ $v"),
    "a protected dollar": ("\\$(var k)", "$(var k)"),
    "backslashes protect anything": ("a\\nb \\\\", "anb \\"),
    "a protected quote and parenthesis": ("$(env NO_SUCH it\\'s\\(\\))", "it's()"),
    "quotes inside quotes are letters": ("$(env NO_SUCH '$(env NO_SUCH &quot;a&quot;)')", '"a"'),
    "a substitution as the name of another": ("$(var $(env NO_SUCH k))", "v"),
}

GRAMMAR = [
    *(
        xml(
            f"XML: {name}",
            f'<log message="{text}"/>',
            expect=bad("bad_markup", **{"problem.message has": said}),
        )
        for name, (text, said) in _REFUSED.items()
    ),
    *(
        xml(
            f"XML: {name}",
            f'<let name="k" value="v"/><log message="{text}"/>',
            expect={"logs.0.message": said},
        )
        for name, (text, said) in _TAKEN.items()
    ),
    xml(
        "XML: a command line with a quote that is not closed",
        "<node pkg='demo' exec='talker' args=\"it's\"/>",
        expect=bad("bad_text"),
    ),
    xml(
        "XML: ns as ROS 1 wrote it",
        "<node pkg='demo' exec='talker' ns='a'/>",
        expect=bad("bad_markup", **{"problem.remedy has": "namespace="}),
    ),
    *(
        xml(
            f"XML: {text}, which ROS 1 knew",
            text,
            expect=bad("bad_markup", **{"problem.remedy has": said}),
        )
        for text, said in (
            ("<arg name='a' value='5'/>", "default="),
            ("<node pkg='demo' exec='talker' required='true'/>", "on_exit='shutdown'"),
            ("<rosparam command='load' file='a.yaml'/>", "<param from="),
            ("<include file='a.launch.xml' ns='a'/>", "push_ros_namespace"),
            ("<log message='$(optenv A b)'/>", "$(env NAME default)"),
            ("<group ns='a'/>", "push_ros_namespace"),
        )
    ),
    Case(
        "XML in a namespace",
        '<launch xmlns="http://example.org"></launch>',
        {"outcome": "error", "problem.kind": "bad_markup"},
        filename="x.launch.xml",
    ),
    Case(
        "XML with a schema and a version",
        '<launch xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="x" version="1"></launch>',
        {"outcome": "ok"},
        filename="x.launch.xml",
    ),
    Case(
        "XML in a file called .yaml",
        "<launch><log message='x'/></launch>",
        {"outcome": "ok", "logs.0.message": "x"},
        filename="x.launch.yaml",
    ),
    Case(
        "YAML in a file called .launch",
        "# a comment\nlaunch:\n- log: {message: x}\n",
        {"outcome": "ok", "logs.0.message": "x"},
        filename="robot.launch",
    ),
    xml(
        "XML: an action of which it is not known since when it is there",
        "<push_env/>",
        expect={"outcome": "not_assessable", "problem.kind": "unsupported", "problem.line": 2},
    ),
    xml(
        "XML: the environment that the launch began with",
        "<set_env name='A' value='1'/><reset_env/><node pkg='demo' exec='talker'/>",
        expect={"processes.0.env": {}},
    ),
    xml(
        "XML: an executable of a package",
        "<executable cmd='$(exec-in-pkg talker demo)'/>",
        expect={"processes.0.path ends": "/lib/demo/talker"},
    ),
    Case(
        "XML behind a byte order mark",
        "\ufeff<launch><log message='x'/></launch>",
        {"outcome": "ok", "logs.0.message": "x"},
        filename="x.launch.xml",
    ),
]

ENDS = [
    body(
        "what a timer would start after a Shutdown is not started",
        "Shutdown(reason='r'), TimerAction(period=1.0, actions=[talker()])",
        expect={"processes": [], "shutdowns.0.reason": "r"},
    ),
    body(
        "of the timers those before a Shutdown count",
        "*[TimerAction(period=float(n), actions=[Shutdown() if n == 2 else talker(name=f't{n}')]) for n in (3, 2, 1)]",
        expect={"len processes": 1, "processes.0.name": "t1"},
    ),
    body(
        "a timer that a Shutdown does not cancel starts nothing either",
        "Shutdown(), TimerAction(period=1.0, cancel_on_shutdown=False, actions=[talker(), LogInfo(msg='late')])",
        expect={"processes": [], "logs.0.message": "late"},
    ),
    body(
        "what stands behind a Shutdown is visited before the event is handled",
        "Shutdown(), talker()",
        expect={"len processes": 1},
    ),
    body(
        "a node in OnShutdown starts",
        "RegisterEventHandler(OnShutdown(on_shutdown=[talker()])), Shutdown()",
        expect={"len processes": 1, "processes.0.when": {"on_shutdown": True}},
    ),
    body(
        "a process that ends before a Shutdown by time is followed by another",
        "a := talker(), RegisterEventHandler(OnProcessExit(target_action=a, on_exit=[talker()])), "
        "TimerAction(period=9.0, actions=[Shutdown()])",
        expect={"len processes": 2, "processes.1.when": {"on_exit_of": "talker-1"}},
    ),
    body(
        "a file that an event handler includes is an included one, with its arguments",
        "RegisterEventHandler(OnProcessStart(on_start=[IncludeLaunchDescription(os.path.join(HERE, 'other.py'), "
        "launch_arguments=[('a', '1')])])), talker()",
        None,
        {"other.py": f"{HEADER}Arg('a', default_value='0')\n])\n"},
        expect={
            "includes.0.file": "other.py",
            "includes.0.arguments": {"a": "1"},
            "includes.0.when": {"on_start_of": "talker-1"},
            "arguments.0.included": True,
        },
    ),
    body(
        "a file that a timer includes is an included one",
        "TimerAction(period=1.0, actions=[IncludeLaunchDescription(os.path.join(HERE, 'other.py'))])",
        None,
        {"other.py": f"{HEADER}Arg('a', default_value='0')\n])\n"},
        expect={"includes.0.when": {"after_s": 1.0}, "arguments.0.included": True},
    ),
    body(
        "infinite doubles",
        "talker(parameters=[{'a': float('inf'), 'b': [1.0, float('-inf')]}])",
        expect={"effective 0": {"a": float("inf"), "b": [1.0, float("-inf")]}},
    ),
    body(
        "integers of any size",
        "talker(parameters=[{'a': 10**12, 'b': [-10**15]}])",
        expect={"effective 0": {"a": 10**12, "b": [-(10**15)]}},
    ),
    body(
        "a text of a Parameter is read as YAML by the node",
        "talker(parameters=[P('a', 'y'), P('b', '1'), P('c', 'text')])",
        expect={"effective 0": {"a": True, "b": "1", "c": "text"}},
    ),
]

SHAPES_OF_YAML = [
    yaml(
        "YAML: a mapping where a list is wanted",
        "- node: {pkg: demo, exec: talker, param: {name: a, value: 1}}\n",
        expect=bad("bad_markup", **{"problem.remedy has": "dash"}),
    ),
    yaml(
        "YAML: an empty list of parameters",
        "- node: {pkg: demo, exec: talker, param: []}\n",
        expect=bad("bad_markup"),
    ),
    yaml("YAML: an empty list of children", "- group: {children: []}\n", expect={"processes": []}),
    yaml("YAML: a group without children", "- group: {scoped: true}\n", expect=bad("bad_markup")),
    yaml(
        "YAML: a group as a list",
        "- group: [{log: {message: x}}]\n",
        expect={"logs.0.message": "x"},
    ),
    yaml("YAML: an action that holds nothing", "- shutdown:\n", expect=bad("bad_markup")),
    yaml(
        "YAML: actions that are no list",
        "  node: {pkg: demo, exec: talker}\n",
        expect=bad("bad_markup", 1),
    ),
    yaml(
        "YAML: an anchor and what is merged",
        "- node: &a {pkg: demo, exec: talker, name: x}\n- node: {<<: *a, name: y}\n",
        expect={"processes.1.name": "y", "processes.1.executable": "talker"},
    ),
    yaml(
        "YAML: of two equal keys the last counts",
        "- node: {pkg: demo, exec: talker, param: [{name: a, value: 1}], param: [{name: b, value: 2}]}\n",
        expect={"effective 0": {"b": 2}},
    ),
    yaml(
        "YAML: a list of two kinds of numbers",
        "- node: {pkg: demo, exec: talker, param: [{name: a, value: [1, 2.5]}]}\n",
        expect=bad("bad_markup", **{"problem.remedy has": "alike"}),
    ),
    yaml(
        "YAML: respawn without quotes",
        "- node: {pkg: demo, exec: talker, respawn: true}\n",
        expect=bad("bad_markup", **{"problem.remedy has": "quotes"}),
    ),
]

NAMES = [
    body(
        "a namespace of the scope, a relative one, an absolute one, an empty one",
        "PushROSNamespace('/a/'), *[talker(name='t', namespace=n) for n in ('b', '/c', 'd/e/', '')]",
        expect={
            "processes.0.namespace": "/a/b",
            "processes.1.namespace": "/c",
            "processes.2.namespace": "/a/d/e",
            "processes.3.namespace": "/a",
        },
    ),
    body(
        "an absolute pushed namespace begins anew",
        "PushROSNamespace('a'), PushROSNamespace('/b'), talker()",
        expect={"processes.0.namespace": "/b"},
    ),
    body(
        "with a pushed namespace the parameters are for the node's full name",
        "PushROSNamespace('a'), talker(name='t', parameters=[{'x': 1}])",
        expect={"parameter_files": {"t_1.yaml": "/a/t:\n  ros__parameters:\n    x: 1\n"}},
    ),
    body(
        "ros_arguments as a list",
        "talker(ros_arguments=['-p', 'a:=1'])",
        expect={"processes.0.argv": ["--ros-args", "-p", "a:=1", "--ros-args"]},
    ),
    fails("ros_arguments as a tuple", "talker(ros_arguments=('-p', 'a:=1'))", "not_a_list"),
    fails("arguments as a substitution", "talker(arguments=Value('a'))", "not_a_list"),
    fails("an empty name", "talker(name='')", "bad_name"),
    fails("a namespace with two slashes", "talker(name='t', namespace='a//b')", "bad_name"),
    fails("a dash in a name", "talker(name='my-node')", "bad_name"),
    fails("a remapping as a dict", "talker(remappings={'a': 'b'})", "bad_remapping"),
    fails(
        "a target that is a list of nodes",
        "RegisterEventHandler(OnProcessExit(target_action=[talker()], on_exit=[]))",
        "bad_target",
    ),
    fails("respawn as text", "talker(respawn='true')", "bad_type"),
    fails(
        "an executable without a package and no path",
        "Node(package='demo', executable=None)",
        "bad_text",
    ),
    whole(
        "a name of an old release",
        "from launch.some_actions_type import SomeActionsType\n",
        "unknown_import",
        1,
    ),
    Case(
        "LaunchIntrospector and the logging of launch can be imported",
        "import logging\nfrom launch import LaunchDescription, LaunchIntrospector, logging as launch_logging\n"
        "launch_logging.launch_config.level = logging.DEBUG\nlaunch_logging.get_logger('x').info('hello')\n"
        "def generate_launch_description():\n    ld = LaunchDescription([])\n    LaunchIntrospector().format_launch_description(ld)\n    return ld\n",
        {"outcome": "ok"},
    ),
    body(
        "a node that names nothing",
        "talker()",
        expect={"processes.0.argv": NODE, "processes.0.namespace": None},
    ),
]

READ_BY_NODES = [
    body(
        "texts that reach a node as something else, since they are written without quotes",
        "talker(parameters=[{'a': 'y', 'b': '08', 'c': 'nan', 'd': ['x', 'y'], 'e': '12:30', 'f': '5'}])",
        expect={
            "parameter 0 a": True,
            "processes.0.parameters.0.type": "bool",
            "parameter 0 b": 8.0,
            "parameter 0 c": {"!!float": "nan"},
            "parameter 0 d": ["x", True],
            "parameter 0 e": "12:30",
            "parameter 0 f": "5",
            "len warnings": 4,
        },
    ),
    body(
        "a file of parameters is read as a node reads it",
        "talker(name='t', namespace='', parameters=[HERE + '/p.yaml'])",
        _files={
            "p.yaml": "/**:\n  ros__parameters: {a: 1e2, b: 010, c: y, d: 'y', e: 1_000, f: 2024-01-01, g: 1:30, h: !!str 5}\n"
            "/t:\n  ros__parameters: {i: .inf, j: 0x1F, k: [1.0, 2e3], l: ~, 5: on}\n"
        },
        expect={
            "effective 0": {
                **{
                    "a": 100.0,
                    "b": 8,
                    "c": True,
                    "d": "y",
                    "e": "1_000",
                    "f": "2024-01-01",
                    "g": "1:30",
                    "h": "5",
                },
                **{"i": float("inf"), "j": 31, "k": [1.0, 2000.0], "l": "~", "5": True},
            }
        },
    ),
    body(
        "a file of parameters with an alias, which no node can read",
        "talker(parameters=[HERE + '/p.yaml'])",
        _files={"p.yaml": "/**:\n  ros__parameters: {a: &x 1, b: *x}\n"},
        expect={"len warnings": 1, "warnings.0.message has": "aliases"},
    ),
    body(
        "parameters among the arguments come before the launch file's own",
        "talker(parameters=[{'b': 3}], arguments=['x', '--ros-args', '-p', 'a:=1e2', '-p', 'b:=2', '--params-file', HERE + '/p.yaml'])",
        _files={"p.yaml": "/**:\n  ros__parameters: {c: y}\n"},
        expect={
            "effective 0": {"a": 100.0, "b": 3, "c": True},
            "processes.0.parameters.0.type": "double",
        },
    ),
    body(
        "a composable node's missing file of parameters",
        "ComposableNodeContainer(name='c', namespace='', package='demo', executable='talker', composable_node_descriptions=["
        "ComposableNode(package='p', plugin='p::N', name='n', parameters=['/no/p.yaml'])])",
        expect={"outcome": "error", "problem.kind": "file_not_found"},
    ),
    body(
        "a delay that is no number is found out when the process is to start again",
        "talker(respawn=True, respawn_delay='2.0', respawn_max_retries=Value('n', default='3'))",
        expect={
            "processes.0.respawn_delay_s": 0.0,
            "processes.0.respawn_max_retries": -1,
            "len warnings": 2,
        },
    ),
    body(
        "a time-out without a value is found out when the launch ends",
        "talker(sigterm_timeout=Value('no_such'), sigkill_timeout='7')",
        expect={
            "processes.0.sigterm_timeout_s": 5.0,
            "processes.0.sigkill_timeout_s": 7.0,
            "len warnings": 1,
        },
    ),
]

#: Expected messages for common slips: entities, kind, and a word of the message or the remedy.
_SLIPS = {
    "text and a substitution added": (
        "talker(name='a' + Value('x'))",
        "substitution_too_early",
        "['text'",
    ),
    "a substitution and text added": (
        "talker(name=Value('x') + 'a')",
        "substitution_too_early",
        "['text'",
    ),
    "a substitution in os.path.join": (
        "LogInfo(msg=os.path.join('a', Value('x')))",
        "substitution_too_early",
        "PathJoin",
    ),
    "float() of a substitution": (
        "talker(parameters=[{'a': float(Value('x'))}])",
        "substitution_too_early",
        "perform",
    ),
    "a function that takes no context": (
        "OpaqueFunction(function=lambda: [])",
        "positional_argument",
        "context",
    ),
    "an action for an event": (
        "EmitEvent(event=Shutdown())",
        "not_an_event",
        "launch.events.Shutdown()",
    ),
    "a handler that was never registered": (
        "UnregisterEventHandler(OnProcessStart(on_start=[]))",
        "exception",
        "Correct",
    ),
    "a list where a dict is wanted": ("talker(additional_env=[('A', '1')])", "bad_pairs", "dict"),
    "a type that no parameter has": (
        "talker(parameters=[{'a': ParameterValue(Value('x', default='1'), value_type=dict)}])",
        "bad_type",
        "List[...]",
    ),
    "a list where one number is wanted": (
        "TimerAction(period=[5], actions=[])",
        "bad_type",
        "not a list",
    ),
    "a number as a text": ("LogInfo(msg=TextSubstitution(text=5))", "bad_text", "Give text"),
    "a list as the name of an argument": (
        "Arg(['a'], default_value='x')",
        "exception",
        "unhashable",
    ),
    "a folder where a file is wanted": (
        "IncludeLaunchDescription(PythonLaunchDescriptionSource(HERE))",
        "file_not_found",
        "folder",
    ),
    "a called function": ("OpaqueFunction(function=talker())", "bad_type", "without calling it"),
    "exec= for executable=": (
        "Node(package='demo', exec='talker')",
        "unknown_keyword",
        "'executable='",
    ),
    "a keyword of another class": (
        "LogInfo(msg=EnvironmentVariable('A', default='x'))",
        "unknown_keyword",
        "EnvironmentVariable()",
    ),
    "None in a group": ("GroupAction([talker(), None])", "not_an_action", "item 2"),
    "a group of one action without a list": ("GroupAction(actions=talker())", "not_a_list", "list"),
    "text for a whole number": (
        "talker(parameters=[{'a': ParameterValue('5', value_type=int)}])",
        "bad_type",
        "an int",
    ),
    "an executable that resembles none": (
        "Node(package='demo', executable='zzz')",
        "unknown_executable",
        "'demo'. The",
    ),
}

#: Whole files, with the line that is to be shown and a word of the remedy.
_WHOLE = {
    "an async function": (
        "async def generate_launch_description():\n    return LaunchDescription([])\n",
        "wrong_return",
        2,
        "'def'",
    ),
    "a generator": (
        "def generate_launch_description():\n    yield LaunchDescription([])\n",
        "wrong_return",
        2,
        "'yield'",
    ),
    "a function that wants an argument": (
        "def generate_launch_description(context):\n    pass\n",
        "missing_argument",
        2,
        "Give",
    ),
    "a description without a function": (
        "launch_description = LaunchDescription([])\n",
        "no_generate_function",
        None,
        "Write a function",
    ),
    "a description under the function's name": (
        "generate_launch_description = LaunchDescription([])\n",
        "no_generate_function",
        None,
        "Write a function",
    ),
    "a null byte": ("# \0\n", "syntax_error", None, "UTF-8"),
    "a typographic quote": ("x = \u2018demo\u2019\n", "syntax_error", 2, "syntax"),
    "an environment without packages": (
        "import os\nos.environ['AMENT_PREFIX_PATH'] = ''\ndef generate_launch_description():\n    return LaunchDescription([Node(package='demo', executable='talker')])\n",
        "exception",
        5,
        "Correct",
    ),
    "a description that holds itself": (
        "def generate_launch_description():\n    ld = LaunchDescription()\n    ld.add_action(ld)\n    return ld\n",
        "endless",
        3,
        "end",
    ),
    "a group that holds itself": (
        "def generate_launch_description():\n    inside = []\n    inside.append(GroupAction(inside))\n    return LaunchDescription(inside)\n",
        "endless",
        4,
        "end",
    ),
    "a function that returns itself without end": (
        "def again(context):\n    return [OpaqueFunction(function=again)]\ndef generate_launch_description():\n    return LaunchDescription(again(None))\n",
        "endless",
        3,
        "end",
    ),
    "a function that yields without end": (
        "def more(context):\n    while True:\n        yield LogInfo(msg='x')\ndef generate_launch_description():\n    return LaunchDescription([OpaqueFunction(function=more)])\n",
        "endless",
        4,
        "end",
    ),
    "timers without end": (
        "def again(context):\n    return [TimerAction(period=1.0, actions=[OpaqueFunction(function=again)])]\ndef generate_launch_description():\n    return LaunchDescription(again(None))\n",
        "endless",
        3,
        "end",
    ),
    "a handler that its own actions call": (
        "def generate_launch_description():\n    return LaunchDescription([\n        RegisterEventHandler(OnExecutionComplete(on_completion=[LogInfo(msg='x')]))])\n",
        "endless",
        4,
        "end",
    ),
    "exit() while launching": (
        "def generate_launch_description():\n    return LaunchDescription([OpaqueFunction(function=lambda context: exit(1))])\n",
        "exits",
        3,
        "exit",
    ),
}
_IMPORTS = "from launch import *; from launch.actions import *; from launch.event_handlers import *; from launch_ros.actions import *\n"

SLIPS = [
    *(
        fails(name, entities, kind, expect={"problem has": said})
        for name, (entities, kind, said) in _SLIPS.items()
    ),
    *(
        whole(
            name,
            _IMPORTS + text,
            kind,
            line,
            expect={"problem.remedy has": said, "problem.file": "x_launch.py"},
        )
        for name, (text, kind, line, said) in _WHOLE.items()
    ),
    Case(
        "the sub-modules of launch are among all that it shows",
        "from launch import *\ndef generate_launch_description():\n"
        "    return LaunchDescription([actions.ExecuteProcess(cmd=['true'], name='t')])\n",
        {"outcome": "ok", "processes.0.line": 3},
    ),
    Case(
        "a module of the submission's own package",
        "from robot.parts import generate_launch_description\n",
        {"outcome": "ok", "processes.0.name": "n1"},
        files={
            **{
                "ws/robot/package.xml": "<package/>",
                "ws/robot/setup.py": "",
                "ws/robot/robot/__init__.py": "",
            },
            "ws/robot/robot/parts.py": OTHER,
        },
    ),
    Case(
        "a module beside the launch file, where Python does not look",
        "from parts import generate_launch_description\n",
        {
            **{"outcome": "error", "problem.kind": "unknown_import", "problem.line": 1},
            "problem.message has": "'parts.py' is nowhere",
        },
        files={"parts.py": OTHER},
    ),
    Case(
        "a Python package that its ROS package does not install",
        "import parts\n",
        {"outcome": "error", "problem.kind": "unknown_import"},
        files={
            "parts/__init__.py": "",
            "package.xml": "<package/>",
            "CMakeLists.txt": "project(robot)\n",
        },
    ),
    *(
        fails(name, entities, kind, expect={"outcome": "not_assessable", "problem.module": program})
        for name, entities, kind, program in (
            (
                "a command of xacro, which is not here",
                "LogInfo(msg=Command(['xacro ', 'a']))",
                "missing_program",
                "xacro",
            ),
            (
                "the path of ros2, which is not here",
                "LogInfo(msg=FindExecutable(name='ros2'))",
                "missing_program",
                "ros2",
            ),
        )
    ),
    body(
        "an autostart is at the line of its node",
        "\nLifecycleNode(package='demo', executable='talker', name='t', namespace='', autostart=True)",
        expect={"transitions.0.line": BODY_LINE + 1, "transitions.0.file": "x_launch.py"},
    ),
    Case(
        "files that include each other in XML",
        "<launch><include file='$(dirname)/b.xml'/></launch>",
        {"outcome": "error", "problem.kind": "include_recursive", "problem.file": "b.xml"},
        files={"b.xml": "<launch><include file='$(dirname)/x.launch.xml'/></launch>"},
        filename="x.launch.xml",
    ),
    Case(
        "a file that includes itself until a condition fails",
        _IMPORTS
        + "from launch.conditions import IfCondition\nfrom launch.substitutions import *\ndef generate_launch_description():\n"
        "    n = LaunchConfiguration('n')\n"
        "    again = IncludeLaunchDescription(ThisLaunchFile(), launch_arguments={'n': PythonExpression([n, '-1'])}.items(),\n"
        "        condition=IfCondition(PythonExpression([n, '> 1'])))\n"
        "    return LaunchDescription([DeclareLaunchArgument('n', default_value='3'), LogInfo(msg=n), again])\n",
        {"outcome": "ok", "len logs": 3, "logs.2.message": "1"},
    ),
    Case(
        "carriage returns, a byte order mark, and the function from another module",
        "\ufeffimport os, sys\r\nsys.path.insert(0, os.path.dirname(__file__))\r\n"
        "from made_elsewhere import generate_launch_description\r\n",
        {"outcome": "ok", "processes.0.name": "n1"},
        files={"made_elsewhere.py": OTHER},
    ),
    body(
        "a number as the name and the description of an argument",
        "Arg(5, default_value='x', description=7)",
        expect={"arguments.0.name": "5", "arguments.0.description": "7"},
    ),
    body(
        "conditions are described by what they compare",
        "Arg('a', default_value='x'), talker(condition=LaunchConfigurationEquals('a', 'x')), "
        "talker(condition=LaunchConfigurationNotEquals('a', 'x'))",
        expect={
            "processes.0.condition_note": "LaunchConfigurationEquals('a', 'x') holds",
            "not_started.0.why": "LaunchConfigurationNotEquals('a', 'x') does not hold",
        },
    ),
    body(
        "a class where an action is wanted fails when the process ends",
        "talker(on_exit=Shutdown)",
        expect={"len warnings": 1, "warnings.0.file": None},
    ),
    body(
        "what is said without end is cut",
        "*[LogInfo(msg='x' * 3000) for _ in range(600)]",
        expect={"len logs": 500, "logs.0.message": "x" * 2000},
    ),
]

WRITES = """\
import os, tempfile, yaml
from launch import LaunchDescription
from launch.actions import ExecuteProcess
from launch_ros.actions import Node
def generate_launch_description():
    folder = tempfile.mkdtemp()
    params, script = os.path.join(folder, 'params.yaml'), os.path.join(folder, 'tool.sh')
    with open(params, 'w') as file:
        yaml.dump({'/**': {'ros__parameters': {'rate': 2.5}}}, file)
    with open(script, 'w') as file:
        file.write('#!/bin/sh\\necho hello\\n')
    return LaunchDescription([
        Node(package='demo', executable='talker', name='t', parameters=[params, {'config': params}],
             arguments=['--file=' + params], additional_env={'A_B': params}),
        ExecuteProcess(cmd=['sh', script]),
        Node(package='demo', executable='listener', parameters=['OLD/p.yaml'.replace('OLD', os.path.dirname(__file__))]),
    ])
"""

WRITTEN = [
    Case(
        "files that are written while the file is read go with the plan",
        WRITES,
        {
            "outcome": "ok",
            "processes.0.argv.0": "--file={parameters}/params_1.yaml",
            "processes.0.argv.5": "{parameters}/params_1.yaml",
            "processes.0.env": {"A_B": "{parameters}/params_1.yaml"},
            "processes.0.parameters.0.content": {"/**": {"ros__parameters": {"rate": 2.5}}},
            "len processes.0.parameter_files": 2,
            "processes.0.parameter_files has": "params_1.yaml",
            "parameter_files.t_1|yaml": "/**:\n  ros__parameters:\n    config: {parameters}/params_1.yaml\n",
            "parameter_files.params_1|yaml": "/**:\n  ros__parameters:\n    rate: 2.5\n",
            "processes.1.argv": ["{parameters}/tool_1.sh"],
            "processes.1.parameter_files": {"tool_1.sh": "#!/bin/sh\necho hello\n"},
            "processes.2.argv.2 ends": "/p.yaml",
            "processes.2.parameter_files": {},
        },
        files={"p.yaml": "/**:\n  ros__parameters:\n    a: 1\n"},
    ),
]

CASES = [
    *ENDS,
    *WRITTEN,
    *READ_BY_NODES,
    *GRAMMAR,
    *SHAPES_OF_YAML,
    *SLIPS,
    *PATHS,
    *TIMERS,
    *SCOPES,
    *VALUES,
    *TEXT_TRAPS,
    *HANDLERS,
    *LIFECYCLES,
    *MARKUP,
    *NAMES,
]

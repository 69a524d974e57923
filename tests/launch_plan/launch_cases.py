"""Launch files, each with parts of its plan by the documented semantics of ROS 2 Jazzy.

A case names expected values by paths into the plan: `processes.0.name` is the name of the first
process, `len processes` the number of processes, `parameter 0 rate` the value of a parameter of the
first process.
"""

# ruff: noqa: E501 - a table: a launch file in one line reads better than one cut in the middle

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

HEADER = """\
import os
from functools import partial
from typing import List
from launch import LaunchDescription
from launch.actions import *
from launch.conditions import *
from launch.event_handlers import *
from launch.events import Shutdown as ShutdownEvent, matches_action
from launch.events.process import ShutdownProcess
from launch.launch_description_sources import *
from launch.substitutions import *
from launch_ros.actions import *
from launch_ros.descriptions import ComposableNode
from launch_ros.parameter_descriptions import Parameter as P, ParameterFile, ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackagePrefix, FindPackageShare

HERE = os.path.dirname(__file__)
talker = partial(Node, package='demo', executable='talker')
Arg, Value = DeclareLaunchArgument, LaunchConfiguration
def generate_launch_description():
    return LaunchDescription([
"""
FOOTER = "\n    ])\n"
BODY_LINE = HEADER.count("\n") + 1


@dataclass(frozen=True)
class Case:
    """A launch file and expected parts of its plan."""

    name: str
    text: str
    expect: Mapping[str, Any]
    arguments: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    filename: str = "x_launch.py"


def body(
    name: str, entities: str, /, _arguments: Any = None, _files: Any = None, **expect: Any
) -> Case:
    """Return a case with some entities inside the common header of a launch file."""
    expect = {"outcome": "ok", **expect.pop("expect", {}), **expect}
    return Case(name, HEADER + entities + FOOTER, expect, _arguments or {}, _files or {})


def fails(name: str, entities: str, kind: str, line: int | None = BODY_LINE, **expect: Any) -> Case:
    """Return a case with a mistake in its entities, on their first line unless told otherwise."""
    arguments, files = expect.pop("_arguments", {}), expect.pop("_files", {})
    wanted = {
        "outcome": "error",
        "problem.kind": kind,
        "problem.file": "x_launch.py",
        "problem.line": line,
    }
    return Case(
        name, HEADER + entities + FOOTER, {**wanted, **expect.pop("expect", {})}, arguments, files
    )


def whole(name: str, text: str, kind: str, line: int | None, **expect: Any) -> Case:
    """A case with a mistake in the file as a whole."""
    outcome = expect.pop("outcome", "error")
    wanted = {
        "outcome": outcome,
        "problem.kind": kind,
        "problem.line": line,
        **expect.pop("expect", {}),
    }
    return Case(name, text, wanted)


NODE = ["--ros-args"]
FILE = "{parameters}/talker_1.yaml"

ARGUMENTS = [
    body("no entities", "", expect={"processes": [], "problem": None}),
    body(
        "a node needs only an executable",
        "talker()",
        expect={"processes.0.argv": NODE, "processes.0.name": None},
    ),
    body(
        "an executable without a package is a path",
        "Node(executable='/bin/true')",
        expect={"processes.0.path": "/bin/true", "processes.0.package": None},
    ),
    body(
        "processes are numbered in order",
        "talker(), talker()",
        expect={"processes.0.id": "talker-1", "processes.1.id": "talker-2"},
    ),
    body(
        "exec_name labels the process",
        "talker(exec_name='mine')",
        expect={"processes.0.id": "mine-1"},
    ),
    body(
        "a default is used",
        "Arg('a', default_value='1'), talker(name=['n', Value('a')])",
        expect={"processes.0.name": "n1", "configurations.a": "1", "arguments.0.default": "1"},
    ),
    body(
        "a given argument overrides the default",
        "Arg('a', default_value='1'), talker(name=['n', Value('a')])",
        {"a": "2"},
        expect={"processes.0.name": "n2", "arguments.0.default": "1"},
    ),
    body(
        "a default may be a substitution",
        "Arg('a', default_value='1'), Arg('b', default_value=[Value('a'), '2'])",
        expect={"configurations.b": "12"},
    ),
    body(
        "a second declaration does not override the first",
        "Arg('a', default_value='1'), Arg('a', default_value='2')",
        expect={"configurations.a": "1"},
    ),
    body(
        "description and choices are kept",
        "Arg('a', default_value='x', choices=['x', 'y'], description='D')",
        expect={"arguments.0.choices": ["x", "y"], "arguments.0.description": "D"},
    ),
    body(
        "an undeclared argument is set and warned of",
        "talker()",
        {"zzz": "1"},
        expect={"configurations.zzz": "1", "len warnings": 1},
    ),
    body(
        "a declaration knows its line",
        "\n Arg('a', default_value='1')",
        expect={"arguments.0.line": BODY_LINE + 1, "arguments.0.file": "x_launch.py"},
    ),
    fails("a required argument is missing", "Arg('a')", "required_argument"),
    fails(
        "a conditional required argument is missing",
        "Arg('a', condition=IfCondition('1'))",
        "required_argument",
    ),
    fails(
        "a value outside the choices",
        "Arg('a', choices=['x'])",
        "invalid_choice",
        _arguments={"a": "q"},
    ),
    fails(
        "a default outside the choices",
        "Arg('a', default_value='q', choices=['x'])",
        "invalid_choice",
    ),
    fails("an empty list of choices", "Arg('a', choices=[])", "invalid_choice"),
    fails(
        "an undefined configuration",
        "Arg('rate', default_value='1'), talker(name=Value('rat'))",
        "undefined_configuration",
        expect={"problem.remedy has": "rate"},
    ),
    fails("a number as default", "Arg('a', default_value=100.0)", "bad_text"),
    fails(
        "a misspelt keyword of an argument",
        "Arg('a', default='1')",
        "unknown_keyword",
        expect={"problem.remedy has": "default_value"},
    ),
]

PARAMETERS = [
    body(
        "plain values keep their types",
        "talker(parameters=[{'a': 1, 'b': 1.5, 'c': True, 'd': 'x'}])",
        expect={
            "processes.0.parameters": [
                {"name": "a", "value": 1, "type": "integer"},
                {"name": "b", "value": 1.5, "type": "double"},
                {"name": "c", "value": True, "type": "bool"},
                {"name": "d", "value": "x", "type": "string"},
            ]
        },
    ),
    body(
        "text that looks like a number stays text",
        "talker(parameters=[{'a': '1'}])",
        expect={"parameter 0 a": "1", "processes.0.parameters.0.type": "string"},
    ),
    body(
        "a configuration is read as YAML: float",
        "Arg('a', default_value='50.0'), talker(parameters=[{'a': Value('a')}])",
        expect={"parameter 0 a": 50.0, "processes.0.parameters.0.type": "double"},
    ),
    body(
        "a configuration is read as YAML: integer",
        "Arg('a', default_value='50'), talker(parameters=[{'a': Value('a')}])",
        expect={"parameter 0 a": 50, "processes.0.parameters.0.type": "integer"},
    ),
    body(
        "a configuration is read as YAML: bool",
        "Arg('a', default_value='false'), talker(parameters=[{'a': Value('a')}])",
        expect={"parameter 0 a": False},
    ),
    body(
        "YAML knows yes",
        "Arg('a', default_value='yes'), talker(parameters=[{'a': Value('a')}])",
        expect={"parameter 0 a": True},
    ),
    body(
        "a configuration is read as YAML: list",
        "Arg('a', default_value='[1, 2]'), talker(parameters=[{'a': Value('a')}])",
        expect={"parameter 0 a": [1, 2], "processes.0.parameters.0.type": "integer_array"},
    ),
    body(
        "an empty configuration is an empty text",
        "Arg('a', default_value=''), talker(parameters=[{'a': Value('a')}])",
        expect={"parameter 0 a": ""},
    ),
    body(
        "quotes keep a configuration text",
        """Arg('a', default_value="'1'"), talker(parameters=[{'a': Value('a')}])""",
        expect={"parameter 0 a": "1"},
    ),
    body(
        "value_type=str keeps text",
        "Arg('a', default_value='1'), talker(parameters=[{'a': ParameterValue(Value('a'), value_type=str)}])",
        expect={"parameter 0 a": "1", "processes.0.parameters.0.type": "string"},
    ),
    body(
        "value_type=float reads an integer as a float",
        "Arg('a', default_value='1'), talker(parameters=[{'a': ParameterValue(Value('a'), value_type=float)}])",
        expect={"parameter 0 a": 1.0, "processes.0.parameters.0.type": "double"},
    ),
    body(
        "value_type=bool reads 1 as true",
        "Arg('a', default_value='1'), talker(parameters=[{'a': ParameterValue(Value('a'), value_type=bool)}])",
        expect={"parameter 0 a": True},
    ),
    body(
        "value_type=List[int] reads a list",
        "Arg('a', default_value='[1]'), talker(parameters=[{'a': ParameterValue(Value('a'), value_type=List[int])}])",
        expect={"parameter 0 a": [1]},
    ),
    body(
        "a list of substitutions is joined",
        "Arg('a', default_value='1'), talker(parameters=[{'a': ['x', Value('a')]}])",
        expect={"parameter 0 a": "x1"},
    ),
    body(
        "integers and floats in a list become floats",
        "talker(parameters=[{'a': [1, 2.5]}])",
        expect={"parameter 0 a": [1.0, 2.5], "processes.0.parameters.0.type": "double_array"},
    ),
    body(
        "a list of texts",
        "talker(parameters=[{'a': ['x', '1']}])",
        expect={"parameter 0 a": ["x", "1"]},
    ),
    body(
        "a tuple of bools",
        "talker(parameters=[{'a': (True, False)}])",
        expect={"parameter 0 a": [True, False]},
    ),
    body(
        "a list of lists of substitutions is a list of texts",
        "Arg('a', default_value='q'), talker(parameters=[{'a': [[Value('a')], ['r']]}])",
        expect={"parameter 0 a": ["q", "r"]},
    ),
    body(
        "nested dicts are joined by dots",
        "talker(parameters=[{'a': {'b': {'c': 1}}}])",
        expect={"parameter 0 a.b.c": 1},
    ),
    body(
        "a name may be a substitution",
        "Arg('a', default_value='q'), talker(parameters=[{Value('a'): 1}])",
        expect={"parameter 0 q": 1},
    ),
    body(
        "without a namespace the file is for any node",
        "talker(name='t', parameters=[{'a': 1}])",
        expect={
            "processes.0.argv": [
                "--ros-args",
                "-r",
                "__node:=t",
                "--params-file",
                "{parameters}/t_1.yaml",
            ],
            "parameter_files": {"t_1.yaml": "/**:\n  ros__parameters:\n    a: 1\n"},
        },
    ),
    body(
        "with name and namespace the file is for that node",
        "talker(name='t', namespace='n', parameters=[{'a': 1}])",
        expect={"parameter_files": {"t_1.yaml": "/n/t:\n  ros__parameters:\n    a: 1\n"}},
    ),
    body(
        "each dict is a file, in order",
        "talker(name='t', parameters=[{'a': 1}, {'a': 2}])",
        expect={
            "processes.0.argv": [
                "--ros-args",
                "-r",
                "__node:=t",
                "--params-file",
                "{parameters}/t_1.yaml",
                "--params-file",
                "{parameters}/t_2.yaml",
            ],
            "parameter 0 a": 2,
        },
    ),
    body(
        "a file is passed as it is",
        "talker(parameters=[os.path.join(HERE, 'p.yaml'), {'b': 2}])",
        _files={"p.yaml": "/**:\n  ros__parameters:\n    a: 1\n"},
        expect={
            "processes.0.parameters.0.content": {"/**": {"ros__parameters": {"a": 1}}},
            "parameter 0 b": 2,
        },
    ),
    body(
        "a file may be given as substitutions",
        "talker(parameters=[PathJoinSubstitution([ThisLaunchFileDir(), 'p.yaml'])])",
        _files={"p.yaml": "talker:\n  ros__parameters:\n    a: 1\n"},
        expect={"processes.0.parameters.0.content": {"talker": {"ros__parameters": {"a": 1}}}},
    ),
    body(
        "a file with substitutions is resolved",
        "Arg('a', default_value='7'), talker(parameters=[ParameterFile(os.path.join(HERE, 'p.yaml'), allow_substs=True)])",
        _files={"p.yaml": "/**:\n  ros__parameters:\n    a: $(var a)\n"},
        expect={"processes.0.parameters.0.content": {"/**": {"ros__parameters": {"a": 7}}}},
    ),
    body(
        "a missing file only warns",
        "talker(parameters=['/no/such.yaml'])",
        expect={"len warnings": 1, "processes.0.argv": NODE, "warnings.0.line": BODY_LINE},
    ),
    body(
        "a Parameter goes onto the command line",
        "talker(parameters=[P('a', 1)])",
        expect={"processes.0.argv": ["--ros-args", "-p", "a:=1\n...\n"], "parameter 0 a": 1},
    ),
    body(
        "SetParameter is for the nodes that follow",
        "talker(), SetParameter('a', True), talker()",
        expect={
            "processes.0.parameters": [],
            "processes.1.argv": ["--ros-args", "-p", "a:=True"],
            "parameter 1 a": True,
        },
    ),
    body(
        "SetParameter ends with its group",
        "GroupAction([SetParameter('a', 1), talker()]), talker()",
        expect={"parameter 0 a": 1, "processes.1.parameters": []},
    ),
    body(
        "a node's own parameters come after the global ones",
        "SetParameter('a', 1), talker(parameters=[{'a': 2}])",
        expect={
            "parameter 0 a": 2,
            "processes.0.argv": [
                "--ros-args",
                "-p",
                "a:=1",
                "--params-file",
                "{parameters}/node_name_unspecified_1.yaml",
            ],
        },
    ),
    body(
        "SetUseSimTime is for the launch itself, and warns of that",
        "SetUseSimTime(True), talker()",
        expect={"processes.0.parameters": [], "processes.0.argv": NODE, "len warnings": 1},
    ),
    fails("SetUseSimTime cannot set false", "SetUseSimTime(False), talker()", "exception"),
    body(
        "SetParametersFromFile gives a file",
        "SetParametersFromFile(os.path.join(HERE, 'p.yaml')), talker()",
        _files={"p.yaml": "/**:\n  ros__parameters:\n    a: 1\n"},
        expect={"processes.0.parameters.0.content": {"/**": {"ros__parameters": {"a": 1}}}},
    ),
    fails("parameters as a dict", "talker(parameters={'a': 1})", "parameters_not_list"),
    fails("parameters as a tuple", "talker(parameters=({'a': 1},))", "parameters_not_list"),
    fails("a list of two types", "talker(parameters=[{'a': [1, 'x']}])", "bad_parameter_value"),
    fails("an empty list", "talker(parameters=[{'a': []}])", "bad_parameter_value"),
    fails("a value of None", "talker(parameters=[{'a': None}])", "bad_parameter_value"),
    fails(
        "a configuration that YAML makes a dict",
        "Arg('a', default_value='{x: 1}'), talker(parameters=[{'a': Value('a')}])",
        "bad_parameter_value",
    ),
    fails(
        "a configuration that is no YAML",
        "Arg('a', default_value='a: b: c'), talker(parameters=[{'a': Value('a')}])",
        "bad_parameter_value",
    ),
    fails(
        "text where a float is wanted",
        "Arg('a', default_value='x'), talker(parameters=[{'a': ParameterValue(Value('a'), value_type=float)}])",
        "bad_parameter_value",
    ),
]

NODES = [
    body(
        "the name is a remap rule",
        "talker(name='t')",
        expect={"processes.0.argv": ["--ros-args", "-r", "__node:=t"]},
    ),
    body(
        "a relative namespace becomes absolute",
        "talker(name='t', namespace='n')",
        expect={
            "processes.0.argv": ["--ros-args", "-r", "__node:=t", "-r", "__ns:=/n"],
            "processes.0.namespace": "/n",
        },
    ),
    body(
        "an empty namespace is the root",
        "talker(name='t', namespace='')",
        expect={"processes.0.namespace": "/"},
    ),
    body(
        "remappings follow",
        "talker(remappings=[('a', 'b'), ('/c', '/d')])",
        expect={
            "processes.0.argv": ["--ros-args", "-r", "a:=b", "-r", "/c:=/d"],
            "processes.0.remappings": [["a", "b"], ["/c", "/d"]],
        },
    ),
    body(
        "a remapping may be a substitution",
        "Arg('a', default_value='q'), talker(remappings=[('x', Value('a'))])",
        expect={"processes.0.remappings": [["x", "q"]]},
    ),
    body(
        "arguments come first",
        "talker(arguments=['--x', Value('a', default=3)])",
        expect={"processes.0.argv": ["--x", "3", "--ros-args"]},
    ),
    body(
        "ros_arguments come before the rest",
        "talker(ros_arguments=['--log-level', 'debug'], name='t')",
        expect={
            "processes.0.argv": [
                "--ros-args",
                "--log-level",
                "debug",
                "--ros-args",
                "-r",
                "__node:=t",
            ]
        },
    ),
    body(
        "arguments given as one text fall apart into letters",
        "talker(arguments='-v')",
        expect={"processes.0.argv": ["-", "v", "--ros-args"]},
    ),
    body("output defaults to the log", "talker()", expect={"processes.0.output": "log"}),
    body(
        "output to the screen", "talker(output='screen')", expect={"processes.0.output": "screen"}
    ),
    body(
        "output by stream",
        "talker(output={'both': {'screen', 'log'}})",
        expect={"processes.0.output": {"both": ["log", "screen"]}},
    ),
    body(
        "respawn with a delay",
        "talker(respawn=True, respawn_delay=2.0)",
        expect={"processes.0.respawn": True, "processes.0.respawn_delay_s": 2.0},
    ),
    body(
        "respawn as a configuration",
        "Arg('r', default_value='true'), talker(respawn=Value('r'))",
        expect={"processes.0.respawn": True},
    ),
    body("emulate_tty", "talker(emulate_tty=True)", expect={"processes.0.emulate_tty": True}),
    body(
        "emulate_tty by configuration",
        "SetLaunchConfiguration('emulate_tty', 'true'), talker()",
        expect={"processes.0.emulate_tty": True},
    ),
    body(
        "prefix comes first",
        "talker(prefix='nice -n 5')",
        expect={"processes.0.prefix": ["nice", "-n", "5"], "processes.0.id": "nice-1"},
    ),
    body(
        "additional_env",
        "talker(additional_env={'A_B': 'c'})",
        expect={"processes.0.env": {"A_B": "c"}},
    ),
    body(
        "SetEnvironmentVariable",
        "SetEnvironmentVariable('A_B', 'c'), talker()",
        expect={"processes.0.env": {"A_B": "c"}},
    ),
    body(
        "UnsetEnvironmentVariable",
        "UnsetEnvironmentVariable('HOME'), talker()",
        expect={"processes.0.env_unset": ["HOME"]},
    ),
    body(
        "AppendEnvironmentVariable",
        "SetEnvironmentVariable('A_B', 'c'), AppendEnvironmentVariable('A_B', 'd'), talker()",
        expect={"processes.0.env": {"A_B": "c:d"}},
    ),
    body(
        "environment variables end with their group",
        "GroupAction([SetEnvironmentVariable('A_B', 'c')]), talker()",
        expect={"processes.0.env": {}},
    ),
    body("the working folder", "talker(cwd='/tmp')", expect={"processes.0.cwd": "/tmp"}),
    body(
        "a working folder with a step upwards",
        "talker(cwd='/tmp/a/..')",
        expect={"processes.0.cwd": "/tmp"},
    ),
    body(
        "a node may have a dotted executable name",
        "Node(package='demo', executable='talker.py')",
        expect={"processes.0.executable": "talker.py"},
    ),
    body(
        "two nodes of one full name are warned of",
        "talker(name='t', namespace='n'), talker(name='t', namespace='n')",
        expect={"len warnings": 1},
    ),
    body(
        "a lifecycle node",
        "LifecycleNode(package='demo', executable='talker', name='t', namespace='')",
        expect={"processes.0.kind": "lifecycle_node"},
    ),
    body(
        "a container with its nodes",
        "ComposableNodeContainer(name='c', namespace='', package='demo', executable='talker', "
        "composable_node_descriptions=[ComposableNode(package='p', plugin='p::N', name='n', parameters=[{'a': 1}])])",
        expect={
            "processes.0.kind": "container",
            "processes.0.components.0.plugin": "p::N",
            "processes.0.components.0.parameters": [{"name": "a", "value": 1, "type": "integer"}],
        },
    ),
    body(
        "a process",
        "ExecuteProcess(cmd=['sh', '-c', ['echo ', 'x']])",
        expect={
            "processes.0.kind": "executable",
            "processes.0.argv": ["-c", "echo x"],
            "processes.0.id": "sh-1",
        },
    ),
    body(
        "a process in a shell",
        "ExecuteProcess(cmd=['echo', 'a b'], shell=True)",
        expect={"processes.0.shell": True, "processes.0.path": "echo"},
    ),
    body(
        "a program that is not there only warns",
        "ExecuteProcess(cmd=['no_such_program_here'])",
        expect={"len warnings": 1},
    ),
    fails(
        "Foxy's node_name",
        "talker(node_name='t')",
        "unknown_keyword",
        expect={"problem.remedy has": "'name='"},
    ),
    fails("positional arguments", "Node('demo', 'talker')", "positional_argument"),
    fails(
        "a misspelt keyword",
        "talker(outptu='screen')",
        "unknown_keyword",
        expect={"problem.remedy has": "output"},
    ),
    fails("an unknown word for output", "talker(output='scren')", "bad_output"),
    fails("a remapping that is a list", "talker(remappings=[['a', 'b']])", "bad_remapping"),
    fails("a remapping without a list", "talker(remappings=('a', 'b'))", "bad_remapping"),
    fails("a remapping of three", "talker(remappings=[('a', 'b', 'c')])", "bad_remapping"),
    fails("a number among the arguments", "talker(arguments=[1])", "bad_text"),
    fails("a slash in a name", "talker(name='a/b')", "bad_name"),
    fails("a name that begins with a digit", "talker(name='1a')", "bad_name"),
    fails("a bad namespace", "talker(name='a', namespace='x y')", "bad_name"),
    fails(
        "an unknown package",
        "Node(package='demmo', executable='talker')",
        "unknown_package",
        expect={"problem.remedy has": "'demo'"},
    ),
    fails(
        "an unknown executable",
        "Node(package='demo', executable='talkr')",
        "unknown_executable",
        expect={"problem.message has": "did you mean 'talker'"},
    ),
    fails(
        "an executable without the permission",
        "Node(package='demo', executable='not_executable')",
        "unknown_executable",
        expect={"problem.remedy has": "chmod"},
    ),
    fails(
        "a package without executables",
        "Node(package='empty', executable='x')",
        "unknown_executable",
    ),
    fails("the same node twice", "*[talker()] * 2", "started_twice"),
    fails(
        "a lifecycle node without a namespace",
        "LifecycleNode(package='demo', executable='talker', name='t')",
        "missing_keyword",
    ),
]

FLOW = [
    body(
        "IfCondition lets through",
        "talker(condition=IfCondition('true'))",
        expect={"len processes": 1, "processes.0.condition_note": "IfCondition('true') holds"},
    ),
    body(
        "IfCondition keeps back",
        "talker(condition=IfCondition('false'))",
        expect={"processes": [], "len not_started": 1},
    ),
    body(
        "a group that is kept back is named once",
        "GroupAction([talker(), talker(name='b')], condition=UnlessCondition('1'))",
        expect={"processes": [], "len not_started": 1, "not_started.0.what": "GroupAction"},
    ),
    body(
        "the accepted words, in any case and with blanks",
        "*[talker(condition=IfCondition(w)) for w in ('true', 'True', 'TRUE', '1', ' true ', 'false', 'False', '0')]",
        expect={"len processes": 5},
    ),
    body(
        "UnlessCondition",
        "talker(condition=UnlessCondition('0')), talker(condition=UnlessCondition('1'))",
        expect={"len processes": 1},
    ),
    body(
        "a condition on an argument",
        "Arg('a', default_value='true'), talker(condition=IfCondition(Value('a')))",
        {"a": "false"},
        expect={"processes": []},
    ),
    body(
        "LaunchConfigurationEquals",
        "Arg('a', default_value='x'), talker(condition=LaunchConfigurationEquals('a', 'x')), "
        "talker(condition=LaunchConfigurationEquals('a', 'y')), talker(condition=LaunchConfigurationNotEquals('a', 'y'))",
        expect={"len processes": 2},
    ),
    body(
        "a condition by expression",
        "Arg('a', default_value='3'), talker(condition=IfCondition(PythonExpression([Value('a'), ' > 2'])))",
        expect={"len processes": 1},
    ),
    body(
        "a group under a condition",
        "GroupAction([talker(), talker()], condition=IfCondition('false'))",
        expect={"processes": []},
    ),
    body(
        "a scoped group keeps its configurations",
        "Arg('a', default_value='1'), GroupAction([SetLaunchConfiguration('a', '2')]), talker(name=['n', Value('a')])",
        expect={"processes.0.name": "n1"},
    ),
    body(
        "an unscoped group does not",
        "Arg('a', default_value='1'), GroupAction([SetLaunchConfiguration('a', '2')], scoped=False), "
        "talker(name=['n', Value('a')])",
        expect={"processes.0.name": "n2"},
    ),
    body(
        "a group's own configurations",
        "GroupAction([talker(name=Value('a'))], launch_configurations={'a': 'q'})",
        expect={"processes.0.name": "q"},
    ),
    fails(
        "a group that does not forward",
        "Arg('a', default_value='1'), GroupAction([talker(name=Value('a'))], forwarding=False)",
        "undefined_configuration",
    ),
    body(
        "PushRosNamespace",
        "GroupAction([PushRosNamespace('r'), talker(name='t'), talker(name='t', namespace='s'), "
        "talker(name='t', namespace='/z')]), talker(name='t')",
        expect={
            "processes.0.namespace": "/r",
            "processes.1.namespace": "/r/s",
            "processes.2.namespace": "/z",
            "processes.3.namespace": None,
        },
    ),
    body(
        "namespaces add up",
        "PushROSNamespace('a'), PushROSNamespace('b'), talker()",
        expect={"processes.0.namespace": "/a/b"},
    ),
    body(
        "SetRemap is for the nodes that follow",
        "SetRemap('a', 'b'), talker(remappings=[('c', 'd')])",
        expect={"processes.0.remappings": [["a", "b"], ["c", "d"]]},
    ),
    body(
        "UnsetLaunchConfiguration",
        "Arg('a', default_value='1'), UnsetLaunchConfiguration('a'), talker(name=Value('a', default='gone'))",
        expect={"processes.0.name": "gone"},
    ),
    body(
        "a timer",
        "TimerAction(period=2.0, actions=[talker()]), talker(name='now')",
        expect={
            "processes.0.name": "now",
            "processes.0.when": None,
            "processes.1.when": {"after_s": 2.0},
        },
    ),
    body(
        "timers come by their time",
        "TimerAction(period=3.0, actions=[talker(name='b')]), TimerAction(period=1.0, actions=[talker(name='a')])",
        expect={"processes.0.name": "a", "processes.1.when": {"after_s": 3.0}},
    ),
    body(
        "a timer in a timer adds up",
        "TimerAction(period=1.0, actions=[TimerAction(period=2.0, actions=[talker()])])",
        expect={"processes.0.when": {"after_s": 3.0}},
    ),
    body(
        "a timer's period may be a configuration",
        "Arg('a', default_value='1.5'), TimerAction(period=Value('a'), actions=[talker()])",
        expect={"processes.0.when": {"after_s": 1.5}},
    ),
    body(
        "a timer sees the configurations of when it began to wait",
        "Arg('a', default_value='1'), "
        "TimerAction(period=1.0, actions=[talker(name=['n', Value('a')])]), SetLaunchConfiguration('a', '2')",
        expect={"processes.0.name": "n1"},
    ),
    body(
        "on the start of a process",
        "*(lambda t: [t, RegisterEventHandler(OnProcessStart(target_action=t, on_start=[talker(name='b')]))])(talker(name='a'))",
        expect={"processes.1.name": "b", "processes.1.when": {"on_start_of": "talker-1"}},
    ),
    body(
        "on the exit of a process",
        "*(lambda t: [t, RegisterEventHandler(OnProcessExit(target_action=t, on_exit=talker(name='b')))])(talker(name='a'))",
        expect={"processes.1.when": {"on_exit_of": "talker-1"}},
    ),
    body(
        "a handler after the process sees its start too",
        "*(lambda t: [RegisterEventHandler(OnProcessStart(target_action=t, on_start=[talker(name='b')])), t])(talker(name='a'))",
        expect={"processes.1.when": {"on_start_of": "talker-1"}},
    ),
    body(
        "a timer after a start",
        "*(lambda t: [t, RegisterEventHandler(OnProcessStart(target_action=t, on_start=[TimerAction(period=1.0, actions=[talker(name='b')])]))])(talker(name='a'))",
        expect={"processes.1.when": {"after_s": 1.0, "since": {"on_start_of": "talker-1"}}},
    ),
    body(
        "on_exit as a function",
        "talker(on_exit=lambda event, context: [LogInfo(msg=str(event.returncode))])",
        expect={"logs.0.message": "0", "logs.0.when": {"on_exit_of": "talker-1"}},
    ),
    body(
        "a process that is begun again whenever it ends is no endless launch",
        "*(lambda again: [again()])(lambda: (lambda make: make(make))(lambda make: "
        "talker(on_exit=lambda event, context: [make(make)])))",
        expect={"len processes": 3, "processes.2.when": {"on_exit_of": "talker-2"}},
    ),
    body(
        "on_exit=Shutdown()",
        "talker(on_exit=Shutdown(reason='done'))",
        expect={"shutdowns.0.reason": "done", "shutdowns.0.when": {"on_exit_of": "talker-1"}},
    ),
    body(
        "on the shutdown",
        "RegisterEventHandler(OnShutdown(on_shutdown=[LogInfo(msg='bye')])), Shutdown()",
        expect={"logs.0.message": "bye", "logs.0.when": {"on_shutdown": True}},
    ),
    body(
        "EmitEvent of a shutdown",
        "EmitEvent(event=ShutdownEvent(reason='r'))",
        expect={"shutdowns.0.reason": "r"},
    ),
    body(
        "OnProcessIO waits for output, which there is none of",
        "RegisterEventHandler(OnProcessIO(on_stdout=lambda e: 1 / 0)), talker()",
        expect={"len processes": 1},
    ),
    body(
        "LogInfo speaks",
        "Arg('a', default_value='x'), LogInfo(msg=['a is ', Value('a')])",
        expect={"logs.0.message": "a is x"},
    ),
    body(
        "OpaqueFunction returns actions",
        "Arg('a', default_value='3'), OpaqueFunction(function=lambda c: "
        "[talker(name=f'n{i}') for i in range(int(Value('a').perform(c)))])",
        expect={"len processes": 3},
    ),
    body(
        "OpaqueFunction with arguments",
        "OpaqueFunction(function=lambda c, x, y: [talker(name=x + y)], args=['a'], kwargs={'y': 'b'})",
        expect={"processes.0.name": "ab"},
    ),
    body(
        "OpaqueFunction sets a configuration",
        "OpaqueFunction(function=lambda c: c.launch_configurations.update(a='q')), talker(name=Value('a'))",
        expect={"processes.0.name": "q"},
    ),
    fails(
        "OpaqueFunction returns one action without a list",
        "OpaqueFunction(function=lambda c: talker())",
        "not_a_list",
    ),
    fails(
        "OpaqueFunction raises",
        "OpaqueFunction(function=lambda c: 1 / 0)",
        "exception",
        expect={"problem.message has": "ZeroDivisionError"},
    ),
    fails("a bad condition word", "talker(condition=IfCondition('yes'))", "bad_condition"),
    fails(
        "a condition that is no condition",
        "Arg('a', default_value='1'), talker(condition=Value('a'))",
        "bad_condition",
    ),
    fails("an empty condition", "talker(condition=IfCondition(''))", "bad_condition"),
    fails("None among the entities", "talker(), None", "not_an_action", line=BODY_LINE - 1),
    fails("a list among the entities", "[talker()]", "not_an_action", line=BODY_LINE - 1),
    fails(
        "a handler that is not registered",
        "OnProcessExit(on_exit=[talker()])",
        "not_an_action",
        line=BODY_LINE - 1,
    ),
    fails(
        "a handler of something that is no process",
        "RegisterEventHandler(OnProcessExit(target_action='x', on_exit=[talker()]))",
        "bad_target",
    ),
    fails("a period that is an integer", "TimerAction(period=2, actions=[])", "bad_period"),
]

SUBSTITUTIONS = [
    body(
        "texts are joined",
        "LogInfo(msg=['a', TextSubstitution(text='b')])",
        expect={"logs.0.message": "ab"},
    ),
    body(
        "a default of a configuration",
        "LogInfo(msg=Value('none', default='d'))",
        expect={"logs.0.message": "d"},
    ),
    body(
        "a path",
        "LogInfo(msg=PathJoinSubstitution(['a', 'b', 'c.x']))",
        expect={"logs.0.message": "a/b/c.x"},
    ),
    body(
        "an absolute part begins the path anew",
        "LogInfo(msg=PathJoinSubstitution(['a', '/b']))",
        expect={"logs.0.message": "/b"},
    ),
    body(
        "an expression", "LogInfo(msg=PythonExpression(['2 ** 3']))", expect={"logs.0.message": "8"}
    ),
    body(
        "an expression knows math",
        "LogInfo(msg=PythonExpression(['floor(pi)']))",
        expect={"logs.0.message": "3"},
    ),
    body(
        "an expression with a module",
        "LogInfo(msg=PythonExpression(['json.dumps([1])'], python_modules=['json']))",
        expect={"logs.0.message": "[1]"},
    ),
    body(
        "an expression gives Python's words",
        "LogInfo(msg=PythonExpression([\"'a' == 'a'\"]))",
        expect={"logs.0.message": "True"},
    ),
    body(
        "an environment variable",
        "SetEnvironmentVariable('A_B', 'c'), LogInfo(msg=EnvironmentVariable('A_B'))",
        expect={"logs.0.message": "c"},
    ),
    body(
        "a default of an environment variable",
        "LogInfo(msg=EnvironmentVariable('NO_SUCH', default_value='d'))",
        expect={"logs.0.message": "d"},
    ),
    body("a command", "LogInfo(msg=Command(['echo ', 'x']))", expect={"logs.0.message": "x\n"}),
    body(
        "a program on the PATH",
        "ExecuteProcess(cmd=[FindExecutable(name='sh')])",
        expect={"processes.0.executable": "sh"},
    ),
    body(
        "what a file says",
        "LogInfo(msg=FileContent(os.path.join(HERE, 'f.txt')))",
        _files={"f.txt": "said"},
        expect={"logs.0.message": "said"},
    ),
    body(
        "not, and, or",
        "LogInfo(msg=[NotSubstitution('true'), AndSubstitution('true', '1'), OrSubstitution('false', '0')])",
        expect={"logs.0.message": "falsetruefalse"},
    ),
    body(
        "any, all",
        "LogInfo(msg=[AnySubstitution('false', 'true'), AllSubstitution('false', 'true')])",
        expect={"logs.0.message": "truefalse"},
    ),
    body(
        "equal as truth, number, text",
        "LogInfo(msg=[EqualsSubstitution('True', '1'), EqualsSubstitution('1.0', '1'), "
        "EqualsSubstitution('a', 'b'), NotEqualsSubstitution('a', 'b')])",
        expect={"logs.0.message": "truetruefalsetrue"},
    ),
    body(
        "one of two",
        "LogInfo(msg=IfElseSubstitution('true', 'a', 'b'))",
        expect={"logs.0.message": "a"},
    ),
    body(
        "an anonymous name stays the same",
        "LogInfo(msg=[EqualsSubstitution(AnonName('a'), AnonName('a'))])",
        expect={"logs.0.message": "true"},
    ),
    body(
        "the share folder of a package",
        "LogInfo(msg=PathJoinSubstitution([FindPackageShare('demo'), 'x']))",
        expect={"logs.0.message ends": "/share/demo/x"},
    ),
    body(
        "this file and its folder",
        "LogInfo(msg=[ThisLaunchFile()]), LogInfo(msg=ThisLaunchFileDir())",
        expect={"logs.0.message ends": "/x_launch.py"},
    ),
    fails(
        "an unknown package's share folder",
        "LogInfo(msg=FindPackageShare('nope'))",
        "unknown_package",
    ),
    fails(
        "an undefined environment variable",
        "LogInfo(msg=EnvironmentVariable('NO_SUCH'))",
        "undefined_variable",
    ),
    fails("a command that fails", "LogInfo(msg=Command('false'))", "command_failed"),
    fails(
        "a command that is not there",
        "LogInfo(msg=Command('no_such_program_here'))",
        "command_failed",
    ),
    fails(
        "an expression with an unquoted text",
        "Arg('m', default_value='sim'), LogInfo(msg=PythonExpression([Value('m'), ' == 1']))",
        "bad_expression",
        expect={"problem.message has": "the expression was: sim == 1"},
    ),
    fails(
        "a name given by position to FindExecutable", "FindExecutable('sh')", "positional_argument"
    ),
]

OTHER = HEADER + "    Arg('b', default_value='1'), talker(name=['n', Value('b')])" + FOOTER
NEEDS = HEADER + "    Arg('b'), talker(name=['n', Value('b')])" + FOOTER
SELF = "IncludeLaunchDescription(PythonLaunchDescriptionSource(os.path.join(HERE, '{}')){})"
INCLUDE = SELF.format("other.py", "")

INCLUDES = [
    body(
        "an include",
        INCLUDE,
        _files={"other.py": OTHER},
        expect={
            "processes.0.name": "n1",
            "includes.0.file": "other.py",
            "includes.0.by": "x_launch.py",
            "processes.0.file": "other.py",
        },
    ),
    body(
        "an include with arguments",
        SELF.format("other.py", ", launch_arguments={'b': '2'}.items()"),
        _files={"other.py": OTHER},
        expect={"processes.0.name": "n2", "includes.0.arguments": {"b": "2"}},
    ),
    body(
        "an include by its path only",
        "IncludeLaunchDescription(os.path.join(HERE, 'other.py'))",
        _files={"other.py": OTHER},
        expect={"processes.0.name": "n1"},
    ),
    body(
        "AnyLaunchDescriptionSource",
        "IncludeLaunchDescription(AnyLaunchDescriptionSource([ThisLaunchFileDir(), '/other.py']))",
        _files={"other.py": OTHER},
        expect={"processes.0.name": "n1"},
    ),
    body(
        "an included file's configurations leak",
        INCLUDE + ", talker(name=['m', Value('b')])",
        _files={"other.py": OTHER},
        expect={"processes.1.name": "m1"},
    ),
    body(
        "a group keeps them",
        f"GroupAction([{INCLUDE}]), talker(name=['m', Value('b', default='x')])",
        _files={"other.py": OTHER},
        expect={"processes.1.name": "mx"},
    ),
    body(
        "the including file's configurations reach in",
        "SetLaunchConfiguration('b', '5'), " + INCLUDE,
        _files={"other.py": OTHER},
        expect={"processes.0.name": "n5"},
    ),
    body(
        "the folder is restored after an include",
        SELF.format("d/other.py", "") + ", LogInfo(msg=ThisLaunchFile())",
        _files={"d/other.py": OTHER},
        expect={"logs.0.message ends": "/x_launch.py"},
    ),
    body(
        "an include under a condition that does not hold",
        SELF.format("gone.py", ", condition=IfCondition('false')"),
        expect={"processes": []},
    ),
    fails(
        "an include that needs an argument",
        INCLUDE,
        "required_argument",
        _files={"other.py": NEEDS},
    ),
    body(
        "an include that gets its argument",
        SELF.format("other.py", ", launch_arguments=[('b', '3')]"),
        _files={"other.py": NEEDS},
        expect={"processes.0.name": "n3"},
    ),
    fails("an include that is not there", SELF.format("gone.py", ""), "include_not_found"),
    fails(
        "launch_arguments without items()",
        SELF.format("other.py", ", launch_arguments={'bcd': '2'}"),
        "bad_pairs",
        _files={"other.py": OTHER},
    ),
    fails("a file that includes itself", SELF.format("x_launch.py", ""), "include_recursive"),
    Case(
        "a mistake in an included file is shown there",
        HEADER + INCLUDE + FOOTER,
        {
            "outcome": "error",
            "problem.kind": "unknown_keyword",
            "problem.file": "other.py",
            "problem.line": BODY_LINE,
        },
        files={"other.py": HEADER + "talker(nam='x')" + FOOTER},
    ),
]

RETURN = "from launch import LaunchDescription\ndef generate_launch_description():\n    return LaunchDescription([])\n"

WHOLE = [
    whole("a syntax error", "def generate_launch_description(:\n    pass\n", "syntax_error", 1),
    whole("a wrong indent", "def generate_launch_description():\nreturn 1\n", "syntax_error", 2),
    whole("an empty file", "", "no_generate_function", None),
    whole(
        "a misspelt function",
        RETURN.replace("generate_launch", "genarate_launch"),
        "no_generate_function",
        2,
        expect={"problem.remedy has": "genarate_launch_description"},
    ),
    whole("no return", "def generate_launch_description():\n    pass\n", "wrong_return", 1),
    whole(
        "a list is returned",
        "def generate_launch_description():\n    return []\n",
        "wrong_return",
        1,
    ),
    whole("an exception at load", "x = 1\nraise ValueError('no')\n", "exception", 2),
    whole(
        "a name error",
        "def generate_launch_description():\n    return LaunchDescription([])\n",
        "unknown_name",
        2,
    ),
    whole("exit at load", "import sys\nsys.exit(0)\n", "exits", 2),
    whole(
        "a module that is not installed",
        "import xacro\n",
        "missing_module",
        1,
        outcome="not_assessable",
        expect={"problem.module": "xacro"},
    ),
    whole(
        "a part of a package that is not installed",
        "from moveit_configs_utils import X\n",
        "missing_module",
        1,
        outcome="not_assessable",
        expect={"problem.module": "moveit_configs_utils"},
    ),
    whole(
        "a misspelt module",
        "from launch.action import DeclareLaunchArgument\n",
        "unknown_import",
        1,
    ),
    whole(
        "a module that does not exist",
        "from launch.acctions import Node\n",
        "unknown_import",
        1,
        expect={"problem.remedy has": "actions"},
    ),
    whole(
        "a misspelt attribute",
        "import launch\nx = launch.actions.DeclareLaunchArgumnt\n",
        "unknown_import",
        2,
    ),
    whole("a misspelt package", "from lanch import LaunchDescription\n", "unknown_import", 1),
    whole(
        "a name from the wrong package",
        "from launch.actions import Node\n",
        "unknown_import",
        1,
        expect={"problem.remedy has": "launch_ros.actions"},
    ),
    whole(
        "a misspelt name",
        "from launch.substitutions import LaunchConfigration\n",
        "unknown_import",
        1,
        expect={"problem.remedy has": "LaunchConfiguration"},
    ),
    whole(
        "a name of a later release",
        "from launch.actions import ForEach\n",
        "unknown_import",
        1,
        expect={"problem.message has": "later release"},
    ),
    whole(
        "a launch from inside the file",
        "import launch\nlaunch.LaunchService().run()\n",
        "unsupported",
        2,
        outcome="not_assessable",
    ),
    Case(
        "sub-modules can be imported from",
        "from launch.launch_description import LaunchDescription\n"
        "from launch.actions.declare_launch_argument import DeclareLaunchArgument\nfrom launch.some_substitutions_type import SomeSubstitutionsType\n"
        "from launch.utilities import perform_substitutions\nimport launch.substitutions.launch_configuration\n"
        + RETURN,
        {"outcome": "ok"},
    ),
    Case(
        "modules used with their names",
        "import launch\nimport launch.actions\nimport launch_ros.actions\n"
        "def generate_launch_description():\n    ld = launch.LaunchDescription()\n"
        "    ld.add_action(launch.actions.DeclareLaunchArgument('a', default_value='1'))\n"
        "    ld.add_action(launch_ros.actions.Node(package='demo', executable='talker', name=['n', launch.substitutions.LaunchConfiguration('a')]))\n"
        "    return ld\n",
        {"outcome": "ok", "processes.0.name": "n1"},
    ),
    Case(
        "what the file prints does not disturb",
        "print('{\"outcome\": 1}')\n" + RETURN,
        {"outcome": "ok"},
    ),
]

XML = """<launch>
  <arg name="a" default="1.5" description="A"/>
  <let name="b" value="$(var a)x"/>
  <group>
    <push_ros_namespace namespace="r"/>
    <node pkg="demo" exec="talker" name="t" output="screen" args="-v $(var b)" if="true">
      <param name="f" value="$(var a)"/><param name="i" value="3"/><param name="s" value="3" type="str"/>
      <param name="n"><param name="m" value="true"/></param>
      <remap from="x" to="y"/><env name="A_B" value="c"/>
    </node>
  </group>
  <executable cmd="sh -c 'a b' $(dirname)/z" cwd="/tmp"/>
  <timer period="2.0"><log message="hi"/></timer>
</launch>
"""
YAML = """launch:
- arg: {name: a, default: "1.5"}
- node:
    pkg: demo
    exec: talker
    name: t
    param:
    - {name: f, value: $(var a)}
    - {name: i, value: 3}
    remap:
    - {from: x, to: y}
- include: {file: $(dirname)/o.xml}
- group:
    children: [{log: {message: hi}}]
"""

MARKUP = [
    Case(
        "an XML launch file",
        XML,
        {
            "outcome": "ok",
            "arguments.0.description": "A",
            "processes.0.namespace": "/r",
            "parameter 0 f": 1.5,
            "parameter 0 i": 3,
            "parameter 0 s": "3",
            "parameter 0 n.m": True,
            "processes.0.remappings": [["x", "y"]],
            "processes.0.env": {"A_B": "c"},
            "processes.0.line": 6,
            "processes.0.argv.0": "-v",
            "processes.0.argv.1": "1.5x",
            "processes.1.argv.1": "a b",
            "processes.1.argv.2 ends": "/z",
            "processes.1.cwd": "/tmp",
            "logs.0.when": {"after_s": 2.0},
        },
        filename="x.launch.xml",
    ),
    Case(
        "a YAML launch file",
        YAML,
        {
            "outcome": "ok",
            "parameter 0 f": 1.5,
            "parameter 0 i": 3,
            "processes.0.remappings": [["x", "y"]],
            "processes.0.line": 3,
            "logs.0.message": "in o",
            "logs.1.message": "hi",
        },
        files={"o.xml": "<launch><log message='in o'/></launch>"},
        filename="x.launch.yaml",
    ),
    Case(
        "XML that is not well-formed",
        "<launch>\n<node>\n</launch>",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 3},
        filename="x.xml",
    ),
    Case(
        "an attribute that does not exist",
        "<launch>\n<node pkg='demo' exec='talker' nam='t'/>\n</launch>",
        {
            "outcome": "error",
            "problem.kind": "bad_markup",
            "problem.line": 2,
            "problem.message has": "'name'",
        },
        filename="x.xml",
    ),
    Case(
        "a tag that does not exist",
        "<launch>\n<nod/>\n</launch>",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 2},
        filename="x.xml",
    ),
    Case(
        "an undefined variable in XML",
        "<launch>\n<log message='$(var q)'/>\n</launch>",
        {"outcome": "error", "problem.kind": "undefined_configuration", "problem.line": 2},
        filename="x.xml",
    ),
]

DEPENDS = """\
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from ament_index_python.packages import get_package_share_directory
def generate_launch_description():
    share = get_package_share_directory('{}')
    return LaunchDescription([IncludeLaunchDescription(PythonLaunchDescriptionSource(share + '/launch/{}'))])
"""
PACKAGE = {
    "pkg/package.xml": "<package/>",
    "pkg/setup.py": "",
    "pkg/demo/speaker.py": "",
    "pkg/demo/__init__.py": "",
}

MISTAKES = [
    fails(
        "an executable of Foxy, by its keyword",
        "Node(package='demo', node_executable='talker')",
        "unknown_keyword",
        expect={"problem.remedy has": "'executable='", "problem.message has": "Node() got"},
    ),
    fails(
        "a name of Foxy, by its keyword",
        "talker(node_name='t')",
        "unknown_keyword",
        expect={"problem.remedy has": "'name='", "problem.message has": "Node() got"},
    ),
    fails("a remapping as text", "talker(remappings=['a:=b'])", "bad_remapping"),
    fails(
        "a pair of texts instead of a list of pairs",
        "talker(remappings=('a', 'b'))",
        "bad_remapping",
    ),
    fails(
        "a condition that says yes",
        "LogInfo(msg='x', condition=IfCondition('yes'))",
        "bad_condition",
    ),
    fails(
        "a condition that is a bool", "LogInfo(msg='x', condition=IfCondition(True))", "bad_text"
    ),
    fails(
        "a file that includes itself, by its short name",
        "IncludeLaunchDescription(PythonLaunchDescriptionSource(__file__))",
        "include_recursive",
        expect={"problem.message": "'x_launch.py' includes itself without end"},
    ),
    fails(
        "a name that was not imported",
        "Nodee(package='demo', executable='talker')",
        "unknown_name",
        expect={"problem.remedy has": "'Node'"},
    ),
    whole(
        "an action from the wrong module",
        "from launch.actions import Node\n",
        "unknown_import",
        1,
        expect={"problem.remedy": "Import it from 'launch_ros.actions'."},
    ),
    whole(
        "a function whose name is misspelt",
        "def generate_launch_descripton():\n    pass\n",
        "no_generate_function",
        1,
        expect={"problem.remedy has": "Rename 'generate_launch_descripton'"},
    ),
    fails(
        "an executable whose module has no entry point",
        "Node(package='demo', executable='speaker')",
        "unknown_executable",
        _files=PACKAGE,
        expect={
            "problem.remedy has": '"speaker = demo.speaker:main"',
            "problem.message has": "pkg/demo/speaker.py",
        },
    ),
    Case(
        "an included file that is not installed",
        DEPENDS.format("demo", "inner.launch.py"),
        {
            "outcome": "error",
            "problem.kind": "include_not_found",
            "problem.line": 7,
            "problem.remedy has": "data_files: ('share/demo/launch', ['launch/inner.launch.py'])",
        },
        files={**PACKAGE, "pkg/launch/inner.launch.py": ""},
    ),
    Case(
        "a package of ROS that is not here",
        DEPENDS.format("ros_gz_sim", "gz_sim.launch.py"),
        {
            "outcome": "not_assessable",
            "problem.kind": "missing_package",
            "problem.module": "ros_gz_sim",
        },
    ),
    body(
        "a node of a package of ROS that is not here",
        "Node(package='rviz2', executable='rviz2'), talker()",
        expect={
            "len processes": 2,
            "processes.0.absent has": "'rviz2'",
            "processes.1.absent": "",
            "warnings": [],
        },
    ),
    body(
        "a container of components is not here",
        "ComposableNodeContainer(package='rclcpp_components', executable='component_container', name='c', namespace='',\n"
        " composable_node_descriptions=[ComposableNode(package='demo', plugin='demo::Talker', name='t')])",
        expect={"processes.0.kind": "container", "processes.0.components.0.name": "t"},
    ),
    Case(
        "an attribute of ROS 1",
        "<launch>\n<node pkg='demo' type='talker'/>\n</launch>",
        {
            "outcome": "error",
            "problem.kind": "bad_markup",
            "problem.line": 2,
            "problem.remedy has": "exec=",
        },
        filename="x.xml",
    ),
    Case(
        "a substitution of ROS 1",
        "<launch>\n<log message='$(find demo)'/>\n</launch>",
        {
            "outcome": "error",
            "problem.kind": "bad_markup",
            "problem.line": 2,
            "problem.remedy has": "find-pkg-share",
        },
        filename="x.xml",
    ),
    Case(
        "a parameter without a name in XML",
        "<launch>\n<node pkg='demo' exec='talker'>\n<param value='1'/>\n</node>\n</launch>",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 3},
        filename="x.xml",
    ),
    Case(
        "an executable that does not exist in YAML",
        "launch:\n- node:\n    pkg: demo\n    exec: taker\n",
        {"outcome": "error", "problem.kind": "unknown_executable", "problem.line": 2},
        filename="x.yaml",
    ),
    Case(
        "YAML that is indented wrongly",
        "launch:\n- node:\n    pkg: demo\n   exec: talker\n",
        {"outcome": "error", "problem.kind": "bad_markup", "problem.line": 4},
        filename="x.yaml",
    ),
    Case(
        "a required argument in YAML",
        "launch:\n- arg:\n    name: a\n",
        {"outcome": "error", "problem.kind": "required_argument", "problem.line": 2},
        filename="x.yaml",
    ),
]

CASES = [
    *MISTAKES,
    *ARGUMENTS,
    *PARAMETERS,
    *NODES,
    *FLOW,
    *SUBSTITUTIONS,
    *INCLUDES,
    *WHOLE,
    *MARKUP,
]

"""Causes of process deaths, told from real output."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.crash.causes import Diagnosis
from grader.evidence.crash.diagnosis import advisories, crashed_at, ended_by_signal, explain
from grader.recording.session import OutputLine, ProcessRun, StackFrame
from tests.thorough import part

NODE_PROPERTIES = (
    *(
        "clients",
        "context",
        "default_callback_group",
        "executor",
        "guards",
        "handle",
        "publishers",
        "services",
    ),
    *("subscriptions", "timers", "waitables"),
)
FILES = ("joint_publisher.py", "src/lab/lab/arm_math.py", "README.md")


def lines(text: str, stream: str = "stderr") -> list[OutputLine]:
    """A text as a process's output."""
    return [OutputLine(t, stream, line) for t, line in enumerate(text.split("\n"))]


def raised(final: str, library: str = "") -> list[OutputLine]:
    """Output of a script of the submission that dies of an exception, perhaps inside a library."""
    if library:
        inner = f'  File "/venv/lib/python3.11/site-packages/{library}\n    code()\n'
    else:
        inner = ""
    return lines(
        "Traceback (most recent call last):\n"
        '  File "/cell/ws/joint_publisher.py", line 40, in <module>\n    main()\n'
        '  File "/cell/ws/joint_publisher.py", line 17, in __init__\n    code()\n'
        "    ^^^^^^\n"
        f"{inner}{final}\n"
    )


def told(final: str, library: str = "") -> Diagnosis:
    """The diagnosis of an exception in the submission's `joint_publisher.py:17`."""
    diagnosis = explain(raised(final, library), FILES)
    assert diagnosis is not None
    assert (diagnosis.file, diagnosis.line) == ("joint_publisher.py", 17)
    assert diagnosis.exception_type == final.split(":")[0].split("\n")[0]
    assert diagnosis.remedy
    assert diagnosis.problem.endswith((".", "?"))
    return diagnosis


@pytest.mark.parametrize(
    ("final", "library", "kind", "subject"),
    [
        ("ModuleNotFoundError: No module named 'rclpy'", "", "ros-not-sourced", "rclpy"),
        ("ModuleNotFoundError: No module named 'arm_math'", "", "missing-sibling", "arm_math"),
        (
            "ModuleNotFoundError: No module named 'lab.arm_math'",
            "",
            "missing-sibling",
            "lab.arm_math",
        ),
        ("ModuleNotFoundError: No module named 'pandas'", "", "missing-module", "pandas"),
        ("EOFError: EOF when reading a line", "", "keyboard", ""),
        (
            "AttributeError: `np.NaN` was removed in the NumPy 2.0 release. Use `np.nan` instead.",
            "",
            "removed-from-numpy",
            "NaN",
        ),
        (
            "TypeError: unsupported format string passed to numpy.ndarray.__format__",
            "",
            "format-of-several",
            "",
        ),
        ("ModuleNotFoundError: No module named 'numppy'", "", "misspelt-module", "numppy"),
        (
            "ModuleNotFoundError: No module named 'std_msgs.msgs'",
            "",
            "misspelt-module",
            "std_msgs.msgs",
        ),
        (
            "ModuleNotFoundError: No module named 'my_robot_interfaces'",
            "",
            "missing-interface",
            "my_robot_interfaces",
        ),
        (
            "ModuleNotFoundError: No module named 'geometry_mgs'",
            "",
            "misspelt-module",
            "geometry_mgs",
        ),
        ("ModuleNotFoundError: No module named 'tf2_msgs'", "", "missing-interface", "tf2_msgs"),
        (
            "ModuleNotFoundError: No module named 'tf2_msgs.msg'",
            "",
            "missing-interface",
            "tf2_msgs.msg",
        ),
        (
            "ModuleNotFoundError: No module named 'example_interfaces'",
            "",
            "missing-interface",
            "example_interfaces",
        ),
        ("ModuleNotFoundError: No module named 'test_msgs'", "", "missing-interface", "test_msgs"),
        ("ModuleNotFoundError: No module named 'tf2_ros'", "", "missing-interface", "tf2_ros"),
        (
            "ModuleNotFoundError: No module named 'lab_interfaces'",
            "",
            "missing-interface",
            "lab_interfaces",
        ),
        (
            "ModuleNotFoundError: No module named 'exmaple_interfaces'",
            "",
            "misspelt-module",
            "exmaple_interfaces",
        ),
        (
            "ModuleNotFoundError: No module named 'sdt_msgs.msg'",
            "",
            "misspelt-module",
            "sdt_msgs.msg",
        ),
        (
            "ModuleNotFoundError: No module named 'sensors_msgs.msg'",
            "",
            "misspelt-module",
            "sensors_msgs.msg",
        ),
        ("ModuleNotFoundError: No module named 'tf2_msg'", "", "misspelt-module", "tf2_msg"),
        (
            "ImportError: cannot import name 'QosProfile' from 'rclpy.qos' (/venv/rclpy/qos.py)",
            "",
            "missing-name",
            "QosProfile",
        ),
        (
            "ImportError: cannot import name 'a' from partially initialized module 'arm_math' (most "
            "likely due to a circular "
            "import) (/cell/ws/arm_math.py)",
            "",
            "circular-import",
            "a",
        ),
        (
            "AttributeError: property 'publishers' of 'QoSComparisonNode' object has no setter",
            "",
            "read-only-property",
            "publishers",
        ),
        ("AttributeError: can't set attribute 'timers'", "", "read-only-property", "timers"),
        ("AttributeError: can't set attribute", "", "read-only-property", ""),
        (
            "AttributeError: handle cannot be modified after node creation",
            'rclpy/node.py", line 9, in handle',
            "read-only-property",
            "handle",
        ),
        (
            "AttributeError: 'dict' object has no attribute 'add_node'",
            'rclpy/node.py", line 9, in executor',
            "read-only-property",
            "executor",
        ),
        (
            "AttributeError: property 'area' of 'Square' object has no setter",
            "",
            "read-only-property",
            "area",
        ),
        (
            "AttributeError: 'B' object has no attribute '_default_callback_group'",
            'rclpy/node.py", line 321, in x',
            "super-init-missing",
            "B",
        ),
        (
            "rclpy.exceptions.NotInitializedException: rclpy.init() has not been called. msg:cannot create node",
            "",
            "not-initialised",
            "",
        ),
        (
            "RuntimeError: Context.init() must only be called once",
            'rclpy/context.py", line 97, in init',
            "initialised-twice",
            "",
        ),
        (
            "rclpy._rclpy_pybind11.RCLError: Failed to create publisher: rcl node's context is "
            "invalid, at /project/src/rcl/node.c:404",
            "",
            "context-shut-down",
            "",
        ),
        (
            "rclpy.exceptions.InvalidTopicNameException: Invalid topic name: topic name must not "
            "contain characters other than "
            "alphanumerics, '_', '~', '{', or '}':\n  'a b'\n    ^",
            "",
            "invalid-name",
            "a b",
        ),
        (
            "rclpy.exceptions.InvalidNodeNameException: Invalid node name: node name must not contain "
            "characters other than "
            "alphanumerics or '_':\n  'bad name'\n      ^",
            "",
            "invalid-name",
            "bad name",
        ),
        (
            "rclpy.exceptions.ParameterNotDeclaredException: Invalid access to undeclared parameter(s): max_velocity",
            "",
            "parameter-not-declared",
            "max_velocity",
        ),
        (
            "rclpy.exceptions.ParameterUninitializedException: The parameter 'threshold' is not initialized: threshold",
            "",
            "parameter-without-value",
            "threshold",
        ),
        (
            "rclpy.exceptions.ParameterAlreadyDeclaredException: Parameter(s) already declared: ['v']",
            "",
            "parameter-declared-twice",
            "v",
        ),
        (
            "rclpy.exceptions.InvalidParameterTypeException: Trying to set parameter 'v' to 'fast' of "
            "type 'STRING', expecting type "
            "'DOUBLE': v",
            "",
            "parameter-type",
            "v",
        ),
        (
            "rclpy._rclpy_pybind11.RCLError: failed to initialize rcl: Couldn't parse parameter "
            "override rule: '-p v=fast'. Error: "
            "Expected lexeme type (22) not found",
            "",
            "ros-arguments",
            "-p v=fast",
        ),
        (
            "rclpy.qos.InvalidQoSProfileException: ('Invalid QoSProfile', 'History and/or depth "
            "settings are required.')",
            "",
            "qos-profile",
            "depth",
        ),
        (
            "AssertionError: Invalid arguments passed to constructor: dict_keys(['dept'])",
            "",
            "qos-profile",
            "dept",
        ),
        ("AttributeError: BESTEFFORT", "", "qos-policy", "BESTEFFORT"),
        (
            "AttributeError: BESTEFFORT. Did you mean: 'BEST_EFFORT'?",
            "",
            "qos-policy",
            "BESTEFFORT",
        ),
        (
            "AttributeError: type object 'ReliabilityPolicy' has no attribute 'BESTEFFORT'",
            "",
            "qos-policy",
            "BESTEFFORT",
        ),
        (
            "TypeError: Node.create_publisher() missing 1 required positional argument: 'qos_profile'",
            "",
            "qos-missing",
            "qos_profile",
        ),
        (
            "TypeError: Expected <class 'std_msgs.msg._string.String'>, got <class 'str'>",
            "",
            "message-type",
            "String",
        ),
        (
            "AttributeError: type object 'str' has no attribute '_TYPE_SUPPORT' This might be a ROS 1 message type",
            "",
            "message-type",
            "",
        ),
        ("TypeError", 'rclpy/service.py", line 75, in send_response', "no-response", ""),
        (
            "RuntimeError: Subscription.__init__(): callback should be either be callable with one "
            "argument(to get only the message) or "
            "two (to get message and message info)",
            "",
            "callback",
            "",
        ),
        (
            "AssertionError: The 'data' field must be a set or sequence and each value of type "
            "'float' and each double in [-17, 17]",
            "",
            "message-field",
            "data",
        ),
        (
            "AssertionError: The 'success' field must be of type 'bool'",
            "",
            "message-field",
            "success",
        ),
        (
            "TypeError: must be real number, not str",
            'std_msgs/msg/_float64_multi_array.py", line 185, in data',
            "message-field",
            "",
        ),
        (
            "TypeError: bad argument type for built-in operation",
            'rclpy/publisher.py", line 79, in publish',
            "message-field",
            "",
        ),
        (
            "NameError: name 'prnt' is not defined. Did you mean: 'print'?",
            "",
            "undefined-name",
            "prnt",
        ),
        (
            "NameError: name 'Float64MultiArrray' is not defined",
            "",
            "undefined-name",
            "Float64MultiArrray",
        ),
        (
            "UnboundLocalError: cannot access local variable 'node' where it is not associated with a value",
            "",
            "undefined-name",
            "node",
        ),
        (
            "UnboundLocalError: local variable 'node' referenced before assignment",
            "",
            "undefined-name",
            "node",
        ),
        ("AttributeError: 'NoneType' object has no attribute 'data'", "", "value-is-none", ""),
        ("TypeError: 'NoneType' object is not subscriptable", "", "value-is-none", ""),
        (
            "AttributeError: 'Talker' object has no attribute 'count'",
            "",
            "missing-attribute",
            "count",
        ),
        (
            "AttributeError: 'Float64MultiArray' object has no attribute 'header'",
            "",
            "missing-attribute",
            "header",
        ),
        ("TypeError: 'int' object is not iterable", "", "not-iterable", ""),
        ("ValueError: too many values to unpack (expected 2)", "", "unpacking", ""),
        (
            "TypeError: RcutilsLogger.info() takes 2 positional arguments but 3 were given",
            "",
            "arguments",
            "",
        ),
        (
            "ValueError: operands could not be broadcast together with shapes (7,) (6,)",
            "",
            "array-shapes",
            "",
        ),
        ("IndexError: list index out of range", "", "index", ""),
        ("IndexError: index 500 is out of bounds for axis 0 with size 500", "", "index", ""),
        ("KeyError: 'reliable'", "", "key", "'reliable'"),
        ("ZeroDivisionError: division by zero", "", "division", ""),
        ("RecursionError: maximum recursion depth exceeded", "", "recursion", ""),
        (
            "FileNotFoundError: [Errno 2] No such file or directory: 'gains.yaml'",
            "",
            "file-missing",
            "gains.yaml",
        ),
        ("PermissionError: [Errno 13] Permission denied: '/etc/x'", "", "permission", "/etc/x"),
        ("OSError: [Errno 98] Address already in use", "", "address", ""),
        ("MyOwnError: something special", "", "exception", "MyOwnError"),
    ],
)
def test_known_exceptions_are_explained(final: str, library: str, kind: str, subject: str) -> None:
    """Each known exception has its kind, the name it is about, the student's line, and a remedy."""
    diagnosis = told(final, library)
    assert (diagnosis.kind, diagnosis.subject) == (kind, subject)


def test_the_trap_of_read_only_properties_is_explained_with_its_mend() -> None:
    """The student reads about the node's property, and another name to use."""
    diagnosis = told(
        "AttributeError: property 'publishers' of 'QoSComparisonNode' object has no setter"
    )
    assert "self.publishers" in diagnosis.problem
    assert "self._my_publishers" in diagnosis.remedy


def test_near_misses_are_named() -> None:
    """A misspelt name comes with the right one, of Python or of ROS."""
    assert (
        "QoSProfile"
        in told("ImportError: cannot import name 'QosProfile' from 'rclpy.qos' (q.py)").problem
    )
    assert "print" in told("NameError: name 'prnt' is not defined. Did you mean: 'print'?").problem
    assert "numpy" in told("ModuleNotFoundError: No module named 'numppy'").remedy
    assert "BEST_EFFORT" in told("AttributeError: BESTEFFORT").problem


@pytest.mark.parametrize(
    ("text", "kind", "line"),
    [
        ("SyntaxError: '(' was never closed", "syntax-error", 2),
        ("IndentationError: unexpected indent", "indentation", 2),
        ("TabError: inconsistent use of tabs and spaces in indentation", "indentation", 2),
    ],
)
def test_syntax_errors_point_at_their_line(text: str, kind: str, line: int) -> None:
    """The file that Python cannot read is named with the line."""
    diagnosis = explain(
        lines(f'  File "/cell/ws/joint_publisher.py", line 2\n    a = (1,\n        ^\n{text}'),
        FILES,
    )
    assert diagnosis is not None
    assert (diagnosis.kind, diagnosis.file, diagnosis.line) == (kind, "joint_publisher.py", line)


def test_a_file_in_another_encoding_is_explained() -> None:
    """Python's message about the encoding has no traceback."""
    text = (
        "SyntaxError: Non-UTF-8 code starting with '\\xe9' in file /cell/ws/joint_publisher.py on "
        "line 1, but no encoding declared"
    )
    diagnosis = explain(lines(text), FILES)
    assert diagnosis is not None
    assert diagnosis.kind == "encoding"


SECOND_SHUTDOWN = """Traceback (most recent call last):
  File "/cell/ws/joint_publisher.py", line 9, in main
    rclpy.shutdown()
  File "/venv/lib/python3.11/site-packages/rclpy/context.py", line 129, in shutdown
    self.__context.shutdown()
rclpy._rclpy_pybind11.RCLError: failed to shutdown: rcl_shutdown already called on the given context"""
STOPPED = """Traceback (most recent call last):
  File "/cell/ws/joint_publisher.py", line 6, in main
    rclpy.spin(n)
rclpy.executors.ExternalShutdownException
"""
DURING = "\nDuring handling of the above exception, another exception occurred:\n\n"
DEAD = """Traceback (most recent call last):
  File "/cell/ws/joint_publisher.py", line 22, in tick
    self.pub.publish(msg)
rclpy._rclpy_pybind11.RCLError: Failed to publish: publisher's context is invalid, at publisher.c:423"""


@pytest.mark.parametrize(
    "text",
    [
        SECOND_SHUTDOWN,
        STOPPED,
        STOPPED.replace("rclpy.executors.ExternalShutdownException", "KeyboardInterrupt"),
        STOPPED + DURING + SECOND_SHUTDOWN,
        STOPPED + DURING + DEAD,
        "",
        "all is well",
    ],
    ids=[
        "second shutdown",
        "external shutdown",
        "interrupt",
        "both",
        "publishing while stopped",
        "nothing",
        "chatter",
    ],
)
def test_being_stopped_is_no_mistake(text: str) -> None:
    """An error caused only by stopping the node yields no diagnosis."""
    assert explain(lines(text), FILES) is None


def test_a_dead_context_is_a_mistake_only_before_the_interrupt() -> None:
    """Publishing after rclpy was shut down matters only where nobody stopped the node."""
    output = lines(DEAD)
    assert explain(output, FILES, interrupted_ns=0) is None
    diagnosis = explain(output, FILES, interrupted_ns=100)
    assert diagnosis is not None
    assert diagnosis.kind == "context-shut-down"


def test_an_interrupt_inside_a_call_explains_nothing_of_before() -> None:
    """An interrupt becomes another error inside a call.

    If nobody stopped the node, that error is a mistake.
    """
    output = raised(
        "RuntimeError: Unable to convert call argument '0' to Python object", "rclpy/executors.py"
    )
    assert explain(output, FILES, interrupted_ns=0) is None
    assert explain(output, FILES) is not None


def test_the_first_cause_of_a_chain_is_reported() -> None:
    """A failure in `finally` after an exception is not the cause."""
    first = "\n".join(line.text for line in raised("KeyError: 'reliable'"))
    diagnosis = explain(lines(first + DURING + SECOND_SHUTDOWN), FILES)
    assert diagnosis is not None
    assert diagnosis.kind == "key"


def test_the_last_exception_is_reported() -> None:
    """The exception that ended the process is explained, not an earlier one."""
    last = raised("ZeroDivisionError: division by zero")
    both = [*raised("KeyError: 'a'"), OutputLine(0, "stderr", ""), *last]
    diagnosis = explain(both, FILES)
    assert diagnosis is not None
    assert diagnosis.kind == "division"


def test_an_exception_before_a_clean_stop_is_still_reported() -> None:
    """A callback that died in a thread is trouble even where the node was stopped later."""
    first = "\n".join(line.text for line in raised("KeyError: 'a'"))
    diagnosis = explain(lines(first + "\n\n" + STOPPED), FILES)
    assert diagnosis is not None
    assert diagnosis.kind == "key"


@pytest.mark.parametrize(
    ("text", "kind", "subject"),
    [
        (
            "[WARN] [1795185180.47] [x]: New publisher discovered on topic '/joint_states', offering "
            "incompatible QoS. No messages will be "
            "received from it. Last incompatible policy: RELIABILITY",
            "incompatible-qos",
            "/joint_states",
        ),
        (
            "[WARN] [1795185180.47] [x]: New subscription discovered on topic 't2', requesting "
            "incompatible QoS. No messages will be sent "
            "to it. Last incompatible policy: DURABILITY",
            "incompatible-qos",
            "t2",
        ),
        (
            "/venv/bin/python: can't open file '/cell/ws/joint_publisher.py': [Errno 2] No such file or directory",
            "not-startable",
            "/cell/ws/joint_publisher.py",
        ),
        ("/usr/bin/env: 'python3\\r': No such file or directory", "line-ends", ""),
        ("Fatal Python error: Segmentation fault", "crash", ""),
    ],
)
def test_trouble_without_an_exception(text: str, kind: str, subject: str) -> None:
    """Clashing QoS and failed starts are told from single lines."""
    diagnosis = explain(lines(text), FILES)
    assert diagnosis is not None
    assert (diagnosis.kind, diagnosis.subject, diagnosis.exception_type) == (kind, subject, "")


def test_the_clashing_policy_is_named() -> None:
    """The clashing policy is named, with its side."""
    text = (
        "New publisher discovered on topic 't', offering incompatible QoS. No messages will be "
        "received. Last incompatible policy: DURABILITY"
    )
    diagnosis = explain(lines(text), FILES)
    assert diagnosis is not None
    assert "DURABILITY" in diagnosis.problem


def test_advisories_cost_nothing_and_say_what_is_better() -> None:
    """A second shutdown and a traceback at Ctrl-C are remarked, once each."""
    assert advisories(lines("all is well")) == ()
    (second,) = advisories(lines(SECOND_SHUTDOWN + "\n\n" + SECOND_SHUTDOWN))
    assert "try_shutdown" in second
    (interrupt,) = advisories(lines(STOPPED))
    assert "ExternalShutdownException" in interrupt
    warning = (
        "node.py:481: UserWarning: when declaring parameter named 'a', declaring a parameter "
        "only providing its name is deprecated."
    )
    assert len(advisories(lines(warning))) == 1


def test_who_calls_try_shutdown_is_not_told_to_call_it() -> None:
    """Ctrl-C can overtake rclpy between its own look at the context and the shutdown: nothing is to be done better."""
    overtaken = SECOND_SHUTDOWN.replace(
        "    rclpy.shutdown()\n", "    rclpy.try_shutdown()\n"
    ).replace(", in shutdown\n", ", in try_shutdown\n")
    assert overtaken.count("try_shutdown") >= 2
    assert advisories(lines(overtaken)) == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    "piece",
    part(
        [
            "\n",
            "a\n",
            "Traceback (most recent call last):\n",
            '  File "a.py", line 3, in f\n',
            "KeyError: 'x'\n",
            "[INFO] [\n",
            "  | ",
            "+-",
            "x" * 5000 + "\n",
            "  + Exception Group Traceback (most recent call last):\n",
        ],
        3,
    ),
)
def test_hostile_output_takes_bounded_time(piece: str) -> None:
    """A megabyte of anything is read in a bounded time."""
    output = lines(
        ("Traceback (most recent call last):\n" + piece * (1_000_000 // len(piece)))[:1_000_000]
    )
    started = time.process_time()
    explain(output, FILES)
    advisories(output)
    assert time.process_time() - started < 5, "ten times what an idle machine takes"


@given(
    st.lists(st.tuples(st.sampled_from(["stdout", "stderr"]), st.text(max_size=60)), max_size=30)
)
def test_any_output_is_read(written: list[tuple[str, str]]) -> None:
    """No output raises."""
    output = [OutputLine(t, stream, text) for t, (stream, text) in enumerate(written)]
    explain(output, FILES)
    advisories(output)


FINALS = st.sampled_from(
    [
        "AttributeError",
        "TypeError",
        "ImportError",
        "RCLError",
        "OSError",
        "SyntaxError",
        "InvalidTopicNameException",
    ]
)


@given(FINALS, st.text(max_size=120))
def test_any_message_is_explained(name: str, message: str) -> None:
    """Every exception of the student's yields a diagnosis, whatever its message."""
    explain(raised(f"{name}: {message}"), FILES)


# -- real runs -----------------------------------------------------------------------------------------

NODE = """
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, DurabilityPolicy, qos_profile_sensor_data
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool

rclpy.init()
"""


@pytest.mark.live
@pytest.mark.parametrize(
    ("body", "kind"),
    [
        *[
            (
                "class N(Node):\n    def __init__(self):\n        super().__init__('n')\n"
                f"        self.{name} = {{}}\nN()\n",
                "read-only-property",
            )
            for name in NODE_PROPERTIES
        ],
        (
            "class N(Node):\n    def __init__(self):\n        self.create_publisher(String, 'a', 10)\nN()\n",
            "super-init-missing",
        ),
        (
            "class N(Node):\n    def __init__(self):\n        self.declare_parameter('rate', 1.0)\nN()\n",
            "super-init-missing",
        ),
        (
            "class N(Node):\n    def __init__(self):\n        super().__init__('n')\n"
            "        self.add_on_set_parameters_callback(self.changed)\n"
            "        self.declare_parameter('rate', 1.0)\n"
            "    def changed(self, parameters):\n        return self._limits\nN()\n",
            "missing-attribute",
        ),
        ("class N(Node):\n    pass\nrclpy.spin(N)\n", "class-for-node"),
        ("n = Node('n')\nn.create_timer(0.01, print())\nrclpy.spin(n)\n", "callback"),
        ("rclpy.shutdown()\nNode('n')\n", "not-initialised"),
        ("rclpy.init()\n", "initialised-twice"),
        ("Node('bad name')\n", "invalid-name"),
        ("Node('n').create_publisher(String, 'a b', 10)\n", "invalid-name"),
        ("Node('n').get_parameter('rate')\n", "parameter-not-declared"),
        ("Node('n').declare_parameter('use_sim_time', False)\n", "parameter-declared-twice"),
        ("QoSProfile(reliability=ReliabilityPolicy.RELIABLE)\n", "qos-profile"),
        ("QoSProfile(dept=1)\n", "qos-profile"),
        ("ReliabilityPolicy.BESTEFFORT\n", "qos-policy"),
        ("Node('n').create_publisher(String, 'a')\n", "qos-missing"),
        ("Node('n').create_publisher(String, 'a', 10).publish('hello')\n", "message-type"),
        ("Node('n').create_publisher('std_msgs/msg/String', 'a', 10)\n", "message-type"),
        ("Node('n').create_subscription(String, 'a', None, 10)\n", "callback"),
        ("Float64MultiArray().data = ['a']\n", "message-field"),
        (
            "m = String()\nm.data = 5\nNode('n').create_publisher(String, 'a', 10).publish(m)\n",
            "message-field",
        ),
        (
            "n = Node('n')\nn.create_service(SetBool, '/a', lambda q, r: None)\n"
            "f = n.create_client(SetBool, '/a').call_async(SetBool.Request())\n"
            "rclpy.spin_until_future_complete(n, f, timeout_sec=5)\n",
            "no-response",
        ),
        (
            "n = Node('n')\np = n.create_publisher(String, 't', qos_profile_sensor_data)\n"
            "s = n.create_subscription(String, 't', print, 10)\nfor _ in range(10):\n    "
            "rclpy.spin_once(n, timeout_sec=0.1)\n",
            "incompatible-qos",
        ),
        ("from rclpy.qos import QosProfile\n", "missing-name"),
        ("import std_msgs.msgs\n", "misspelt-module"),
    ],
)
def test_real_rclpy_is_understood(tmp_path: Path, body: str, kind: str) -> None:
    """Real output of the installed rclpy is recognised, at the student's line."""
    pytest.importorskip("rclpy")
    script = tmp_path / "ws" / "talker.py"
    script.parent.mkdir()
    script.write_text(NODE + body, encoding="utf-8")
    environment = dict(
        os.environ, HOME=str(tmp_path), ROS_AUTOMATIC_DISCOVERY_RANGE="OFF", ROS_DOMAIN_ID="93"
    )
    run = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        env=environment,
        timeout=60,
        check=False,
    )
    diagnosis = explain(lines(run.stderr), ["talker.py"])
    assert diagnosis is not None, run.stderr
    assert diagnosis.kind == kind, run.stderr
    if kind != "incompatible-qos":
        assert diagnosis.file == "talker.py"
        assert (diagnosis.line or 0) > NODE.count("\n")


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (139, "ended by signal 11 (segmentation fault). The last line of its output is 'reads'."),
        (-8, "ended by signal 8 (floating-point exception)"),
        (137, ""),
        (130, ""),
        (1, ""),
        (0, ""),
        (None, ""),
    ],
)
def test_a_signal_of_its_own_ends_a_program(status: int | None, words: str) -> None:
    """Only signals that end a program by its own doing are named, in a sandbox and without one."""
    run = ProcessRun(
        "it", "student", [], exited_ns=5, exit_status=status, output=lines("a\nreads\n")
    )
    found = ended_by_signal(run, ())
    assert bool(found) == bool(words)
    if found is not None:
        assert words in found.problem


def test_a_crash_is_named_by_the_students_frames() -> None:
    """Frames of headers are left out; the innermost of the student's own is the location."""
    crash = [
        StackFrame(
            "/usr/include/c++/12/bits/stl_vector.h", 1152, "std::vector<int>::at(unsigned long)"
        ),
        StackFrame("arm/src/talker.cpp", 12, "Talker::on_timer()"),
        StackFrame("/opt/ros/jazzy/include/rclcpp/timer.hpp", 30, "call()"),
        StackFrame("arm/src/talker.cpp", 31, "main"),
    ]
    run = ProcessRun("it", "student", [], exited_ns=5, exit_status=139, crash=crash)
    found = ended_by_signal(run, ["arm/src/talker.cpp"])
    assert found is not None
    assert (found.file, found.line) == ("arm/src/talker.cpp", 12)
    words = "It was in Talker::on_timer() at talker.cpp:12, called by main() at talker.cpp:31."
    assert words in found.problem


def test_an_uncaught_exception_of_cpp_is_located() -> None:
    """The words of the program explain it, and the frames show where; a lambda is named without its parameters."""
    function = "Relay::Relay()::{lambda(std_msgs::msg::String const&)#1}::operator()() const"
    crash = [StackFrame("arm/src/relay.cpp", 14, function)]
    run = ProcessRun("it", "student", [], exited_ns=5, exit_status=134, crash=crash)
    words = Diagnosis("crash", "Nothing caught it.", "")
    found = crashed_at(words, run, ["arm/src/relay.cpp"])
    assert found.problem == "Nothing caught it. It was in Relay::Relay()::{lambda} at relay.cpp:14."
    assert (found.file, found.line) == ("arm/src/relay.cpp", 14)
    assert crashed_at(words, run, ["arm/src/other.cpp"]) == words


@pytest.mark.parametrize(
    "change", [{"interrupted_ns": 3}, {"limit": "memory"}, {"ended_by": "kill"}]
)
def test_a_signal_after_an_interrupt_or_a_limit_explains_nothing(change: dict[str, Any]) -> None:
    """A crash while a program is stopped, or beyond a limit, has another cause."""
    run = ProcessRun("it", "student", [], exited_ns=5, exit_status=139, **change)
    assert ended_by_signal(run, ()) is None

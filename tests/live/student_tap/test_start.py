"""Modules that a student's node need not import at its start."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from grader.live.sandbox.environment import INSIDE_FOLDER

pytestmark = pytest.mark.live

_NODE = """
import rclpy, sys
from rclpy.node import Node
rclpy.init()
Node("early")
print(sorted({"lark", "regex", "em"} & set(sys.modules)))
from rosidl_generator_py import generate_py
import rosidl_generator_py
try:
    generate_py(sys.argv[1], [])
except FileNotFoundError as error:
    print(error.filename)
from rosidl_generator_py.generate_py_impl import generate_py as itself
print(itself.__module__, rosidl_generator_py.__all__)
"""


def test_the_parser_of_interfaces_is_imported_by_who_needs_it_only(tmp_path: Path) -> None:
    """A node starts without the parser of interfaces, and a generator of code finds it as ever."""
    absent = tmp_path / "absent.json"
    said = subprocess.run(
        [sys.executable, "-c", _NODE, str(absent)],
        env={**os.environ, "PYTHONPATH": str(INSIDE_FOLDER)},
        capture_output=True,
        text=True,
        check=True,
    )
    parsers, file, itself = said.stdout.splitlines()
    assert (parsers, file) == ("[]", str(absent))
    assert itself == "rosidl_generator_py.generate_py_impl ['import_type_support', 'generate_py']"


_LATE = """
import sys
from importlib import import_module as get
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Imu, JointState
from std_srvs.srv import SetBool
there = lambda: "numpy" in sys.modules
rclpy.init()
node = Node("early")
node.create_publisher(JointState, "/joints", 1)
node.create_service(SetBool, "/enable", lambda request, response: response)
seen = [there(), "yaml" in sys.modules]
heard = []
node.create_subscription(Imu, "/imu", heard.append, 1)
seen.append(there())
publisher = node.create_publisher(Imu, "/imu", 1)
while not heard:
    publisher.publish(Imu(orientation_covariance=[2.0] * 9))
    rclpy.spin_once(node, timeout_sec=0.1)
import numpy
seen += [float(heard[0].orientation_covariance.sum()), type(CameraInfo(k=numpy.ones(9)).k).__module__]
seen.append(get("rclpy.parameter").get_parameter_value("[1, 2]").integer_array_value.tolist())
print(seen)
"""


def run_with_tap(folder: Path, code: str) -> list[str]:
    """Run a file with the tap, and return the lines that it printed."""
    script = folder / "node.py"
    script.write_text(code, encoding="utf-8")
    notes, domain = (
        os.open(folder / "notes", os.O_CREAT | os.O_WRONLY),
        str(100 + os.getpid() % 100),
    )
    environment = {
        "PYTHONPATH": str(INSIDE_FOLDER),
        "GRADER_TAP_FD": str(notes),
        "ROS_DOMAIN_ID": domain,
    }
    command = [sys.executable, str(script)]
    said = subprocess.run(
        command,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
        pass_fds=[notes],
    )
    os.close(notes)
    return said.stdout.splitlines()


def test_numpy_is_imported_for_messages_that_need_it(tmp_path: Path) -> None:
    """Numpy is imported before any callback, once a node makes an endpoint with a type that needs numpy.

    All services have such a message in their type.
    """
    assert run_with_tap(tmp_path, _LATE) == ["[False, False, True, 18.0, 'numpy', [1, 2]]"]


def test_a_module_of_the_students_is_imported_as_ever(tmp_path: Path) -> None:
    """One that is called as NumPy is found by ROS 2's messages too, as soon as they are imported."""
    (tmp_path / "numpy.py").write_text("print('mine')\nndarray = None\n", encoding="utf-8")
    code = (
        "from sensor_msgs.msg import JointState\nprint('then')\nimport numpy\nprint(numpy.__file__)"
    )
    assert run_with_tap(tmp_path, code) == ["mine", "then", str(tmp_path / "numpy.py")]

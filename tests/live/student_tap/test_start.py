"""What a student's node need not import at its start."""

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
    """A node starts without it, and who generates code finds it as ever."""
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

"""Programs of built packages run as after `source install/setup.bash`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from confine.isolation import Isolation
from tests.live.builds.test_build import cache, isolation
from tests.live.small_lab import make_lab, texts
from tests.ros_packages import PACKAGE, write

pytestmark = pytest.mark.live
#: Fixtures of the other module.
__all__ = ["cache", "isolation"]

#: A package in Python without setup.cfg: its script lies in bin.
TOOL = {f"tool/{path}": text for path, text in PACKAGE.items() if path != "setup.cfg"} | {
    "tool/lab/talker.py": "def main():\n    print('by the console script')\n",
}
MANIFEST = (
    PACKAGE["package.xml"].replace("<name>lab<", "<name>greeter<").replace("ament_python", "cmake")
)
#: A package in C with a library, installed under the names of its versions, and a program linked to it.
LIBRARY = {
    "greeter/package.xml": MANIFEST,
    "greeter/CMakeLists.txt": """\
cmake_minimum_required(VERSION 3.8)
project(greeter C)
add_library(greet SHARED greet.c)
set_target_properties(greet PROPERTIES VERSION 1.2.3 SOVERSION 1)
add_executable(hello hello.c)
target_link_libraries(hello greet)
install(TARGETS greet DESTINATION lib)
install(TARGETS hello DESTINATION lib/greeter)
""",
    "greeter/greet.c": 'const char *greet(void) { return "by the library"; }\n',
    "greeter/hello.c": "#include <stdio.h>\nconst char *greet(void);\n"
    "int main(void) { puts(greet()); return 0; }\n",
}
LAUNCH = """
from launch import LaunchDescription
from launch.actions import ExecuteProcess
from launch_ros.actions import Node

def generate_launch_description():
    return LaunchDescription([
        ExecuteProcess(cmd=['talker'], name='tool'),
        Node(package='greeter', executable='hello', name='hello'),
    ])
"""
STEPS: list[dict[str, Any]] = [
    {"plan": {"launch": "up_launch"}, "label": "plan"},
    {"start": {"launch": "up_launch"}},
    {"observe": {"duration_s": 5}},
]


def test_programs_find_libraries_and_commands_of_their_workspace(
    tmp_path: Path, isolation: Isolation, cache: Path
) -> None:
    """A library of the workspace is linked, and a console script in bin is found, also from the cache of builds."""
    assert isolation.namespaces
    for attempt in ("built", "cached"):
        folder = tmp_path / attempt
        folder.mkdir()
        lab = make_lab(folder, {"up_launch": LAUNCH}, {"only": STEPS})
        write(lab.submission, {**TOOL, **LIBRARY})
        recorded = lab.record()["only"]
        said: dict[str, list[str]] = {}
        for process in recorded.students:
            said[process.name] = texts(recorded, process.name)
        assert ["by the console script"] in said.values(), said
        assert ["by the library"] in said.values(), said
        assert len(list(cache.glob("*.tar"))) == 1

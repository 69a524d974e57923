"""Runs colcon on a workspace in a sandbox, and reads its output and the installed files."""

from __future__ import annotations

import os
import re
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from confine.command import confined
from confine.helpers import python, search_path, start_helper
from confine.interpreters import OWN_INTERPRETER
from confine.isolation import Isolation, free_slot, sandbox_cgroup
from confine.room import TEMPORARY
from confine.running import enter_or_end
from grader.live.sandbox.environment import ros_environment
from grader.live.sandbox.installation import Installation
from grader.live.sandbox.room import HOME, WORKSPACE, StudentRoom
from grader.submission.beneath import open_regular_beneath

#: Modules of the extensions of colcon that build packages of ROS, by their distributions.
_PARTS = {
    "colcon-core": "colcon_core",
    "colcon-ros": "colcon_ros",
    "colcon-python-setup-py": "colcon_python_setup_py",
    "colcon-cmake": "colcon_cmake",
    "catkin-pkg": "catkin_pkg",
    "setuptools": "setuptools",
}
#: Distributions on which the outcome of a build depends.
_VERSIONS = (*_PARTS, "ros-jazzy-rclpy", "ros-jazzy-ament-cmake", "ros-jazzy-ament-package")
#: Folder of the file that CMake reads in each project, here and as a build sees it.
INSIDE_FOLDER = Path(__file__).parent / "inside"
_INSIDE = "/building"
#: Name of the file with the output in the area of temporary files.
_OUTPUT = "output.txt"
#: Bytes of the output that are kept from its beginning and from its end.
_MOST_OUTPUT = 1024**2
#: Interval between two looks at a build, and between two looks at its disk space, in s.
_LOOK_S = 0.02
_LOOK_AT_SPACE_S = 0.5
#: Disk space and files of a workspace during its build.
_MOST_BYTES = 512 * 1024**2
_MOST_FILES = 20_000
#: Bytes of an installed file that are read: as many as Linux reads of a `#!` line.
_LONGEST_HEAD = 256
#: Extensions of colcon that a build does not need; they take time.
_NOT_NEEDED = (
    "colcon_core.argcomplete_completer",
    "colcon_core.event_handler.log_command",
    "colcon_test_result.verb",
)
#: Option of compilers that keeps functions and lines in programs, for the explanation of a crash.
_LINES = "-g1"
#: Runs colcon with its output in a file, whose size the sandbox limits.
_SHELL = 'out=$1; shift; exec "$@" >"$out" 2>&1'
_PROGRAM = "import sys; from colcon_core.command import main; sys.exit(main(argv=sys.argv[1:]))"


class Ran(NamedTuple):
    """A run of colcon."""

    #: Exit status; None if it was ended.
    status: int | None
    output: str
    #: Why it was ended: "time" or "space"; empty if it ended itself.
    ended_by: str


class Installed(NamedTuple):
    """A file below the prefix of a package."""

    path: str
    is_executable: bool
    #: First bytes of the file.
    head: bytes


def lacking_builder() -> str:
    """Name the missing parts of colcon; empty if this machine has all."""
    missing = []
    for name, module in _PARTS.items():
        if find_spec(module) is None:
            missing.append(name)
    return ", ".join(missing)


def builder_versions() -> dict[str, str]:
    """Return the versions on which the outcome of a build depends."""
    found = {"python": sys.version}
    for name in _VERSIONS:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def run_colcon(isolation: Isolation, room: StudentRoom, time_s: float, ros: Installation) -> Ran:
    """Build the workspace of a room in a sandbox of its own, and end the build after some time.

    The packages lie below `src` in the workspace; each is installed below `install` in a prefix of its name.
    """
    tools = {**room.tools, _INSIDE: INSIDE_FOLDER}
    room = replace(room, tools=tools)
    seen = room.seen(isolation)
    environment = {
        **ros_environment(ros),
        "PYTHONPATH": ":".join(ros.modules),
        "HOME": seen[HOME],
        "TMPDIR": seen[TEMPORARY],
        "COLCON_EXTENSION_BLOCKLIST": ":".join(_NOT_NEEDED),
        "PYTHONDONTWRITEBYTECODE": "1",
        "CFLAGS": _LINES,
        "CXXFLAGS": _LINES,
        "ROS_DISTRO": ros.distribution.lower(),
        "ROS_VERSION": "2",
    }
    colcon = [*python(OWN_INTERPRETER, "-c", _PROGRAM), "--log-base", "/dev/null", "build"]
    colcon += ["--base-paths", "src", "--executor", "sequential", "--continue-on-error"]
    colcon += ["--event-handlers", "console_direct+"]
    colcon += ["--cmake-args", "-DBUILD_TESTING=OFF"]
    colcon.append(f"-DPython3_EXECUTABLE={ros.interpreter}")
    if ros.is_of_wheels:
        colcon.append(f"-DCMAKE_PROJECT_INCLUDE={_INSIDE}/wheels.cmake")
    output = f"{seen[TEMPORARY]}/{_OUTPUT}"
    command = ["sh", "-c", _SHELL, "sh", output, *colcon]
    with free_slot() as slot:
        group = sandbox_cgroup(isolation, slot)
        if group is not None:
            group.make()
        try:
            with confined(
                isolation,
                command,
                environment=environment,
                room=room,
                slot=slot,
                cwd=seen[WORKSPACE],
                group=group,
            ) as (argv, passed, info):
                try:
                    status, ended_by = _watched(isolation, argv, passed, room, time_s)
                finally:
                    if info is not None:
                        os.close(info)
        finally:
            if group is not None:
                group.remove()
    return Ran(status, _output_in(room.areas[TEMPORARY]), ended_by)


def _watched(
    isolation: Isolation, argv: list[str], passed: tuple[int, ...], room: StudentRoom, time_s: float
) -> tuple[int | None, str]:
    """Run a command; returns its exit status, or why it was ended."""
    process = start_helper(
        argv,
        environment={"PATH": search_path()},
        pass_fds=passed,
        before=partial(enter_or_end, isolation.form),
    )
    end_s = time.monotonic() + time_s
    look_s = time.monotonic() + _LOOK_AT_SPACE_S
    ended_by = ""
    try:
        while process.poll() is None and not ended_by:
            time.sleep(_LOOK_S)
            now_s = time.monotonic()
            if now_s > end_s:
                ended_by = "time"
            if now_s > look_s:
                look_s = now_s + _LOOK_AT_SPACE_S
                if not _is_in_bounds(room):
                    ended_by = "space"
    finally:
        process.kill()
        process.wait()
    if ended_by:
        return None, ended_by
    return process.returncode, ""


def _is_in_bounds(room: StudentRoom) -> bool:
    """Return whether the areas of a room have few files, of bounded size."""
    size_bytes = 0
    number = 0
    for area in room.areas.values():
        for file in files_below(area):
            number += 1
            with suppress(OSError):
                size_bytes += file.stat(follow_symlinks=False).st_size
            if number > _MOST_FILES or size_bytes > _MOST_BYTES:
                return False
    return True


def files_below(folder: Path) -> Iterator[os.DirEntry[str]]:
    """Yield the entries below a folder of untrusted content that are no folders; links are not followed."""
    waiting = [str(folder)]
    while waiting:
        try:
            entries = list(os.scandir(waiting.pop()))
        except OSError:
            continue
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                waiting.append(entry.path)
            else:
                yield entry


def _output_in(folder: Path) -> str:
    """Return beginning and end of the output, without colours."""
    try:
        file = open_regular_beneath(folder, _OUTPUT)
    except OSError:
        return ""
    with os.fdopen(file, "rb") as opened:
        size = os.fstat(opened.fileno()).st_size
        content = opened.read(_MOST_OUTPUT)
        if size > 2 * _MOST_OUTPUT:
            opened.seek(-_MOST_OUTPUT, os.SEEK_END)
            content += b"\n[...]\n"
        content += opened.read(_MOST_OUTPUT)
    text = content.decode("utf-8", errors="replace")
    return re.sub(r"\x1b\[[0-9;]*m", "", text)


def installed_in(prefix: Path, most: int) -> list[Installed]:
    """Return the first files below a prefix of untrusted content, by their paths."""
    found = []
    for entry in files_below(prefix):
        path = os.path.relpath(entry.path, prefix)
        with suppress(OSError):
            file = open_regular_beneath(prefix, path)
            with os.fdopen(file, "rb") as opened:
                mode = os.fstat(opened.fileno()).st_mode
                head = opened.read(_LONGEST_HEAD)
            found.append(Installed(path, bool(mode & stat.S_IXUSR), head))
        if len(found) >= most:
            break
    return sorted(found)

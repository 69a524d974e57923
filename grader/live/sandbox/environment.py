"""Environments of the processes in a sandbox, built from nothing.

Sourced or exported variables of the caller reach no process of a session.
"""

from __future__ import annotations

import functools
import importlib.metadata
import importlib.util
import json
import os
import platform
import subprocess
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.machinery import PathFinder
from pathlib import Path

import grader
from confine.helpers import absolute_entries, python, run_helper
from confine.interpreters import OWN_INTERPRETER
from grader.errors import PlatformError
from grader.evidence.session_variables import PREFIXES, is_sessions
from grader.live.sandbox.enough import require_limits
from launch_plan.exchange import PACKAGE

#: Folder of the tap and of the settings of discovery, as seen in a student's sandbox.
INSIDE_FOLDER = Path(__file__).parents[1] / "student_tap/inside"
#: Folder of the program that evaluates launch files there.
LAUNCHING_FOLDER = PACKAGE

#: The first import from a cold disk takes seconds.
_IMPORT_S = 60.0

#: Fast DDS over UDP alone: shared memory needs equal user ids on both sides and crosses sandboxes.
_DDS = {
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    "SKIP_DEFAULT_XML_FILE": "1",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
}


def python_folder() -> str:
    """Return the folder of this Python's modules below `lib`, e.g. "python3.12"."""
    return f"python{sys.version_info.major}.{sys.version_info.minor}"


def ros_environment(prefix: Path) -> dict[str, str]:
    """Environment of a program that uses the ROS wheels in a virtual environment."""
    version = python_folder()
    libraries = sorted((prefix / "lib" / version / "site-packages").glob("ros_*.libs"))
    return {
        **_DDS,
        # The ROS wheels' start-up hook would set these and start Python again.
        "LD_LIBRARY_PATH": ":".join(map(str, [prefix / "lib", *libraries])),
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
        "LANG": "C.UTF-8",
        "PATH": f"{prefix}/bin:/usr/local/bin:/usr/bin:/bin",
        "PYTHONUNBUFFERED": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "MALLOC_ARENA_MAX": "2",
    }


def with_prefixes(environment: Mapping[str, str], prefixes: Sequence[str]) -> dict[str, str]:
    """Return an environment with the packages of some ament prefixes, as if these had been sourced.

    Packages of the environment itself come first, then packages of earlier prefixes.
    """
    version = python_folder()
    below = {
        "AMENT_PREFIX_PATH": "",
        "PYTHONPATH": f"/lib/{version}/site-packages",
        "LD_LIBRARY_PATH": "/lib",
    }
    found = dict(environment)
    for name, folder in below.items():
        entries = [f"{prefix}{folder}" for prefix in prefixes]
        if environment.get(name):
            entries.insert(0, environment[name])
        if entries:
            found[name] = ":".join(entries)
    return found


def trusted_environment(home: Path, domain_id: int) -> dict[str, str]:
    """Environment of the grader's own processes: director and reference nodes."""
    prefix = Path(sys.prefix)
    return {
        **ros_environment(prefix),
        "HOME": str(home),
        "TMPDIR": str(home),
        "ROS_LOG_DIR": str(home / "log"),
        "ROS_DOMAIN_ID": str(domain_id),
        "AMENT_PREFIX_PATH": str(prefix),
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(INSIDE_FOLDER / "discovery.xml"),
    }


def student_environment(
    interpreter: Path, home: str, workspace: str, inside: str, domain_id: int
) -> dict[str, str]:
    """Environment of a student's process, with paths inside its sandbox.

    If `interpreter` belongs to a virtual environment with the ROS wheels, these are set up.
    """
    prefix = interpreter.parent.parent
    installed = f"{workspace}/install"
    own = ros_environment(prefix)
    environment = (
        own
        | {
            # Behind ROS and the system, so that a package replaces none of their files.
            "PATH": f"{own['PATH']}:{installed}/bin",
            "LD_LIBRARY_PATH": f"{own['LD_LIBRARY_PATH']}:{installed}/lib",
            "HOME": home,
            "TMPDIR": "/tmp",
            "ROS_LOG_DIR": f"{home}/log",
            "ROS_DOMAIN_ID": str(domain_id),
            "ROS_DISTRO": "jazzy",
            "ROS_VERSION": "2",
            "AMENT_PREFIX_PATH": f"{installed}:{prefix}",
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONNOUSERSITE": "1",  # files that an earlier program left at home must not run before the tap
            "PYTHONPATH": inside,
            # Behind the tap: a package of the submission can have the name of one of Python's modules.
            "GRADER_INSTALLED": f"{installed}/lib/{python_folder()}/site-packages",
            "FASTRTPS_DEFAULT_PROFILES_FILE": f"{inside}/discovery.xml",
            "RCUTILS_COLORIZED_OUTPUT": "0",
        }
    )
    environment["GRADER_SESSION_VARIABLES"] = _sessions_own(environment)
    return environment


def _sessions_own(environment: Mapping[str, str]) -> str:
    """Return the session's variables in JSON, for the tap: first characters of their names, and their values."""
    values = {}
    for name, value in environment.items():
        if is_sessions(name):
            values[name] = value
    return json.dumps({"prefixes": PREFIXES, "values": values})


@functools.cache  # An interpreter takes half a second to answer.
def require_platform(interpreter: Path | None = None) -> None:
    """Raise `PlatformError` unless ROS 2 nodes can run here, and, if it is given, with students' interpreter."""
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        raise PlatformError(
            f"ROS 2 nodes cannot run on {platform.system()} {platform.machine()}",
            remedy="The ROS 2 wheels exist for Linux x86-64. Grade there or in the container; "
            "`grade regrade` works on every system.",
        )
    require_limits()
    if importlib.util.find_spec("rclpy") is None:
        raise PlatformError(
            "the Python package rclpy is not installed",
            remedy="pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces",
        )
    if interpreter is None or interpreter == OWN_INTERPRETER:
        return
    # In the environment that students' processes get: every submission would fail for want of rclpy.
    try:
        if not ask_interpreter(
            interpreter, "import rclpy, std_msgs.msg, std_srvs.srv; print('imported')"
        ):
            raise ValueError("it does not answer")
    except ValueError as problem:
        raise PlatformError(
            f"this interpreter cannot run students' nodes ({problem})",
            location=str(interpreter),
            remedy="Give --python an environment in which the ROS 2 packages are installed with pip, as the grader's "
            "own constraints.txt has them. What was sourced in the terminal reaches no student's process.",
        ) from problem


def versions() -> dict[str, str]:
    """Return the versions that a recording keeps."""
    named = {
        "grader": grader.__version__,
        "python": platform.python_version(),
        "kernel": platform.release(),
    }
    for package in (
        "ros-jazzy-rclpy",
        "ros-fastrtps",
        "ros-rmw-fastrtps-cpp",
        "mcap",
        "rosbags",
        "numpy",
    ):
        try:
            named[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            named[package] = "not installed"
    return named


def ask_interpreter(
    interpreter: Path, program: str, *arguments: str, more: Mapping[str, str] | None = None
) -> str:
    """Run a short program with an interpreter in the environment of students' processes, and return its output.

    `more` are further variables. Raises `ValueError` with the reason if that fails.
    """
    environment = ros_environment(interpreter.parent.parent)
    if more is not None:
        environment.update(more)
    command = python(interpreter, "-c", program, *arguments)
    try:
        run = run_helper(command, timeout_s=_IMPORT_S, environment=environment)
    except (OSError, subprocess.TimeoutExpired) as problem:
        raise ValueError(str(problem)[:200]) from problem
    if run.returncode != 0:
        raise ValueError(run.stderr.strip().rsplit("\n", 1)[-1][:200] or "it does not answer")
    return run.stdout


# -- the real `launch` and `launch_ros`, on a machine that has them ----------------------------------

#: Lists of folders that lead to a sourced ROS installation.
SOURCED = ("PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH")
#: Its arguments are the folders of PYTHONPATH, which Python does not read with `-I`. The module of JSON is imported
#: before they count: a folder of a sourced workspace may have one of that name.
_FIND_LAUNCH = """
import json, os, sys
sys.path[:0] = sys.argv[1:]
import launch, launch_ros, launch.actions, launch_ros.actions, launch.launch_description_sources
print(json.dumps([p for p in sys.path if p and os.path.isdir(p)]))
"""


@dataclass(frozen=True)
class NativeLaunch:
    """Settings of an interpreter for importing the real `launch`."""

    python_path: list[str]
    prefixes: list[str]
    library_path: str

    def environment(self, prefix: str) -> dict[str, str]:
        """Variables for an evaluation; `prefix` is where the submission is installed."""
        return {
            "PYTHONPATH": ":".join(self.python_path),
            "AMENT_PREFIX_PATH": ":".join([prefix, *self.prefixes]),
            "LD_LIBRARY_PATH": self.library_path,
        }

    @property
    def folders(self) -> dict[str, Path]:
        """Folders that must be seen, where they are, besides those that always are."""
        return {p: Path(p) for p in [*self.prefixes, *self.python_path] if not p.startswith("/usr")}


def find_native_launch(
    interpreter: Path, choice: str, without: Sequence[Path] = ()
) -> NativeLaunch | None:
    """Find the real `launch` in the grader's initial environment; None for the stand-in.

    The choice is "standin", "native" or "auto". Nothing is imported from the working folder, nor from the folders
    `without`, which belong to submissions, whatever the environment says. Raises `PlatformError` if the real one was
    asked for and cannot be imported.
    """
    if choice == "standin":
        return None
    modules = absolute_entries("PYTHONPATH", without)
    prefixes = list(filter(os.path.isdir, absolute_entries("AMENT_PREFIX_PATH", without)))
    libraries = absolute_entries("LD_LIBRARY_PATH", without)
    libraries += ros_environment(interpreter.parent.parent)["LD_LIBRARY_PATH"].split(":")
    library_path = ":".join(dict.fromkeys(libraries))
    more = {"AMENT_PREFIX_PATH": ":".join(prefixes), "LD_LIBRARY_PATH": library_path}
    try:
        answer = ask_interpreter(interpreter, _FIND_LAUNCH, *modules, more=more)
        python_path = list(json.loads(answer))
        return NativeLaunch(python_path, prefixes, library_path)
    except (ValueError, TypeError) as problem:
        if choice == "auto":
            return None
        raise PlatformError(
            f"the real launch and launch_ros cannot be imported ({problem})",
            location=str(interpreter),
            remedy="Source a ROS 2 installation in this terminal first. The interpreter (that of grade, or --python) "
            "must be of the Python version that the installation was built for, as 3.12 for Jazzy on Ubuntu 24.04, "
            "with the pip packages of grade's constraints.txt in it. Or leave --launch out: the stand-in needs no "
            "ROS installation.",
        ) from problem


# -- what an interpreter finds ---------------------------------------------------------------------

_FIND = "import importlib.util, sys; print(*(n for n in sys.argv[1:] if importlib.util.find_spec(n) is None))"


def absent_modules(interpreter: Path, names: Sequence[str]) -> list[str] | None:
    """Return the top-level modules that an interpreter does not find; None if it gives no answer.

    Nothing of the submission is on its path, and no module is imported for it.
    """
    own = (
        [sysconfig.get_path("purelib"), sysconfig.get_path("platlib")]
        if interpreter == OWN_INTERPRETER
        else []
    )
    unknown = [name for name in names if not own or PathFinder.find_spec(name, own) is None]
    if not unknown:
        return []
    try:
        return ask_interpreter(interpreter, _FIND, *unknown).split()
    except ValueError:
        return None

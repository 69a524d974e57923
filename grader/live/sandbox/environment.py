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
from dataclasses import dataclass, replace
from importlib.machinery import PathFinder
from pathlib import Path

import grader
from confine.helpers import absolute_entries, python, run_helper
from confine.interpreters import OWN_INTERPRETER
from grader.errors import PlatformError
from grader.evidence.session_variables import PREFIXES, is_sessions
from grader.live.sandbox.enough import require_limits
from grader.live.sandbox.installation import Installation, shown_at_own_paths, wheels_of
from launch_plan.exchange import PACKAGE

#: Folder of the tap and of the settings of discovery, as seen in a student's sandbox.
INSIDE_FOLDER = Path(__file__).parents[1] / "student_tap/inside"
#: Settings of Fast DDS for students' programs, and for the director and the reference nodes.
DISCOVERY_FILE = INSIDE_FOLDER / "discovery.xml"
TRUSTED_FILE = Path(__file__).parents[1] / "ros_node/trusted.xml"
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


def ros_environment(installation: Installation) -> dict[str, str]:
    """Environment of a program that uses an installation of ROS, without its modules of Python."""
    found = {
        **_DDS,
        # The start-up hook of ROS wheels would set LD_LIBRARY_PATH and start Python again.
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
        "LANG": "C.UTF-8",
        "PYTHONUNBUFFERED": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "MALLOC_ARENA_MAX": "2",
    }
    for variable, folders in installation.paths.items():
        if variable != "PYTHONPATH":
            found[variable] = ":".join(folders)
    return found


def own_ros() -> dict[str, str]:
    """Environment of a program that uses the grader's own ROS wheels."""
    return ros_environment(wheels_of(OWN_INTERPRETER))


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
    return {
        **own_ros(),
        # Pydantic would look for plugins in each installed package.
        "PYDANTIC_DISABLE_PLUGINS": "__all__",
        "HOME": str(home),
        "TMPDIR": str(home),
        "ROS_LOG_DIR": str(home / "log"),
        "ROS_DOMAIN_ID": str(domain_id),
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(TRUSTED_FILE),
    }


def student_environment(
    installation: Installation, home: str, workspace: str, inside: str, domain_id: int
) -> dict[str, str]:
    """Environment of a student's process on an installation of ROS, with paths inside its sandbox."""
    installed = f"{workspace}/install"
    own = ros_environment(installation)
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
            "ROS_DISTRO": installation.distribution.lower(),
            "ROS_VERSION": "2",
            "AMENT_PREFIX_PATH": ":".join([installed, *installation.prefixes]),
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONNOUSERSITE": "1",  # files that an earlier program left at home must not run before the tap
            "PYTHONPATH": ":".join([inside, *installation.modules]),
            # Behind the tap: a package of the submission can have the name of one of Python's modules.
            "GRADER_INSTALLED": f"{installed}/lib/{python_folder()}/site-packages",
            installation.profiles: f"{inside}/{DISCOVERY_FILE.name}",
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


#: Puts the folders in its first argument before Python's own; with `-I`, PYTHONPATH is not read. A folder of a sourced
#: workspace may have a module of JSON too.
_WITH_MODULES = """
import json, sys
sys.path[:0] = json.loads(sys.argv.pop(1))
"""


def ask(installation: Installation, program: str, *arguments: str) -> str:
    """Run a short program on an installation in the environment of students' processes, and return its output.

    Raises `ValueError` with the reason if that fails.
    """
    modules = json.dumps(installation.modules)
    command = python(installation.interpreter, "-c", _WITH_MODULES + program, modules, *arguments)
    try:
        run = run_helper(command, timeout_s=_IMPORT_S, environment=ros_environment(installation))
    except (OSError, subprocess.TimeoutExpired) as problem:
        raise ValueError(str(problem)[:200]) from problem
    if run.returncode != 0:
        last = run.stderr.strip().rsplit("\n", 1)[-1]
        raise ValueError(last[:200] or "it does not answer")
    return run.stdout


def ask_interpreter(interpreter: Path, program: str, *arguments: str) -> str:
    """Run a short program with an interpreter and its wheels, see `ask`."""
    return ask(wheels_of(interpreter), program, *arguments)


# -- the real `launch` and `launch_ros`, on a machine that has them ----------------------------------

#: Lists of folders that lead to a sourced ROS installation.
SOURCED = ("PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH")
_FIND_LAUNCH = """
import os
import launch, launch_ros, launch.actions, launch_ros.actions, launch.launch_description_sources
print(json.dumps(list(filter(os.path.isdir, sys.path))))
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
        return shown_at_own_paths(map(Path, [*self.prefixes, *self.python_path]))


#: Remedies for a failed import from a named installation, and from the initial environment.
_REPAIR_INSTALLATION = (
    "Install there what is missing, or evaluate launch files with --launch standin."
)
_SOURCE_FIRST = (
    "Source a ROS 2 installation in this terminal first. The interpreter (that of grade, or --python) must be of the "
    "Python version that the installation was built for, as 3.12 for Jazzy on Ubuntu 24.04, with the pip packages of "
    "grade's constraints.txt in it. Or leave --launch out: the stand-in needs no ROS installation."
)


def find_native_launch(
    installation: Installation, choice: str, without: Sequence[Path] = ()
) -> NativeLaunch | None:
    """Find the real `launch` in a named installation, or else in the grader's initial environment.

    Nothing is imported from the working folder, nor from the folders of submissions in `without`, whatever the
    environment says.

    Parameters
    ----------
    choice
        "standin", "native" or "auto".

    Returns
    -------
    None for the stand-in.

    Raises
    ------
    PlatformError
        The real one was asked for and cannot be imported.
    """
    if choice == "standin":
        return None
    if installation.is_named:
        return _in_named(installation, choice)
    searched = _sourced_before(installation, without)
    try:
        return _native(searched)
    except ValueError as problem:
        if choice == "auto":
            return None
        raise _not_imported(str(installation.interpreter), problem, _SOURCE_FIRST) from problem


def _in_named(installation: Installation, choice: str) -> NativeLaunch | None:
    """Return the real `launch` of an installation; None if it has none and the choice is "auto"."""
    has_launch = installation.has("launch_ros")
    if choice == "auto" and not has_launch:
        return None
    try:
        return _native(installation)
    except ValueError as problem:
        place = str(installation.prefix)
        raise _not_imported(place, problem, _REPAIR_INSTALLATION) from problem


def _native(installation: Installation) -> NativeLaunch:
    """Import the real `launch`; raises ValueError with the reason if this fails."""
    python_path = list(json.loads(ask(installation, _FIND_LAUNCH)))
    library_path = ":".join(installation.paths["LD_LIBRARY_PATH"])
    return NativeLaunch(python_path, list(installation.prefixes), library_path)


def _not_imported(place: str, problem: ValueError, remedy: str) -> PlatformError:
    words = f"the real launch and launch_ros cannot be imported ({problem})"
    return PlatformError(words, location=place, remedy=remedy)


def _sourced_before(installation: Installation, without: Sequence[Path]) -> Installation:
    """Return an installation with the search paths of the grader's initial environment."""
    modules = absolute_entries("PYTHONPATH", without)
    prefixes = filter(os.path.isdir, absolute_entries("AMENT_PREFIX_PATH", without))
    libraries = absolute_entries("LD_LIBRARY_PATH", without)
    libraries += installation.paths["LD_LIBRARY_PATH"]
    paths = {
        **installation.paths,
        "PYTHONPATH": tuple(modules),
        "AMENT_PREFIX_PATH": tuple(prefixes),
        "LD_LIBRARY_PATH": tuple(dict.fromkeys(libraries)),
    }
    return replace(installation, paths=paths)


# -- what an interpreter finds ---------------------------------------------------------------------

#: A module that each program has imported, such as `__main__`, is not looked for.
_FIND = """
import importlib.util
wanted = set(sys.argv[1:]).difference(sys.modules)
print(*(name for name in sorted(wanted) if importlib.util.find_spec(name) is None))
"""


def absent_modules(installation: Installation, names: Sequence[str]) -> list[str] | None:
    """Return the top-level modules missing in an installation; None if it gives no answer.

    Nothing of the submission is on its path, and no module is imported for it.
    """
    unknown = list(names)
    absent = []
    own = _own_modules(installation)
    if own:
        elsewhere = []
        for name in names:
            if PathFinder.find_spec(name, own) is None:
                elsewhere.append(name)
        absent = list(filter(_is_absent_here, elsewhere))
        unknown = sorted(set(elsewhere).difference(absent))
    if not unknown:
        return absent
    try:
        return absent + ask(installation, _FIND, *unknown).split()
    except ValueError:
        return None


def _is_absent_here(name: str) -> bool:
    """Tell whether this process finds no top-level module of a name.

    It finds all that its interpreter finds alone, and more where variables lead.
    """
    if name in sys.modules:
        return False
    return importlib.util.find_spec(name) is None


def _own_modules(installation: Installation) -> list[str]:
    """Return the grader's folders of modules for its own wheels; an empty list for another installation."""
    if installation.is_named:
        return []
    if installation.interpreter != OWN_INTERPRETER:
        return []
    return [sysconfig.get_path("purelib"), sysconfig.get_path("platlib")]

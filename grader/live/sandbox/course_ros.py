"""The ROS 2 of a course: finds an installation by its folder, and probes whether the grader can watch its nodes."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from confine.helpers import find_tool, run_helper
from grader.errors import PlatformError
from grader.live.sandbox.environment import ask
from grader.live.sandbox.installation import (
    SEARCHED,
    SYSTEM_PATH,
    Installation,
    paths_below,
    python_of,
    rclpy_in,
)

#: File of an installation with its search paths, for a terminal.
SETUP = "setup.bash"
#: Prints the variables of a terminal after sourcing the file in its argument, each with a NUL behind it.
_SOURCE = 'source "$1" >/dev/null && exec env -0'
#: Time for sourcing, in s. Jazzy takes 0.3 s; a workspace of a hundred packages some 3 s.
_SOURCING_S = 60.0
#: Bytes of an endpoint's name in the discovery messages of Jazzy.
_NAME_BYTES = 16
#: Prints these bytes, whether endpoints have type hashes, and the middleware.
_PROBE = """
import importlib.util
import rclpy, std_msgs.msg, std_srvs.srv
from rmw_dds_common.msg import Gid
renamed = importlib.util.find_spec("rclpy.endpoint_info")
name = "rclpy.topic_endpoint_info" if renamed is None else "rclpy.endpoint_info"
endpoint = importlib.import_module(name).TopicEndpointInfo
print(len(Gid().data), hasattr(endpoint, "topic_type_hash"), rclpy.get_rmw_implementation_identifier())
"""


def installation_at(prefix: Path, interpreter: Path | None = None) -> Installation:
    """Return the installation in a folder.

    Its `setup.bash` names its search paths, and of a workspace also the paths of the installations below it. A folder without
    that file is searched as an environment of wheels.

    Parameters
    ----------
    prefix
        For example `/opt/ros/jazzy`, the folder `install` of a workspace, or a virtual environment.
    interpreter
        Python for its programs; None for a Python of the same version as its rclpy.

    Raises
    ------
    PlatformError
        No installation is there, or no Python for it.
    """
    prefix = prefix.absolute()
    paths = paths_below(prefix)
    if (prefix / SETUP).is_file():
        paths = _sourced(prefix)
    modules = paths.get("PYTHONPATH", ())
    version = python_of(modules)
    if not version:
        raise PlatformError(
            "there is no rclpy",
            location=str(prefix),
            remedy="Name the folder with setup.bash, such as /opt/ros/jazzy or the `install` folder of a workspace, or "
            "a virtual environment with the ROS wheels.",
        )
    if interpreter is None:
        interpreter = _python(prefix, version)
    return Installation(interpreter, rclpy_in(modules), paths, prefix)


def require_usable(installation: Installation) -> None:
    """Raise PlatformError unless students' nodes run with an installation, and the grader can watch them."""
    if installation.is_older:
        raise _older(installation)
    try:
        middleware = probed(installation)
    except ValueError as problem:
        raise PlatformError(
            f"rclpy cannot be imported ({problem})",
            location=str(installation.prefix),
            remedy="`grade doctor --ros` shows more. Nodes need rclpy, rmw_fastrtps_cpp, std_msgs and std_srvs.",
        ) from problem
    if not middleware:
        raise _older(installation)


def probed(installation: Installation) -> str:
    """Return the middleware of an installation; empty if its discovery differs from Jazzy's.

    Raises
    ------
    ValueError
        The installation cannot be imported; its text has the reason.
    """
    answer = ask(installation, _PROBE).split()
    if len(answer) != 3:
        raise ValueError("it does not answer")
    if answer[:2] != [str(_NAME_BYTES), "True"]:
        return ""
    return answer[2]


def _older(installation: Installation) -> PlatformError:
    found = f"{installation.distribution} (rclpy {installation.rclpy})"
    return PlatformError(
        f"{found} has other discovery messages than ROS 2 Jazzy, or no type hashes",
        location=str(installation.prefix),
        remedy="Use Jazzy, Kilted or Rolling. Without --ros, students' programs run on the grader's own ROS 2 Jazzy.",
    )


def _sourced(prefix: Path) -> dict[str, tuple[str, ...]]:
    """Return the search paths of a new terminal after sourcing an installation."""
    command = ["bash", "--noprofile", "--norc", "-c", _SOURCE, "bash", str(prefix / SETUP)]
    environment = {"PATH": ":".join(SYSTEM_PATH), "LANG": "C.UTF-8"}
    try:
        run = run_helper(command, environment=environment, timeout_s=_SOURCING_S)
    except (OSError, subprocess.TimeoutExpired) as problem:
        raise _not_sourced(prefix, str(problem)) from problem
    if run.returncode != 0:
        raise _not_sourced(prefix, run.stderr.strip().rsplit("\n", 1)[-1])
    found = {}
    for variable in run.stdout.split("\0"):
        name, _, value = variable.partition("=")
        if name in SEARCHED:
            found[name] = _folders(value)
    return found


def _folders(value: str) -> tuple[str, ...]:
    """Return the absolute folders in a search path."""
    entries = filter(os.path.isabs, value.split(os.pathsep))
    return tuple(dict.fromkeys(entries))


def _not_sourced(prefix: Path, reason: str) -> PlatformError:
    return PlatformError(
        f"{SETUP} cannot be sourced ({reason[:200]})",
        location=str(prefix),
        remedy=f"Try `source {prefix}/{SETUP}` in a terminal.",
    )


def _python(prefix: Path, version: str) -> Path:
    """Return the Python of a version: the installation's own, the system's, or another one on this machine."""
    name = f"python{version}"
    for candidate in (prefix / "bin" / name, Path("/usr/bin", name)):
        if candidate.exists():
            return candidate
    found = find_tool(name)
    if found is None:
        raise PlatformError(
            f"there is no Python {version} on this machine",
            location=str(prefix),
            remedy="Install it, or name another interpreter of this version with --python.",
        )
    return Path(found)

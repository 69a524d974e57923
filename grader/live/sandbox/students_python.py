"""A Python environment for students' programs alone: the ROS wheels, and libraries as on a student's machine.

The grader's own environment has newer libraries, and libraries without a place in a student's program. An environment
of this module has neither. It is made once with pip, and kept in the cache folder of the user.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import platform
import re
import shutil
import subprocess
import sys
import venv
from collections.abc import Iterator, Sequence
from pathlib import Path

from confine.helpers import helper_environment, run_helper
from grader.errors import PlatformError

#: The ROS wheels, without their dependencies.
_ROS = ("ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces")
#: NumPy and SciPy of Ubuntu 24.04, the system of ROS 2 Jazzy, and the newest Python with wheels of them.
_LIBRARIES = ("numpy==1.26.4", "scipy==1.11.4")
_NEWEST_PYTHON = (3, 12)
#: The same libraries for a newer Python.
_NEWER_LIBRARIES = ("numpy", "scipy")
#: Time for pip, in s.
_INSTALL_S = 900.0
#: First characters of the variables for pip's way to a package index.
_OF_PIP = ("PIP_", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY", "http_proxy", "https_proxy", "no_proxy")
#: Words in the output of pip without a package index.
_UNREACHABLE = re.compile("NewConnectionError|ConnectTimeout|Connection (refused|reset|broken)")


def has_libraries_of_jazzy() -> bool:
    """Tell whether the grader's Python can have the NumPy of ROS 2 Jazzy."""
    return sys.version_info[:2] <= _NEWEST_PYTHON


def requirements_with(own: Sequence[str] = ()) -> list[str]:
    """Return the requirements of the environment in the form of pip, with a lab's `own` ones at the end."""
    libraries = _NEWER_LIBRARIES
    if has_libraries_of_jazzy():
        libraries = _LIBRARIES
    return [*_ROS, *libraries, *own]


def students_python(own: Sequence[str] = ()) -> Path:
    """Return the interpreter of the environment with a lab's own requirements, and make it if it is missing.

    Raises
    ------
    PlatformError
        The environment cannot be made, for example without a package index.
    """
    folder = _folder(own)
    if not folder.exists():
        _make(folder, requirements_with(own))
    return folder / "bin/python"


def _folder(own: Sequence[str]) -> Path:
    """Return the folder of an environment, with a name that depends on all that is in it."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser()
    identity = [platform.python_version(), str(sys.base_prefix)]
    text = "\n".join([*identity, *requirements_with(own), *_constraints()])
    return cache / "grade/students-python" / hashlib.sha256(text.encode()).hexdigest()[:16]


def _constraints() -> Iterator[str]:
    """Yield the versions of the ROS wheels in the grader's environment: both sides have the same."""
    found = set()
    for distribution in importlib.metadata.distributions():
        name = distribution.metadata["Name"]
        if name.startswith("ros-"):
            found.add(f"{name}=={distribution.version}")
    yield from sorted(found)


def _make(folder: Path, requirements: Sequence[str]) -> None:
    """Make an environment under another name first, because an interrupted one must not be used."""
    new = folder.with_name(f"{folder.name}.{os.getpid()}")
    try:
        new.mkdir(parents=True)
        venv.create(new, symlinks=True)
        constraints = new / "constraints.txt"
        constraints.write_text("\n".join(_constraints()), encoding="utf-8")
        _install(new / "bin/python", constraints, requirements)
        new.rename(folder)
    except OSError as problem:
        if not folder.exists():  # Another grading may have made it at the same time.
            raise _failure(str(problem), folder) from problem
    finally:
        shutil.rmtree(new, ignore_errors=True)


def _install(interpreter: Path, constraints: Path, requirements: Sequence[str]) -> None:
    """Install requirements with the grader's pip; raises PlatformError with the last line of pip."""
    pip = [sys.executable, "-m", "pip", "--python", str(interpreter)]
    options = ["--quiet", "--retries", "2", "--prefer-binary"]
    command = [*pip, "install", *options, "--constraint", str(constraints), *requirements]
    also = filter(lambda name: name.startswith(_OF_PIP), os.environ)
    try:
        run = run_helper(command, environment=helper_environment(also), timeout_s=_INSTALL_S)
    except subprocess.TimeoutExpired as problem:
        raise _failure(f"pip took longer than {_INSTALL_S:g} s", interpreter) from problem
    if run.returncode == 0:
        return
    errors = [line for line in run.stderr.split("\n") if line.startswith("ERROR")]
    reason = " ".join(errors[-1:])[:300]
    if _UNREACHABLE.search(run.stderr):
        reason = f"the package index cannot be reached: {reason}"
    raise _failure(reason, interpreter)


def _failure(reason: str, place: Path) -> PlatformError:
    remedy = (
        "Check the network and pip's settings, or leave out `--python lab`: students' programs "
        "then run in the grader's own environment."
    )
    problem = f"the Python environment of students' programs cannot be made ({reason})"
    return PlatformError(problem, location=str(place), remedy=remedy)

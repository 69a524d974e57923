"""A prefix that imitates `/opt/ros/jazzy` as far as wheels go.

It has the folders of the original, `setup.bash`, and modules for the system's Python. Its files are links to the
wheels in a virtual environment.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, distributions
from pathlib import Path

PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"
#: Modules of the prefix, below it.
MODULES = f"lib/{PYTHON}/site-packages"
#: Libraries that come from the system's packages beside an installation.
_OF_SYSTEM = (
    "PyYAML",
    "catkin-pkg",
    "empy",
    "lark-parser",
    "numpy",
    "osrf-pycommon",
    "packaging",
    "setuptools",
    "typing_extensions",
)
#: Folders of a prefix with files of the wheels.
_FOLDERS = ("bin", "include", "lib", "share", "tools")
_SETUP = """\
export ROS_DISTRO={distribution}
export ROS_VERSION=2
export AMENT_PREFIX_PATH={prefix}${{AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}}
export CMAKE_PREFIX_PATH={prefix}${{CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}}
export LD_LIBRARY_PATH={libraries}${{LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}}
export PYTHONPATH={prefix}/{modules}${{PYTHONPATH:+:$PYTHONPATH}}
export PATH={prefix}/bin:$PATH
"""


def system_python() -> Path | None:
    """Return the system's Python of the grader's version; None without one."""
    found = Path("/usr/bin", PYTHON)
    return found if found.exists() else None


def imitate(prefix: Path, environment: Path = Path(sys.prefix)) -> Path:
    """Make a prefix from the wheels in a virtual environment, and return it."""
    modules = environment / MODULES
    for wheel in _wheels(modules):
        for file in wheel.files or ():
            origin = Path(os.path.realpath(modules / file))
            path = origin.relative_to(environment.resolve())
            if path.parts[0] in _FOLDERS and origin.suffix != ".pth":
                _link(origin, prefix / path)
    # CMake's files of Fast DDS name it, as in a virtual environment.
    (prefix / "lib64").symlink_to("lib")
    libraries = [prefix / "lib", *sorted((prefix / MODULES).glob("ros_*.libs"))]
    text = _SETUP.format(
        distribution="jazzy",
        prefix=prefix,
        libraries=":".join(map(str, libraries)),
        modules=MODULES,
    )
    (prefix / "setup.bash").write_text(text, encoding="utf-8")
    return prefix


def add_launch(prefix: Path, original: Path) -> None:
    """Add the real `launch` and its packages to a prefix."""
    for folder in original.iterdir():
        if folder.name == "prefix":
            continue
        if folder.is_dir():
            shutil.copytree(folder, prefix / MODULES / folder.name)
    shutil.copytree(original / "prefix", prefix, dirs_exist_ok=True)


def replace_library(prefix: Path, requirement: str) -> str:
    """Replace a library of a prefix by another version from the package index; return the reason if that fails."""
    name = requirement.partition("=")[0]
    for path in (prefix / MODULES).glob(f"{name}*"):
        shutil.rmtree(path)
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", requirement]
    command += ["--target", str(prefix / MODULES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    return "" if done.returncode == 0 else done.stderr.strip().rsplit("\n", 1)[-1]


def _wheels(modules: Path) -> Iterator[Distribution]:
    """Yield the wheels of ROS, and of the libraries that the system has beside an installation."""
    for found in distributions(path=[str(modules)]):
        name = found.metadata["Name"]
        if name.startswith("ros-") or name in _OF_SYSTEM:
            yield found


def _link(origin: Path, target: Path) -> None:
    """Make a file one more name of another, or a copy of it on another file system."""
    if target.exists() or not origin.is_file():
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        target.hardlink_to(origin)
    except OSError:
        shutil.copy(origin, target)

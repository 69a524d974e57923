"""An installation of ROS 2 for students' programs: its Python, its version and its search paths."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

#: First number of rclpy's version in each distribution, by the distributions' package lists.
_DISTRIBUTIONS = {3: "Humble", 4: "Iron", 7: "Jazzy", 9: "Kilted"}
#: First number of rclpy's version in the oldest distribution with the grader's discovery messages and type hashes.
_OLDEST = 7
#: First number of rclpy's version in the first distribution with Fast DDS 3, Kilted.
_FAST_DDS_3 = 9
#: List of the packages below a prefix.
_PACKAGES = "share/ament_index/resource_index/packages"
#: Folders of Python modules below a prefix, as of wheels and as of Debian.
_MODULES = ("lib/python3.*/site-packages", "lib/python3.*/dist-packages")
#: Folders with the system's programs.
SYSTEM_PATH = ("/usr/local/bin", "/usr/bin", "/bin")
#: Folders of a prefix that change with its files.
_DATED = ("include", "lib", "share")
#: Folders of the system outside of `/usr`.
_OF_SYSTEM = (Path("/"), Path("/bin"))
#: Search paths of an installation. CMake reads the last one.
SEARCHED = ("PATH", "PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "CMAKE_PREFIX_PATH")


@dataclass(frozen=True)
class Installation:
    """An installation of ROS 2.

    Attributes
    ----------
    interpreter
        Python of its programs.
    rclpy
        Version of rclpy, such as "7.1.5"; empty without rclpy.
    paths
        Absolute folders by variable, such as {"AMENT_PREFIX_PATH": ("/opt/ros/jazzy",)}, as in a terminal that
        sourced the installation.
    prefix
        Folder named by a person; None for the wheels of the interpreter.
    """

    interpreter: Path
    rclpy: str
    paths: Mapping[str, tuple[str, ...]]
    prefix: Path | None = None

    @property
    def major(self) -> int:
        """First number of rclpy's version; 0 without rclpy."""
        if not self.rclpy:
            return 0
        return int(self.rclpy.partition(".")[0])

    @property
    def is_named(self) -> bool:
        """True for the installation of `--ros` or of a lab, False for the wheels of an interpreter."""
        return self.prefix is not None

    @property
    def distribution(self) -> str:
        """Name of the distribution, such as "Jazzy"."""
        if self.major > max(_DISTRIBUTIONS):
            return "Rolling"
        return _DISTRIBUTIONS.get(self.major, "unknown")

    @property
    def is_older(self) -> bool:
        """True for a distribution before Jazzy."""
        return self.major < _OLDEST

    def __str__(self) -> str:
        return f"{self.distribution} (rclpy {self.rclpy}) in {self.prefix}"

    @property
    def profiles(self) -> str:
        """Variable with the file of profiles for Fast DDS."""
        if self.major < _FAST_DDS_3:
            return "FASTRTPS_DEFAULT_PROFILES_FILE"
        return "FASTDDS_DEFAULT_PROFILES_FILE"

    @property
    def modules(self) -> tuple[str, ...]:
        """Folders of Python modules besides the interpreter's own."""
        return self.paths.get("PYTHONPATH", ())

    @property
    def prefixes(self) -> tuple[str, ...]:
        """Prefixes of its packages, the first one before the others."""
        return self.paths.get("AMENT_PREFIX_PATH", ())

    @property
    def folders(self) -> dict[str, Path]:
        """Folders shown to its programs at their own paths, besides the system's and the interpreter's."""
        if self.prefix is None:
            return {}
        listed = [self.prefix]
        for entries in self.paths.values():
            listed += map(Path, entries)
        return shown_at_own_paths(listed)

    @property
    def is_of_wheels(self) -> bool:
        """True if its libraries come from wheels. Files of wheels for CMake name the machine of their builder."""
        libraries = self.paths.get("LD_LIBRARY_PATH", ())
        return any(map(re.compile(r".*\.libs").fullmatch, libraries))

    def has(self, package: str) -> bool:
        """Tell whether a package is installed."""
        return package in self.packages()

    def facts(self) -> list[object]:
        """Return the facts on which outcomes depend, in plain types: versions, paths, packages, times of its folders."""
        found: list[object] = [str(self.interpreter), sorted(self.paths.items())]
        found += self.contents()
        for prefix in self.prefixes:
            for folder in _DATED:
                found.append(_changed_ns(Path(prefix, folder)))
        return found

    def contents(self) -> list[str]:
        """Return rclpy's version and the names of its packages: the same for one installation on several machines."""
        return [self.rclpy, *self.packages()]

    def packages(self) -> list[str]:
        """Return the names of its packages."""
        found: set[str] = set()
        for prefix in self.prefixes:
            folder = Path(prefix, _PACKAGES)
            if folder.is_dir():
                found.update(path.name for path in folder.iterdir())
        return sorted(found)


@functools.cache  # Several processes of a session ask.
def wheels_of(interpreter: Path) -> Installation:
    """Return the ROS wheels in the virtual environment of an interpreter."""
    prefix = interpreter.parent.parent
    paths = paths_below(prefix)
    modules = paths.pop("PYTHONPATH")
    return Installation(interpreter, rclpy_in(modules), paths)


def paths_below(prefix: Path) -> dict[str, tuple[str, ...]]:
    """Return the search paths of an installation in one folder, as of wheels."""
    modules = []
    for pattern in _MODULES:
        modules += sorted(prefix.glob(pattern))
    libraries = [prefix / "lib"]
    for folder in modules:
        libraries += sorted(folder.glob("ros_*.libs"))
    return {
        "PATH": (f"{prefix}/bin", *SYSTEM_PATH),
        "PYTHONPATH": tuple(map(str, modules)),
        "AMENT_PREFIX_PATH": (str(prefix),),
        "LD_LIBRARY_PATH": tuple(map(str, libraries)),
        "CMAKE_PREFIX_PATH": (str(prefix),),
    }


def rclpy_in(modules: Iterable[str]) -> str:
    """Return the version of rclpy in the first folder of modules with one; empty without one."""
    for _, version in _versions_in(modules):
        return version
    return ""


def python_of(modules: Iterable[str]) -> str:
    """Return the version of rclpy's Python, such as "3.12"; empty without rclpy."""
    for folder, _ in _versions_in(modules):
        version = re.search(r"/python(3\.\d+)/", folder)
        if version is not None:
            return version[1]
    return ""


def _versions_in(modules: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield each folder of modules with rclpy, and rclpy's version."""
    for folder in modules:
        for path in sorted(Path(folder).glob("rclpy-*")):
            version = re.match(r"rclpy-(\d+\.\d+\.\d+)", path.name)
            if version is not None:
                yield folder, version[1]


def _changed_ns(folder: Path) -> int:
    """Return the time of the last new or removed entry of a folder; 0 without the folder."""
    if not folder.is_dir():
        return 0
    return folder.stat().st_mtime_ns


def shown_at_own_paths(folders: Iterable[Path]) -> dict[str, Path]:
    """Return existing folders outside of the system's by their paths, without folders below another one."""
    found: list[Path] = []
    for folder in sorted(set(folders)):
        if folder.is_relative_to("/usr"):
            continue
        if folder in _OF_SYSTEM:
            continue
        if not folder.is_dir():
            continue
        if not any(map(folder.is_relative_to, found)):
            found.append(folder)
    return {str(folder): folder for folder in found}

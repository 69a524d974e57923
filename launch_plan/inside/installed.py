"""Files of the submission, and reasons why `launch` does not find them, e.g. a missing line in setup.py."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any

from launch_plan.format import is_left_out
from launch_plan.jazzy import is_released

#: Most files of a submission that are looked at.
MOST_FILES = 5000
#: Folder of an installation of ROS, for packages that are missing here.
ELSEWHERE = "/opt/ros/jazzy"


def _files_below(root: str) -> Iterator[Path]:
    """Yield files in the order of their names, except in hidden folders; none if there is no root."""
    if not root:
        return
    seen = 0
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(name for name in folders if not _is_hidden(name))
        for name in sorted(names):
            seen += 1
            if seen > MOST_FILES:
                return
            yield Path(folder) / name


def _is_hidden(folder: str) -> bool:
    return folder.startswith(".") or folder == "__pycache__"


def _in_packages(name: str, root: str) -> Iterator[tuple[str, Path, str]]:
    """Yield the files of a name in packages: path below the root, path in the package, and name of the build file."""
    for path in _files_below(root):
        if path.name != name:
            continue
        home = _package_around(path, root)
        if home is not None:
            build = "setup.py" if (home / "setup.py").is_file() else "CMakeLists.txt"
            yield str(path.relative_to(root)), path.relative_to(home), build


def _package_around(path: Path, root: str) -> Path | None:
    """Return the innermost folder around a path that has a package.xml."""
    for folder in path.parents:
        if folder.is_relative_to(root) and (folder / "package.xml").is_file():
            return folder
    return None


def missing_entry_point(executable: str, root: str) -> tuple[str, str, str] | None:
    """Return the source of an executable that is not installed: its path, the build file, and the missing line."""
    for path, inside, build in _in_packages(executable.removesuffix(".py") + ".py", root):
        if build == "CMakeLists.txt":
            return path, build, f"install(PROGRAMS {inside} DESTINATION lib/${{PROJECT_NAME}})"
        if len(inside.parts) > 1:
            return path, build, f'"{executable} = {".".join(inside.with_suffix("").parts)}:main"'
    return None


def missing_data_file(path: str, root: str) -> tuple[str, str, str] | None:
    """Return the source of a file that a share folder lacks: its path, the build file, and the missing line."""
    parts = Path(path).parts
    if "share" not in parts[:-2]:
        return None
    last_share = len(parts) - 1 - parts[::-1].index("share")
    target = Path(*parts[last_share:]).parent
    for file, source, build in _in_packages(Path(path).name, root):
        if build == "setup.py":
            return file, build, f"data_files: ('{target}', ['{source}'])"
        line = f"install(DIRECTORY {source.parts[0]} DESTINATION share/${{PROJECT_NAME}})"
        return file, build, line
    return None


class SubmittedModules(MetaPathFinder):
    """Finder for the Python packages of the submission's ROS packages, as if these were built."""

    def __init__(self, root: str) -> None:
        self._root = root

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """Return the spec of a top-level package; other finders come first."""
        if path is not None or "." in fullname:
            return None
        for file in _files_below(self._root):
            home = file.parent.parent
            is_package = file.name == "__init__.py" and file.parent.name == fullname
            if is_package and _installs_python(home):
                return PathFinder.find_spec(fullname, [str(home)])
        return None


def _installs_python(folder: Path) -> bool:
    """Return whether the build of a ROS package installs its Python packages."""
    if not (folder / "package.xml").is_file():
        return False
    build = folder / "CMakeLists.txt"
    if build.is_file() and "ament_python_install_package" in build.read_text(errors="replace"):
        return True
    return (folder / "setup.py").is_file()


def module_out_of_reach(name: str, root: str) -> str | None:
    """Return the path of a top-level module that is in the submission but cannot be imported from there."""
    for path in _files_below(root):
        is_package = path.name == "__init__.py" and path.parent.name == name
        if is_package or path.name == f"{name}.py":
            return str(path.relative_to(root))
    return None


def own_packages() -> tuple[list[str], list[str]]:
    """Return the names of the submission's packages, installed in the first prefix, and the names of all packages."""
    from ament_index_python.packages import get_packages_with_prefixes

    there = sorted(get_packages_with_prefixes())
    first = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)[0]
    return [package for package in there if (Path(first) / "share" / package).is_dir()], there


def find_executable(executable: str, package: str, root: str) -> str:
    """Return the path of an executable of a package, for the stand-in as for the real `launch`.

    Raises
    ------
    LookupError
        If neither this machine nor a ROS release has the package.
    RuntimeError
        If the package has no such executable; `launch_remedy` of the exception is the instruction for the author.
    """
    from ament_index_python.packages import get_package_prefix

    try:
        folder = Path(get_package_prefix(package)) / "lib" / package
    except LookupError:
        if is_released(package):
            return f"{ELSEWHERE}/lib/{package}/{executable}"
        raise
    path = folder / executable
    if _is_executable(path):
        return str(path)
    message, remedy = _not_found(executable, package, folder, root)
    failure = getattr(import_module("launch.substitutions"), "SubstitutionFailure", RuntimeError)
    error: Exception = failure(message)
    error.__dict__.update(launch_kind="unknown_executable", launch_remedy=remedy)
    raise error


def _not_found(executable: str, package: str, folder: Path, root: str) -> tuple[str, str]:
    """Return the message and the remedy for an executable that cannot be started from its package's folder."""
    there = _executables(folder)
    close = difflib.get_close_matches(executable.removesuffix(".py"), there, n=1)
    remedy = "Write the name of an executable that is installed."
    meant = "."
    if close:
        remedy = f"Write executable='{close[0]}'."
        meant = f"; did you mean '{close[0]}'?"
    if not folder.exists():
        message = f"package '{package}' has no executables at all: its folder lib/{package} does not exist"
        return message, remedy
    if (folder / executable).is_file():
        message = f"executable '{executable}' of package '{package}' is there, but may not be executed (chmod +x)"
        return message, "Make it executable: chmod +x."
    message = f"executable '{executable}' not found in package '{package}'"
    installed = f"The package installs: {_listed(there)}"
    entry = missing_entry_point(executable, root)
    if entry is None:
        return f"{message}{meant} {installed}", remedy
    file, build, line = entry
    where = "console_scripts in setup.py" if build == "setup.py" else build
    message += f": its file {file} is there, but {build} does not install it ({line} is missing). {installed}"
    return message, f"Add to {where}: {line}, and build again."


def _executables(folder: Path) -> list[str]:
    if not folder.exists():
        return []
    names = []
    for path in folder.iterdir():
        if is_left_out(path):
            continue
        if _is_executable(path):
            names.append(path.name)
    return sorted(names)


def _is_executable(path: Path) -> bool:
    return path.is_file() and os.access(path, os.X_OK)


def _listed(executables: list[str]) -> str:
    """Return names as a list; a single file is installed with and without its ending, and is named once."""
    names: list[str] = []
    for name in executables:
        if not name.endswith(".py") or name.removesuffix(".py") not in executables:
            names.append(name)
    return ", ".join(names) or "nothing"

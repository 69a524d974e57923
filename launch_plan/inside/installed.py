"""What lies in the submission, but is not installed: the commonest reason why something is not found."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any

from launch_plan.jazzy import is_released

MOST_FILES = 5000
#: Where a ROS machine keeps what is not here.
ELSEWHERE = "/opt/ros/jazzy"


def _files_below(root: str) -> Iterator[Path]:
    seen = 0
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(
            name for name in folders if not name.startswith(".") and name != "__pycache__"
        )
        for name in sorted(names):
            seen += 1
            if seen > MOST_FILES:
                return
            yield Path(folder) / name


def _in_packages(name: str, root: str) -> Iterator[tuple[str, Path, str]]:
    """Files of a name in the packages of the submission: the path, that inside the package, and the build file."""
    for path in _files_below(root) if root else ():
        inside_root = (folder for folder in path.parents if folder.is_relative_to(root))
        home = next((folder for folder in inside_root if (folder / "package.xml").is_file()), None)
        if path.name == name and home is not None:
            build = "setup.py" if (home / "setup.py").is_file() else "CMakeLists.txt"
            yield str(path.relative_to(root)), path.relative_to(home), build


def missing_entry_point(executable: str, root: str) -> tuple[str, str, str] | None:
    """A file that an executable was meant to run: (its path, the build file, the line that is missing)."""
    for path, inside, build in _in_packages(executable.removesuffix(".py") + ".py", root):
        if build == "CMakeLists.txt":
            return path, build, f"install(PROGRAMS {inside} DESTINATION lib/${{PROJECT_NAME}})"
        if len(inside.parts) > 1:
            return path, build, f'"{executable} = {".".join(inside.with_suffix("").parts)}:main"'
    return None


def missing_data_file(path: str, root: str) -> tuple[str, str, str] | None:
    """A file that was meant by a path in a share folder: (its path, the build file, the line that is missing)."""
    parts = Path(path).parts
    if "share" not in parts[:-2]:
        return None
    target = Path(*parts[len(parts) - 1 - parts[::-1].index("share") :]).parent
    for file, source, build in _in_packages(Path(path).name, root):
        if build == "setup.py":
            return file, build, f"data_files: ('{target}', ['{source}'])"
        return (
            file,
            build,
            f"install(DIRECTORY {source.parts[0]} DESTINATION share/${{PROJECT_NAME}})",
        )
    return None


class SubmittedModules(MetaPathFinder):
    """Finds the Python packages of the submission's ROS packages, which are importable once these are built."""

    def __init__(self, root: str) -> None:
        self._root = root

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """The spec of such a package, which is looked for only where nothing else has the name."""
        if path is not None or "." in fullname:
            return None
        for file in _files_below(self._root):
            home = file.parent.parent
            if (
                file.name == "__init__.py"
                and file.parent.name == fullname
                and _installs_python(home)
            ):
                return PathFinder.find_spec(fullname, [str(home)])
        return None


def _installs_python(folder: Path) -> bool:
    if not (folder / "package.xml").is_file():
        return False
    build = folder / "CMakeLists.txt"
    by_cmake = build.is_file() and "ament_python_install_package" in build.read_text(
        errors="replace"
    )
    return by_cmake or (folder / "setup.py").is_file()


def module_out_of_reach(name: str, root: str) -> str | None:
    """Path of a module (its name up to the first full stop) that is where nothing can import it from."""
    for path in _files_below(root) if root else ():
        if path.name == f"{name}.py" or (path.name == "__init__.py" and path.parent.name == name):
            return str(path.relative_to(root))
    return None


def own_packages() -> tuple[list[str], list[str]]:
    """Names of the submission's packages, which the first prefix holds, and of all that are installed."""
    from ament_index_python.packages import get_packages_with_prefixes

    there = sorted(get_packages_with_prefixes())
    first = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)[0]
    return [package for package in there if (Path(first) / "share" / package).is_dir()], there


def find_executable(executable: str, package: str, root: str) -> str:
    """Path of an executable of a package, as both implementations of `launch` find it here.

    Raises LookupError if there is no such package, and none of ROS either, and RuntimeError if the package has no such
    executable, with what to do about it.
    """
    from ament_index_python.packages import get_package_prefix

    try:
        folder = Path(get_package_prefix(package)) / "lib" / package
    except LookupError:
        if is_released(package):
            return f"{ELSEWHERE}/lib/{package}/{executable}"
        raise
    path = folder / executable
    if path.is_file() and os.access(path, os.X_OK):
        return str(path)
    there = (
        sorted(p.name for p in folder.iterdir() if p.is_file() and os.access(p, os.X_OK))
        if folder.exists()
        else []
    )
    # Bare files are installed under their names without the ending too; one of both says enough.
    listed = (
        ", ".join(name for name in there if not name.endswith(".py") or name[:-3] not in there)
        or "nothing"
    )
    entry = missing_entry_point(executable, root)
    close = difflib.get_close_matches(executable.removesuffix(".py"), there, n=1)
    meant = f"; did you mean '{close[0]}'?" if close else "."
    # Bare files have no setup.py; the one name that was meant is right with and without.
    remedy = (
        f"Write executable='{close[0]}'."
        if close
        else "Write the name of an executable that is installed."
    )
    message = f"executable '{executable}' not found in package '{package}'{meant} The package installs: {listed}"
    if not folder.exists():
        message = f"package '{package}' has no executables at all: its folder lib/{package} does not exist"
    elif path.is_file():
        message = f"executable '{executable}' of package '{package}' is there, but may not be executed (chmod +x)"
        remedy = "Make it executable: chmod +x."
    elif entry is not None:
        message = f"executable '{executable}' not found in package '{package}': its file {entry[0]} is there, "
        message += f"but {entry[1]} does not install it ({entry[2]} is missing). The package installs: {listed}"
        where = "console_scripts in setup.py" if entry[1] == "setup.py" else entry[1]
        remedy = f"Add to {where}: {entry[2]}, and build again."
    failure = getattr(import_module("launch.substitutions"), "SubstitutionFailure", RuntimeError)
    error: Exception = failure(message)
    error.__dict__.update(launch_kind="unknown_executable", launch_remedy=remedy)
    raise error

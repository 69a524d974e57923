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

from .jazzy import is_released

MOST_FILES = 5000
#: Where a ROS machine keeps what is not here.
ELSEWHERE = "/opt/ros/jazzy"


def _files_below(root: str) -> Iterator[Path]:
    seen = 0
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(name for name in folders if not name.startswith(".") and name != "__pycache__")
        for name in sorted(names):
            seen += 1
            if seen > MOST_FILES:
                return
            yield Path(folder) / name


def _package_of(path: Path, root: str) -> Path | None:
    """The folder with the package.xml above a file, inside the submission."""
    for folder in path.parents:
        if not folder.is_relative_to(root):
            return None
        if (folder / "package.xml").is_file():
            return folder
    return None


def missing_entry_point(executable: str, package: str, root: str) -> tuple[str, str, str] | None:
    """A file that an executable was meant to run: (its path, the build file, the line that is missing).

    Parameters
    ----------
    executable, package : str
        As the launch file names them.
    root : str
        The submission.
    """
    wanted = executable.removesuffix(".py") + ".py"
    for path in _files_below(root) if root else ():
        home = _package_of(path, root) if path.name == wanted else None
        if home is None:
            continue
        inside = path.relative_to(home)
        shown = str(path.relative_to(root))
        if (home / "setup.py").is_file() and len(inside.parts) > 1:
            module = ".".join(inside.with_suffix("").parts)
            return shown, "setup.py", f'"{executable} = {module}:main"'
        if (home / "CMakeLists.txt").is_file():
            return shown, "CMakeLists.txt", f"install(PROGRAMS {inside} DESTINATION lib/${{PROJECT_NAME}})"
    return None


def missing_data_file(path: str, root: str) -> tuple[str, str, str] | None:
    """A file that was meant by a path in a share folder: (its path, the build file, the line that is missing)."""
    parts = Path(path).parts
    if not root or "share" not in parts[:-2]:
        return None
    at = len(parts) - 1 - parts[::-1].index("share")
    package, inside = parts[at + 1], Path(*parts[at + 2 :])
    for file in _files_below(root):
        home = _package_of(file, root) if file.name == inside.name else None
        if home is None:
            continue
        source = file.relative_to(home)
        if (home / "setup.py").is_file():
            target = (Path("share") / package / inside).parent
            return str(file.relative_to(root)), "setup.py", f"data_files: ('{target}', ['{source}'])"
        line = f"install(DIRECTORY {source.parts[0]} DESTINATION share/${{PROJECT_NAME}})"
        return str(file.relative_to(root)), "CMakeLists.txt", line
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
            if file.name == "__init__.py" and file.parent.name == fullname and _installs_python(home):
                return PathFinder.find_spec(fullname, [str(home)])
        return None


def _installs_python(folder: Path) -> bool:
    if not (folder / "package.xml").is_file():
        return False
    build = folder / "CMakeLists.txt"
    by_cmake = build.is_file() and "ament_python_install_package" in build.read_text(errors="replace")
    return by_cmake or (folder / "setup.py").is_file()


def module_out_of_reach(name: str, root: str) -> str | None:
    """Path of a module that is in the submission, but where nothing can import it from.

    Parameters
    ----------
    name : str
        The module's name up to its first full stop.
    root : str
        The submission.
    """
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

    Raises
    ------
    LookupError
        There is no such package, and none of ROS either.
    RuntimeError
        The package has no such executable, with what to do about it.
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
    remedy = "Write the name of an entry point of setup.py ('name = package.module:main'), and build again."
    there = sorted(p.name for p in folder.iterdir() if p.is_file() and os.access(p, os.X_OK)) if folder.exists() else []
    listed = ", ".join(there) or "nothing"
    entry = missing_entry_point(executable, package, root)
    close = difflib.get_close_matches(executable.removesuffix(".py"), there, n=1)
    meant = f"; did you mean '{close[0]}'?" if close else "."
    message = f"executable '{executable}' not found in package '{package}'{meant} The package has: {listed}"
    if not folder.exists():
        message = f"package '{package}' has no executables at all: its folder lib/{package} does not exist"
    elif path.is_file():
        message = f"executable '{executable}' of package '{package}' is there, but may not be executed (chmod +x)"
        remedy = "Make it executable: chmod +x."
    elif entry is not None:
        message = f"executable '{executable}' not found in package '{package}': its file {entry[0]} is there, "
        message += f"but {entry[1]} does not install it ({entry[2]} is missing). The package has: {listed}"
        where = "console_scripts in setup.py" if entry[1] == "setup.py" else entry[1]
        remedy = f"Add to {where}: {entry[2]}, and build again."
    failure = getattr(import_module("launch.substitutions"), "SubstitutionFailure", RuntimeError)
    error: Exception = failure(message)
    error.__dict__.update(launch_kind="unknown_executable", launch_remedy=remedy)
    raise error

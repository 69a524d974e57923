"""A submission → a throw-away workspace, as `colcon build` would leave it.

Below the workspace's folder stand `src/` (a copy of the student's files) and `install/`, an ament
prefix whose executables are wrappers around the files in `src/`. Paths inside are relative, so the
workspace can be mounted anywhere. File names with or without `.py`, executable bits and CRLF line
ends make no difference.
"""

from __future__ import annotations

import re
import shutil
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from grader.live.entry import function_to_call
from grader.live.launching.jazzy import is_released
from grader.packages import is_launch_file
from grader.recording.submission import PackageFact, SubmissionRecord
from grader.rubric import Rubric

#: Packages that launch files name literally.
_PACKAGE_ARGUMENT = re.compile(r"""package\s*=\s*['"]([A-Za-z][A-Za-z0-9_]{0,80})['"]""")

_WRAPPER = '''\
#!{interpreter}
"""Runs {target} as `ros2 run` would."""
import os
import runpy
import sys

source = os.path.normpath(os.path.join(os.path.dirname(os.path.realpath(__file__)), {up!r}, {source!r}))
sys.path[0] = {path_entry}
sys.argv[0] = source
{run}
'''

#: Where packages keep data files of a kind.
_USUAL_FOLDERS = {".yaml": "config", ".yml": "config", ".rviz": "rviz", ".urdf": "urdf", ".xacro": "urdf"}

#: What is installed beside the sources at most: data files once for each package, and programs.
_MOST_INSTALLED_BYTES, _MOST_INSTALLED = 64 * 1024 * 1024, 8_000

_PACKAGE_PATH = "os.path.normpath(os.path.join(os.path.dirname(os.path.realpath(__file__)), '../../..', {root!r}))"
_RUN_FILE = 'runpy.run_path(source, run_name="__main__")'
_RUN_FILE_FUNCTION = 'sys.exit(runpy.run_path(source, run_name="student_module")[{function!r}]())'
_RUN_MODULE = 'runpy.run_module({module!r}, run_name="__main__", alter_sys=True)'
_RUN_ENTRY = "from {module} import {attribute}\n\nsys.exit({function}())"


@dataclass(frozen=True)
class Workspace:
    """A staged submission.

    Attributes
    ----------
    folder : Path
        Holds `src/` and `install/`.
    executables : dict
        Artifact name -> path of its wrapper, relative to `folder`.
    """

    folder: Path
    executables: dict[str, str] = field(default_factory=dict)


@dataclass
class _Room:
    """What is left of the room for what is installed."""

    size_bytes: int = _MOST_INSTALLED_BYTES
    entries: int = _MOST_INSTALLED

    def take(self, path: Path, size_bytes: int) -> bool:
        """Take the room for a file and the folders that it needs, if there is so much."""
        entries = 1 + sum(not parent.is_dir() for parent in path.parents)
        if size_bytes > self.size_bytes or entries > self.entries:
            return False
        self.size_bytes, self.entries = self.size_bytes - size_bytes, self.entries - entries
        return True


def stage(source: Path, record: SubmissionRecord, rubric: Rubric, folder: Path, interpreter: str) -> Workspace:
    """Make the workspace.

    Parameters
    ----------
    source : Path
        The submission's folder; only the files listed in `record` are copied.
    interpreter : str
        Absolute path of the Python that runs students' code.

    Notes
    -----
    Of data there may be more than a session has room for, once it is installed for each of several packages; then what
    is no text is left out.
    """
    room = _Room()
    for file in record.files:
        target = folder / "src" / file.path
        origin = source / file.path
        if origin.is_symlink() or not origin.is_file():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(origin, target, follow_symlinks=False)
    executables = {}
    for artifact in record.artifacts:
        if artifact.path is not None:
            relative = f"install/lib/.artifacts/{artifact.name}"
            named = rubric.artifacts[artifact.name].executable
            _write(folder / relative, _wrapper_of_file(artifact.path, record, interpreter, depth=3, executable=named))
            executables[artifact.name] = relative
    for package in record.packages:
        _install_package(folder, room, package, record, interpreter)
    if not record.packages:
        for name in _packages_of_bare_files(record, rubric):
            _install_bare_files(folder, room, name, record, rubric, interpreter)
    return Workspace(folder, executables)


def _write(path: Path, text: str, mode: int = 0o755) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(mode)


def _register(folder: Path, package: str) -> None:
    install = folder / "install"
    _write(install / "share/ament_index/resource_index/packages" / package, "", 0o644)
    (install / "share" / package).mkdir(parents=True, exist_ok=True)
    (install / "lib" / package).mkdir(parents=True, exist_ok=True)


def _packages_of_bare_files(record: SubmissionRecord, rubric: Rubric) -> list[str]:
    """Bare files stand for the lab's package, and for any other that their launch files name."""
    named = [m for text in record.texts.values() for m in _PACKAGE_ARGUMENT.findall(text)]
    return [p for p in dict.fromkeys([rubric.lab.package, *named]) if not is_released(p)][:20]


def _install_bare_files(
    folder: Path, room: _Room, package: str, record: SubmissionRecord, rubric: Rubric, interpreter: str
) -> None:
    _register(folder, package)
    for artifact in record.artifacts:
        executable = rubric.artifacts[artifact.name].executable
        if artifact.path is None or executable is None:
            continue
        text = _wrapper_of_file(artifact.path, record, interpreter, depth=3)
        # `ros2 run` knows them by the names that their entry points would have, or by their own.
        for name in {executable, PurePosixPath(artifact.path).name, PurePosixPath(artifact.path).stem}:
            _write(folder / "install/lib" / package / name, text)
    for file in sorted(record.files, key=lambda file: file.path not in record.texts):
        # Nothing says what would be installed, so all data files are, where they lie and where they usually do.
        path = PurePosixPath(file.path)
        usual = _USUAL_FOLDERS.get(path.suffix, "launch" if is_launch_file(path.name) else None)
        if _is_shared(path):
            for target in {str(path), f"{usual}/{path.name}" if usual and len(path.parts) == 1 else str(path)}:
                _share(folder, room, file.path, f"share/{package}/{target}")


def _install_package(
    folder: Path, room: _Room, package: PackageFact, record: SubmissionRecord, interpreter: str
) -> None:
    _register(folder, package.name)
    for name, target in package.executables.items():
        program = folder / "install/lib" / package.name / name
        text = _wrapper_of_entry(package, target, record, interpreter)
        if re.fullmatch(r"(?!\.{1,2}$)[\w.+-]{1,200}", name) and room.take(program, len(text)):
            _write(program, text)
    shared = _all_data(package, record) if package.shared is None else package.shared
    for target, file_path in sorted(shared.items(), key=lambda pair: pair[1] not in record.texts):
        _share(folder, room, file_path, target)


def _share(folder: Path, room: _Room, file_path: str, target: str) -> None:
    """Install a file below the prefix's share folder, and nowhere else."""
    origin, parts = folder / "src" / file_path, PurePosixPath(target).parts
    if parts[:1] != ("share",) or ".." in parts or not origin.is_file():
        return
    installed = folder / "install" / target
    with suppress(OSError):  # a name that is a folder elsewhere, or too long
        if not room.take(installed, origin.stat().st_size):
            return
        installed.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(origin, installed)


def _all_data(package: PackageFact, record: SubmissionRecord) -> dict[str, str]:
    """All data files of a package, for one whose setup.py or CMakeLists.txt does not tell."""
    shared = {}
    for file in record.files:
        relative, root = PurePosixPath(file.path), PurePosixPath(package.path)
        if relative.is_relative_to(root) and _is_shared(inside := relative.relative_to(root)):
            shared[f"share/{package.name}/{inside}"] = file.path
            if is_launch_file(inside.name) and len(inside.parts) == 1:
                shared[f"share/{package.name}/launch/{inside.name}"] = file.path
    return shared


def _is_shared(inside: PurePosixPath) -> bool:
    """Whether a package's file belongs in its share folder: data rather than modules."""
    return inside.suffix != ".py" or "launch" in inside.parts[0] or inside.name.endswith("launch.py")


def _wrapper_of_entry(package: PackageFact, target: str, record: SubmissionRecord, interpreter: str) -> str:
    if ":" not in target:
        return _wrapper_of_file(target, record, interpreter, depth=3)
    module, attribute = target.split(":", 1)
    return _WRAPPER.format(
        interpreter=interpreter,
        target=target,
        up="../../..",
        source=str(PurePosixPath("src") / package.path / (module.replace(".", "/") + ".py")),
        path_entry=_PACKAGE_PATH.format(root=str(PurePosixPath("src") / package.path)),
        run=_RUN_ENTRY.format(module=module, attribute=attribute.split(".")[0], function=attribute),
    )


def _wrapper_of_file(
    path: str, record: SubmissionRecord, interpreter: str, depth: int, executable: str | None = None
) -> str:
    relative = PurePosixPath(path)
    function = function_to_call(record.texts.get(path, ""), _entry_points_of(relative, record, executable))
    run = _RUN_FILE_FUNCTION.format(function=function) if function is not None else _RUN_FILE
    path_entry = "os.path.dirname(source)"
    package_root = _package_root(relative, record)
    if package_root is not None and relative.suffix == ".py":
        levels = len(relative.relative_to(package_root).parts)
        module = ".".join(relative.relative_to(package_root).with_suffix("").parts)
        path_entry = f"os.path.normpath(os.path.join(source, *[os.pardir] * {levels}))"
        run = _RUN_MODULE.format(module=module)
        if function is not None:
            run = _RUN_ENTRY.format(module=module, attribute=function, function=function)
    return _WRAPPER.format(
        interpreter=interpreter,
        target=path,
        up="/".join([".."] * depth),
        source=str(PurePosixPath("src") / relative),
        path_entry=path_entry,
        run=run,
    )


def _entry_points_of(path: PurePosixPath, record: SubmissionRecord, executable: str | None) -> list[str]:
    """Return the functions of a file that entry points of its package name, that of an executable first."""
    named = []
    for package in (p for p in record.packages if path.is_relative_to(p.path)):
        module = ".".join(path.relative_to(package.path).with_suffix("").parts)
        points = sorted(package.executables.items(), key=lambda point: point[0] != executable)
        targets = [target.split(":") for _, target in points if target.count(":") == 1]
        named += [function for of_module, function in targets if of_module == module]
    return named


def _package_root(path: PurePosixPath, record: SubmissionRecord) -> PurePosixPath | None:
    """Folder from which the file's Python package is imported, or None for a file that stands alone."""
    files = {f.path for f in record.files}
    root = path.parent
    while root.parts and str(root / "__init__.py") in files:
        if not all(part.isidentifier() for part in (root.name, path.stem)):
            return None
        root = root.parent
    return root if root != path.parent else None

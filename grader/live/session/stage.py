"""A submission → a throw-away workspace, as `colcon build` would leave it.

It holds `src/` (a copy of the student's files) and `install/`, an ament prefix. A package that colcon built has its
installed files there. Executables of bare files, and of a package that was not built, are wrappers around the files in
`src/`. Paths inside are relative, so that it can be mounted anywhere.
"""

from __future__ import annotations

import os
import re
import shutil
from collections import defaultdict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path, PurePosixPath

from grader.evidence.installed_faults import call_fault
from grader.lab.rubric import Rubric
from grader.live.session.built import BuiltPackage, InstalledFile, built_package
from grader.live.session.entry import function_to_call
from grader.live.session.program import StudentProgram
from grader.recording.submission import PackageFact, SubmissionRecord
from grader.submission.beneath import is_regular_beneath
from grader.submission.packages.colcon import is_launch_file
from grader.submission.packages.compiled import compiled_programs, is_compiled_source
from launch_plan.jazzy import is_released

#: Packages that launch files name literally.
_PACKAGE_ARGUMENT = re.compile(r"""package\s*=\s*['"]([A-Za-z][A-Za-z0-9_]{0,80})['"]""")

#: Largest number of packages that bare files stand for.
_MOST_BARE_PACKAGES = 20

_WRAPPER = '''\
#!{interpreter}
"""Runs {target} as `ros2 run` would."""
import os
import runpy
import sys

workspace = os.path.normpath(os.path.join(os.path.dirname(os.path.realpath(__file__)), "../../../src"))
root = os.path.normpath(os.path.join(workspace, {root!r}))
source = os.path.join(root, {source!r})
sys.path[0] = root
sys.path += [os.path.join(workspace, package) for package in {packages!r}]
sys.argv[0] = source
{run}
'''

#: Where packages keep data files of a kind.
_USUAL_FOLDERS = {
    ".yaml": "config",
    ".yml": "config",
    ".rviz": "rviz",
    ".urdf": "urdf",
    ".xacro": "urdf",
}

_INIT = re.compile(r"(^|/)__init__\.py$")
#: Folders that are looked through for modules.
_MOST_FOLDERS = 100

#: Most bytes and entries beside the sources: data files once for each package, and programs.
_MOST_INSTALLED_BYTES, _MOST_INSTALLED = 64 * 1024 * 1024, 8_000

#: Refusal of bytes that are not UTF-8, unless a coding line declares them, as Python refuses them in a program.
#: runpy misses such bytes in comments.
_REFUSE_OTHER_ENCODINGS = """\
with open(source, "rb") as program:
    lines = program.readlines()
declares = any(b"coding" in line for line in lines[:2])
for number, line in enumerate(lines, 1):
    try:
        line.decode()
    except UnicodeDecodeError as problem:
        if declares:
            break
        start = f"Non-UTF-8 code starting with '\\\\x{line[problem.start]:02x}'"
        place = (source, number, None, None)
        raise SyntaxError(f"{start} on line {number}, but no encoding declared", place) from None
"""
_RUN_FILE = 'runpy.run_path(source, run_name="__main__")'
_RUN_FILE_FUNCTION = """\
import operator
import types

module = types.SimpleNamespace(**runpy.run_path(source, run_name="student_module"))
sys.exit(operator.attrgetter({function!r})(module)())"""
_RUN_MODULE = 'runpy.run_module({module!r}, run_name="__main__", alter_sys=True)'


def stage(
    source: Path,
    record: SubmissionRecord,
    rubric: Rubric,
    folder: Path,
    interpreter: str,
    prefixes: Path | None = None,
) -> dict[str, StudentProgram]:
    """Make the workspace of a submission's folder with the files listed in `record`.

    Returns the program of each artifact; a compiled one that was not built is left out. The folder `prefixes` holds the
    installed files of each built package below the package's name.

    Data may need more room than a session has, once it is installed for each of several packages; then a file that
    is not text is left out. The interpreter is the absolute path of the Python that runs students' code.
    """
    for file in record.files:
        origin, target = source / file.path, folder / "src" / file.path
        if not origin.is_symlink() and origin.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(origin, target, follow_symlinks=False)
    return _Installation(folder, record, rubric, interpreter, prefixes).install()


@dataclass(eq=False)
class _Installation:
    """The ament prefix, and the room left in it."""

    folder: Path
    record: SubmissionRecord
    rubric: Rubric
    interpreter: str
    prefixes: Path | None = None
    size_bytes: int = _MOST_INSTALLED_BYTES
    entries: int = _MOST_INSTALLED
    #: Source of a module -> installed programs that call it, by their names.
    _installed: dict[str, dict[str, str]] = field(default_factory=lambda: defaultdict(dict))

    def install(self) -> dict[str, StudentProgram]:
        """Install everything; returns the artifacts' programs."""
        packages = self.record.packages or self._packages_of_bare_files()
        for package in packages:
            self._register(package.name)  # before any package installs something in another's place
        for package in packages:
            built = None
            if self.prefixes is not None:
                built = built_package(self.record, package, self.prefixes)
            if built is not None:
                self._install_built(built)
            self._install_wrappers(package)
            if built is None:
                self._install_data(package)
        programs = {}
        for artifact in self.record.artifacts:
            if artifact.path is None:
                continue
            executable = self.rubric.artifacts[artifact.name].executable
            program = self._program(artifact.name, artifact.path, executable)
            if program is not None:
                programs[artifact.name] = program
        return programs

    def _program(self, artifact: str, path: str, executable: str | None) -> StudentProgram | None:
        """Return the installed program that runs an artifact's file, or else a new wrapper.

        None for the source of a compiled program that was not built.
        """
        if is_compiled_source(path):
            return self._compiled_program(path, executable)
        programs = self._installed.get(path, {})
        if executable in programs:
            return StudentProgram(programs[executable])
        if programs:
            return StudentProgram(min(programs.values()))
        relative = f"install/lib/.artifacts/{artifact}"
        _write(self.folder / relative, self._wrapper_of_file(path, executable))
        return StudentProgram(relative)

    def _compiled_program(self, path: str, executable: str | None) -> StudentProgram | None:
        """Return the program that was compiled from a source: by the name of the artifact, else by the build file."""
        candidates = []
        for package in self.record.packages:
            if executable is not None and PurePosixPath(path).is_relative_to(package.path):
                candidates.append(f"install/lib/{package.name}/{executable}")
            for name, source in compiled_programs(package, self.record.texts).items():
                if source == path:
                    candidates.append(f"install/lib/{package.name}/{name}")
        for program in candidates:
            if is_regular_beneath(self.folder, program):
                return StudentProgram(program, is_compiled=True)
        return None

    def _take_room(self, path: Path, size_bytes: int) -> bool:
        """Take the room for a file and the folders that it needs, if there is so much."""
        entries = 1 + sum(not parent.is_dir() for parent in path.parents)
        if size_bytes > self.size_bytes or entries > self.entries:
            return False
        self.size_bytes, self.entries = self.size_bytes - size_bytes, self.entries - entries
        return True

    def _register(self, package: str) -> None:
        install = self.folder / "install"
        _write(install / "share/ament_index/resource_index/packages" / package, "", 0o644)
        for part in ("share", "lib"):
            (install / part / package).mkdir(parents=True, exist_ok=True)

    def _packages_of_bare_files(self) -> list[PackageFact]:
        """Bare files stand for the lab's package, and for any other that their launch files name."""
        named = [self.rubric.lab.package]
        for text in self.record.texts.values():
            named += _PACKAGE_ARGUMENT.findall(text)
        names = [name for name in dict.fromkeys(named) if not is_released(name)]
        programs = self._bare_programs()
        return [
            PackageFact(name, "", "ament_python", programs) for name in names[:_MOST_BARE_PACKAGES]
        ]

    def _bare_programs(self) -> dict[str, str]:
        """Return bare files by the names that their entry points would have, and by their own names."""
        parts: dict[str, str] = {}
        for artifact in self.record.artifacts:
            executable = self.rubric.artifacts[artifact.name].executable
            if executable is not None and artifact.path is not None:
                parts[executable] = artifact.path
        scripts = [path for path in self.record.texts if path.endswith(".py")]
        others = [path for path in scripts if not is_launch_file(path)]
        programs: dict[str, str] = {}
        for path in (*others, *parts.values()):
            file = PurePosixPath(path)
            programs[file.name] = str(file)
            programs[file.stem] = str(file)
        return programs | parts

    # -- built packages -----------------------------------------------------------------------

    def _install_built(self, built: BuiltPackage) -> None:
        """Install the files of a built package, and note its programs by the files that they run."""
        linked = {}
        for file in built.files:
            target = self.folder / "install" / file.path
            with suppress(OSError):  # a name that is a folder in another package
                if target.exists():
                    continue
                if not self._take_room(target, file.size_bytes):
                    continue
                target.parent.mkdir(parents=True, exist_ok=True)
                self._install_file(built, file, target)
                if file.source is not None:
                    linked[file.path] = file.source
        for name, path in built.programs.items():
            if path not in linked:
                continue
            source = linked[path]
            if self._leads_to(source, built.scripts[name]):
                program = f"install/lib/{built.name}/{name}"
                self._installed[source][name] = program

    def _leads_to(self, source: str, target: str) -> bool:
        """Return whether an entry point may call a function of a file."""
        module, _, function = target.partition(":")
        return call_fault(self.record.texts.get(source), module, function) is None

    def _install_file(self, built: BuiltPackage, file: InstalledFile, target: Path) -> None:
        """Install a file: an unchanged module as a link to its source, a copied script as a wrapper around it."""
        if file.source is None:
            built.copy(file, target, self.interpreter)
        elif file.is_program:
            _write(target, self._wrapper_of_file(file.source))
        else:
            target.symlink_to(os.path.relpath(self.folder / "src" / file.source, target.parent))

    # -- packages by wrappers -----------------------------------------------------------------

    def _install_wrappers(self, package: PackageFact) -> None:
        """Install a wrapper for each declared executable that is missing."""
        for name, target in package.executables.items():
            program = self.folder / "install/lib" / package.name / name
            if program.exists():
                continue
            if not re.fullmatch(r"(?!\.{1,2}$)[\w.+-]{1,200}", name):
                continue
            text = self._wrapper_of_entry(package, target)
            if self._take_room(program, len(text)):
                _write(program, text)

    def _install_data(self, package: PackageFact) -> None:
        """Install the data files of a package that was not built."""
        self._share(self._all_data(package.name, PurePosixPath(package.path)))

    def _all_data(self, package: str, root: PurePosixPath) -> list[tuple[str, str]]:
        """Return all data files of a package, where they lie and where they usually are installed."""
        shared = []
        for path in (PurePosixPath(file.path) for file in self.record.files):
            if path.is_relative_to(root) and _is_shared(inside := path.relative_to(root)):
                usual = _USUAL_FOLDERS.get(
                    path.suffix, "launch" if is_launch_file(path.name) else None
                )
                targets = [f"{usual}/{inside}"] if usual and len(inside.parts) == 1 else []
                shared += [
                    (f"share/{package}/{target}", str(path)) for target in (inside, *targets)
                ]
        return shared

    def _share(self, files: Iterable[tuple[str, str]]) -> None:
        """Install files, texts first, below the prefix's share folder, and nowhere else."""
        for target, path in sorted(files, key=lambda pair: pair[1] not in self.record.texts):
            origin, installed = self.folder / "src" / path, self.folder / "install" / target
            parts = PurePosixPath(target).parts
            if parts[:1] != ("share",) or ".." in parts or not origin.is_file():
                continue
            with suppress(OSError):  # a name that is a folder elsewhere, or too long
                if self._take_room(installed, origin.stat().st_size):
                    installed.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(origin, installed)

    # -- wrappers -----------------------------------------------------------------------------

    def _wrapper(self, target: str, root: PurePosixPath, source: str, run: str) -> str:
        packages = [folder for folder in self._python_path if folder != str(root)]
        return _WRAPPER.format(
            interpreter=self.interpreter,
            target=target,
            root=str(root),
            source=source,
            run=run,
            packages=packages,
        )

    def _wrapper_of_entry(self, package: PackageFact, target: str) -> str:
        if ":" not in target:
            return self._wrapper_of_file(target)
        module, function = target.split(":", 1)
        source = module.replace(".", "/") + ".py"
        return self._wrapper(
            target, PurePosixPath(package.path), source, _run_entry(module, function)
        )

    # Many names may stand for one file, in packages within each other too, and it takes long to read.
    @cache  # noqa: B019
    def _wrapper_of_file(self, path: str, executable: str | None = None) -> str:
        file = PurePosixPath(path)
        function = function_to_call(
            self.record.texts.get(path, ""), self._entry_points_of(file, executable)
        )
        root = self._package_root(file)
        module = ".".join(file.relative_to(root).with_suffix("").parts)
        if root == file.parent or file.suffix != ".py":
            root = file.parent
            call = _RUN_FILE
            if function is not None:
                call = _RUN_FILE_FUNCTION.format(function=function)
            run = _REFUSE_OTHER_ENCODINGS + call
        else:
            run = (
                _RUN_MODULE.format(module=module)
                if function is None
                else _run_entry(module, function)
            )
        return self._wrapper(path, root, str(file.relative_to(root)), run)

    def _entry_points_of(self, path: PurePosixPath, executable: str | None) -> list[str]:
        """Return the functions of a file that are entry points of its package, the executable's first."""
        points = self._entry_points.get(path.with_suffix(""), [])
        return [
            function for name, function in sorted(points, key=lambda point: point[0] != executable)
        ]

    @cached_property
    def _entry_points(self) -> Mapping[PurePosixPath, list[tuple[str, str]]]:
        """For each module that entry points name: their names and functions."""
        named = defaultdict(list)
        for package in self.record.packages:
            for name, target in package.executables.items():
                module, colon, function = target.partition(":")
                if colon:
                    named[PurePosixPath(package.path, *module.split("."))].append((name, function))
        return named

    @cached_property
    def _files(self) -> frozenset[str]:
        return frozenset(file.path for file in self.record.files)

    @cached_property
    def _python_path(self) -> list[str]:
        """Folders of all packages, with modules beside a program's own, as in a sourced workspace."""
        if not self.record.packages:
            return []
        inner = (
            self._package_root(PurePosixPath(path))
            for path in sorted(self._files)
            if _INIT.search(path)
        )
        folders = [package.path for package in self.record.packages] + [str(root) for root in inner]
        return list(dict.fromkeys(folders))[:_MOST_FOLDERS]

    def _package_root(self, path: PurePosixPath) -> PurePosixPath:
        """Folder from which the file's Python package is imported; its own for a file that stands alone."""
        root = path.parent
        while root.parts and str(root / "__init__.py") in self._files:
            if not all(part.isidentifier() for part in (root.name, path.stem)):
                return path.parent
            root = root.parent
        return root


def _run_entry(module: str, function: str) -> str:
    return f"from {module} import {function.partition('.')[0]}\n\nsys.exit({function}())"


def _write(path: Path, text: str, mode: int = 0o755) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(mode)


def _is_shared(inside: PurePosixPath) -> bool:
    """Return whether a package's file belongs in its share folder: data rather than modules."""
    return (
        inside.suffix != ".py" or "launch" in inside.parts[0] or inside.name.endswith("launch.py")
    )

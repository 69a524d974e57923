"""Faults of a ROS package by its recorded build: the words of the build, their place, and a remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath

from grader.recording.submission import BuildFact, PackageFact, SubmissionRecord

#: Where a build sees the files of a submission.
_SOURCES = "/ws/src/"
#: Characters of a message that are shown.
_LONGEST = 300
_MARKER = "share/ament_index/resource_index/packages"


@dataclass(frozen=True)
class BuildFault:
    """A fault of a package: its message as a sentence, its place and its remedy."""

    message: str
    remedy: str
    file: str = ""
    line: int | None = None


@dataclass(frozen=True)
class _Place:
    """A message of a build, and its place; the file is relative to the submission."""

    words: str
    file: str = ""
    line: int | None = None


# -- a package that is not built ---------------------------------------------------------------------


def build_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str]
) -> BuildFault | None:
    """Return the fault at which a build stopped; None for a package that was built, or that nobody could build here."""
    if build.outcome == "ignored":
        return _ignored(package, texts)
    if build.outcome != "failed":
        return None
    found = _place_of(package, build.output)
    remedy = _remedy(package, found.words)
    line = found.line
    if line is None:
        line = _line_of(found, texts)
    return BuildFault(
        f"`colcon build` does not build the package {package.name}: {found.words}",
        remedy,
        found.file,
        line,
    )


def _ignored(package: PackageFact, texts: Mapping[str, str]) -> BuildFault:
    """Return the fault of a package that colcon does not find."""
    manifest = _within(package, "package.xml")
    for problem in package.problems:
        if problem.startswith("package.xml"):
            message = f"`colcon build` finds no package of ROS in {manifest}: {problem}"
            return BuildFault(message, "Correct package.xml.", manifest)
    message = f"`colcon build` does not find the package {package.name}"
    for above in PurePosixPath(manifest).parents:
        if str(above / "COLCON_IGNORE") in texts:
            return BuildFault(
                f"{message}: COLCON_IGNORE is beside it.", "Remove COLCON_IGNORE.", manifest
            )
    remedy = "Move the package out of the folder of the other package."
    return BuildFault(f"{message}: it lies inside another package.", remedy, manifest)


def _place_of(package: PackageFact, output: str) -> _Place:
    """Return the message that tells most of a failed build, with its place."""
    for look in (_of_traceback, _of_compiler, _of_setuptools, _of_cmake, _of_colcon):
        found = look(package, output)
        if found is not None:
            return found
    problems = [problem for problem in package.problems if "does not follow" not in problem]
    if problems:
        return _Place(problems[0], _within(package, _build_file(package)))
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    words = lines[-1] if lines else "it failed without a message."
    return _Place(words[:_LONGEST], _within(package, _build_file(package)))


def _build_file(package: PackageFact) -> str:
    return "setup.py" if package.build_type == "ament_python" else "CMakeLists.txt"


def _within(package: PackageFact, name: str) -> str:
    return f"{package.path}/{name}".lstrip("/")


_TRACEBACK = re.compile(
    r"^Traceback \(most recent call last\):\n((?:[ \t].*\n)*)(\w[\w.]*(?::.*)?)$", re.MULTILINE
)
_FRAME = re.compile(r'File "([^"\n]{1,300})", line (\d+)')


def _of_traceback(package: PackageFact, output: str) -> _Place | None:
    """Return the end of the first traceback of a student's setup.py; colcon's own ones tell of nothing else."""
    for match in _TRACEBACK.finditer(output):
        frames, error = match.groups()
        if "colcon_core" in frames:
            continue
        place = _last_frame(package, frames)
        if place is not None:
            return _Place(error[:_LONGEST], *place)
    return None


def _last_frame(package: PackageFact, frames: str) -> tuple[str, int] | None:
    """Return file and line of the last frame in a student's file.

    colcon executes a setup.py as `<string>`, after a frame of `run_setup`.
    """
    found = None
    _, _, inside = frames.partition("in run_setup")
    for file, line in _FRAME.findall(inside):
        if file == "<string>":
            found = _within(package, "setup.py"), int(line)
    for file, line in _FRAME.findall(frames):
        if file.startswith(_SOURCES):
            found = file.removeprefix(_SOURCES), int(line)
        elif file == "setup.py":
            found = _within(package, "setup.py"), int(line)
    return found


_COMPILER = re.compile(
    r"^([^\s:]{1,300}):(\d+):(?:\d+:)? (?:fatal )?error: (.{1,300})", re.MULTILINE
)


def _of_compiler(package: PackageFact, output: str) -> _Place | None:
    match = _COMPILER.search(output)
    if match is None:
        return None
    file, line, words = match.groups()
    return _Place(words, file.removeprefix(_SOURCES), int(line))


def _of_setuptools(package: PackageFact, output: str) -> _Place | None:
    match = re.search(r"^error: (.{1,300})", output, re.MULTILINE)
    if match is not None:
        return _Place(match[1], _within(package, "setup.py"))
    if re.search(r"can't open file '[^'\n]{1,300}/setup\.py'", output):
        return _Place("there is no setup.py beside package.xml.", _within(package, "package.xml"))
    return None


_CMAKE = re.compile(
    r"^CMake Error at ([^\s:]{1,300}):(\d+) \([^)\n]{0,100}\):\s*\n((?:[ \t]*\n|[ \t]+\S.*\n){1,12})",
    re.MULTILINE,
)


def _of_cmake(package: PackageFact, output: str) -> _Place | None:
    match = _CMAKE.search(output)
    if match is not None:
        file, line, words = match.groups()
        name = file.removeprefix(_SOURCES)
        if name == "CMakeLists.txt":
            name = _within(package, name)
        text = " ".join(words.split())
        return _Place(text[:_LONGEST], name, int(line))
    if "does not appear to contain CMakeLists.txt" in output:
        words = "there is no CMakeLists.txt, and package.xml names no other build type."
        return _Place(words, _within(package, "package.xml"))
    return None


def _of_colcon(package: PackageFact, output: str) -> _Place | None:
    if "Duplicate package names" not in output:
        return None
    words = f"there are several packages with the name {package.name}."
    return _Place(words, _within(package, "package.xml"))


def _line_of(found: _Place, texts: Mapping[str, str]) -> int | None:
    """Return the line of a file that has the name in quotes of a message, or the last part of this name."""
    quoted = re.search(r"(?:^| )'([^'\n]{1,200})'", found.words)
    if quoted is None:
        return None
    name = quoted[1]
    lines = texts.get(found.file, "").splitlines()
    for wanted in (name, f"{PurePosixPath(name).parent}/", "packages="):
        for number, line in enumerate(lines, start=1):
            if wanted in line:
                return number
    return None


#: Words of a message -> remedy; `{0}` is the first group, `{package}` the package.
_REMEDIES = (
    (
        r"package directory '(.+?)' does not exist",
        "Rename the folder of the modules to {0}, or name the existing folder in `packages` of setup.py.",
    ),
    (
        r"can't copy '(resource/.+?)'",
        "Add an empty file {0}: it marks the package in the index of ROS.",
    ),
    (r"can't copy '(.+?)'", "Add the file {0}, or remove it from data_files in setup.py."),
    (
        r"there is no CMakeLists\.txt",
        "In package.xml, write <export><build_type>ament_python</build_type></export> for a package with a setup.py.",
    ),
    (
        r"there is no setup\.py",
        "Add setup.py; `ros2 pkg create --build-type ament_python` shows one.",
    ),
    (
        r"^SyntaxError",
        "Correct the syntax of the file; `python3 setup.py --version` shows the error.",
    ),
    (r"No module named '(.+?)'", "A setup.py imports setuptools alone; remove the import of {0}."),
    (
        r"entry point",
        "Write entry points as 'name = package.module:function', with dots instead of slashes.",
    ),
    (r"several packages", "Remove all of them but one; `colcon build` builds nothing before."),
)


def _remedy(package: PackageFact, words: str) -> str:
    for pattern, remedy in _REMEDIES:
        match = re.search(pattern, words)
        if match is not None:
            return remedy.format(*match.groups(), package=package.name)
    return f"Run `colcon build --packages-select {package.name}` until it ends without an error."


# -- a package that is built ---------------------------------------------------------------------------


def executables_in(build: BuildFact) -> set[str]:
    """Return the names of the executables that `ros2 run` finds."""
    folder = f"lib/{build.package}/"
    found = set()
    for path in build.installed:
        name = path.removeprefix(folder)
        if path.startswith(folder) and "/" not in name:
            found.add(name)
    return found


def misplaced_executables(build: BuildFact) -> dict[str, str]:
    """Return the declared executables in a folder that `ros2 run` does not search: name -> folder."""
    found = {}
    for path in build.installed:
        folder, _, name = path.rpartition("/")
        is_program = folder == "bin" or re.fullmatch(r"lib/[A-Za-z][\w-]*", folder)
        is_python = folder.startswith("lib/python")
        if is_program and not is_python and folder != f"lib/{build.package}":
            found[name] = folder
    return found


def placement_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str]
) -> BuildFault | None:
    """Return the fault of a package with executables that `ros2 run` and `ros2 launch` do not find.

    Its place is setup.cfg, or the setup.py that declares the executables if there is no setup.cfg.
    """
    misplaced = misplaced_executables(build)
    found = executables_in(build)
    lost = [name for name in misplaced if name not in found]
    if not lost:
        return None
    folder = misplaced[lost[0]]
    names = ", ".join(sorted(lost))
    wanted = f"lib/{package.name}"
    remedy = (
        f"Write four lines in setup.cfg: `[develop]`, `script_dir=$base/{wanted}`, `[install]`, "
        f"`install_scripts=$base/{wanted}`."
    )
    place = _within(package, "setup.cfg")
    cause = "setup.cfg names another folder"
    if place not in texts:
        place = _within(package, "setup.py")
        cause = "there is no setup.cfg"
    return BuildFault(
        f"The package {package.name} installs {names} in {folder}, while `ros2 run` and `ros2 launch` search {wanted}: "
        f"{cause}.",
        remedy,
        place,
    )


def not_startable(
    package: PackageFact, build: BuildFact | None, texts: Mapping[str, str]
) -> dict[str, str]:
    """Return installed executables that Linux cannot start, with their sources: scripts without a `#!` line."""
    found = {}
    scripts = _copied_scripts(package, texts)
    if build is not None and build.outcome == "built":
        for path in build.without_interpreter:
            name = PurePosixPath(path).name
            found[name] = scripts.get(name, "")
        return found
    for name, file in scripts.items():
        if not texts[file].startswith("#!"):
            found[name] = file
    return found


def _copied_scripts(package: PackageFact, texts: Mapping[str, str]) -> dict[str, str]:
    """Return the executables that a build file copies as they are, with their sources."""
    if any("does not follow" in problem for problem in package.problems):
        return {}
    found = {}
    for name, file in package.executables.items():
        if ":" not in file and file in texts:
            found[name] = file
    return found


def start_fault(
    package: PackageFact, build: BuildFact | None, texts: Mapping[str, str], named: Iterable[str]
) -> BuildFault | None:
    """Return the fault of named executables that `ros2 run` finds and Linux cannot start."""
    broken = not_startable(package, build, texts)
    concerned = sorted(broken.keys() & set(named))
    if not concerned:
        return None
    names = ", ".join(concerned)
    return BuildFault(
        f"Linux cannot start {names} of the package {package.name} (Exec format error): there is no `#!` line.",
        "Begin the file with `#!/usr/bin/env python3`.",
        broken[concerned[0]],
        1,
    )


def has_own_marker(build: BuildFact) -> bool:
    """Return whether the build files install the marker of the package; colcon-ros adds a missing one for now."""
    is_added = "doesn't explicitly install a marker" in build.output
    return f"{_MARKER}/{build.package}" in build.installed and not is_added


# -- the dependencies ----------------------------------------------------------------------------------

_IMPORT = re.compile(r"^[ \t]*(?:from|import)[ \t]+([A-Za-z_]\w*)", re.MULTILINE)
_DEPENDENCY = re.compile(
    r"<(?:depend|exec_depend|build_depend|run_depend|build_export_depend|test_depend)\b[^>]{0,200}>\s*([\w.-]{1,100})\s*<"
)


def undeclared_dependencies(
    submission: SubmissionRecord, package: PackageFact, known: Iterable[str]
) -> dict[str, str]:
    """Return the packages of ROS that a package imports and does not declare, with a file of each.

    Parameters
    ----------
    known
        Names of packages of ROS.
    """
    manifest = submission.texts.get(_within(package, "package.xml"), "")
    declared = {*_DEPENDENCY.findall(manifest), package.name}
    ours = {each.name for each in submission.packages}
    names = {*known, *ours} - declared
    found: dict[str, str] = {}
    for path, text in _modules(submission, package):
        for name in _IMPORT.findall(text):
            if name in names:
                found.setdefault(name, path)
    return found


def _modules(submission: SubmissionRecord, package: PackageFact) -> Iterator[tuple[str, str]]:
    """Yield the Python files of a package, without its tests and launch files."""
    above = _within(package, "")
    for path, text in submission.texts.items():
        inside = path.removeprefix(above)
        is_module = path.startswith(above) and path.endswith(".py")
        if is_module and not inside.startswith(("test/", "launch/")):
            yield path, text


# -- folders of a build ----------------------------------------------------------------------------------

_MADE = frozenset({"build", "install", "log"})


def built_folders(submission: SubmissionRecord) -> list[str]:
    """Return the folders that `colcon build` makes and that were handed in; their files are left out of a grading."""
    found = []
    for note in submission.left_out:
        folder = note.partition(": ")[0].rstrip("/")
        if PurePosixPath(folder).name in _MADE:
            found.append(folder)
    return sorted(found)

"""Faults of a ROS package by its recorded build: the words of the build, their place, and a remedy."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath

from grader.evidence.known_packages import package_meant_by
from grader.recording.submission import BuildFact, PackageFact, SubmissionRecord

#: Where a build sees the files of a submission.
_SOURCES = "/ws/src/"
#: Characters of a message that are shown.
_LONGEST = 300


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
    #: Text in the line, if the message does not name its number; by default the name in quotes of the message.
    line_has: str = ""


# -- a package that is not built ---------------------------------------------------------------------


def build_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str]
) -> BuildFault | None:
    """Return the fault at which a build stopped; None for a package that was built, or that nobody could build here."""
    if build.outcome == "ignored":
        return _ignored(package, build, texts)
    if build.outcome != "failed":
        return None
    found = _place_of(package, f"{build.output}\n")
    remedy = _remedy(package, found.words, texts)
    line = found.line
    if line is None:
        line = _line_of(found, texts)
    return BuildFault(
        f"`colcon build` does not build the package {package.name}: {found.words}",
        remedy,
        found.file,
        line,
    )


def is_put_aside(package: PackageFact, texts: Mapping[str, str]) -> bool:
    """Return whether a COLCON_IGNORE lies in a folder of the package, or above it."""
    parents = PurePosixPath(within(package, "package.xml")).parents
    return any(str(above / "COLCON_IGNORE") in texts for above in parents)


def _ignored(package: PackageFact, build: BuildFact, texts: Mapping[str, str]) -> BuildFault:
    """Return the fault of a package that colcon does not find, or cannot build."""
    manifest = within(package, "package.xml")
    if f"No task extension to 'build' a 'ros.{package.build_type}'" in build.output:
        message = (
            f"`colcon build` leaves out the package {package.name}: "
            f"there is no build type {package.build_type}."
        )
        remedy = f"Write <build_type>{_type_meant(package, texts)}</build_type>."
        line = line_with(texts.get(manifest, ""), "<build_type>")
        return BuildFault(message, remedy, manifest, line)
    for problem in package.problems:
        if problem.startswith("package.xml"):
            message = f"`colcon build` finds no package of ROS in {manifest}: {problem}"
            return BuildFault(message, "Correct package.xml.", manifest)
    message = f"`colcon build` does not find the package {package.name}"
    if is_put_aside(package, texts):
        message = f"{message}: COLCON_IGNORE is beside it."
        return BuildFault(message, "Remove COLCON_IGNORE.", manifest)
    remedy = "Move the package out of the folder of the other package."
    return BuildFault(f"{message}: it lies inside another package.", remedy, manifest)


def _type_meant(package: PackageFact, texts: Mapping[str, str]) -> str:
    """Return the build type of a package by its build file."""
    if within(package, "CMakeLists.txt") in texts:
        return "ament_cmake"
    return "ament_python"


def _place_of(package: PackageFact, output: str) -> _Place:
    """Return the message that tells most of a failed build, with its place."""
    for look in (_of_traceback, _of_compiler, _of_linker, _of_setuptools, _of_cmake, _of_colcon):
        found = look(package, output)
        if found is not None:
            return found
    problems = [problem for problem in package.problems if "does not follow" not in problem]
    if problems:
        return _Place(problems[0], within(package, _build_file(package)))
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    words = lines[-1] if lines else "it failed without a message."
    return _Place(words[:_LONGEST], within(package, _build_file(package)))


def _build_file(package: PackageFact) -> str:
    return "setup.py" if package.build_type == "ament_python" else "CMakeLists.txt"


def within(package: PackageFact, name: str) -> str:
    """Return the path of a package's file in the submission."""
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
            found = within(package, "setup.py"), int(line)
    for file, line in _FRAME.findall(frames):
        if file.startswith(_SOURCES):
            found = file.removeprefix(_SOURCES), int(line)
        elif file == "setup.py":
            found = within(package, "setup.py"), int(line)
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
        return _Place(match[1], within(package, "setup.py"))
    if re.search(r"can't open file '[^'\n]{1,300}/setup\.py'", output):
        return _Place("there is no setup.py beside package.xml.", within(package, "package.xml"))
    return None


#: A function with two bodies, and the object file of the second.
_TWICE = re.compile(
    r"CMakeFiles/[^/\s]{1,200}\.dir/(\S{1,300}?)\.o: in function `[^\n]{1,300}\n[^\n]{1,500}"
    r"(multiple definition of `([^'\n]{1,300})')"
)
#: A function without a body, and the object file of its call before that.
_LINKER = re.compile(
    r"CMakeFiles/[^/\s]{1,200}\.dir/(\S{1,300}?)\.o\b(?s:.){0,500}?(undefined reference to `([^'\n]{1,300})')"
)


def _of_linker(package: PackageFact, output: str) -> _Place | None:
    match = _LINKER.search(output) or _TWICE.search(output)
    if match is None:
        return None
    file, words, symbol = match.groups()
    function = symbol.partition("(")[0].rpartition("::")[2]
    return _Place(words, within(package, file), line_has=f"{function}(")


_CMAKE = re.compile(
    r"^CMake Error at ([^\s:]{1,300}):(\d+)(?: \([^)\n]{0,100}\))?:\s*\n((?:[ \t]*\n|[ \t]+\S.*\n){1,12})",
    re.MULTILINE,
)
#: Beginnings of sentences of CMake that add nothing.
_ADVICE = re.compile(
    r"Tried extensions|Could not find a package|Add the installation|Possible reasons"
)
#: A script outside of the submission.
_ELSEWHERE = re.compile(f"/(?!{_SOURCES[1:]})")
_CALLED_AT = re.compile(r"^ +CMakeLists\.txt:(\d+) \(", re.MULTILINE)
#: Script that installs; its line is none of the student's.
_INSTALLING = "cmake_install.cmake"
_SCRIPT = "CMakeLists.txt"


def _of_cmake(package: PackageFact, output: str) -> _Place | None:
    match = _CMAKE.search(output)
    if match is not None:
        file, number, words = match.groups()
        text = " ".join(_ADVICE.split(words)[0].replace(_SOURCES, "").split())[:_LONGEST]
        name = within(package, _SCRIPT)
        if file == _INSTALLING:
            return _Place(text, name, line_has=PurePosixPath(_quoted(text)).name)
        if "PROJECT_NAME" in text:
            return _Place(text, name, line_has=_project_line(text))
        if _ELSEWHERE.match(file):
            return _Place(text, name, _called_at(output[match.end() :]))
        if file != _SCRIPT:
            name = file.removeprefix(_SOURCES)
        return _Place(text, name, int(number))
    if "does not appear to contain CMakeLists.txt" in output:
        words = "there is no CMakeLists.txt, and package.xml names no other build type."
        return _Place(words, within(package, "package.xml"), line_has="<build_type>")
    return None


def _project_line(words: str) -> str:
    """Return the text of the line that a message about the project concerns."""
    if "not a valid project name" in words:
        return "cmake_minimum_required"
    return "project("


def _called_at(output: str) -> int | None:
    """Return the line of the package's script in the first stack of calls."""
    stack, _, _ = output.partition("CMake Error")
    match = _CALLED_AT.search(stack)
    if match is None:
        return None
    return int(match[1])


def _quoted(words: str) -> str:
    match = re.search(r'"([^"]{1,300})"', words)
    if match is None:
        return ""
    return match[1]


#: A line of packages that colcon cannot order: `lab: ['other']`.
_WAITING = re.compile(r"^([\w-]{1,100}): \['([\w-]{1,100})'", re.MULTILINE)


def _of_colcon(package: PackageFact, output: str) -> _Place | None:
    manifest = within(package, "package.xml")
    if "Duplicate package names" in output:
        words = f"there are several packages with the name {package.name}."
        return _Place(words, manifest, line_has="<name>")
    if "Unable to order packages topologically" not in output:
        return None
    needed = dict(_WAITING.findall(output))
    others = ", ".join(sorted(needed))
    words = f"the packages {others} need each other, so that none can be the first."
    return _Place(words, manifest, line_has=f">{needed.get(package.name, '')}<")


def line_with(text: str, *wanted: str) -> int | None:
    """Return the first line with the first of several texts that the lines have; None if they have none."""
    lines = text.splitlines()
    for each in wanted:
        for number, line in enumerate(lines, start=1):
            if each in line:
                return number
    return None


def _line_of(found: _Place, texts: Mapping[str, str]) -> int | None:
    """Return the line of a file that has the name in quotes of a message, or the last part of this name."""
    text = texts.get(found.file, "")
    if found.line_has:
        return line_with(text, found.line_has)
    quoted = re.search(r"(?:^| )'([^'\n]{1,200})'", found.words)
    if quoted is None:
        return None
    name = quoted[1]
    folder = f"{PurePosixPath(name).parent}/"
    # Two entry points without a comma between them are one text.
    entry, _, _ = name.partition(":")
    return line_with(text, name, folder, entry, "packages=")


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
    (r"can't copy '([^'\n]+)'", "Add the file {0}, or remove it from data_files in setup.py."),
    (
        r"there is no CMakeLists\.txt",
        "In package.xml, write <export><build_type>ament_python</build_type></export> for a package with a setup.py.",
    ),
    (
        r"there is no setup\.py",
        "Add setup.py; `ros2 pkg create --build-type ament_python` shows one.",
    ),
    (
        r"^(?:Syntax|Indentation|Tab)Error",
        "Correct the syntax of the file; `python3 setup.py --version` shows the error.",
    ),
    (
        r"^configparser\.",
        "Correct setup.cfg: it begins with `[develop]`, and its encoding is UTF-8 without a byte order mark (BOM).",
    ),
    (
        r"name 'find_packages' is not defined",
        "Write `from setuptools import find_packages, setup`.",
    ),
    (r"name 'glob' is not defined", "Write `from glob import glob` at the top of setup.py."),
    (r"name '(\w+)' is not defined", "Import {0} at the top of setup.py, or correct its name."),
    (r"'module' object is not callable", "Write `from glob import glob` instead of `import glob`."),
    (r"Multiple top-level packages", "Write packages=find_packages(exclude=['test']) in setup()."),
    (r"No module named '(.+?)'", "A setup.py imports setuptools alone; remove the import of {0}."),
    (
        r"entry point",
        "Write entry points as 'name = package.module:function', with dots instead of slashes, and without dashes.",
    ),
    (
        r"passed package name '(.+?)' was not found",
        "Add find_package({0} REQUIRED) before it, and <depend>{0}</depend> to package.xml.",
    ),
    (
        r'links to.*?"?([\w-]+)::.*target was not found',
        "Add find_package({0} REQUIRED) before it, and <depend>{0}</depend> to package.xml.",
    ),
    (
        r'given target "([^"\n]+)" which does not exist',
        "Write the name of a target as in add_executable or add_library instead of {0}.",
    ),
    (r"Cannot find source file: (\S+)", "Add the file {0}, or correct its name."),
    (r"does not match current PROJECT_NAME", "Write project({package}), as in package.xml."),
    (
        r'INSTALL cannot find "(.+?)"',
        "Add {0}, or remove it from install() in CMakeLists.txt.",
    ),
    (
        r"doesn't contain an '__init__\.py'",
        "Add an empty file __init__.py to the folder that ament_python_install_package names.",
    ),
    (
        r"not a valid project name",
        "Write project({package}) below cmake_minimum_required.",
    ),
    (
        r'cannot create target "(.+?)" because another target',
        "Remove one of the commands that make {0}, or give it another name.",
    ),
    (
        r'Unknown CMake command "rosidl_generate_interfaces"',
        "Add find_package(rosidl_default_generators REQUIRED) before it.",
    ),
    (
        r'Unknown CMake command "ament_python_install_package"',
        "Add find_package(ament_cmake_python REQUIRED) before it.",
    ),
    (r'Unknown CMake command "ament_\w+"', "Add find_package(ament_cmake REQUIRED) before it."),
    (r"multiple definition of `(.+?)'", "Name only one source file with {0} in add_executable."),
    (r"^Parse error", "Write the closing bracket of this command."),
    (
        r"^(\w+)/\S+: No such file",
        "Add find_package({0} REQUIRED) and ament_target_dependencies with {0} to CMakeLists.txt; for a header of your "
        "own, target_include_directories.",
    ),
    (
        r"undefined reference to `(.+?)'",
        "Define {0}, or name the library that defines it in target_link_libraries.",
    ),
    (r"^expected|undeclared|was not declared", "Correct this line, the first with an error."),
    (r"need each other", "Remove one of their dependencies in package.xml."),
    (r"several packages", "Remove all of them but one; `colcon build` builds nothing before."),
)


def _remedy(package: PackageFact, words: str, texts: Mapping[str, str]) -> str:
    """Return the remedy of a message, by the files of the package if they tell more than the message."""
    for look in _BY_FILES:
        remedy = look(package, words, texts)
        if remedy:
            return remedy
    for pattern, remedy in _REMEDIES:
        match = re.search(pattern, words)
        if match is not None:
            return remedy.format(*match.groups(), package=package.name)
    return f"Run `colcon build --packages-select {package.name}` until it ends without an error."


def _meant_package(package: PackageFact, words: str, texts: Mapping[str, str]) -> str:
    """Correct a misspelt package of find_package."""
    misspelt = re.search(r'provided by "(.+?)"', words)
    meant = package_meant_by(misspelt[1]) if misspelt is not None else ""
    if misspelt is None or not meant:
        return ""
    return f"Write {meant} instead of {misspelt[1]}."


def _missing_script(package: PackageFact, words: str, texts: Mapping[str, str]) -> str:
    """Ask for a CMakeLists.txt in a package without a setup.py."""
    if "no CMakeLists.txt" not in words or within(package, "setup.py") in texts:
        return ""
    return "Add CMakeLists.txt; `ros2 pkg create --build-type ament_cmake` shows one."


def _wrong_root(package: PackageFact, words: str, texts: Mapping[str, str]) -> str:
    """Correct a package_dir that leads to a missing folder."""
    missing = re.search(r"package directory '([^'\n]+)/[^'/\n]+' does not exist", words)
    if missing is None or "package_dir" not in texts.get(within(package, "setup.py"), ""):
        return ""
    return f"Remove package_dir from setup.py, or move the folder of the modules into {missing[1]}."


def _copied_folder(package: PackageFact, words: str, texts: Mapping[str, str]) -> str:
    """Name the files of a folder in data_files."""
    copied = re.search(r"can't copy '([^'\n]+)'", words)
    if copied is None:
        return ""
    folder = copied[1]
    above = f"{within(package, folder)}/"
    if not any(path.startswith(above) for path in texts):
        return ""
    script = texts.get(within(package, "setup.py"), "")
    listed = folder
    if f"'{folder}'" not in script and f'"{folder}"' not in script:
        listed = str(PurePosixPath(folder).parent)
    return f"{folder} is a folder, and data_files takes files: write glob('{listed}/*.*')."


def _late_target(package: PackageFact, words: str, texts: Mapping[str, str]) -> str:
    """Move the installation of a target below its definition."""
    target = re.search(r'given target "([^"\n]+)" which does not exist', words)
    if target is None:
        return ""
    made = f"add_executable({target[1]} "
    if made not in texts.get(within(package, _SCRIPT), ""):
        return ""
    return f"Write install(TARGETS {target[1]} ...) below {made}...)."


def _missing_comma(package: PackageFact, words: str, texts: Mapping[str, str]) -> str:
    """Separate two entry points that Python reads as one text."""
    if not re.search(r"entry point '[^']*=[^']*=", words):
        return ""
    return "Write a comma between two entry points."


#: Remedies that the files of a package tell.
_BY_FILES = (
    _meant_package,
    _missing_script,
    _wrong_root,
    _copied_folder,
    _late_target,
    _missing_comma,
)


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

"""ROS packages in a submission: what `colcon build` would install, read by parsing alone.

`setup.py` is read as a syntax tree, and never executed.
"""

from __future__ import annotations

import configparser
import re
from pathlib import PurePosixPath
from xml.etree import ElementTree

from grader.recording.submission import PackageFact
from grader.submission.packages.cmake_script import commands_of, installs_of
from grader.submission.packages.interfaces import interface_problems
from grader.submission.packages.setup_script import (
    NotRecognisedError,
    data_files_of_setup,
    keyword_of_setup,
)

_MOST_SCRIPTS = 200
_MOST_PACKAGES = 100
_MOST_PROBLEMS = 20
_LONGEST_LINE = 500


def find_packages(texts: dict[str, str], paths: list[str]) -> list[PackageFact]:
    """Find the packages by their `package.xml`, among all files' relative paths, of which some have texts."""
    packages = []
    for path in sorted(p for p in paths if PurePosixPath(p).name == "package.xml")[:_MOST_PACKAGES]:
        folder = str(PurePosixPath(path).parent).removeprefix(".")
        package = _read_manifest(folder, texts.get(path, ""))
        above = _inside(package.path, "")
        inside = [
            path.removeprefix(above) for path in paths if path.startswith(above)
        ]  # relative to its folder
        if package.build_type == "ament_python":
            _read_setup(package, texts, inside)
        else:
            _read_cmake(package, texts, inside)
        more = len(package.problems) - _MOST_PROBLEMS
        package.problems[_MOST_PROBLEMS:] = [f"and {more} more of the kind"] if more > 0 else []
        packages.append(package)
    return packages


def _read_manifest(folder: str, text: str) -> PackageFact:
    fallback = PurePosixPath(folder).name or "package"
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        return PackageFact(
            fallback,
            folder,
            "ament_python",
            problems=["package.xml declares entities; it is not read"],
        )
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as problem:
        return PackageFact(
            fallback, folder, "ament_python", problems=[f"package.xml is not valid XML: {problem}"]
        )
    name = (root.findtext("name") or "").strip()
    build_type = (root.findtext("export/build_type") or "ament_cmake").strip()
    package = PackageFact(name or fallback, folder, build_type)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,99}", name):
        package.name = fallback
        package.problems.append("package.xml names no valid package name")
    return package


def _inside(folder: str, name: str) -> str:
    return f"{folder}/{name}" if folder else name


def _read_setup(package: PackageFact, texts: dict[str, str], inside: list[str]) -> None:
    scripts: list[str] = []
    setup_text = texts.get(_inside(package.path, "setup.py"))
    config_text = texts.get(_inside(package.path, "setup.cfg"))
    if setup_text is None and config_text is None:
        package.problems.append("there is no setup.py beside package.xml, so nothing is installed")
        return
    if setup_text is not None:
        declared = _console_scripts(setup_text, package, inside)
        if declared is None:
            _take_all(package, "setup.py declares its entry points", inside)
        scripts += declared or []
    if config_text is not None:
        scripts += _scripts_of_config(config_text)
    _add_scripts(package, scripts)
    if not package.executables and not package.problems:
        package.problems.append(
            "setup.py declares no console_scripts, so `ros2 run` finds no executable"
        )
    is_broken = any("cannot be read" in problem for problem in package.problems)
    if setup_text is not None and not is_broken and "options.data_files" not in (config_text or ""):
        _note_shared(package, "setup.py", data_files_of_setup(setup_text, inside), inside)


def _add_scripts(package: PackageFact, scripts: list[str]) -> None:
    if len(scripts) > _MOST_SCRIPTS:
        package.problems.append(
            f"there are {len(scripts)} entry points; only the first {_MOST_SCRIPTS} are installed"
        )
    for script in scripts[:_MOST_SCRIPTS]:
        match = re.fullmatch(r"\s*([^=\s]+)\s*=\s*([\w.]+)\s*:\s*([\w.]+)\s*", script)
        if match and match[1] not in (".", ".."):
            package.executables[match[1]] = f"{match[2]}:{match[3]}"
        else:
            package.problems.append(
                f"the entry point {script!r} is not of the form 'name = module:function'"
            )


def _note_shared(
    package: PackageFact, name: str, installed: dict[str, str] | None, inside: list[str]
) -> None:
    """Note what a file of a name installs below the prefix, and launch files that it does not."""
    by_cmake = package.build_type != "ament_python"
    if installed is None:
        package.problems.append(
            f"{name} installs files in a way that the grader does not follow; it takes every launch and data file for "
            "installed"
        )
        return
    there = set(inside)
    package.shared = {
        target: _inside(package.path, file) for target, file in installed.items() if file in there
    }
    gone = sorted(
        file for file in installed.values() if file not in there and "resource/" not in file
    )
    package.problems += [f"{name} installs {file}, which is not there" for file in gone[:3]]
    for file in (f for f in inside if is_launch_file(f) and f not in installed.values()):
        folder = str(PurePosixPath(file).parent).removeprefix(".")
        entry = f"('share/{package.name}/{folder or 'launch'}', ['{file}'])"
        line = (
            f"install(DIRECTORY {folder or '.'} DESTINATION share/${{PROJECT_NAME}})"
            if by_cmake
            else entry
        )
        package.problems.append(
            f"{name} does not install {file}, so `ros2 launch {package.name} {PurePosixPath(file).name}` "
            f"does not find it; add {line}" + ("" if by_cmake else " to data_files")
        )


def is_launch_file(path: str) -> bool:
    """Whether a file's name is one that `ros2 launch` completes."""
    return re.search(r"[._-]launch\.(py|xml|ya?ml)$", path) is not None


def _console_scripts(text: str, package: PackageFact, inside: list[str]) -> list[str] | None:
    """Return what a setup.py declares as console scripts; None if it is written in a way that is not followed."""
    try:
        return _scripts_of(keyword_of_setup(text, "entry_points", inside))
    except NotRecognisedError:
        return None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as problem:
        package.problems.append(f"setup.py cannot be read: {problem}")
        return []


def _scripts_of(points: object) -> list[str]:
    if isinstance(points, dict):
        scripts = points.get("console_scripts", [])
        if isinstance(scripts, list):
            return [s for s in scripts if isinstance(s, str)]
    if not isinstance(points, str):
        return []
    parser = _sections_of(points)  # a section a group, a line a script
    written = parser.items("console_scripts") if parser.has_section("console_scripts") else []
    return [f"{name} = {target}" for name, target in written]


def _scripts_of_config(text: str) -> list[str]:
    lines = _sections_of(text).get("options.entry_points", "console_scripts", fallback="")
    return [line for line in lines.splitlines() if line.strip()]


def _sections_of(text: str) -> configparser.ConfigParser:
    """Read a text of sections; one that is none has no section."""
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    parser.optionxform = str  # type: ignore[method-assign,assignment]
    try:
        # It takes time by the square of the blanks in a line.
        parser.read_string("\n".join(line[:_LONGEST_LINE] for line in text.splitlines()))
    except configparser.Error:
        parser.clear()
    return parser


def _read_cmake(package: PackageFact, texts: dict[str, str], inside: list[str]) -> None:
    text = texts.get(_inside(package.path, "CMakeLists.txt"))
    if text is None:
        package.problems.append(
            "there is no CMakeLists.txt beside package.xml, so nothing is installed"
        )
        return
    of_python = (
        words
        for name, words in commands_of(text, package.name)
        if name == "ament_python_install_package"
    )
    if any("SCRIPTS_DESTINATION" in words for words in of_python):
        _add_scripts(package, _scripts_of_config(texts.get(_inside(package.path, "setup.cfg"), "")))
    installs = list(installs_of(text, package.name, inside))
    if any(files is None for is_programs, files in installs if is_programs):
        _take_all(package, "CMakeLists.txt installs programs", inside)
    for target, file in (
        (t, f) for is_programs, files in installs if is_programs for t, f in (files or {}).items()
    ):
        if file in inside:
            package.executables[PurePosixPath(target).name] = _inside(package.path, file)
        else:
            package.problems.append(f"CMakeLists.txt installs {file}, which is not there")
    package.problems += interface_problems(package, texts)
    others = [files for is_programs, files in installs if not is_programs]
    known = {target: file for files in others for target, file in (files or {}).items()}
    _note_shared(package, "CMakeLists.txt", None if None in others else known, inside)


def _take_all(package: PackageFact, what: str, inside: list[str]) -> None:
    """Take each Python file for an executable where nobody can say which are, and note it."""
    package.problems.append(
        f"{what} in a way that the grader does not follow; it takes every Python file for one"
    )
    files = [
        PurePosixPath(path) for path in inside if path.endswith(".py") and not is_launch_file(path)
    ]
    for path in [file for file in files if file.name not in ("setup.py", "__init__.py")][
        :_MOST_SCRIPTS
    ]:
        package.executables.setdefault(path.name, _inside(package.path, str(path)))
        package.executables.setdefault(path.stem, _inside(package.path, str(path)))

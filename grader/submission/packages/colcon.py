"""ROS packages in a submission: executables that their build files declare, by parsing alone.

A build tells more; these facts choose the artifacts before it, and stand for it on machines that cannot build.
"""

from __future__ import annotations

import configparser
import re
from pathlib import PurePosixPath
from xml.etree import ElementTree

from grader.recording.submission import PackageFact
from grader.submission.packages.cmake_script import commands_of, programs_of
from grader.submission.packages.interfaces import interface_problems
from grader.submission.packages.setup_script import NotRecognisedError, keyword_of_setup

_MOST_SCRIPTS = 200
_MOST_PACKAGES = 100
_MOST_PROBLEMS = 20
_LONGEST_LINE = 500


def find_packages(texts: dict[str, str], paths: list[str]) -> list[PackageFact]:
    """Find the packages by their `package.xml`.

    Parameters
    ----------
    texts
        Texts of files, by their paths.
    paths
        Relative paths of all files.
    """
    manifests = [path for path in paths if PurePosixPath(path).name == "package.xml"]
    packages = []
    for path in sorted(manifests)[:_MOST_PACKAGES]:
        folder = str(PurePosixPath(path).parent).removeprefix(".")
        package = _read_manifest(folder, texts.get(path, ""))
        above = _inside(package.path, "")
        inside = []
        for file in paths:
            if file.startswith(above):
                inside.append(file.removeprefix(above))
        if package.build_type == "ament_python":
            _read_setup(package, texts, inside)
        else:
            _read_cmake(package, texts, inside)
        package.problems = bounded(package.problems)
        packages.append(package)
    return packages


def bounded(problems: list[str]) -> list[str]:
    """Return the first of a package's problems, and the number of further ones."""
    more = len(problems) - _MOST_PROBLEMS
    if more <= 0:
        return problems
    return [*problems[:_MOST_PROBLEMS], f"and {more} more of the kind"]


def _read_manifest(folder: str, text: str) -> PackageFact:
    fallback = PurePosixPath(folder).name or "package"
    unread = PackageFact(fallback, folder, "ament_python")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        unread.problems.append("package.xml declares entities; it is not read")
        return unread
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as problem:
        unread.problems.append(f"package.xml is not valid XML: {problem}")
        return unread
    name = (root.findtext("name") or "").strip()
    build_type = (root.findtext("export/build_type") or "ament_cmake").strip()
    package = PackageFact(name or fallback, folder, build_type)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,99}", name):
        package.name = fallback
        package.problems.append("package.xml names no valid package name")
    return package


def _inside(folder: str, name: str) -> str:
    return f"{folder}/{name}".lstrip("/")


def _read_setup(package: PackageFact, texts: dict[str, str], inside: list[str]) -> None:
    setup_text = texts.get(_inside(package.path, "setup.py"))
    config_text = texts.get(_inside(package.path, "setup.cfg"))
    if setup_text is None and config_text is None:
        package.problems.append("there is no setup.py beside package.xml, so nothing is installed")
        return
    scripts: list[str] = []
    if setup_text is not None:
        declared = _console_scripts(setup_text, package)
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


def is_launch_file(path: str) -> bool:
    """Return whether `ros2 launch` completes a file's name."""
    return re.search(r"[._-]launch\.(py|xml|ya?ml)$", path) is not None


def _console_scripts(text: str, package: PackageFact) -> list[str] | None:
    """Return the console scripts that a setup.py declares; None if they are not recognised."""
    try:
        return _scripts_of(keyword_of_setup(text, "entry_points"))
    except NotRecognisedError:
        return None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as problem:
        package.problems.append(f"setup.py cannot be read: {problem}")
        return []


def _scripts_of(points: object) -> list[str]:
    """Return the console scripts of entry points, given as a dictionary or as a text with a section for each group."""
    if isinstance(points, dict):
        scripts = points.get("console_scripts", [])
        if isinstance(scripts, list):
            return [script for script in scripts if isinstance(script, str)]
    if not isinstance(points, str):
        return []
    parser = sections_of(points)
    if not parser.has_section("console_scripts"):
        return []
    return [f"{name} = {target}" for name, target in parser.items("console_scripts")]


def _scripts_of_config(text: str) -> list[str]:
    lines = sections_of(text).get("options.entry_points", "console_scripts", fallback="")
    return list(filter(str.strip, lines.splitlines()))


def sections_of(text: str) -> configparser.ConfigParser:
    """Read a text with sections; another text has none."""
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    parser.optionxform = str  # type: ignore[method-assign,assignment]
    # The parser's time grows with the square of the blanks in a line.
    lines = []
    for line in text.splitlines():
        lines.append(line[:_LONGEST_LINE])
    try:
        parser.read_string("\n".join(lines))
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
    if _installs_scripts(text, package):
        config = texts.get(_inside(package.path, "setup.cfg"), "")
        _add_scripts(package, _scripts_of_config(config))
    is_known = True
    for files in programs_of(text, package.name, inside):
        if files is None:
            is_known = False
            continue
        for target, file in files.items():
            if file in inside:
                package.executables[PurePosixPath(target).name] = _inside(package.path, file)
            else:
                package.problems.append(f"CMakeLists.txt installs {file}, which is not there")
    if not is_known:
        _take_all(package, "CMakeLists.txt installs programs", inside)
    package.problems += interface_problems(package, texts)


def _installs_scripts(text: str, package: PackageFact) -> bool:
    """Return whether a CMakeLists.txt installs the scripts of a setup.cfg."""
    for name, words in commands_of(text, package.name):
        if name == "ament_python_install_package" and "SCRIPTS_DESTINATION" in words:
            return True
    return False


def _take_all(package: PackageFact, what: str, inside: list[str]) -> None:
    """Take each Python file for an executable, because the executables are not recognised, and note it."""
    package.problems.append(
        f"{what} in a way that the grader does not follow; it takes every Python file for one"
    )
    files = []
    for name in inside:
        path = PurePosixPath(name)
        is_program = name.endswith(".py") and not is_launch_file(name)
        if is_program and path.name not in ("setup.py", "__init__.py"):
            files.append(path)
    for path in files[:_MOST_SCRIPTS]:
        package.executables.setdefault(path.name, _inside(package.path, str(path)))
        package.executables.setdefault(path.stem, _inside(package.path, str(path)))

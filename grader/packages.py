"""ROS packages in a submission: what `colcon build` would install, read by parsing alone.

`package.xml` gives name and build type; `setup.py` is read as a syntax tree (never executed) for its
console scripts; `CMakeLists.txt` for installed programs.
"""

from __future__ import annotations

import ast
import configparser
import re
from pathlib import PurePosixPath
from xml.etree import ElementTree

from grader.data_files import data_files_of_cmake, data_files_of_setup
from grader.recording.submission import PackageFact

#: Constants of a setup.py that double each other would otherwise grow beyond all bounds.
_LONGEST_VALUE = 100_000
_MOST_SCRIPTS = 200
_MOST_PACKAGES = 100


def find_packages(texts: dict[str, str], paths: list[str]) -> list[PackageFact]:
    """Find the packages by their `package.xml`.

    Parameters
    ----------
    texts : dict
        Relative path -> text.
    paths : list of str
        All files' relative paths.
    """
    packages = []
    for path in sorted(p for p in paths if PurePosixPath(p).name == "package.xml")[:_MOST_PACKAGES]:
        folder = str(PurePosixPath(path).parent).removeprefix(".")
        package = _read_manifest(folder, texts.get(path, ""))
        if package.build_type == "ament_python":
            _read_setup(package, texts)
        else:
            _read_cmake(package, texts, paths)
        _read_data_files(package, texts, paths)
        packages.append(package)
    return packages


def _read_manifest(folder: str, text: str) -> PackageFact:
    fallback = PurePosixPath(folder).name or "package"
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        return PackageFact(fallback, folder, "ament_python", problems=["package.xml declares entities; it is not read"])
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as problem:
        return PackageFact(fallback, folder, "ament_python", problems=[f"package.xml is not valid XML: {problem}"])
    name = (root.findtext("name") or "").strip()
    build_type = (root.findtext("export/build_type") or "ament_cmake").strip()
    package = PackageFact(name or fallback, folder, build_type)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,99}", name):
        package.name = fallback
        package.problems.append("package.xml names no valid package name")
    return package


def _inside(folder: str, name: str) -> str:
    return f"{folder}/{name}" if folder else name


def _read_setup(package: PackageFact, texts: dict[str, str]) -> None:
    scripts: list[str] = []
    setup_text = texts.get(_inside(package.path, "setup.py"))
    config_text = texts.get(_inside(package.path, "setup.cfg"))
    if setup_text is None and config_text is None:
        package.problems.append("there is no setup.py beside package.xml, so nothing is installed")
        return
    if setup_text is not None:
        scripts += _console_scripts(setup_text, package)
    if config_text is not None:
        scripts += _console_scripts_of_config(config_text)
    if len(scripts) > _MOST_SCRIPTS:
        package.problems.append(f"there are {len(scripts)} entry points; only the first {_MOST_SCRIPTS} are installed")
    for script in scripts[:_MOST_SCRIPTS]:
        match = re.fullmatch(r"\s*([^=\s]+)\s*=\s*([\w.]+)\s*:\s*([\w.]+)\s*", script)
        if match and match[1] not in (".", ".."):
            package.executables[match[1]] = f"{match[2]}:{match[3]}"
        else:
            package.problems.append(f"the entry point {script!r} is not of the form 'name = module:function'")
    if not package.executables and not package.problems:
        package.problems.append("setup.py declares no console_scripts, so `ros2 run` finds no executable")


def _read_data_files(package: PackageFact, texts: dict[str, str], paths: list[str]) -> None:
    """Note what goes into the share folder, and launch files that do not."""
    above = f"{package.path}/" if package.path else ""
    inside = [path.removeprefix(above) for path in paths if path.startswith(above)]
    by_cmake = package.build_type != "ament_python"
    name = "CMakeLists.txt" if by_cmake else "setup.py"
    text = texts.get(above + name)
    if text is None or (not by_cmake and "options.data_files" in texts.get(f"{above}setup.cfg", "")):
        return
    found = data_files_of_cmake(text, package.name, inside) if by_cmake else data_files_of_setup(text, inside)
    if found is None and any("cannot be read" in problem for problem in package.problems):
        return  # said already
    if found is None:
        where = "CMakeLists.txt installs files" if by_cmake else "setup.py writes data_files"
        package.problems.append(
            f"{where} in a way that the grader does not follow; it takes every launch and data file for installed"
        )
        return
    package.shared = {target: above + file for target, file in found.items() if file in inside}
    gone = sorted(file for file in found.values() if file not in inside and "resource/" not in file)
    package.problems += [f"{name} installs {file}, which is not there" for file in gone[:3]]
    for file in (f for f in inside if is_launch_file(f) and above + f not in package.shared.values()):
        folder = str(PurePosixPath(file).parent).removeprefix(".")
        entry = f"('share/{package.name}/{folder or 'launch'}', ['{file}'])"
        line = f"install(DIRECTORY {folder or '.'} DESTINATION share/${{PROJECT_NAME}})" if by_cmake else entry
        package.problems.append(
            f"{name} does not install {file}, so `ros2 launch {package.name} {PurePosixPath(file).name}` "
            f"does not find it; add {line}" + ("" if by_cmake else " to data_files")
        )


def is_launch_file(path: str) -> bool:
    """Whether a file's name is one that `ros2 launch` completes."""
    return re.search(r"[._-]launch\.(py|xml|ya?ml)$", path) is not None


def _console_scripts(text: str, package: PackageFact) -> list[str]:
    try:
        tree = ast.parse(text)
        constants = _constants(tree)
        for call in (n for n in ast.walk(tree) if isinstance(n, ast.Call)):
            for keyword in call.keywords:
                if keyword.arg == "entry_points":
                    return _scripts_of(_value(keyword.value, constants))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as problem:
        package.problems.append(f"setup.py cannot be read: {problem}")
    return []


def _scripts_of(points: object) -> list[str]:
    if isinstance(points, dict):
        scripts = points.get("console_scripts", [])
        if isinstance(scripts, (list, tuple)):
            return [s for s in scripts if isinstance(s, str)]
    return _scripts_of_text(points) if isinstance(points, str) else []


def _scripts_of_text(points: str) -> list[str]:
    """Read entry points written as text: a section a group, a line a script."""
    parser = configparser.ConfigParser(interpolation=None, strict=False, delimiters=("=",))
    parser.optionxform = str  # type: ignore[method-assign,assignment]
    try:
        parser.read_string(points)
    except configparser.Error:
        return []
    if not parser.has_section("console_scripts"):
        return []
    return [f"{name} = {target}" for name, target in parser.items("console_scripts")]


def _console_scripts_of_config(text: str) -> list[str]:
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        parser.read_string(text)
    except configparser.Error:
        return []
    lines = parser.get("options.entry_points", "console_scripts", fallback="")
    return [line for line in lines.splitlines() if line.strip()]


def _constants(tree: ast.Module) -> dict[str, object]:
    constants: dict[str, object] = {}
    for node in tree.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            constants[node.targets[0].id] = _value(node.value, constants)
    return constants


def _value(node: ast.expr, constants: dict[str, object]) -> object:
    """Evaluate literals, names of constants, f-strings, `+` and `%`; anything else is None."""
    if isinstance(node, ast.Constant):
        return node.value
    if isinstance(node, ast.Name):
        return constants.get(node.id)
    if isinstance(node, (ast.List, ast.Tuple)):
        return [_value(item, constants) for item in node.elts]
    if isinstance(node, ast.Dict):
        return {
            _value(k, constants): _value(v, constants)
            for k, v in zip(node.keys, node.values, strict=True)
            if isinstance(k, ast.Constant)
        }
    if isinstance(node, ast.JoinedStr):
        parts = [_text(v.value if isinstance(v, ast.FormattedValue) else v, constants) for v in node.values]
        return "".join(parts) if sum(map(len, parts)) <= _LONGEST_VALUE else None
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = _value(node.left, constants), _value(node.right, constants)
        if isinstance(left, str) and isinstance(right, str):
            return left + right if len(left) + len(right) <= _LONGEST_VALUE else None
        if isinstance(left, list) and isinstance(right, list):
            return left + right if len(left) + len(right) <= _LONGEST_VALUE else None
    return None


def _text(node: ast.expr, constants: dict[str, object]) -> str:
    value = _value(node, constants)
    return value if isinstance(value, str) else ""


def _read_cmake(package: PackageFact, texts: dict[str, str], paths: list[str]) -> None:
    text = texts.get(_inside(package.path, "CMakeLists.txt"))
    if text is None:
        package.problems.append("there is no CMakeLists.txt beside package.xml, so nothing is installed")
        return
    text = re.sub(r"#[^\n]*", "", text)
    for block in re.findall(r"install\s*\(\s*PROGRAMS\b([^()]{0,10000})\)", text):
        names = re.split(r"\bDESTINATION\b", block)[0].split()
        for name in names:
            relative = _inside(package.path, name.strip('"').replace("${PROJECT_NAME}", package.name))
            if relative in paths:
                package.executables[PurePosixPath(relative).name] = relative
            else:
                package.problems.append(f"CMakeLists.txt installs {name}, which is not there")

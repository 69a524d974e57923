"""Faults of a ROS package that was built: executables that ROS does not find or cannot start, by the installed files."""

from __future__ import annotations

import ast
import difflib
import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import PurePosixPath

from grader.evidence.build_faults import BuildFault, line_with, within
from grader.evidence.manifest_faults import manifest_problem
from grader.recording.submission import BuildFact, PackageFact
from grader.submission.packages.setup_script import NotRecognisedError, keyword_of_setup
from grader.submission.python_source import parse_python

_MARKER = "share/ament_index/resource_index/packages"
#: Length of a list of installed files that may be cut.
_MOST_LISTED = 1000
#: Folders with programs.
_PROGRAMS = re.compile(r"bin|lib/(?!python)[A-Za-z][\w-]*")
#: Build types with a hook that shows ROS the package.
_SHOWN = ("ament_python", "ament_cmake")


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
        is_own = folder == f"lib/{build.package}"
        if _PROGRAMS.fullmatch(folder) and not is_own:
            found[name] = folder
    return found


def use_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str]
) -> BuildFault | None:
    """Return the fault of a built package that `ros2 run` and `ros2 launch` do not find, or with lost executables."""
    for look in (_unseen_fault, _name_fault, _placement_fault):
        fault = look(package, build, texts)
        if fault is not None:
            return fault
    return None


def _unseen_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str]
) -> BuildFault | None:
    """Return the fault of a package without the hook that puts its prefix into AMENT_PREFIX_PATH.

    colcon builds a package with a package.xml that it cannot read as a package of plain Python, without a word.
    """
    if package.build_type not in _SHOWN:
        return None
    if _is_cut(build):
        return None
    share = f"share/{package.name}"
    for folder in ("hook", "environment"):
        if f"{share}/{folder}/ament_prefix_path.dsv" in build.installed:
            return None
    lost = (
        f"`ros2 run` and `ros2 launch` do not find the package {package.name}, although it is built"
    )
    manifest = within(package, "package.xml")
    problem = None
    if manifest in texts:
        problem = manifest_problem(texts[manifest])
    if problem is not None:
        message = f"{lost}: colcon does not read its package.xml, because {problem.words}."
        return BuildFault(message, problem.remedy, manifest, problem.line)
    script = within(package, "CMakeLists.txt")
    if script in texts and "ament_package" not in texts[script]:
        message = f"{lost}: CMakeLists.txt does not call ament_package()."
        return BuildFault(message, "Write ament_package() as its last line.", script)
    return None


def _is_cut(build: BuildFact) -> bool:
    """Return whether a build installed more files than are listed."""
    return len(build.installed) >= _MOST_LISTED


def _name_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str]
) -> BuildFault | None:
    """Return the fault of a setup.py with another name than package.xml; the files are installed under the former."""
    script = within(package, "setup.py")
    text = texts.get(script, "")
    name = _keyword(text, "name")
    own = f"lib/{package.name}/"
    is_used = any(path.startswith((f"lib/{name}/", f"share/{name}/")) for path in build.installed)
    is_other = name not in ("", package.name)
    if any(path.startswith(own) for path in build.installed):
        return None
    if not (is_other and is_used):
        return None
    message = f"setup.py installs the files of a package {name}, while package.xml names it {package.name}."
    remedy = f"Write the same name in both, and in setup.cfg and the folder resource: {package.name}, or {name}."
    return BuildFault(message, remedy, script, line_with(text, f"'{name}'", f'"{name}"'))


def _keyword(text: str, name: str) -> str:
    """Return a keyword of `setup()` with a text; empty if it is not recognised."""
    try:
        value = keyword_of_setup(text, name)
    except (NotRecognisedError, SyntaxError, ValueError, RecursionError, MemoryError):
        return ""
    if isinstance(value, str):
        return value
    return ""


def _placement_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str]
) -> BuildFault | None:
    """Return the fault of executables in another folder than `ros2 run` and `ros2 launch` search."""
    misplaced = misplaced_executables(build)
    found = executables_in(build)
    lost = [name for name in misplaced if name not in found]
    if not lost:
        return None
    folder = misplaced[lost[0]]
    wanted = f"lib/{package.name}"
    seen = f"The package {package.name} installs {', '.join(sorted(lost))} in {folder}"
    message = f"{seen}, while `ros2 run` and `ros2 launch` search {wanted}"
    place = within(package, "CMakeLists.txt")
    if package.build_type != "ament_python" and place in texts:
        line = line_with(texts[place], f"install(TARGETS {lost[0]}", "install(TARGETS", "install(")
        remedy = (
            f"Write install(TARGETS {' '.join(sorted(lost))} DESTINATION lib/${{PROJECT_NAME}})."
        )
        return BuildFault(f"{message}.", remedy, place, line)
    remedy = (
        f"Write four lines in setup.cfg: `[develop]`, `script_dir=$base/{wanted}`, `[install]`, "
        f"`install_scripts=$base/{wanted}`."
    )
    place = within(package, "setup.cfg")
    cause = "setup.cfg names another folder"
    if place not in texts:
        place = within(package, "setup.py")
        cause = "there is no setup.cfg"
    line = line_with(texts.get(place, ""), folder)
    return BuildFault(f"{message}: {cause}.", remedy, place, line)


# -- entry points ------------------------------------------------------------------------------------


def entry_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str]
) -> BuildFault | None:
    """Return the fault of the first executable that ends at once, because its entry point leads nowhere."""
    script = within(package, "setup.py")
    text = texts.get(script, "")
    for problem in package.problems:
        if "entry point" in problem:
            remedy = "Write entry points as 'name = package.module:function'."
            entry = problem.partition("'")[2].partition("'")[0]
            return BuildFault(f"{_capitalised(problem)}.", remedy, script, line_with(text, entry))
    if _is_cut(build):
        return None
    if package.build_type != "ament_python":
        return None
    modules = _installed_modules(build)
    for name, target in package.executables.items():
        module, _, function = target.partition(":")
        if not function:
            continue
        fault = _module_fault(package, texts, module, modules)
        if fault is None:
            fault = _function_fault(package, texts, module, function)
        if fault is not None:
            problem, remedy = fault
            message = (
                f"The executable {name} of the package {package.name} starts {target}, {problem}."
            )
            return BuildFault(message, remedy, script, line_with(text, target, module))
    return None


def _capitalised(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


_MODULE = re.compile(r"lib/python[^/]+/site-packages/(.+?)(?:/__init__)?\.(?:py|.*\.so)")


def _installed_modules(build: BuildFact) -> set[str]:
    """Return the dotted names of the installed modules."""
    found = set()
    for path in build.installed:
        match = _MODULE.fullmatch(path)
        if match is not None:
            found.add(match[1].replace("/", "."))
    return found


def _module_fault(
    package: PackageFact, texts: Mapping[str, str], module: str, modules: Collection[str]
) -> tuple[str, str] | None:
    """Return problem and remedy of an entry point to a module that is not installed; None if it is."""
    if module in modules:
        return None
    problem = f"and there is no module {module} among the installed files"
    folder, _, _ = module.rpartition(".")
    path = module.replace(".", "/")
    is_here = within(package, f"{path}.py") in texts
    beside = f"{folder.replace('.', '/')}/__init__.py"
    is_marked = not folder or within(package, beside) in texts
    if is_here and not is_marked:
        return problem, f"Add an empty file {beside}: find_packages takes no folder without it."
    if is_here:
        return problem, f"Name the package {folder or module} in `packages` of setup.py."
    near = difflib.get_close_matches(module, sorted(modules), n=1)
    if near:
        return problem, f"Write {near[0]}, or add the file {path}.py."
    return problem, f"Add the file {path}.py, or name the module that has the function."


def _function_fault(
    package: PackageFact, texts: Mapping[str, str], module: str, function: str
) -> tuple[str, str] | None:
    """Return problem and remedy of an entry point to a function that its module surely lacks; None if it may have it."""
    path = f"{module.replace('.', '/')}.py"
    try:
        tree = parse_python(texts[within(package, path)])
    except (KeyError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    names = _names_in(tree)
    first, _, _ = function.partition(".")
    if not names.isdisjoint(("*", "__getattr__", first)):
        return None
    functions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    functions.sort(key=lambda name: name != "main")
    problem = f"and {path} has no function {function}"
    if functions:
        return problem, f"Write {module}:{functions[0]}, or rename the function to {function}."
    return problem, f"Write a function {function}() in {path}, which starts the node."


def _names_in(tree: ast.Module) -> set[str]:
    """Return the names that a module may bind: all that it writes, defines or imports anywhere."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.alias):
            found.add((node.asname or node.name).partition(".")[0])
        elif isinstance(node, ast.Name):
            found.add(node.id)
    return found


# -- programs that Linux cannot start ------------------------------------------------------------------


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
    file = broken[concerned[0]]
    message = f"Linux cannot start {', '.join(concerned)} of the package {package.name}"
    if texts.get(file, "").startswith("#!"):
        cause = "its lines end as on Windows, so that the `#!` line names no program"
        remedy = (
            f"Save the file with the line ends of Linux: `dos2unix {PurePosixPath(file).name}`."
        )
        return BuildFault(f"{message}: {cause}.", remedy, file, 1)
    remedy = "Begin the file with `#!/usr/bin/env python3`."
    return BuildFault(f"{message} (Exec format error): there is no `#!` line.", remedy, file, 1)


def has_own_marker(build: BuildFact) -> bool:
    """Return whether the build files install the marker of the package; colcon-ros adds a missing one for now."""
    is_added = "doesn't explicitly install a marker" in build.output
    return f"{_MARKER}/{build.package}" in build.installed and not is_added

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
        if path in build.not_executable:
            continue
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
    for look in (_unseen_fault, _name_fault, _placement_fault, _mode_fault):
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
    why = _why_unseen(package, texts)
    if why is None:
        return None
    message, remedy, file, line = why
    lost = (
        f"`ros2 run` and `ros2 launch` do not find the package {package.name}, although it is built"
    )
    return BuildFault(f"{lost}: {message}.", remedy, file, line)


def _why_unseen(
    package: PackageFact, texts: Mapping[str, str]
) -> tuple[str, str, str, int | None] | None:
    """Return reason, remedy, file and line of a package that was built without the hook; None without its files."""
    manifest = within(package, "package.xml")
    problem = manifest_problem(texts.get(manifest, ""))
    if manifest in texts and problem is not None:
        reason = f"colcon does not read its package.xml, because {problem.words}"
        return reason, problem.remedy, manifest, problem.line
    script = within(package, "CMakeLists.txt")
    if script in texts and "ament_package" not in texts[script]:
        reason = "CMakeLists.txt does not call ament_package()"
        return reason, "Write ament_package() as its last line.", script, None
    if manifest not in texts:
        return None
    remedy = f"Compare it with one that `ros2 pkg create --build-type {package.build_type}` makes."
    return "colcon does not read its package.xml", remedy, manifest, None


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
    if not re.search("install[_-]scripts", texts.get(place, "")):
        cause = "setup.cfg has no install_scripts"
    if place not in texts:
        place = within(package, "setup.py")
        cause = "there is no setup.cfg"
    line = line_with(texts.get(place, ""), folder)
    return BuildFault(f"{message}: {cause}.", remedy, place, line)


def _mode_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str]
) -> BuildFault | None:
    """Return the fault of scripts that CMake installs without the right to execute them; modules need no such right."""
    names = []
    for path in sorted(build.not_executable):
        script = PurePosixPath(path)
        if not _is_imported(script.stem, texts):
            names.append(script.name)
    if not names:
        return None
    place = within(package, "CMakeLists.txt")
    line = line_with(texts.get(place, ""), names[0], "install(FILES", "install(DIRECTORY")
    message = (
        f"The package {package.name} installs {', '.join(names)} as files that are not executable, "
    )
    message += "so that `ros2 run` and `ros2 launch` find no such program."
    remedy = "Write install(PROGRAMS ... DESTINATION lib/${PROJECT_NAME}) for scripts instead of FILES or DIRECTORY."
    return BuildFault(message, remedy, place, line)


def _is_imported(module: str, texts: Mapping[str, str]) -> bool:
    """Return whether a text imports a module by its name alone."""
    pattern = rf"^[ \t]*(?:from|import)[ \t]+\.?{re.escape(module)}\b"
    imports = re.compile(pattern, re.MULTILINE)
    for text in texts.values():
        if imports.search(text):
            return True
    return False


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
    misspelt = _group_fault(package, script, text)
    if misspelt is not None:
        return misspelt
    for name in package.executables:
        fault = executable_fault(package, build, texts, name)
        if fault is not None:
            return fault
    return None


def executable_fault(
    package: PackageFact, build: BuildFact, texts: Mapping[str, str], name: str
) -> BuildFault | None:
    """Return the fault of an executable with an entry point that leads nowhere; None for another executable."""
    target = package.executables.get(name, "")
    module, _, function = target.partition(":")
    if not function or _is_cut(build):
        return None
    found = _module_fault(package, texts, module, _installed_modules(build))
    if found is None:
        source = within(package, f"{module.replace('.', '/')}.py")
        found = call_fault(texts.get(source), module, function)
    if found is None:
        return None
    problem, remedy = found
    message = f"The executable {name} of the package {package.name} starts {target}, {problem}."
    script = within(package, "setup.py")
    line = line_with(texts.get(script, ""), target, module)
    return BuildFault(message, remedy, script, line)


#: Group of the entry points that become executables.
_GROUP = "console_scripts"


def _group_fault(package: PackageFact, script: str, text: str) -> BuildFault | None:
    """Return the fault of a setup.py with executables in a misspelt group, or with two groups of one name."""
    groups = _groups_in(text)
    lost = f"has no effect, so that executables of the package {package.name} are missing"
    if groups.count(_GROUP) > 1:
        message = f"setup.py names {_GROUP} twice; the first list {lost}."
        remedy = f"Write all executables into one list {_GROUP}."
        return BuildFault(message, remedy, script, line_with(text, _GROUP))
    near = difflib.get_close_matches(_GROUP, groups, n=1)
    if not near or _GROUP in groups:
        return None
    message = f"setup.py names {near[0]} instead of {_GROUP}; the list {lost}."
    return BuildFault(message, f"Write {_GROUP}.", script, line_with(text, near[0]))


def _groups_in(text: str) -> list[str]:
    """Return the keys of the dictionary that a setup.py gives for its entry points."""
    found: list[str] = []
    try:
        tree = parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return found
    for node in ast.walk(tree):
        match node:
            case ast.keyword(arg="entry_points", value=ast.Dict(keys=keys)):
                names = [key.value for key in keys if isinstance(key, ast.Constant)]
                found += map(str, names)
    return found


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
    if is_here and not folder:
        name = package.name
        return problem, f"Move {path}.py into the folder {name}, and write {name}.{module}."
    if is_here and not is_marked:
        return problem, f"Add an empty file {beside}: find_packages takes no folder without it."
    if is_here:
        return problem, f"Name the package {folder} in `packages` of setup.py."
    near = difflib.get_close_matches(module, sorted(modules), n=1)
    if near:
        return problem, f"Write {near[0]}, or add the file {path}.py."
    return problem, f"Add the file {path}.py, or name the module that has the function."


def call_fault(text: str | None, module: str, function: str) -> tuple[str, str] | None:
    """Return problem and remedy of an entry point to a function that its module surely lacks; None if it may have it.

    Parameters
    ----------
    text
        Source of the module; None if it is unknown.
    """
    if text is None:
        return None
    try:
        tree = parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    path = f"{module.replace('.', '/')}.py"
    names = _names_in(tree)
    first, _, _ = function.partition(".")
    wanting = _arguments_of(tree, function)
    if wanting:
        problem = f"and {function} needs the argument {wanting[0]}, which no executable gives"
        return problem, f"Write def {function}({wanting[0]}=None) in {path}."
    if not names.isdisjoint(("*", "__getattr__", first)):
        return None
    functions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    functions.sort(key=lambda name: name != "main")
    problem = f"and {path} has no function {function}"
    if functions:
        return problem, f"Write {module}:{functions[0]}, or rename the function to {function}."
    return problem, f"Write a function {function}() in {path}, which starts the node."


def _arguments_of(tree: ast.Module, function: str) -> list[str]:
    """Return the arguments without a default of a plain function that a module defines once."""
    nodes = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name == function:
            nodes.append(node)
    if len(nodes) != 1 or nodes[0].decorator_list:
        return []
    given = nodes[0].args
    positional = [argument.arg for argument in (*given.posonlyargs, *given.args)]
    return positional[: len(positional) - len(given.defaults)]


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


_BEGIN = "Begin the file with `#!/usr/bin/env python3`."
#: First line with an `env` that no Linux has; the true one is /usr/bin/env, and /bin/env where both folders are one.
_OTHER_ENV = re.compile(r"#!\s*(?!(?:/usr)?/bin/)\S*/env\b")


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
    first, _, _ = texts.get(file, "").partition("\n")
    if _OTHER_ENV.match(first):
        message = f"{message}: there is no program {first.split()[0].removeprefix('#!')}."
        return BuildFault(message, _BEGIN, file, 1)
    if first.startswith("#!"):
        cause = "its lines end as on Windows, so that the `#!` line names no program"
        remedy = (
            f"Save the file with the line ends of Linux: `dos2unix {PurePosixPath(file).name}`."
        )
        return BuildFault(f"{message}: {cause}.", remedy, file, 1)
    message = f"{message} (Exec format error): there is no `#!` line."
    return BuildFault(message, _BEGIN, file, 1)


def has_own_marker(build: BuildFact) -> bool:
    """Return whether the build files install the marker of the package; colcon-ros adds a missing one for now."""
    is_added = "doesn't explicitly install a marker" in build.output
    return f"{_MARKER}/{build.package}" in build.installed and not is_added

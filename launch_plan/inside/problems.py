"""Problems of a launch file: message, place and remedy, in words for the author.

Exceptions of the stand-in carry their kind and their remedy. Exceptions of Python and of the real `launch` are
recognised here, by type and by message.
"""

from __future__ import annotations

import difflib
import itertools
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from launch_plan.inside.installed import missing_data_file, module_out_of_reach, own_packages
from launch_plan.jazzy import LATER, NAMES, RENAMED, SUBMODULES, homes_of, is_released

_PACKAGES = ("launch", "launch_ros", "launch_xml", "launch_yaml", "ament_index_python")
SUBSTITUTION_AS_TEXT = re.compile(
    r"<launch(_ros)?\.(substitutions|parameter_descriptions)[\w.]* object at 0x"
)

#: Programs of ROS or a simulator, which may be missing here.
_ROS_PROGRAMS = (
    "xacro",
    "ros2",
    "rviz2",
    "colcon",
    "gz",
    "ign",
    "gazebo",
    "gzserver",
    "gzclient",
    "check_urdf",
)
#: Kinds that are no fault of the launch file.
_NOT_HERE = ("unsupported", "missing_module", "missing_package", "missing_program")

#: Kind, message and remedy.
Described = tuple[str, str, str]


class LimitExceededError(RuntimeError):
    """Raised for a launch description without end."""

    launch_kind = "endless"
    launch_remedy = "Let the description come to an end."


class UnsupportedByStandin(ImportError):
    """Raised for a part of ROS that the stand-in does not evaluate, through no fault of the launch file."""

    launch_kind = "unsupported"
    launch_remedy = "No change is needed: the grader cannot evaluate this part."


def mistake(raised: type[BaseException], message: str, kind: str, remedy: str) -> Any:
    """Return an exception that carries the kind of its problem and the remedy."""
    error = raised(message)
    error.__dict__.update(launch_kind=kind, launch_remedy=remedy)
    return error


def blame(error: BaseException, source: Any) -> None:
    """Note on an exception the object of the launch file that raised it; the first note stays."""
    line = getattr(source, "source_line", None)
    if line is not None and not hasattr(error, "launch_source"):
        error.__dict__.update(launch_source=line, launch_object=type(source).__name__)


@contextmanager
def blaming(source: Any) -> Iterator[None]:
    """Note on an exception in this block the object of the launch file that raised it."""
    try:
        yield
    except Exception as error:
        blame(error, source)
        raise


def shown(value: Any) -> str:
    """Return a value with its type for a message, e.g. "5 is of type 'int'"."""
    if value is None:
        return "None is given"
    written = "what is given"
    if isinstance(value, (str, int, float, list, tuple, dict, set)):
        text = repr(value)
        if " object at 0x" not in text:
            written = text[:120]
    return f"{written} is of type '{type(value).__name__}'"


def near(name: str, known: Iterable[Any]) -> str:
    """Return a question for the likeliest name, e.g. "Did you mean 'package'? ", or an empty text."""
    found = difflib.get_close_matches(name, [str(each) for each in known], n=1, cutoff=0.6)
    if not found:
        return ""
    return f"Did you mean '{found[0]}'? "


def no_action(given: Any, position: int, parent: Any) -> Any:
    """Return the error for an item of a list of actions that is not an action."""
    remedies = {
        type(None): "Take None out: a function that makes an action must return it.",
        tuple: "Take the comma away that stands behind the action, or write *(...) for several.",
        list: "Put the items of the list here, not the list: *[...].",
    }
    remedy = remedies.get(type(given), "Put only actions into this list.")
    if hasattr(given, "matches"):
        remedy = "Put the handler into RegisterEventHandler(...)."
    elif callable(given):
        remedy = "Call the function, or put it into OpaqueFunction(function=...)."
    message = f"item {position} of {type(parent).__name__} is no action: {shown(given)}"
    error = mistake(AttributeError, message, "not_an_action", remedy)
    blame(error, parent)
    return error


def relative(path: str, root: str) -> str:
    """Return a path relative to the submission, if it is in there."""
    if not root:
        return path
    try:
        return str(Path(path).absolute().relative_to(Path(root).absolute()))
    except ValueError:
        return path


def place_of(source: Any, root: str) -> tuple[str | None, int | None]:
    """Return file and line that constructed an object, the file relative to the submission; None if unknown."""
    place = getattr(source, "source_line", None)
    if place is None:
        return None, None
    file, line = place
    return relative(file, root), line


def problem_of(
    error: BaseException, root: str, file: str, configurations: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Return the outcome, `error` or `not_assessable`, and the problem of an exception of the evaluation."""
    # The real `launch` tries all formats, and raises this error with the cause of each.
    while type(error).__name__ == "InvalidLaunchFileError" and error.__cause__ is not None:
        error = error.__cause__
    where: str = file
    line: int | None = None
    try:
        kind, message, remedy = _describe(error, root, configurations)
        where, line = _location(error, root, file)
    except Exception as second:
        message = f"{type(error).__name__} (which could not be described: {type(second).__name__})"
        kind = "exception"
        remedy = "Correct the launch file."
    if SUBSTITUTION_AS_TEXT.search(message):
        remedy = "Use a list instead of str() or an f-string: ['text', LaunchConfiguration(...)]."
    problem = {
        "kind": kind,
        "message": message,
        "file": relative(where, root),
        "line": line,
        "remedy": _in_markup(remedy, where),
    }
    if kind not in _NOT_HERE:
        return "error", problem
    problem["module"] = getattr(error, "name", None) or ""
    return "not_assessable", problem


def _in_markup(remedy: str, file: str) -> str:
    """Return a remedy in the language of the file, e.g. with `<arg name="rate" default="..."/>` for XML."""
    if not file.endswith((".xml", ".yaml", ".yml")):
        return remedy
    eval_form = r"\1$(eval '\\'$(var name)\\' == \\'x\\'')"
    remedy = re.sub(r"(inside the expression: )\[.*\]", eval_form, remedy)
    argument_form = r"- arg: {name: \1, default: ...}"
    if file.endswith(".xml"):
        argument_form = r'<arg name="\1" default="..."/>'
    return re.sub(r"DeclareLaunchArgument\('([^']*)', \.\.\.\)", argument_form, remedy)


def _inside(path: str, root: str) -> bool:
    return not path.startswith("<") and Path(path).absolute().is_relative_to(Path(root).absolute())


def _location(error: BaseException, root: str, file: str) -> tuple[str, int | None]:
    """Return file and line of a syntax error, of the innermost frame in the submission, or of the noted object."""
    if isinstance(error, SyntaxError) and error.filename and _inside(error.filename, root):
        return error.filename, error.lineno
    noted = getattr(error, "launch_source", None)
    if noted and getattr(error, "launch_kind", "") == "wrong_return":
        return noted[0], noted[1]
    frames = [f for f in traceback.extract_tb(error.__traceback__) if _inside(f.filename, root)]
    if frames:
        return frames[-1].filename, frames[-1].lineno
    if noted and _inside(noted[0], root):
        return noted[0], noted[1]
    return getattr(error, "launch_file", file), getattr(error, "launch_line", None)


def _describe(error: BaseException, root: str, configurations: Mapping[str, Any]) -> Described:
    kind = getattr(error, "launch_kind", None)
    message = _message(error)
    if kind is not None:
        return kind, message, error.launch_remedy  # type: ignore[attr-defined]
    for kinds, describe in _BY_TYPE:
        if isinstance(error, kinds):
            found = describe(error, root)
            if found is not None:
                return found
    for pattern, kind, remedy in _BY_MESSAGE:
        match = re.search(pattern, message)
        if match is not None:
            message = re.sub(r"^(\w+)\.__init__\(\)", r"\1()", message)
            if callable(remedy):
                remedy = remedy(match, configurations)
            return kind, message, remedy
    title = type(error).__name__
    if message:
        title += f": {message}"
    return "exception", title, "Correct the line: it raises this exception while the file is read."


def _message(error: BaseException) -> str:
    """Return the message of an exception, without the quotes of a KeyError."""
    if isinstance(error, KeyError) and error.args:
        return str(error.args[0])
    return str(error)


# -- by the type of the exception -------------------------------------------------------------


def _syntax(error: Any, _: str) -> Described:
    remedy = "Correct the syntax on this line, or on the one before it."
    if error.filename is None and "null bytes" in str(error.msg):
        remedy = "Save the file as UTF-8."
    return "syntax_error", f"syntax error: {error.msg}", remedy


def _import(error: Any, root: str) -> Described | None:
    match = re.search(r"cannot import name '(\w+)' from '([\w.]+)'", str(error))
    if match and match[2].split(".")[0] in _PACKAGES:
        return _unknown_name(match[1], match[2])
    module = error.name or ""
    top = module.split(".")[0]
    message = f"there is no module '{module}'"
    remedy = "Correct the import."
    if top in _PACKAGES and top in sys.modules:
        parent, _, last = module.rpartition(".")
        return "unknown_import", message, near(last, SUBMODULES.get(parent, ())) + remedy
    close = difflib.get_close_matches(top, _PACKAGES, n=1, cutoff=0.85)
    if close:
        return "unknown_import", message, f"Did you mean '{close[0]}'? {remedy}"
    if not isinstance(error, ModuleNotFoundError):
        return None
    return _missing_module(module, root)


def _missing_module(module: str, root: str) -> Described:
    """Describe the import of a module that is in the submission or nowhere."""
    top = module.split(".")[0]
    lying = module_out_of_reach(top, root) if top else None
    if lying is not None:
        message = f"the launch file imports '{module}', but '{lying}' is nowhere where Python looks for modules"
        remedy = "Put it into the Python package of a ROS package, and import it as package.module."
        return "unknown_import", message, remedy
    message = f"the launch file imports '{module}', which is not installed where it is evaluated"
    remedy = "No change is needed if the module is installed where you launch."
    return "missing_module", message, remedy


def _attribute(error: Any, _: str) -> Described | None:
    pattern = r"module '((?:launch|launch_ros)[\w.]*)' has no attribute '(\w+)'"
    match = re.search(pattern, str(error))
    return _unknown_name(match[2], match[1]) if match else None


def _unknown_name(name: str, module: str) -> Described:
    message = f"'{module}' has no '{name}'"
    if name in LATER.get(module, ()):
        message += " in ROS 2 Jazzy: it came with a later release"
        return "unknown_import", message, "Do without it."
    homes = [home for home in homes_of(name) if home != module]
    remedy = near(name, NAMES.get(module, ())).strip()
    if homes:
        remedy = f"Import it from '{homes[0]}'."
    if not remedy:
        remedy = "Look up the name in the documentation of ROS 2 Jazzy."
    return "unknown_import", message, remedy


def _name(error: Any, _: str) -> Described:
    name = getattr(error, "name", None) or ""
    homes = homes_of(name)
    if homes:
        return "unknown_name", str(error), f"Import it: from {homes[0]} import {name}"
    remedy = near(name, itertools.chain(*NAMES.values()))
    return "unknown_name", str(error), f"{remedy}Define or import the name before it is used."


def _package(error: Any, _: str) -> Described | None:
    match = re.search(r"package '([^']*)'", str(error))
    if type(error).__name__ != "PackageNotFoundError" or match is None:
        return None
    name = match[1]
    if is_released(name):
        error.name = name
        message = f"the launch file needs the package '{name}', which is not installed where it is evaluated"
        remedy = "No change is needed if the package is installed where you launch."
        return "missing_package", message, remedy
    own, there = own_packages()
    listed = ", ".join(own[:8]) or "no package"
    if len(own) > 8:
        listed += " …"
    remedy = f"{near(name, own or there)}Write the name as in package.xml and setup.py."
    return "unknown_package", f"package '{name}' not found; the submission has: {listed}", remedy


def _file(error: Any, root: str) -> Described | None:
    path = str(error.filename or error)
    if isinstance(error, IsADirectoryError):
        message = f"'{relative(path, root)}' is a folder, and a file is wanted here"
        return "file_not_found", message, "Give the path of a file."
    launched = path.endswith((".launch.py", "launch.xml"))
    what = "the file"
    kind = "file_not_found"
    remedy = "Correct the path, or hand the file in."
    if launched or getattr(error, "launch_object", "") == "IncludeLaunchDescription":
        what = "the included launch file"
        kind = "include_not_found"
        remedy = "Correct the path, and install the file in setup.py under data_files."
    missing = missing_data_file(path, root)
    if missing is None:
        return kind, f"{what} '{relative(path, root)}' does not exist", remedy
    source, build, line = missing
    message = f"{what} '{source}' is in the package, but {build} does not install it "
    message += "into the share folder, where this launch file looks for it"
    return kind, message, f"Add to {build}: {line}, and build again."


def missing_program(program: str | None) -> Described | None:
    """Return the problem of a missing program of ROS; None for any other program."""
    if program not in _ROS_PROGRAMS:
        return None
    message = f"the launch file runs '{program}', which is not installed where it is evaluated"
    remedy = "No change is needed if the program is installed where you launch."
    return "missing_program", message, remedy


def _exits(_error: Any, _: str) -> Described:
    return "exits", "the launch file ends the whole program", "Remove the call of exit()."


def _not_found(error: Any, _: str) -> Described | None:
    pattern = r"No such file or directory: '([^']*)'|executable '([^']*)' not found on the PATH"
    match = re.search(pattern, str(error))
    program = match[match.lastindex or 0] if match else None
    error.__dict__["name"] = program
    return missing_program(program)


_BY_TYPE: list[tuple[Any, Callable[[Any, str], Described | None]]] = [
    (SyntaxError, _syntax),
    (ImportError, _import),
    (AttributeError, _attribute),
    (NameError, _name),
    (KeyError, _package),
    ((FileNotFoundError, IsADirectoryError), _file),
    (SystemExit, _exits),
    (Exception, _not_found),
]

# -- by the message of Python, and of the real launch --------------------------------------------

_TOO_EARLY = (
    "It has a value only while launching. Where a text is wanted, give a list: ['text', LaunchConfiguration(...)]; "
    "for a path PathJoinSubstitution([...]); to compute with it, OpaqueFunction and .perform(context)."
)


def keyword_remedy(name: str, known: Iterable[str]) -> str:
    """Return the instruction for an unknown keyword, with the present name of a renamed one."""
    if name in RENAMED:
        return f"Write '{RENAMED[name]}=' instead of '{name}='."
    return near(name, known) + "Use the keywords of ROS 2 Jazzy."


def configuration_remedy(name: str, known: Iterable[str]) -> str:
    """Return the instruction for a missing launch configuration."""
    return f"{near(name, known)}Declare it first: DeclareLaunchArgument('{name}', ...)."


def _positional(match: re.Match[str], _: Any) -> str:
    if "takes 0 positional arguments but 1 was given" in match.string:
        return "Give the function a parameter for the launch context: def name(context, *args, **kwargs)."
    return "Write keywords: name=value."


_Remedy = str | Callable[[re.Match[str], Any], str]

_BY_MESSAGE: list[tuple[str, str, _Remedy]] = [
    (
        r"unexpected keyword argument '(\w+)'",
        "unknown_keyword",
        lambda match, _: keyword_remedy(match[1], ()),
    ),
    (
        r"missing \d+ required keyword-only argument",
        "missing_keyword",
        "Give what is missing by its keyword.",
    ),
    (r"missing \d+ required positional argument", "missing_argument", "Give what is missing."),
    (r"takes .* positional argument", "positional_argument", _positional),
    (
        r"(argument must be|can only concatenate|unsupported operand|not supported between|expected str, bytes)"
        r".*(LaunchConfiguration|Substitution|FindPackage|FindExecutable|PathJoin|Command|EnvironmentVariable"
        r"|ThisLaunchFile|PythonExpression)",
        "substitution_too_early",
        _TOO_EARLY,
    ),
    (r"object has no attribute 'items'$", "bad_pairs", "Give a dict: {'name': 'value'}."),
    (r"values to unpack", "bad_pairs", "Write launch_arguments as pairs: {...}.items()."),
    (
        r"No closing quotation|No escaped character",
        "bad_text",
        "Close the quotes of the command line.",
    ),
    (
        r"object is not iterable|can only concatenate list",
        "not_a_list",
        "Make it a list, even of one item.",
    ),
    # Messages of the real launch.
    (
        r"^launch configuration '([^']*)' does not exist",
        "undefined_configuration",
        lambda match, known: configuration_remedy(match[1], known),
    ),
    (
        r"[Rr]equired (launch )?argument '",
        "required_argument",
        "Give a default_value, or name:=value when launching.",
    ),
]

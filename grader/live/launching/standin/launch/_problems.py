"""What went wrong in a launch file, where, and how to mend it, in words for the one who wrote it."""

from __future__ import annotations

import difflib
import importlib
import os
import re
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ._base import STANDIN_ROOT, Located, UnsupportedByStandin
from ._catalogue import LATER, SUBMODULES, homes_of, is_released, similar_names
from ._installed import missing_data_file, module_out_of_reach
from ._session import SUBSTITUTION_AS_TEXT, LimitExceededError
from ._sources import InvalidPythonLaunchFileError, WrongReturnError

OURS = ("launch", "launch_ros", "launch_xml", "launch_yaml", "ament_index_python")

_RENAMED = {
    "node_name": "name",
    "node_executable": "executable",
    "node_namespace": "namespace",
    "node_package": "package",
    "env_vars": "additional_env",
    "args": "arguments",
    "params": "parameters",
    "remap": "remappings",
    "remapping": "remappings",
    "default": "default_value",
    "value": "default_value",
    "ns": "namespace",
    "pkg": "package",
    "exec": "executable",
    "type": "executable",
}

_KEYWORDS = (
    "package executable name namespace exec_name parameters remappings ros_arguments arguments output",
    "respawn respawn_delay respawn_max_retries emulate_tty condition on_exit additional_env env cwd prefix",
    "shell cmd default_value description choices launch_arguments actions period event_handler target_action",
    "on_start on_stdout on_stderr on_shutdown function scoped forwarding sigterm_timeout sigkill_timeout",
)

_NOT_HERE = ("unsupported", "missing_module", "missing_package", "missing_program")

#: Programs that come with ROS or a simulator, and are not where this is evaluated.
_ROS_PROGRAMS = ("xacro", "ros2", "rviz2", "colcon", "gz", "ign", "gazebo", "gzserver", "gzclient", "check_urdf")

Described = tuple[str, str, str]


def problem_of(error: BaseException, root: str, file: str, context: Any) -> tuple[str, dict[str, Any]]:
    """The outcome (`error` or `not_assessable`) and the problem of an exception.

    Parameters
    ----------
    error : BaseException
        What the evaluation raised.
    root, file : str
        The submission's folder, and the launch file in it.
    context : LaunchContext
        The state of the launch when it was raised.
    """
    kind, message, remedy = _describe(error, context)
    if SUBSTITUTION_AS_TEXT.search(message):
        remedy = "Use a list instead of str() or an f-string: ['text', LaunchConfiguration(...)]."
    where, line = _place(error, root, file)
    if where.endswith((".xml", ".yaml", ".yml")):
        remedy = _in_markup(remedy, where)
    note = getattr(error, "launch_note", None)
    problem = {
        "kind": kind,
        "message": f"{message} ({note})" if note else message,
        "file": relative(where, root),
        "line": line,
        "remedy": remedy,
    }
    outcome = "not_assessable" if kind in (*_NOT_HERE, "no_prefix") else "error"
    if kind in _NOT_HERE:
        problem["module"] = getattr(error, "name", None) or ""
    return outcome, problem


def _in_markup(remedy: str, file: str) -> str:
    """The remedy as the language of the file writes it."""
    remedy = re.sub(r"(inside the expression: )\[.*\]", r"\1$(eval '\\'$(var name)\\' == \\'x\\'')", remedy)
    form = r'<arg name="\1" default="..."/>' if file.endswith(".xml") else r"- arg: {name: \1, default: ...}"
    return re.sub(r"DeclareLaunchArgument\('([^']*)', \.\.\.\)", form, remedy)


def relative(path: str, root: str) -> str:
    """A path as seen from the submission."""
    try:
        return str(Path(path).absolute().relative_to(Path(root).absolute()))
    except ValueError:
        return path


def _inside(path: str, root: str) -> bool:
    return not path.startswith("<") and Path(path).absolute().is_relative_to(Path(root).absolute())


def _place(error: BaseException, root: str, file: str) -> tuple[str, int | None]:
    if (
        isinstance(error, SyntaxError)
        and not hasattr(error, "launch_note")
        and error.filename
        and _inside(error.filename, root)
    ):
        return error.filename, error.lineno
    noted = getattr(error, "launch_source", None)
    if isinstance(error, WrongReturnError) and noted:
        return noted[0], noted[1]
    frames = [f for f in traceback.extract_tb(error.__traceback__) if _inside(f.filename, root)]
    if frames:
        return frames[-1].filename, frames[-1].lineno
    if noted and _inside(noted[0], root):
        return noted[0], noted[1]
    return getattr(error, "launch_file", file), getattr(error, "launch_line", None)


def _describe(error: BaseException, context: Any) -> Described:
    if hasattr(error, "launch_note"):
        quotes = "Texts need quotes inside the expression: [\"'\", LaunchConfiguration(...), \"' == 'x'\"]."
        if re.match(r"name '(true|false)' is not defined", str(error)):
            quotes = "The expression is read as Python, which writes True and False."
        elif str(getattr(error, "launch_file", "")).endswith((".xml", ".yaml", ".yml")):
            quotes = 'Texts need quotes inside the expression: $(eval \'"$(var name)" == "x"\').'
        return "bad_expression", f"{type(error).__name__}: {_text(error)}", quotes
    program = re.match(r"command not found: '([^']*)'|executable '([^']*)' not found on the PATH", str(error))
    if program is not None and (program[1] or program[2]) in _ROS_PROGRAMS:
        error.name = program[1] or program[2]  # type: ignore[attr-defined]
        message = f"the launch file runs '{program[1] or program[2]}', which is not installed where it is evaluated"
        return "missing_program", message, "Nothing, if the program is installed where you launch."
    for kinds, describe in _BY_TYPE:
        if isinstance(error, kinds):
            found = describe(error, context)
            if found is not None:
                return found
    message = _with_class(_text(error), error)
    for pattern, kind, remedy in _BY_MESSAGE:
        match = re.search(pattern, message)
        if match:
            return kind, message, remedy(match, context) if callable(remedy) else remedy
    name = type(error).__name__
    return (
        "exception",
        f"{name}: {message}" if message else name,
        "Mend the line: it raises this exception while the file is read.",
    )


def _with_class(message: str, error: BaseException) -> str:
    """Name the class that the student used, where Python names one behind it, and count what the student counts."""
    behind = re.match(r"\w+\.__init__\(\)", message) is not None
    message = re.sub(r"^(\w+)\.__init__\(\)", r"\1()", message)
    match = re.match(r"(\w+)\(\) takes (?:from \d+ to )?(\d+) positional arguments? but (\d+) were given", message)
    if match is not None:
        allowed, given = int(match[2]) - 1, int(match[3]) - 1
        least = f"{allowed} of them" if allowed else "none of them"
        return f"{match[1]}() is given {given} values without a keyword, and takes {least} so"
    if not behind or " got an unexpected" not in message:
        return message
    made = _entered_last(error)
    return f"{made} {message.partition('() ')[2]}" if made else message


def _entered_last(error: BaseException) -> str:
    """The class of the stand-in whose construction a student's line began, while the error was raised inside it."""
    name = ""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        maker = frame.f_locals.get("self")
        if not frame.f_code.co_filename.startswith(STANDIN_ROOT):
            name = ""
        elif isinstance(maker, Located):
            name = f"{type(maker).__name__}()"
    return name


def _markup(match: re.Match[str], _: Any) -> str:
    for words, remedy in _MARKUP_REMEDIES.items():
        if words in match.string:
            return remedy
    return "Correct this element of the file."


_MARKUP_REMEDIES = {
    "needs the attribute 'exec'": "Write exec='...' (ROS 1 wrote type='...').",
    "'$(find ": "Write $(find-pkg-share package) (ROS 1 wrote $(find package)).",
    "'$(arg ": "Write $(var name) (ROS 1 wrote $(arg name)).",
    "<arg> cannot have value": "Write default='...', or <let> for what is not to be an argument.",
    "<node> cannot have required": "Write on_exit='shutdown' (ROS 1 wrote required='true').",
    "<include> cannot have": "Put the include into a group, after push_ros_namespace or <let>.",
    "rosparam": "Write <param from='...'/> inside the node (ROS 1 wrote rosparam).",
    "'$(optenv ": "Write $(env NAME default) (ROS 1 wrote $(optenv NAME default)).",
    "<node> cannot have ns": "Write namespace='...' (ROS 1 wrote ns='...').",
    "<group> cannot have ns": "Write push_ros_namespace as the first action of the group (ROS 1 wrote ns='...').",
    "did you mean": "Correct the name.",
    "must be a list of mappings": "Begin each item with a dash: '- name: ...'.",
    "under the key 'children'": "Write the actions as a list: each begins with a dash.",
    "one blank too many": "Write one blank between the arguments, and none before ')'.",
    "needs quotes around": "Put the argument in quotes.",
    "YAML makes it a dict": "Write the inner names as <param> inside this one.",
    "items are of one type": "Write all items alike: [1.0, 2.5] instead of [1, 2.5].",
    "not of one type": "Write all items alike: [1.0, 2.5] instead of [1, 2.5].",
    "cannot have": "Take it out.",
    "needs the attribute": "Add the attribute.",
    "decimal point": "Write 2.0 instead of 2.",
    "in quotes": "Put the value in quotes.",
    "is not closed": "Close it.",
    "the type '": "Use one of the types.",
    "can only be": "Write this value, or take the attribute out.",
}


def _text(error: BaseException) -> str:
    if isinstance(error, KeyError) and error.args:
        return str(error.args[0])
    return str(error)


def near(name: str, known: Any) -> str:
    """A question after what was meant, or nothing."""
    found = difflib.get_close_matches(name, [str(each) for each in known], n=1, cutoff=0.6)
    return f"Did you mean '{found[0]}'? " if found else ""


def _syntax(error: Any, _: Any) -> Described | None:
    if hasattr(error, "launch_note"):
        return None
    remedy = "Mend the syntax on this line, or on the one before it."
    if error.filename is None and "null bytes" in str(error.msg):
        remedy = "Save the file as UTF-8."
    return "syntax_error", f"syntax error: {error.msg}", remedy


def _unsupported(error: Any, _: Any) -> Described:
    return "unsupported", str(error), "Nothing: this part cannot be judged by evaluation."


def _import(error: Any, context: Any) -> Described | None:
    match = re.search(r"cannot import name '(\w+)' from '([\w.]+)'", str(error))
    if match and match[2].split(".")[0] in OURS:
        return _unknown_name(match[1], match[2])
    module = error.name or ""
    top = module.split(".")[0]
    if top in OURS and top in sys.modules:
        parent, _, last = module.rpartition(".")
        known = [
            *SUBMODULES.get(parent, "").split(),
            *(m.rpartition(".")[2] for m in sys.modules if parent in m),
        ]
        return "unknown_import", f"there is no module '{module}'", near(last, known) + "Mend the import."
    close = difflib.get_close_matches(top, OURS, n=1, cutoff=0.85)
    if close:
        return (
            "unknown_import",
            f"there is no module '{module}'",
            f"Did you mean '{close[0]}'? Mend the import.",
        )
    lying = module_out_of_reach(top, context.session.root) if isinstance(error, ModuleNotFoundError) and top else None
    if lying is not None:
        message = f"the launch file imports '{module}', but '{lying}' is nowhere where Python looks for modules"
        return (
            "unknown_import",
            message,
            "Put it into the Python package of a ROS package, and import it as package.module.",
        )
    if isinstance(error, ModuleNotFoundError):
        message = f"the launch file imports '{module}', which is not installed where it is evaluated"
        return "missing_module", message, "Nothing, if the module is installed where you launch."
    return None


def _attribute(error: Any, _: Any) -> Described | None:
    match = re.search(r"module '((?:launch|launch_ros)[\w.]*)' has no attribute '(\w+)'", str(error))
    return _unknown_name(match[2], match[1]) if match else None


def _unknown_name(name: str, module: str) -> Described:
    _import_all()
    homes = [home for home in homes_of(name) if home != module]
    similar = similar_names(module, name)
    if name in LATER.get(module, ()):
        message = f"'{module}' has no '{name}' in ROS 2 Jazzy: it came with a later release"
        return "unknown_import", message, "Do without it."
    if homes:
        remedy = f"Import it from '{homes[0]}'."
    elif similar:
        remedy = f"Did you mean '{similar[0]}'?"
    else:
        remedy = "Look up the name in the documentation of ROS 2 Jazzy."
    return "unknown_import", f"'{module}' has no '{name}'", remedy


def _no_function(error: Any, _: Any) -> Described:
    lines: dict[str, int | None] = getattr(error, "module_names", {})
    functions = [name for name, line in lines.items() if line is not None]
    meant = difflib.get_close_matches("generate_launch_description", functions, n=1)
    error.launch_line = lines[meant[0]] if meant else None
    remedy = f"Rename '{meant[0]}': w" if meant else "W"
    remedy += "rite a function 'def generate_launch_description():' that returns a LaunchDescription."
    return "no_generate_function", str(error), remedy


def _name(error: Any, _: Any) -> Described | None:
    name = getattr(error, "name", None) or ""
    _import_all()
    homes = homes_of(name)
    if homes:
        return "unknown_name", str(error), f"Import it: from {homes[0]} import {name}"
    there = [n for m in list(sys.modules) if m.split(".")[0] in ("launch", "launch_ros") for n in _public(m)]
    return "unknown_name", str(error), f"{near(name, there)}Define or import the name before it is used."


def _public(module: str) -> tuple[str, ...]:
    return tuple(getattr(sys.modules.get(module), "__all__", ()))


def _import_all() -> None:
    """Load the modules whose names a student may mean."""
    for module in (
        "launch.actions",
        "launch.conditions",
        "launch.event_handlers",
        "launch.launch_description_sources",
        "launch.substitutions",
        "launch_ros.actions",
        "launch_ros.descriptions",
        "launch_ros.parameter_descriptions",
        "launch_ros.substitutions",
    ):
        importlib.import_module(module)


def _wrong_return(error: Any, _: Any) -> Described:
    for words, remedy in {
        "a coroutine": "Write 'def', not 'async def': the function is called, and nobody awaits it.",
        "a generator": "Write 'return LaunchDescription([...])' instead of 'yield'.",
    }.items():
        if words in str(error):
            return "wrong_return", str(error), remedy
    return "wrong_return", str(error), "End the function with 'return LaunchDescription([...])'."


def _limit(error: Any, _: Any) -> Described:
    if "includes itself" in str(error):
        return "include_recursive", str(error), "Include another file, or put the include under a condition."
    return "endless", str(error), "Let the description come to an end."


def _package(error: Any, _: Any) -> Described | None:
    if type(error).__name__ != "PackageNotFoundError":
        return None
    from ament_index_python.packages import get_packages_with_prefixes

    match = re.search(r"package '([^']*)'", _text(error))
    name = match[1] if match else ""
    if is_released(name):
        message = f"the launch file needs the package '{name}', which is not installed where it is evaluated"
        error.name = name
        return "missing_package", message, "Nothing, if the package is installed where you launch."
    there = sorted(get_packages_with_prefixes())
    own_prefix = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)[0]
    own = [package for package in there if (Path(own_prefix) / "share" / package).is_dir()]
    shown = ", ".join(own[:8]) + (" …" if len(own) > 8 else "") if own else "no package"
    remedy = f"{near(name, own or there)}Write the name as in package.xml and setup.py."
    return "unknown_package", f"package '{name}' not found; the submission has: {shown}", remedy


def _file(error: Any, context: Any) -> Described | None:
    path = str(error.filename or error)
    included = getattr(error, "launch_object", "") == "IncludeLaunchDescription" or path.endswith(
        (".launch.py", "launch.xml")
    )
    missing = missing_data_file(path, context.session.root)
    if missing is not None:
        what, kind = ("the included launch file", "include_not_found") if included else ("the file", "file_not_found")
        message = (
            f"{what} '{missing[0]}' is in the package, but {missing[1]} does not install it "
            f"into the share folder, where this launch file looks for it"
        )
        return kind, message, f"Add to {missing[1]}: {missing[2]}, and build again."
    path = relative(path, context.session.root) if context.session.root else path
    if included:
        remedy = "Correct the path, and install the file in setup.py under data_files."
        return "include_not_found", f"the included launch file '{path}' does not exist", remedy
    return "file_not_found", f"the file '{path}' does not exist", "Correct the path, or hand the file in."


def _folder(error: Any, context: Any) -> Described:
    path = relative(str(error.filename), context.session.root) if context.session.root else str(error.filename)
    return "file_not_found", f"'{path}' is a folder, and a file is wanted here", "Give the path of a file."


def _exit(error: Any, _: Any) -> Described:
    return "exits", "the launch file ends the whole program", "Remove the call of exit()."


def _no_prefix(error: Any, context: Any) -> Described | None:
    there_before = context.session.initial_environment.get("AMENT_PREFIX_PATH")
    if "AMENT_PREFIX_PATH" not in str(error) or there_before:
        return None
    return "no_prefix", "the evaluation has no ROS packages to look into", "Set AMENT_PREFIX_PATH."


_BY_TYPE: list[tuple[Any, Callable[[Any, Any], Described | None]]] = [
    (SyntaxError, _syntax),
    (UnsupportedByStandin, _unsupported),
    (ImportError, _import),
    (InvalidPythonLaunchFileError, _no_function),
    (WrongReturnError, _wrong_return),
    (AttributeError, _attribute),
    (LimitExceededError, _limit),
    (NameError, _name),
    (KeyError, _package),
    (FileNotFoundError, _file),
    (IsADirectoryError, _folder),
    (OSError, _no_prefix),
    (SystemExit, _exit),
]


def _keyword(match: re.Match[str], _: Any) -> str:
    name = match[1]
    if name in _RENAMED:
        return f"Write '{_RENAMED[name]}=' instead of '{name}='."
    return near(name, " ".join(_KEYWORDS).split()) + "Use the keywords of ROS 2 Jazzy."


def _configuration(match: re.Match[str], context: Any) -> str:
    meant = near(match[1], context.launch_configurations)
    return f"{meant}Declare it first: DeclareLaunchArgument('{match[1]}', ...)."


def _executable(match: re.Match[str], _: Any) -> str:
    missing = re.search(r"but (\S+) does not install it \((.+) is missing\)", match.string)
    if missing and missing[1] == "setup.py":
        return f"Add to console_scripts in setup.py: {missing[2]}, and build again."
    if missing:
        return f"Add to {missing[1]}: {missing[2]}, and build again."
    return "Write the name of an entry point of setup.py ('name = package.module:main'), and build again."


def _package_name(match: re.Match[str], _: Any) -> str:
    return "Write the name as in package.xml."


_TOO_EARLY = (
    "It has a value only while launching. Where a text is wanted, give a list: ['text', LaunchConfiguration(...)]; "
    "for a path PathJoinSubstitution([...]); to compute with it, OpaqueFunction and .perform(context)."
)


def _positional(match: re.Match[str], _: Any) -> str:
    of_the_file = "<locals>" in match.string or not re.match(r"[A-Z]", match.string)
    if of_the_file and "takes 0 positional arguments but 1 was given" in match.string:
        return "Give the function a parameter for the launch context: def name(context, *args, **kwargs)."
    return "Write keywords: name=value."


_AS_TEXT = "If it is meant as text, wrap it: ParameterValue(..., value_type=str)."
_VALUE = "Give a value of the type that is asked for, or a text that can be read as one."


def _no_action(match: re.Match[str], _: Any) -> str:
    for words, remedy in {
        "None is given": "Take None out: a function that makes an action must return it.",
        "'tuple'": "Take the comma away that stands behind the action, or write *(...) for several.",
        "'list'": "Put the items of the list here, not the list: *[...].",
        "'On": "Put the handler into RegisterEventHandler(...).",
        "'function'": "Call the function, or put it into OpaqueFunction(function=...).",
    }.items():
        if words in match.string:
            return remedy
    return "Put only actions into this list."


def _one_type(match: re.Match[str], _: Any) -> str:
    for words, remedy in {
        "it is []": "Leave the parameter out, or give a list with at least one item.",
        "its items must all": "Write all items alike: [1.0, 2.5] instead of [1, 2.5], ['1', 'x'] instead of [1, 'x'].",
        "None is given": "Leave the parameter out, or give it a value.",
        "'PosixPath'": "Give a path as text: str(path).",
        "'ndarray'": "Give a plain list: array.tolist().",
    }.items():
        if words in match.string:
            return remedy
    return "Give a bool, an int, a float, a text, or a list of one of these."


_Remedy = str | Callable[[re.Match[str], Any], str]

_BY_MESSAGE: list[tuple[str, str, _Remedy]] = [
    (r"unexpected keyword argument '(\w+)'", "unknown_keyword", _keyword),
    (
        r"missing \d+ required keyword-only argument",
        "missing_keyword",
        "Give what is missing by its keyword.",
    ),
    (r"missing \d+ required positional argument", "missing_argument", "Give what is missing."),
    (
        r"^LaunchDescription\(\) is given",
        "positional_argument",
        "Put the actions into a list: LaunchDescription([...]).",
    ),
    (r"values without a keyword|takes .* positional argument", "positional_argument", _positional),
    (
        r"(argument must be|can only concatenate|unsupported operand|not supported between|expected str, bytes)"
        r".*(LaunchConfiguration|Substitution|FindPackage|FindExecutable|PathJoin|Command|EnvironmentVariable"
        r"|ThisLaunchFile|PythonExpression)",
        "substitution_too_early",
        _TOO_EARLY,
    ),
    (
        r"^EmitEvent needs an event",
        "not_an_event",
        "Give an event, such as launch.events.Shutdown(); an action stands in the list by itself.",
    ),
    (r"^OpaqueFunction needs a function", "bad_type", "Give the function itself, without calling it: function=name."),
    (r"is not a type that a value can have", "bad_type", "Use int, float, bool, str, or List[...] of one of them."),
    (r"is given where one \w+ is wanted", "bad_type", "Give one value, not a list."),
    (r"^TextSubstitution takes a str", "bad_text", "Give text."),
    (r"object has no attribute 'items'$", "bad_pairs", "Give a dict: {'name': 'value'}."),
    (r"No closing quotation|No escaped character", "bad_text", "Close the quotes of the command line."),
    (r"^launch configuration '([^']*)' does not exist", "undefined_configuration", _configuration),
    (r"^a condition must be one of", "bad_condition", "Let the condition be 'true' or 'false'."),
    (r"argument 'condition'", "bad_condition", "Wrap it: condition=IfCondition(...)."),
    (r"argument 'period'", "bad_period", "Write the period as a float: 2.0."),
    (r"argument 'parameters'", "parameters_not_list", "Put the parameters into a list: parameters=[{...}]."),
    (r"argument 'param_file'", "bad_parameter_value", "Let each item of parameters be a dict or the path of a file."),
    (r"argument 'allow_substs'", "bad_type", "Write allow_substs=True, or leave it out."),
    (r"argument 'actions'", "bad_type", "Give a list, even for one action: actions=[...]."),
    (r"when read as YAML|cannot be read as YAML", "bad_parameter_value", _AS_TEXT),
    (
        r"^the attribute '|cannot stand in one element|is not closed|a name is missing after|one blank too many"
        r"|needs quotes around",
        "bad_markup",
        _markup,
    ),
    (r"^the type '[^']*' is not one of|^a <param>", "bad_markup", _markup),
    (
        r"a remapping must be a tuple of two",
        "bad_remapping",
        "Write a list of tuples: remappings=[('from', 'to')].",
    ),
    (r"^package '[^']*' has no executables", "unknown_executable", _executable),
    (
        r"^executable '[^']*' not found on the PATH",
        "unknown_program",
        "Install the program, or give its path.",
    ),
    (r"^executable '[^']*' of package .* may not", "unknown_executable", "Make it executable: chmod +x."),
    (r"^executable '([^']*)' not found", "unknown_executable", _executable),
    (r"is not a valid package name", "unknown_package", _package_name),
    (
        r"required launch argument '(\w+)'",
        "required_argument",
        "Give a default_value, or name:=value when launching.",
    ),
    (
        r"needs the argument '",
        "required_argument",
        "Give it: a default_value, name:=value when launching, or launch_arguments when including.",
    ),
    (r"must be one of \[|among its choices|list of choices", "invalid_choice", "Use one of the choices."),
    (r"values to unpack", "bad_pairs", "Write launch_arguments as pairs: {...}.items()."),
    (
        r"the parameter '|argument 'value'",
        "bad_parameter_value",
        _one_type,
    ),
    (r"cannot be read as|^a list of \w+ is given|not of one type|^in this list only", "bad_parameter_value", _VALUE),
    (r"^an? \w+ is wanted|^a value, a substitution", "bad_type", "Give a value of this type, without quotes."),
    (r"^invalid node name", "bad_name", "Use letters, digits and '_', and put '/' into namespace=."),
    (r"^invalid namespace", "bad_name", "Use letters, digits and '_', with one '/' between the parts."),
    (r"^output must be|output can be set|the output of", "bad_output", "Write output='screen'."),
    (r"^item \d+ of \w+ is no action", "not_an_action", _no_action),
    (
        r"object is not iterable|can only concatenate list",
        "not_a_list",
        "Make it a list, even of one item.",
    ),
    (r"^environment variable", "undefined_variable", "Set the variable, or give default_value=."),
    (r"^command ", "command_failed", "Run the command by hand and mend what it says."),
    (r"is started twice", "started_twice", "Put each action into the description once."),
    (r"every item must be an action", "not_an_action", "Put only actions into this list."),
    (r"only text", "bad_text", "Give text or a substitution: '100.0' for 100.0, 'true' for True."),
    (r"target_\w+ must be", "bad_target", "Give the action itself, as it is kept in a variable."),
    (r"not well-formed|not encoded in UTF-8|root of a launch file|mapping", "bad_markup", "Mend it where it says."),
    (
        r"^(a )?<\w+> |the attribute '|there is no (action|substitution)",
        "bad_markup",
        _markup,
    ),
]

"""Known causes of exceptions in rclpy programs, each with a friendly sentence and a remedy.

Each cause is one small function; `RULES` lists them in the order in which they are tried. The texts of rclpy
are those of rclpy 7.1 (Jazzy), those of Python of 3.10 to 3.14.
"""

from __future__ import annotations

import difflib
import re
import sys
from collections.abc import Callable, Collection
from dataclasses import dataclass

from grader.evidence.known_packages import ros_packages
from grader.evidence.tracebacks import Raised, student_file

NODE_PROPERTIES = frozenset(
    [
        "clients",
        "context",
        "default_callback_group",
        "executor",
        "guards",
        "handle",
        "publishers",
        "services",
        "subscriptions",
        "timers",
        "waitables",
    ]
)
"""Properties of `rclpy.node.Node` that a subclass cannot use as names of its own."""

_SHORTER = {
    "publishers": "_pubs",
    "subscriptions": "_subs",
    "services": "_srvs",
    "clients": "_clis",
    "timers": "_tmrs",
}
_RCLPY_NAMES = (
    "QoSProfile QoSReliabilityPolicy QoSDurabilityPolicy QoSHistoryPolicy ReliabilityPolicy DurabilityPolicy",
    "HistoryPolicy LivelinessPolicy qos_profile_sensor_data qos_profile_system_default Node Parameter",
    "ExternalShutdownException SingleThreadedExecutor MultiThreadedExecutor ReentrantCallbackGroup",
    "MutuallyExclusiveCallbackGroup ActionServer ActionClient LifecycleNode Duration Time",
    "SetParametersResult ParameterDescriptor Float64MultiArray Float32MultiArray MultiArrayDimension Float64",
    "Float32 Int32 Int64 String Bool Header Empty JointState SetBool Trigger Twist LaunchDescription",
    "DeclareLaunchArgument LaunchConfiguration IncludeLaunchDescription",
)
_KNOWN_NAMES = tuple(name for line in _RCLPY_NAMES for name in line.split())
_KNOWN_MODULES = (
    "rclpy",
    "rclpy.node",
    "rclpy.qos",
    "rclpy.executors",
    "rclpy.parameter",
    "std_msgs",
    "std_msgs.msg",
    "std_srvs",
    "std_srvs.srv",
    "sensor_msgs",
    "sensor_msgs.msg",
    "geometry_msgs",
    "geometry_msgs.msg",
    "rcl_interfaces",
    "rcl_interfaces.msg",
    "numpy",
    "launch",
    "launch_ros",
    "launch.actions",
    "launch.substitutions",
    "launch_ros.actions",
)
_INTERFACE_ENDING = re.compile(r"_(?:msgs|srvs|interfaces|actions)$")
_INTERFACE_PACKAGE = re.compile(rf"\w+{_INTERFACE_ENDING.pattern}")
#: How alike two names have to be, from 0 to 1, for one to be a slip in the other: "sdt" and "std" are just so.
_ALIKE = 0.6
MESSAGE_LENGTH = 300
"""Characters of an exception's message that are kept."""


@dataclass(frozen=True)
class Case:
    """An exception, and the files of the submission in which it may have come up."""

    raised: Raised
    root_files: Collection[str]

    @property
    def name(self) -> str:
        """Its type without the module."""
        return self.raised.name

    @property
    def text(self) -> str:
        """First line of the message."""
        return self.raised.message.split("\n", 1)[0]

    def passes(self, part: str) -> bool:
        """Whether a frame's path or function holds `part`."""
        return any(part in frame.path or part == frame.function for frame in self.raised.frames)


Told = tuple[str, str, str, str]
"""Kind, sentence, remedy, subject."""


def uses_dead_context(exception: Raised) -> bool:
    """Whether it comes of using rclpy or a node after it has been shut down."""
    return exception.name in ("InvalidHandle", "NotInitializedException") or (
        exception.name == "RCLError" and ("context is invalid" in exception.message)
    )


def cause_of(case: Case) -> Told:
    """Kind, sentence, remedy and subject of what is behind an exception."""
    return next((told for rule in RULES if (told := rule(case)) is not None), None) or _unknown(case)


def _match(pattern: str, text: str) -> re.Match[str] | None:
    return re.search(pattern, text[:2000])


def _near(name: str, known: Collection[str]) -> str | None:
    folded = {k.casefold(): k for k in sorted(known)}
    close = difflib.get_close_matches(name[:80].casefold(), list(folded), n=1, cutoff=0.75)
    return folded[close[0]] if close and folded[close[0]] != name else None


def _suggested(case: Case, name: str, known: Collection[str] = ()) -> str:
    """Python's own suggestion or a near miss as a question that follows a sentence, else empty."""
    own = _match(r"Did you mean:? '([^']{1,80})'\?", case.text)
    near = own[1] if own else _near(name, known)
    return f" Did you mean {near}?" if near else ""


# -- imports -------------------------------------------------------------------------------------------


def _missing_module(case: Case) -> Told | None:
    match = _match(r"No module named '?([\w.]{1,200})'?", case.text)
    if match is None or case.name not in ("ModuleNotFoundError", "ImportError"):
        return None
    module = match[1]
    root = module.split(".")[0]
    sentence = f"Python finds no module named {module}."
    if root == "rclpy" and module == "rclpy":
        return (
            "ros-not-sourced",
            sentence + " That is ROS 2's Python library.",
            "Source ROS 2 in the terminal before the node is started: source /opt/ros/<distro>/setup.bash.",
            module,
        )
    stems = {f.rsplit("/", 1)[-1].removesuffix(".py") for f in case.root_files if f.endswith(".py")}
    folders = {part for f in case.root_files for part in f.split("/")[:-1]}
    if root in stems | folders or module.rsplit(".", 1)[-1] in stems:
        return (
            "missing-sibling",
            sentence + " The submission has it, but Python does not look where it lies.",
            "Import it by its package's name (from <package>.<module> import ...) and list the package in "
            "setup.py, or put what is shared into the file itself.",
            module,
        )
    near = _meant(module, root)
    if near is not None:
        return "misspelt-module", sentence, f"It is spelt {near}.", module
    if _INTERFACE_PACKAGE.match(root) or root in ros_packages():
        return _missing_package(module, root, sentence)
    near = _near(root, stems | sys.stdlib_module_names)
    hint = f" If {near} is meant, correct the name." if near else ""
    return (
        "missing-module",
        sentence + " It is neither in Python nor in ROS 2, nor in the submission.",
        f"Do without {root}, or ask whether it may be installed with pip for grading.{hint}",
        module,
    )


def _meant(module: str, root: str) -> str | None:
    """Return the module that was meant by a misspelt name; a package that there is means itself."""
    for near in (_near(module, _KNOWN_MODULES), _near(root, ros_packages())):
        other = near.split(".")[0] if near is not None else ""
        if other and (other == root if root in ros_packages() else _alike(root, other)):
            return near
    return None


def _alike(name: str, other: str) -> bool:
    """Whether two names of packages are alike beside the ending that many have."""
    bare, bare_other = (_INTERFACE_ENDING.sub("", each) for each in (name, other))
    return difflib.SequenceMatcher(None, bare, bare_other).ratio() >= _ALIKE


def _missing_package(module: str, root: str, sentence: str) -> Told:
    what = "package of ROS 2" if root in ros_packages() else "package of ROS interfaces"
    return (
        "missing-interface",
        f"{sentence} {root} is a {what} that is not there.",
        "Use the interfaces that the lab names; a package of your own must be handed in and built.",
        module,
    )


def _missing_name(case: Case) -> Told | None:
    match = _match(
        r"cannot import name '([^']{1,200})' from (partially initialized module )?'([^']{1,200})'", case.text
    )
    if match is None:
        return None
    name, partial, module = match[1], match[2], match[3]
    if partial:
        return (
            "circular-import",
            f"The module {module} is imported while it is still being read, so that {name} is not there yet.",
            "Two files import each other, or one has the name of a library: rename it, or move the import.",
            name,
        )
    file = _match(r"\(([^()]{1,1000})\)\s*$", case.text)
    if file and student_file(file[1], case.root_files) and _near(module, _KNOWN_MODULES) is None:
        sentence = f"The submission's module {module} has no {name}."
    else:
        sentence = f"The module {module} has no {name}."
    near = _suggested(case, name, _KNOWN_NAMES)
    return (
        "missing-name",
        sentence + near,
        "Correct the name in the import; upper and lower case matter.",
        name,
    )


# -- a node's own traps --------------------------------------------------------------------------------


def _read_only_property(case: Case) -> Told | None:
    match = _match(r"property '(\w+)' of '(\w+)' object has no setter|can't set attribute(?: '(\w+)')?", case.text)
    if case.name == "AttributeError" and case.text.startswith("handle cannot be modified"):
        name, owner = "handle", ""
    elif match is not None and case.name == "AttributeError":
        name, owner = match[1] or match[3] or "", match[2] or ""
    elif case.name == "AttributeError" and case.text.endswith("object has no attribute 'add_node'"):
        name, owner = "executor", ""
    else:
        return None
    if name and name not in NODE_PROPERTIES:
        return (
            "read-only-property",
            f"{name} is a read-only property of {owner or 'the class'}, so nothing can be assigned to it.",
            "Give the attribute another name, or write a setter for the property.",
            name,
        )
    attribute = name or "publishers, subscriptions, services, clients or timers"
    better = _SHORTER.get(name, f"_{name}" if name else "_pubs")
    if better == f"_{name}":
        better = f"_my_{name}"
    return (
        "read-only-property",
        f"Every rclpy node already has a read-only property {attribute}, "
        f"so the assignment to self.{name or '...'} ends the node.",
        f"Rename the attribute wherever it is used, for instance to self.{better}.",
        name,
    )


def _hidden_property(case: Case) -> Told | None:
    """A method named like a property of Node: rclpy takes the method for the property."""
    in_node = any(f.path.endswith(("rclpy/node.py", "rclpy/executors.py")) for f in case.raised.frames)
    method = _match(r"'(?:method|function)' object|^__enter__$", case.text)
    if method is None or case.name not in ("TypeError", "AttributeError") or not in_node:
        return None
    name = "handle" if _match(r"context manager|__enter__", case.text) else ""
    named = f"a method named {name}" if name else "a method with the name of one of Node's own attributes"
    return (
        "hidden-property",
        f"The class has {named}, which hides the one of rclpy's Node that rclpy itself needs.",
        f"Rename the method, for instance to on_{name or 'request'}; Node uses for itself: "
        f"{', '.join(sorted(NODE_PROPERTIES))}.",
        name,
    )


_OWN_ATTRIBUTES = re.compile(
    r"'(\w{1,100})' object has no attribute '(?:_default_callback_group|_Node__\w{1,60}|_parameters|_clock"
    r"|_logger|_context|_publishers|_subscriptions|_services|_timers|_clients)'"
)
"""Attributes that `Node.__init__` sets."""


def _no_super_init(case: Case) -> Told | None:
    match = _OWN_ATTRIBUTES.search(case.text)
    if match is None or case.name != "AttributeError":
        return None
    return (
        "super-init-missing",
        f"The class {match[1]} uses its node before the node is made.",
        "Call super().__init__('<node name>') as the first line of __init__.",
        match[1],
    )


def _not_initialised(case: Case) -> Told | None:
    if case.name == "NotInitializedException":
        return (
            "not-initialised",
            "A node is made while rclpy is not initialised.",
            "Call rclpy.init() before the node is made, and do not use the node after rclpy.shutdown().",
            "",
        )
    if "Context.init() must only be called once" in case.text:
        return (
            "initialised-twice",
            "rclpy.init() is called a second time.",
            "Call it once, at the start of main().",
            "",
        )
    if uses_dead_context(case.raised):
        return (
            "context-shut-down",
            "The node goes on to use rclpy after it has been shut down or the node destroyed.",
            "Let rclpy.shutdown() and destroy_node() be the last calls; first stop what publishes or logs.",
            "",
        )
    return None


def _names(case: Case) -> Told | None:
    match = re.match(r"Invalid(Topic|Service|Node|Namespace)\w*NameException|InvalidNamespaceException", case.name)
    quoted = _match(r"\n\s*'([^'\n]{1,200})'", case.raised.message)
    if match is None and not case.text.startswith("invalid node name"):
        return None
    what = (match[1] or "namespace").lower() if match else "node"
    name = quoted[1] if quoted else ""
    why = case.text.split(": ", 1)[-1].split(", at ")[0].rstrip(":")
    return (
        "invalid-name",
        f"ROS refuses the {what} name {name!r}: {why}." if name else f"ROS refuses a {what} name: {why}.",
        "Use letters, digits and underscores, with slashes between the parts; a part begins with no digit.",
        name,
    )


# -- parameters and QoS --------------------------------------------------------------------------------


_PARAMETER_TYPE = re.compile(
    r"Trying to set parameter '([^']{1,200})' to '(.{0,200}?)' of type '(\w+)', expecting type '(\w+)'"
)


def _parameters(case: Case) -> Told | None:
    if case.name == "ParameterNotDeclaredException":
        name = case.text.rpartition(": ")[2]
        return (
            "parameter-not-declared",
            f"The parameter {name} is used but never declared.",
            f"Declare it with its default in __init__: self.declare_parameter('{name}', <default>).",
            name,
        )
    if case.name == "ParameterAlreadyDeclaredException":
        name = case.text.rpartition(": ")[2].strip("[]'")
        remedy = "Declare each parameter once; use_sim_time is declared by rclpy itself."
        return "parameter-declared-twice", f"The parameter {name} is declared twice.", remedy, name
    match = _PARAMETER_TYPE.search(case.text[:2000])
    if match is not None:
        return (
            "parameter-type",
            f"The parameter {match[1]} is set to {match[2]} of type {match[3].lower()}, "
            f"but it is declared as {match[4].lower()}.",
            "Let the value and the declared default have the same type: 100.0 is a double, 100 an integer.",
            match[1],
        )
    match = _match(r"Couldn't parse (?:parameter override|remap) rule: '([^']{1,300})'", case.text)
    if match is not None:
        remedy = "A parameter is given as -p name:=value, a remapping as -r from:=to."
        return "ros-arguments", f"ROS cannot read the argument {match[1]}.", remedy, match[1]
    return None


_POLICY = re.compile(
    r"([A-Z][A-Z_]{2,60})(?:$|\. Did you mean)|type object '\w{0,40}Policy' has no attribute '(\w{1,60})'"
)
_POLICY_MEMBERS = ("RELIABLE", "BEST_EFFORT", "VOLATILE", "TRANSIENT_LOCAL", "KEEP_LAST", "KEEP_ALL")


def _qos(case: Case) -> Told | None:
    if case.name == "InvalidQoSProfileException":
        return (
            "qos-profile",
            "A QoSProfile lacks its depth: keep last needs to know how many messages to keep.",
            "Give it one: QoSProfile(depth=10, ...).",
            "depth",
        )
    match = _match(r"Invalid arguments passed to constructor: dict_keys\(\['(\w{1,80})'", case.text)
    if match is not None:
        known = ("depth", "history", "reliability", "durability", "deadline", "lifespan", "liveliness")
        near = _near(match[1], known)
        remedy = f"It is spelt {near}." if near else "QoSProfile knows " + ", ".join(known) + "."
        return "qos-profile", f"QoSProfile or a message has no argument {match[1]}.", remedy, match[1]
    match = _POLICY.match(case.text)
    if case.name == "AttributeError" and match is not None:
        member = match[1] or match[2]
        near = _near(member, _POLICY_MEMBERS)
        remedy = f"It is spelt {near}." if near else "Look up its members' names; they are in capitals."
        return "qos-policy", f"There is no policy or enumeration member {member}.", remedy, member
    if "argument: 'qos_profile'" in case.text:
        return (
            "qos-missing",
            "A publisher or subscription is made without a QoS profile.",
            "Give a depth or a QoSProfile as the last argument, e.g. 10.",
            "qos_profile",
        )
    return None


# -- messages and services -----------------------------------------------------------------------------


_FIELD_COMPLAINTS = (
    "must be real number",
    "bad argument type",
    "cannot be interpreted as an integer",
    "to initialize an array",
    "is not iterable",
    "can be converted to Python scalars",
    "has no attribute 'dim'",
)


def _field(case: Case) -> Told | None:
    match = _match(r"The '(\w{1,80})' field must be (.{1,100})", case.text)
    if match is not None:
        wanted = match[2].split(" and each double")[0].split(" and each float")[0].rstrip("'")
        return (
            "message-field",
            f"The message's field {match[1]} must be {wanted}'.",
            "Convert the value first: float(x), [float(x) for x in values], or .tolist() of a numpy array.",
            match[1],
        )
    in_message = any("/msg/_" in f.path or "/srv/_" in f.path for f in case.raised.frames)
    at_publish = any(f.function in ("publish", "send_response") for f in case.raised.frames[-1:])
    if (in_message or at_publish) and any(part in case.text for part in _FIELD_COMPLAINTS):
        return (
            "message-field",
            f"A value of the wrong type is put into a message: {case.text}.",
            "Give each field the type that the interface says; float(), bool(), str() or .tolist() convert.",
            "",
        )
    return None


def _wrong_message(case: Case) -> Told | None:
    match = _match(r"Expected <class '([\w.]{1,200})'>, got <class '([\w.]{1,200})'>", case.text)
    if match is not None:
        wanted, got = match[1].rsplit(".", 1)[-1], match[2].rsplit(".", 1)[-1]
        return (
            "message-type",
            f"The publisher is for {wanted}, but is given {got}.",
            f"Make a message first: msg = {wanted}(); fill it, then publish(msg).",
            wanted,
        )
    if "_TYPE_SUPPORT" in case.text:
        return (
            "message-type",
            "What is given as the interface type is none.",
            "Pass the imported class (Float64MultiArray), neither its name as a string nor an instance.",
            "",
        )
    if case.name == "TypeError" and case.passes("send_response") and not case.text:
        return (
            "no-response",
            "The service's callback returns no response.",
            "Fill the response that the callback is given, and end the callback with `return response`.",
            "",
        )
    if "callback should be either be callable" in case.text:
        remedy = "Pass a function of one argument, without calling it: self.on_message, not self.on_message()."
        return "callback", "What is given as callback cannot be called with a message.", remedy, ""
    return None


# -- Python --------------------------------------------------------------------------------------------


def _syntax(case: Case) -> Told | None:
    if case.name not in ("SyntaxError", "IndentationError", "TabError"):
        return None
    if "Non-UTF-8" in case.text:
        remedy = "Save the file as UTF-8."
        return "encoding", "The file is not in UTF-8, so Python cannot read it.", remedy, ""
    kind = "syntax-error" if case.name == "SyntaxError" else "indentation"
    remedies = {
        "syntax-error": "Mend the line, or the bracket, quote or colon missing in the one above it; "
        "`python3 -m py_compile <file>` shows the next.",
        "indentation": "Indent with four spaces a level throughout, and give every `:` a body.",
    }
    return kind, f"Python cannot read the file: {case.text.split(' (')[0]}.", remedies[kind], ""


def _logging(case: Case) -> Told | None:
    if "Logger severity cannot be changed between calls" not in case.text:
        return None
    return (
        "logger-severity",
        "One line of code logs now with one severity, now with another, which rclpy refuses: it knows calls by line.",
        "Write the calls on lines of their own, in an if and its else: one for info(), one for warning() or error().",
        "",
    )


def _undefined(case: Case) -> Told | None:
    match = _match(r"name '([^']{1,200})' is not defined", case.text)
    if match is not None:
        near = _suggested(case, match[1], _KNOWN_NAMES)
        remedy = "Import or define it before it is used; upper and lower case matter."
        return "undefined-name", f"The name {match[1]} is not defined.{near}", remedy, match[1]
    match = _match(r"local variable '?(\w{1,200})'?", case.text)
    if case.name == "UnboundLocalError" and match is not None:
        remedy = "Assign it on every way to that line; for an attribute of the node write self."
        return "undefined-name", f"The variable {match[1]} is used before it has a value.", remedy, match[1]
    return None


def _none(case: Case) -> Told | None:
    if "NoneType" not in case.text or case.name not in ("AttributeError", "TypeError"):
        return None
    if "context manager protocol" in case.text:
        return (
            "nothing-to-enter",
            "What stands behind `with` is None. In ROS 2 Jazzy rclpy.init() returns nothing that `with` can use.",
            "Call rclpy.init() on a line of its own, and rclpy.try_shutdown() at the end.",
            "",
        )
    return (
        "value-is-none",
        f"A value is still None where it is used: {case.text}.",
        "Check it first, e.g. `if self.latest is None: return`; a message may come before the one it needs.",
        "",
    )


def _attribute(case: Case) -> Told | None:
    match = _match(r"'(\w{1,100})' object has no attribute '(\w{1,100})'", case.text)
    match = match or _match(r"module '([\w.]{1,100})' has no attribute '(\w{1,100})'", case.text)
    if match is None or case.name != "AttributeError":
        return None
    near = _suggested(case, match[2])
    remedy = "Correct the name, or set it in __init__ before a callback can use it."
    return "missing-attribute", f"{match[1]} has no attribute {match[2]}.{near}", remedy, match[2]


def _arguments(case: Case) -> Told | None:
    if case.name != "TypeError" or not _match(
        r"(?:missing \d+ required|takes .{1,60} but \d+|unexpected keyword)", case.text
    ):
        return None
    return (
        "arguments",
        f"A call does not fit the function: {case.text}.",
        "Compare the call with the function's parameters; methods begin with self, "
        "service callbacks take request and response.",
        "",
    )


_PLAIN = {
    "IndexError": (
        "index",
        "A list is shorter than the code expects.",
        "Check its length before an element is taken.",
    ),
    "ZeroDivisionError": (
        "division",
        "Something is divided by zero.",
        "Check the divisor first: there may be nothing to count yet.",
    ),
    "RecursionError": (
        "recursion",
        "A function calls itself without end.",
        "End the recursion; to repeat something, use a timer.",
    ),
}


def _values(case: Case) -> Told | None:
    if "could not be broadcast" in case.text:
        remedy = "Check that both arrays have as many elements before they are subtracted."
        return "array-shapes", f"Two arrays do not fit each other: {case.text}.", remedy, ""
    if case.name == "KeyError":
        return "key", f"A dictionary has no key {case.text}.", "Set the key first, or use .get().", case.text
    if case.name == "IndexError" and "is out of bounds for axis" in case.text:
        remedy = "Check how many elements it has before one is taken or set; an array does not grow as a list does."
        return "index", f"An array is used beyond its end: {case.text}.", remedy, ""
    if case.name not in _PLAIN:
        return None
    kind, sentence, remedy = _PLAIN[case.name]
    return kind, sentence, remedy, ""


def _system(case: Case) -> Told | None:
    path = _match(r"\] .{1,100}?: '(.{1,300}?)'", case.text)
    subject = path[1] if path else ""
    if case.name == "FileNotFoundError":
        remedy = "Hand the file in, and find it relative to the source: Path(__file__).parent."
        return "file-missing", f"The file {subject} is not there.", remedy, subject
    if case.name == "PermissionError":
        remedy = "Nodes may write only to /tmp while they are graded; print or log instead."
        return "permission", f"The node may not use {subject or 'a file'}.", remedy, subject
    if case.name == "OSError" and ("Address already in use" in case.text or "assign requested address" in case.text):
        remedy = "Leave the network to ROS; a node of this lab needs no socket of its own."
        return "address", f"A network address cannot be had: {case.text}.", remedy, ""
    return None


def _unknown(case: Case) -> Told:
    what = f"{case.name}: {case.text}" if case.text else case.name
    return (
        "exception",
        f"The program ends with {what[:MESSAGE_LENGTH].rstrip('.')}.",
        "Run it by hand and follow the traceback to the line named here.",
        case.name,
    )


RULES: tuple[Callable[[Case], Told | None], ...] = (
    _missing_module,
    _missing_name,
    _read_only_property,
    _hidden_property,
    _no_super_init,
    _not_initialised,
    _names,
    _parameters,
    _qos,
    _wrong_message,
    _field,
    _syntax,
    _logging,
    _undefined,
    _none,
    _attribute,
    _arguments,
    _values,
    _system,
)

"""The tap: notes the endpoints that a student's node requests from rclpy, with their source lines.

The tap changes five things of a program: the number of cores that Python reports, the time at which modules are imported
that ROS 2 itself seldom uses (NumPy is most of a third of a node's start), the number of look-ups of a file's path
by rclpy's logger, `with rclpy.init():`, which works and is noted on a ROS 2 that does not know it yet, and the
session's own variables, such as ROS_DOMAIN_ID, which keep their values.

Discovery carries neither history nor depth, and no lines. The tap therefore wraps a few methods of rclpy's classes when
their modules are imported, and writes one JSON line a call to the descriptor in GRADER_TAP_FD: a claim, no evidence.
Programs that the node's process starts, such as workers of `multiprocessing`, open the same pipe by GRADER_TAP_PIPE.

Two signals make `faulthandler` write the stacks of the process to the same pipe, for the line at which a program hangs.
This works while the program holds the interpreter's lock, waits in a library, or handles other signals itself.
"""

import _signal
import builtins
import faulthandler
import importlib.machinery
import json
import os
import sys


def _descriptor():
    """Return the descriptor of the tap's pipe, or -1 if there is none."""
    descriptor = int(os.environ.pop("GRADER_TAP_FD", "-1"))
    if descriptor >= 0:
        os.set_inheritable(descriptor, False)
        os.environ["GRADER_TAP_PIPE"] = f"/proc/{os.getpid()}/fd/{descriptor}"
        return descriptor
    try:
        return os.open(os.environ.get("GRADER_TAP_PIPE", ""), os.O_WRONLY)
    except OSError:
        return -1


_STARTED = "GRADER_TAP_FD" in os.environ
_FD = _descriptor()
_LIMIT = 1000
#: Variables of the session: the first characters of their names, and value by name.
_SESSIONS = json.loads(os.environ.get("GRADER_SESSION_VARIABLES", "{}"))
_PREFIXES = tuple(_SESSIONS.get("prefixes", ()))
_VALUES = _SESSIONS.get("values", {})
#: Signals for the stacks of all threads and of the main thread alone; `stacks.py` beside this folder sends them.
_ALL_THREADS, _MAIN_THREAD = _signal.SIGRTMAX - 4, _signal.SIGRTMAX - 5
_LATE = vars(builtins).copy()
#: Message in the type of each service, six of them in a node; only introspection uses it.
_EACH_NODES = "service_msgs.msg._service_event_info"
#: Module -> class -> method -> kind of the note, and the argument with its name.
_WRAPPED = {
    "rclpy.node": {
        "Node": {
            "create_publisher": ("publisher", "topic"),
            "create_subscription": ("subscription", "topic"),
            "create_service": ("service", "srv_name"),
            "create_client": ("client", "srv_name"),
            "create_timer": ("timer", "timer_period_sec"),
            "declare_parameter": ("parameter", "name"),
        }
    },
    "rclpy.action.server": {"ActionServer": {"__init__": ("action", "action_name")}},
    "rclpy.action.client": {"ActionClient": {"__init__": ("action_client", "action_name")}},
}


def _qos_of(value):
    if isinstance(value, int):
        return {
            "history": "keep_last",
            "depth": value,
            "reliability": "reliable",
            "durability": "volatile",
        }
    return {
        "history": value.history.name.lower(),
        "depth": int(value.depth),
        "reliability": value.reliability.name.lower(),
        "durability": value.durability.name.lower(),
    }


def _type_of(value):
    module = getattr(value, "__module__", "")
    if not module:
        return ""
    package_and_folder = module.split(".")[:2]
    return "/".join([*package_and_folder, getattr(value, "__name__", "")])


def _note(kind, name, node, arguments):
    global _LIMIT
    frame = sys._getframe(2)  # frame of the caller of the wrapped method
    file = frame.f_code.co_filename
    if _LIMIT <= 0 or "/rclpy/" in file:  # Endpoints that rclpy itself requests are skipped.
        return
    _LIMIT -= 1
    note = {"kind": kind, "file": file, "line": frame.f_lineno}
    note["node"] = node.get_fully_qualified_name()
    note["name"] = str(arguments.get(name, ""))[:500]
    for key in ("msg_type", "srv_type", "action_type"):
        if key in arguments:
            note["type"] = _type_of(arguments[key])
    if "qos_profile" in arguments:
        note["qos"] = _qos_of(arguments["qos_profile"])
    if kind == "parameter":
        value = arguments.get("value")
        note["value"] = value if isinstance(value, (bool, int, float, str)) else repr(value)[:200]
    os.write(_FD, (json.dumps(note) + "\n").encode())


def _wrap(cls, method, kind, name):
    import functools
    import inspect

    original = getattr(cls, method)
    signature = inspect.signature(original)

    @functools.wraps(original)
    def noted(self, *args, **kwargs):
        result = original(self, *args, **kwargs)
        try:
            bound = signature.bind(self, *args, **kwargs)
            # An action's server or client is given its node.
            _note(kind, name, bound.arguments.get("node", self), bound.arguments)
        except Exception:
            pass  # The tap never disturbs the node.
        return result

    setattr(cls, method, noted)


class _Later:
    """Stands for a module within a module of ROS 2, and imports it at its first use."""

    def __init__(self, name):
        self._name = name

    def __getattr__(self, name):
        return getattr(importlib.import_module(self._name), name)


def _import_late(name, *args, **kwargs):
    if name in ("numpy", "yaml") and name not in sys.modules:
        found = importlib.machinery.PathFinder.find_spec(name)
        is_students = found is None or not str(found.origin).startswith((sys.prefix, "/usr/"))
        if not is_students:
            return _Later(name)
    return builtins.__import__(name, *args, **kwargs)


def _exec_late(module, exec_module):
    """Execute a module of ROS 2 with late imports."""
    module.__builtins__ = _LATE
    exec_module(module)
    # A program that requests an endpoint of such a message will need NumPy: better now than in a callback.
    if isinstance(vars(module).get("numpy"), _Later) and module.__name__ != _EACH_NODES:
        for cls in list(vars(module).values()):
            if "__import_type_support__" in getattr(cls, "__dict__", ()):
                _import_before(cls, cls.__import_type_support__)


def _import_before(cls, original):
    cls.__import_type_support__ = lambda: (importlib.import_module("numpy"), original())


def _remember_files(logger):
    """Let rclpy's logger look up each file once; a look-up for each message takes nine tenths of a message's CPU time."""
    import functools
    import inspect
    import types

    info = lambda frame: types.SimpleNamespace(filename=frame.f_code.co_filename)  # noqa: E731
    logger.inspect = types.SimpleNamespace(currentframe=inspect.currentframe, getframeinfo=info)
    path = {name: functools.cache(getattr(os.path, name)) for name in ("abspath", "realpath")}
    logger.os = types.SimpleNamespace(path=types.SimpleNamespace(**path))


class _Initialised:
    """Context manager that a newer `rclpy.init` returns: it shuts down at its end."""

    def __init__(self, rclpy):
        self._rclpy = rclpy

    def __enter__(self):
        frame = sys._getframe(1)
        note = {"kind": "newer_idiom", "file": frame.f_code.co_filename, "line": frame.f_lineno}
        note.update(name="with rclpy.init()", node="")
        os.write(_FD, (json.dumps(note) + "\n").encode())
        return self

    def __exit__(self, *problem):
        self._rclpy.try_shutdown()


def _give_context_manager(rclpy):
    """Let `rclpy.init` return a context manager where the ROS 2 of this machine returns None."""
    import functools

    init = rclpy.init

    @functools.wraps(init)
    def initialised(*args, **kwargs):
        result = init(*args, **kwargs)
        if result is None:
            return _Initialised(rclpy)
        return result

    rclpy.init = initialised


def _keep_sessions_variables(module):
    """Let each context of rclpy have the session's domain, RMW and settings of DDS."""
    import functools

    init = module.Context.init

    @functools.wraps(init)
    def initialised(self, *args, **kwargs):
        _restore_variables()
        domain = kwargs.get("domain_id")
        if isinstance(domain, int):
            del kwargs["domain_id"]
            if str(domain) != _VALUES.get("ROS_DOMAIN_ID"):
                _note_variable("ROS_DOMAIN_ID", str(domain))
        return init(self, *args, **kwargs)

    module.Context.init = initialised


def _restore_variables():
    """Give the session's variables their values again, and note each other value."""
    for name, value in list(os.environ.items()):
        if not name.startswith(_PREFIXES):
            continue
        if _VALUES.get(name) != value:
            _note_variable(name, value)
            del os.environ[name]
    os.environ.update(_VALUES)


def _is_loading(file):
    """Tell whether a file is the tap, rclpy, or Python's own code for imports."""
    if "/rclpy/" in file:
        return True
    return file.startswith(("<frozen ", __file__))


def _note_variable(name, value):
    """Note a value in the program, with the nearest line outside of rclpy."""
    frame = sys._getframe(1)
    while _is_loading(frame.f_code.co_filename):
        frame = frame.f_back
    note = {"kind": "session_variable", "file": frame.f_code.co_filename, "line": frame.f_lineno}
    note.update(name=name[:100], node="", value=value[:200])
    os.write(_FD, (json.dumps(note) + "\n").encode())


#: Module -> its change once it is there.
_CHANGED = {
    "rclpy": _give_context_manager,
    "rclpy.context": _keep_sessions_variables,
    "rclpy.impl.rcutils_logger": _remember_files,
}


class _NodeFinder:
    def find_spec(self, name, path, target=None):
        if name == "rclpy":
            _restore_variables()  # Its libraries read RMW_IMPLEMENTATION when they are loaded.
        # Finding a module imports its packages, which can be in _WRAPPED too.
        wrapped = _WRAPPED.pop(name, {})
        late = name == "rclpy.parameter" or ".msg._" in name
        changed = _CHANGED.get(name)
        if not wrapped and not late and changed is None:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is None or spec.loader is None:
            return spec
        exec_module = spec.loader.exec_module

        def exec_and_wrap(module):
            if late:
                _exec_late(module, exec_module)
            else:
                exec_module(module)
            for cls, methods in wrapped.items():
                for method, (kind, argument) in methods.items():
                    _wrap(getattr(module, cls), method, kind, argument)
            if changed is not None:
                changed(module)

        spec.loader.exec_module = exec_and_wrap
        return spec


def _keep_cores():
    """Report the cores of the start for ever, and never a single one.

    The grader holds a program to one core once its node is there. A `MultiThreadedExecutor()` that is made later would have
    one thread, on which an action that waits would wait for ever.
    """
    now = os.sched_getaffinity
    at_start = now(0) if len(now(0)) > 1 else {0, 1}
    os.sched_getaffinity = lambda pid, /: set(at_start) if pid in (0, os.getpid()) else now(pid)


def _generate_py(*args, **kwargs):
    """Generate code. All messages import this, and with it a parser, an eighth of a node's start; no node calls it."""
    del sys.modules[_generator.__name__]
    return importlib.import_module(_generator.__name__).generate_py(*args, **kwargs)


def _name_sources():
    """Compile a module behind a link under the path of its source, so that tracebacks and notes name that file."""
    loader = importlib.machinery.SourceFileLoader
    compiled = loader.source_to_code

    def source_to_code(self, data, path, *args, **kwargs):
        if os.path.islink(path):  # noqa: PTH114
            path = os.path.realpath(path)
        return compiled(self, data, path, *args, **kwargs)

    loader.source_to_code = source_to_code


def _find_installed():
    """Let installed modules be found, as PYTHONPATH would; a module of the tap's own cannot be one of them."""
    folder = os.environ.get("GRADER_INSTALLED", "")
    if os.path.isdir(folder):  # noqa: PTH112
        place = sys.path.index(__file__.rpartition("/")[0]) + 1
        sys.path.insert(place, folder)
        _name_sources()


def _answer_for_stacks():
    """Write stacks when the grader asks for them."""
    faulthandler.register(_ALL_THREADS, file=_FD, all_threads=True)
    faulthandler.register(_MAIN_THREAD, file=_FD, all_threads=False)


_keep_cores()
_LATE["__import__"] = _import_late
_generator = sys.modules["rosidl_generator_py.generate_py_impl"] = type(sys)(
    "rosidl_generator_py.generate_py_impl"
)
_generator.generate_py = _generate_py
if _STARTED:
    # Python itself has started: whatever happens from here on is the student's doing.
    os.write(_FD, b'{"kind": "started"}\n')
if _FD >= 0:
    _answer_for_stacks()
    sys.meta_path.insert(0, _NodeFinder())
_find_installed()

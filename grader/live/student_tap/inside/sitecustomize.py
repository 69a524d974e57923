"""The tap: notes what a student's node asks rclpy for, with its source line.

It changes nothing but how many cores a program is told of, when modules are imported that ROS 2 itself seldom uses
(NumPy is most of a third of a node's start), and how often rclpy's logger looks up where a file lies.

Discovery carries neither history nor depth, and no lines. So it wraps a few methods of rclpy's classes when their
modules are imported, and writes one JSON line a call to the descriptor named by GRADER_TAP_FD: a claim, no evidence.
Programs that the node's process starts, such as those of `multiprocessing`, open the same pipe by GRADER_TAP_PIPE.
"""

import builtins
import importlib.machinery
import json
import os
import sys


def _descriptor():
    """Return the descriptor of the tap's pipe, or -1 without one."""
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
_LATE = vars(builtins).copy()
#: In the type of each service, of which each node has six, but used by introspection alone.
_EACH_NODES = "service_msgs.msg._service_event_info"
# Module -> class -> method -> kind of the note, and the argument that is its name.
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
    return "/".join([*module.split(".")[:2], getattr(value, "__name__", "")]) if module else ""


def _note(kind, name, node, arguments):
    global _LIMIT
    frame = sys._getframe(2)  # that of the code which called the wrapped method
    file, line = frame.f_code.co_filename, frame.f_lineno
    if _LIMIT <= 0 or "/rclpy/" in file:  # What rclpy asks of itself is of no interest.
        return
    _LIMIT -= 1
    note = {"kind": kind, "file": file, "line": line, "node": node.get_fully_qualified_name()}
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
    """Stands for a module within one of ROS 2's, and imports it once it is used."""

    def __init__(self, name):
        self._name = name

    def __getattr__(self, name):
        return getattr(importlib.import_module(self._name), name)


def _import_late(name, *args, **kwargs):
    if name in ("numpy", "yaml") and name not in sys.modules:
        found = importlib.machinery.PathFinder.find_spec(name)
        if found is not None and str(found.origin).startswith(
            (sys.prefix, "/usr/")
        ):  # and not the student's own
            return _Later(name)
    return builtins.__import__(name, *args, **kwargs)


def _exec_late(module, exec_module):
    """Execute a module of ROS 2 that is to import others late."""
    module.__builtins__ = _LATE
    exec_module(module)
    # Who asks for an endpoint of such a message will need NumPy: better now than in a callback.
    if isinstance(vars(module).get("numpy"), _Later) and module.__name__ != _EACH_NODES:
        for cls in [
            cls
            for cls in vars(module).values()
            if "__import_type_support__" in getattr(cls, "__dict__", ())
        ]:
            _import_before(cls, cls.__import_type_support__)


def _import_before(cls, original):
    cls.__import_type_support__ = lambda: (importlib.import_module("numpy"), original())


def _remember_files(logger):
    """Let rclpy's logger look up a file once: doing so for each message is nine tenths of a message's CPU time."""
    import functools
    import inspect
    import types

    info = lambda frame: types.SimpleNamespace(filename=frame.f_code.co_filename)  # noqa: E731
    logger.inspect = types.SimpleNamespace(currentframe=inspect.currentframe, getframeinfo=info)
    path = {name: functools.cache(getattr(os.path, name)) for name in ("abspath", "realpath")}
    logger.os = types.SimpleNamespace(path=types.SimpleNamespace(**path))


class _NodeFinder:
    def find_spec(self, name, path, target=None):
        # Finding one imports the packages that it is in, which may be another of them.
        wrapped, late = _WRAPPED.pop(name, {}), name == "rclpy.parameter" or ".msg._" in name
        logs = name == "rclpy.impl.rcutils_logger"
        if not wrapped and not late and not logs:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is None or spec.loader is None:
            return spec
        exec_module = spec.loader.exec_module

        def exec_and_wrap(module):
            _exec_late(module, exec_module) if late else exec_module(module)
            for cls, methods in wrapped.items():
                for method, (kind, argument) in methods.items():
                    _wrap(getattr(module, cls), method, kind, argument)
            if logs:
                _remember_files(module)

        spec.loader.exec_module = exec_and_wrap
        return spec


def _keep_cores():
    """Tell the cores that there were at the start, and never a single one.

    Once its node is seen, the grader holds a program to one core. A `MultiThreadedExecutor()` that was made after that
    had one thread, in which an action that waits waits for ever.
    """
    now = os.sched_getaffinity
    at_start = now(0) if len(now(0)) > 1 else {0, 1}
    os.sched_getaffinity = lambda pid, /: set(at_start) if pid in (0, os.getpid()) else now(pid)


def _generate_py(*args, **kwargs):
    """Generate code. All messages import this, and with it a parser: an eighth of a node's start, and none calls it."""
    del sys.modules[_generator.__name__]
    return importlib.import_module(_generator.__name__).generate_py(*args, **kwargs)


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
    sys.meta_path.insert(0, _NodeFinder())

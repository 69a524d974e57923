"""The tap: notes what a student's node asks rclpy for, with its source line.

It changes nothing but how many cores a program is told of, and when the generator of Python code is imported.

Discovery carries neither history nor depth, and no lines. So it wraps a few methods of rclpy's classes when their
modules are imported, and writes one JSON line a call to the descriptor named by GRADER_TAP_FD: a claim, no evidence.
"""

import importlib.machinery
import json
import os
import sys

_FD = int(os.environ.pop("GRADER_TAP_FD", "-1"))
_LIMIT = 1000
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
        return {"history": "keep_last", "depth": value, "reliability": "reliable", "durability": "volatile"}
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


class _NodeFinder:
    def find_spec(self, name, path, target=None):
        # Finding one imports the packages that it is in, which may be another of them.
        wrapped = _WRAPPED.pop(name, None)
        if wrapped is None:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is None or spec.loader is None:
            return spec
        exec_module = spec.loader.exec_module

        def exec_and_wrap(module):
            exec_module(module)
            for cls, methods in wrapped.items():
                for method, (kind, argument) in methods.items():
                    _wrap(getattr(module, cls), method, kind, argument)

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
_generator = sys.modules["rosidl_generator_py.generate_py_impl"] = type(sys)("rosidl_generator_py.generate_py_impl")
_generator.generate_py = _generate_py
if _FD >= 0:
    os.set_inheritable(_FD, False)
    # Python itself has started: whatever happens from here on is the student's doing.
    os.write(_FD, b'{"kind": "started"}\n')
    sys.meta_path.insert(0, _NodeFinder())

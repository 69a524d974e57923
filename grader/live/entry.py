"""Whether a Python file starts its node by itself, or is written for an entry point that calls a function of it.

Told from its syntax tree: students' code is not imported here.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence

from grader.python_source import parse_python

#: What only a program calls that runs a node.
_STARTING = frozenset(["spin", "spin_once", "spin_until_future_complete", "create_node", "MultiThreadedExecutor"])
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def function_to_call(text: str, entry_points: Sequence[str] = ()) -> str | None:
    """Return the function that must be called for the file to do anything; None where it runs by itself.

    Parameters
    ----------
    text : str
        The file.
    entry_points : sequence of str
        Functions of the file that the package's entry points name. Without any, `main` is meant.
    """
    try:
        tree = parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    defined = {n.name for n in tree.body if isinstance(n, _FUNCTIONS)}
    meant = next((name for name in (*entry_points, "main") if name in defined), None)
    return None if meant is None or _runs_by_itself(tree, meant) else meant


def _runs_by_itself(tree: ast.Module, function: str) -> bool:
    """Whether the file, run as a program, calls the function or starts a node in another way."""
    own = {n.name: n for n in tree.body if isinstance(n, (*_FUNCTIONS, ast.ClassDef))}
    callers: dict[str, list[str]] = {}
    waiting, starting = [function], set[str]()
    for name, node in own.items():
        at_once, called = _called(ast.walk(node))
        waiting += [name] if at_once else []
        for other in called:
            callers.setdefault(other, []).append(name)
    while waiting:
        name = waiting.pop()
        if name not in starting:
            starting.add(name)
            waiting += callers.get(name, ())
    statements = [n for n in tree.body if not isinstance(n, (*_FUNCTIONS, ast.ClassDef))]
    return any(_is_guard(n) or _starts(_outside_of_functions(n), starting) for n in statements)


def _starts(nodes: Iterator[ast.AST], starting: set[str]) -> bool:
    """Whether any of the nodes calls rclpy to run a node, or something that does."""
    at_once, called = _called(nodes)
    return at_once or not called.isdisjoint(starting)


def _called(nodes: Iterator[ast.AST]) -> tuple[bool, set[str]]:
    """Return whether rclpy is called to run a node, and the names of what else is called."""
    called: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Call):
            function = node.func
            name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
            of_rclpy = isinstance(function, ast.Attribute) and getattr(function.value, "id", "") == "rclpy"
            if name in _STARTING or (name == "init" and of_rclpy):
                return True, called
            if isinstance(function, ast.Name):
                called.add(name)
    return False, called


def _outside_of_functions(node: ast.AST) -> Iterator[ast.AST]:
    """Give a statement and what lies in it, without the bodies of functions that it defines."""
    waiting = [node]
    while waiting:
        each = waiting.pop()
        yield each
        if not isinstance(each, (*_FUNCTIONS, ast.ClassDef, ast.Lambda)):
            waiting += ast.iter_child_nodes(each)


def _is_guard(node: ast.stmt) -> bool:
    """Whether it is `if __name__ == ...`, under which a file says itself how it is run."""
    names = (n.id for n in ast.walk(node.test) if isinstance(n, ast.Name)) if isinstance(node, ast.If) else ()
    return "__name__" in names

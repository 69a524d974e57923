"""Whether a Python file starts its node by itself, or is written for an entry point that calls a function of it."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence

from grader.submission.python_source import parse_python

#: What only a program calls that runs a node.
_STARTING = frozenset(
    ["spin", "spin_once", "spin_until_future_complete", "create_node", "MultiThreadedExecutor"]
)
_RCLPY_INIT = "rclpy.init"
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def function_to_call(text: str, entry_points: Sequence[str] = ()) -> str | None:
    """Return the function that must be called for the file to do anything; None where it runs by itself.

    It is told from the syntax tree: students' code is not imported here. It is one of those that the package's entry
    points name, or `main`.
    """
    try:
        tree = parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    defined = [n for n in tree.body if isinstance(n, (*_FUNCTIONS, ast.ClassDef))]
    holding = {name: n for n in tree.body for name in _names_given_by(n)}
    usual = (
        []
        if isinstance(holding.get("main"), (ast.Import, ast.ImportFrom, ast.ClassDef))
        else ["main"]
    )
    meant = next(
        (name for name in (*entry_points, *usual) if name.partition(".")[0] in holding), None
    )
    statements = [n for n in tree.body if n not in defined and n is not holding.get(meant or "")]
    guards = (
        n
        for statement in statements
        if isinstance(statement, ast.If)
        for n in ast.walk(statement.test)
    )
    if meant is None or any(isinstance(n, ast.Name) and n.id == "__name__" for n in guards):
        return None  # Under `if __name__ == ...` a file says itself how it is run.
    callers: dict[str, list[str]] = {}
    for node in defined:
        for name in _called(ast.walk(node)):
            callers.setdefault(name, []).append(node.name)
    starting, waiting = set[str](), [meant, _RCLPY_INIT, *_STARTING]
    while waiting:
        if (name := waiting.pop()) not in starting:
            starting.add(name)
            waiting += callers.get(name, ())
    called = {name for n in statements for name in _called(_outside_of_functions(n))}
    return meant if starting.isdisjoint(called) else None


def _names_given_by(node: ast.stmt) -> list[str]:
    """Return the names that a statement of a module defines: a function may be made in other ways than by `def`."""
    if isinstance(node, (*_FUNCTIONS, ast.ClassDef)):
        return [node.name]
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        return [alias.asname or alias.name for alias in node.names]
    return [target.id for target in getattr(node, "targets", ()) if isinstance(target, ast.Name)]


def _called(nodes: Iterator[ast.AST]) -> set[str]:
    """Return the names of what is called: of methods those that run a node."""
    found = set()
    for function in (node.func for node in nodes if isinstance(node, ast.Call)):
        if isinstance(function, ast.Name):
            found.add(function.id)
        elif isinstance(function, ast.Attribute):
            found |= {function.attr} & _STARTING
            found |= {f"{getattr(function.value, 'id', '')}.{function.attr}"} & {_RCLPY_INIT}
    return found


def _outside_of_functions(node: ast.AST) -> Iterator[ast.AST]:
    """Give a statement and what lies in it, without the bodies of functions that it defines."""
    waiting = [node]
    while waiting:
        each = waiting.pop()
        yield each
        if not isinstance(each, (*_FUNCTIONS, ast.ClassDef, ast.Lambda)):
            waiting += ast.iter_child_nodes(each)

"""Finds out whether a Python file starts its node by itself, or is written for an entry point that calls a function."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Sequence

from grader.submission.python_source import parse_python

#: Methods and classes that only a program calls which runs a node.
_STARTING = frozenset(
    ["spin", "spin_once", "spin_until_future_complete", "create_node", "MultiThreadedExecutor"]
)
_RCLPY_INIT = "rclpy.init"
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
_NO_MAIN = (ast.Import, ast.ImportFrom, ast.ClassDef)


def function_to_call(text: str, entry_points: Sequence[str] = ()) -> str | None:
    """Return the function that must be called for the file to do anything; None if the file runs by itself.

    The function is one of the package's entry points, or `main`. It is found in the syntax tree, because students'
    code is not imported here.
    """
    try:
        tree = parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    holding = {name: node for node in tree.body for name in _names_given_by(node)}
    meant = _meant(holding, entry_points)
    if meant is None:
        return None
    defined = [node for node in tree.body if isinstance(node, (*_FUNCTIONS, ast.ClassDef))]
    statements = []
    for node in tree.body:
        if node not in defined and node is not holding.get(meant):
            statements.append(node)
    if _has_guard(statements):
        return None
    called: set[str] = set()
    for node in statements:
        called |= _called(_outside_of_functions(node))
    return meant if _starting(meant, defined).isdisjoint(called) else None


def _meant(holding: dict[str, ast.stmt], entry_points: Sequence[str]) -> str | None:
    """Return the first entry point that the file defines, or `main`."""
    for name in entry_points:
        if name.partition(".")[0] in holding:
            return name
    main = holding.get("main")
    return "main" if main is not None and not isinstance(main, _NO_MAIN) else None


def _has_guard(statements: Iterable[ast.stmt]) -> bool:
    """Return whether the file says itself how it is run, under `if __name__ == ...`."""
    for statement in statements:
        if isinstance(statement, ast.If):
            for node in ast.walk(statement.test):
                if isinstance(node, ast.Name) and node.id == "__name__":
                    return True
    return False


def _starting(
    meant: str, defined: Iterable[ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef]
) -> set[str]:
    """Return the names of functions that start a node: the function meant, rclpy's, and all their callers."""
    callers: dict[str, list[str]] = {}
    for node in defined:
        for name in _called(ast.walk(node)):
            callers.setdefault(name, []).append(node.name)
    starting: set[str] = set()
    waiting = [meant, _RCLPY_INIT, *_STARTING]
    while waiting:
        name = waiting.pop()
        if name not in starting:
            starting.add(name)
            waiting += callers.get(name, ())
    return starting


def _names_given_by(node: ast.stmt) -> list[str]:
    """Return the names that a statement of a module defines: a function may be made in other ways than by `def`."""
    if isinstance(node, (*_FUNCTIONS, ast.ClassDef)):
        return [node.name]
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        return [alias.asname or alias.name for alias in node.names]
    return [target.id for target in getattr(node, "targets", ()) if isinstance(target, ast.Name)]


def _called(nodes: Iterator[ast.AST]) -> set[str]:
    """Return the names of called functions, and of called methods that run a node."""
    found = set()
    for function in (node.func for node in nodes if isinstance(node, ast.Call)):
        if isinstance(function, ast.Name):
            found.add(function.id)
        elif isinstance(function, ast.Attribute):
            found |= {function.attr} & _STARTING
            found |= {f"{getattr(function.value, 'id', '')}.{function.attr}"} & {_RCLPY_INIT}
    return found


def _outside_of_functions(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a statement and all nodes in it, without the bodies of functions that it defines."""
    waiting = [node]
    while waiting:
        each = waiting.pop()
        yield each
        if not isinstance(each, (*_FUNCTIONS, ast.ClassDef, ast.Lambda)):
            waiting += ast.iter_child_nodes(each)

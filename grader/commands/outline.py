"""Outlines of the classes and functions for a lab's own checks: signatures and docstrings."""

from __future__ import annotations

import ast
import inspect
import textwrap
from typing import Any

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def own_api() -> dict[str, Any]:
    """Return the classes and functions of `grader.own_checks` with a source, such as `Context`, by their names."""
    from grader import own_checks

    found = {}
    for name, thing in vars(own_checks).items():
        is_made = inspect.isclass(thing) or inspect.isfunction(thing)
        if is_made and not name.startswith("_") and thing.__module__.startswith("grader."):
            found[name] = thing
    return found


def outline_of(thing: Any) -> str:
    """Return the outline of a class or a function."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(thing)))
    return outline(tree.body[0])


def outline(node: ast.stmt) -> str:
    """Return a definition without the bodies of functions and the private members of classes."""
    return ast.unparse(_outside(node))


def _outside(node: ast.stmt) -> ast.stmt:
    if isinstance(node, FUNCTIONS):
        node.body = node.body[:1] if ast.get_docstring(node) else [ast.Expr(ast.Constant(...))]
    elif isinstance(node, ast.ClassDef):
        node.body = [_outside(each) for each in node.body if not _name_of(each).startswith("_")]
    return node


def _name_of(node: ast.stmt) -> str:
    target = getattr(node, "target", node)
    return str(getattr(target, "name", getattr(target, "id", "")))

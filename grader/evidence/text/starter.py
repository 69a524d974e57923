"""Programs to which nobody has added anything: given files without a change, and files of empty functions."""

from __future__ import annotations

import ast
from collections.abc import Iterable

from grader.evidence.text.syntax import normalise, tree_of

_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def untouched(text: str, given: Iterable[str]) -> str:
    """Return why a program does nothing of its own, as the end of a sentence; empty if it does something.

    Comments, blank lines and the style of quotes make no difference.

    Examples
    --------
    A file that equals one of the `given` texts `is the file that the lab gave out, without a change`, and
    `class Talker(Node): pass` with `def main(): pass` `has only empty functions`.
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return ""
    program = ast.dump(tree)
    for other in given:
        same = tree_of(normalise(other))
        if same is not None and ast.dump(same) == program:
            return "is the file that the lab gave out, without a change"
    functions = [node for node in ast.walk(tree) if isinstance(node, _DEFINITIONS)]
    if functions and all(_is_empty(function.body) for function in functions):
        return "has only empty functions"
    return ""


def _is_empty(body: Iterable[ast.stmt]) -> bool:
    """Return whether statements are `pass`, texts, `...`, or a return of nothing."""
    for statement in body:
        match statement:
            case ast.Pass() | ast.Expr(value=ast.Constant()):
                pass
            case ast.Return(value=None | ast.Constant(value=None)):
                pass
            case _:
                return False
    return True

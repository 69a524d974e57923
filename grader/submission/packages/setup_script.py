"""Arguments of `setup()` in a `setup.py`, by parsing alone: the grader executes it in the sandbox of a build only.

Literals, sums of them and names with literal values are evaluated. Other expressions are not recognised; callers must
not count them against a student.
"""

from __future__ import annotations

import ast
from collections import Counter
from contextlib import suppress
from typing import Any

from grader.submission.python_source import parse_python

#: Characters of a text: more than of any path.
_LONGEST_TEXT = 4096


class NotRecognisedError(Exception):
    """Raised for an expression with a value that only execution can tell."""


def keyword_of_setup(text: str, name: str) -> Any:
    """Return the value of a keyword of the only call of `setup`, None if it is not given; tuples become lists.

    Parameters
    ----------
    text
        The script.
    name
        The keyword.

    Raises
    ------
    NotRecognisedError
        If only execution can tell the value, or if it is wrong.
    SyntaxError, ValueError, RecursionError, MemoryError
        If Python refuses the file.
    """
    tree = parse_python(text)
    setups = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _called(node) == "setup":
            setups.append(node)
    if len(setups) != 1:
        raise NotRecognisedError
    given = {keyword.arg: keyword.value for keyword in setups[0].keywords}
    if name in given:
        return _Script(tree).value(given[name])
    if None in given:
        raise NotRecognisedError
    return None


class _Script:
    """Values of expressions, with the names that have one value in the whole file."""

    def __init__(self, tree: ast.Module) -> None:
        self._names: dict[str, Any] = {}
        #: Numbers of assignments to each name, and of its occurrences.
        self._bound: Counter[str] = Counter()
        self._used: Counter[str] = Counter()
        for node in ast.walk(tree):
            self._count(node)
        for statement in tree.body:
            self._take(statement)

    def _count(self, node: ast.AST) -> None:
        if isinstance(node, ast.arg):
            self._bound[node.arg] += 1
        elif isinstance(node, ast.Name):
            self._used[node.id] += 1
            if not isinstance(node.ctx, ast.Load):
                self._bound[node.id] += 1

    def _take(self, statement: ast.stmt) -> None:
        """Keep the value of a name that is assigned once."""
        match statement:
            case ast.Assign(targets=[ast.Name(name)], value=value):
                pass
            case ast.AnnAssign(target=ast.Name(name), value=ast.expr() as value):
                pass
            case _:
                return
        if self._bound[name] != 1:
            return
        with suppress(NotRecognisedError):
            found = self.value(value)
            # Each use of a list can change it; its only use is the one in `setup()`.
            if isinstance(found, str) or self._used[name] == 2:
                self._names[name] = found

    def value(self, node: ast.expr | None) -> Any:
        try:
            value = self._evaluated(node)
        except (TypeError, ValueError, RecursionError, MemoryError) as problem:
            raise NotRecognisedError from problem
        if isinstance(value, str) and len(value) > _LONGEST_TEXT:
            raise NotRecognisedError
        return value

    def _evaluated(self, node: ast.expr | None) -> Any:
        value: Any
        match node:
            case ast.Constant(value=value):
                pass
            case ast.Name(id=name) if name in self._names:
                value = self._names[name]
            case ast.List(elts=items) | ast.Tuple(elts=items):
                value = list(map(self.value, items))
            case ast.Dict(keys=keys, values=values):
                value = dict(zip(map(self.value, keys), map(self.value, values), strict=True))
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                value = self.value(left) + self.value(right)
            case ast.JoinedStr(values=parts):
                value = "".join(str(self.value(part)) for part in parts)
            case ast.FormattedValue(value=inner, conversion=-1, format_spec=None):
                value = self.value(inner)
            case _:
                raise NotRecognisedError
        return value


def _called(call: ast.Call) -> str:
    """Return the name of a called function, without its module."""
    return getattr(call.func, "attr", "") or getattr(call.func, "id", "")

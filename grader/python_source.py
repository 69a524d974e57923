"""Python files of students, parsed and never run, within bounds of time; and the literal values in them."""

from __future__ import annotations

import ast
import re
from collections import Counter
from typing import Any

#: Replacement fields of one string: Python 3.11 takes time by the square of their number.
_MOST_FIELDS = 2000
_FORMATTED = re.compile(r"(?<![A-Za-z0-9_])(?:[fF][rR]?|[rR][fF])(\"\"\"|'''|\"|')")
#: Expressions, characters and elements that are looked at in one file: names that double each other have no end.
_MOST_IN_VALUES = 100_000


def parse_python(text: str) -> ast.Module:
    """Return the syntax tree of a file.

    Raises
    ------
    SyntaxError, ValueError, RecursionError, MemoryError
        If Python refuses it, or if it is nothing that anybody has written.
    """
    for opening in _FORMATTED.finditer(text):
        end = text.find(opening[1] if len(opening[1]) > 1 else "\n", opening.end())
        if text.count("{", opening.end(), end if end >= 0 else len(text)) > _MOST_FIELDS:
            raise ValueError("a string has too many replacement fields")
    return ast.parse(text)


class NotRecognisedError(Exception):
    """An expression whose value only running it could tell."""


class Literals:
    """Values of the expressions of a file that are as good as literals.

    These are constants, collections, sums and f-strings of such, a list made of another one, and names that the file
    binds once. A subclass says which names and calls of a library it knows.
    """

    def __init__(self, tree: ast.Module) -> None:
        self._left = _MOST_IN_VALUES
        self._assigned: dict[str, ast.expr] = {}
        self._bound = Counter[str]()
        for node in ast.walk(tree):
            self._note(node)

    def _note(self, node: ast.AST) -> None:
        """Note what is assigned to names, and which are bound again or changed in place."""
        match node:
            case ast.Assign(targets=[target], value=value) | ast.AnnAssign(target=target, value=ast.expr() as value):
                self._assigned[dotted(target)] = value
            case ast.arg(arg=name):
                self._bound[name] += 1
            case ast.Call(func=ast.Attribute(value=holder)):
                self._bound[dotted(holder)] += 2
            case _:
                pass
        if isinstance(getattr(node, "ctx", None), ast.Store | ast.Del):
            self._bound[dotted(node)] += 1
            if isinstance(node, ast.Attribute | ast.Subscript):
                self._bound[dotted(node.value)] += 2

    def known(self, name: str) -> Any:
        """Return the value of a dotted name that the file does not assign."""
        raise NotRecognisedError

    def called(self, name: str, given: list[Any], named: dict[str, Any]) -> Any:
        """Return what a call gives."""
        raise NotRecognisedError

    def value(self, node: ast.expr) -> Any:
        """Return the value of an expression; tuples and sets are lists.

        Raises
        ------
        NotRecognisedError
            If only running it would tell, or if it is wrong.
        """
        try:
            return self._value(node, {})
        except (TypeError, ValueError, RecursionError, MemoryError) as problem:
            raise NotRecognisedError from problem

    def _value(self, node: ast.expr, names: dict[str, Any]) -> Any:
        value = self._evaluated(node, names)
        self._left -= 1 + (len(value) if isinstance(value, str | list | dict) else 0)
        if self._left < 0:
            raise NotRecognisedError
        return value

    def _evaluated(self, node: ast.expr, names: dict[str, Any]) -> Any:
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name() | ast.Attribute():
                name = dotted(node)
                if name in names:
                    return names[name]
                if name in self._assigned:
                    return self._assigned_value(name)
                return self.known(name)
            case ast.List(elts=items) | ast.Tuple(elts=items) | ast.Set(elts=items):
                return [self._value(item, names) for item in items]
            case ast.Dict(keys=keys, values=values):
                given = [key for key in keys if key is not None]
                pairs = zip(given, values, strict=True)  # raises for {**other}
                return {self._value(key, names): self._value(value, names) for key, value in pairs}
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                return self._value(left, names) + self._value(right, names)
            case ast.JoinedStr(values=parts):
                return "".join(str(self._value(part, names)) for part in parts)
            case ast.FormattedValue(value=inner, conversion=-1, format_spec=None):
                return self._value(inner, names)
            case ast.ListComp(elt=element, generators=[ast.comprehension(ast.Name(target), items, [])]):
                return [self._value(element, {**names, target: item}) for item in self._value(items, names)]
            case ast.Call(func=function, args=arguments, keywords=keywords):
                given = [self._value(argument, names) for argument in arguments]
                named = {keyword.arg or "": self._value(keyword.value, names) for keyword in keywords}
                return self.called(dotted(function), given, named)
            case _:
                raise NotRecognisedError

    def _assigned_value(self, name: str) -> Any:
        if self._bound[name] != 1:
            raise NotRecognisedError
        return self._value(self._assigned[name], {})


def dotted(node: ast.AST) -> str:
    """Return a name with its points as it is written; empty for any other expression."""
    parts: list[str] = []
    while isinstance(node, ast.Attribute):
        parts.append(node.attr)
        node = node.value
    return ".".join([node.id, *reversed(parts)]) if isinstance(node, ast.Name) else ""

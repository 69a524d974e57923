"""Values of expressions in a `setup.py`, by parsing alone: what students write there is never executed.

Understood are literals, constants, f-strings, `+`, `%`, `.format()`, comprehensions over what is known, paths and
glob. Whatever only running it would tell is not understood, and it is for the caller to hold nothing against that.
"""

from __future__ import annotations

import ast
import fnmatch
import posixpath
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any

_MOST_DEPTH, _MOST_STEPS, _MOST_PARTS = 50, 5000, 12
#: Values that double each other, and lists of commands, would otherwise take without end.
_LONGEST_VALUE, _MOST_PATTERNS = 100_000, 100
#: Characters and elements of all values together.
_MOST_IN_VALUES = 1_000_000

_Names = Mapping[str, Any]


class NotUnderstoodError(Exception):
    """An expression that only running it could tell."""


#: What evaluating a text that is wrong, or made to do harm, may raise.
UNREADABLE = (
    NotUnderstoodError,
    SyntaxError,
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    AttributeError,
    OverflowError,
    RecursionError,
    MemoryError,
)


def keyword_of_setup(tree: ast.Module, name: str) -> ast.expr | None:
    """Return what is given for a keyword of the only call of `setup`, None if it is not given.

    Raises
    ------
    NotUnderstoodError
        If there is no such call, or several, or if keywords are given as `**something`.
    """
    calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call)]
    setups = [c for c in calls if (getattr(c.func, "id", None) or getattr(c.func, "attr", None)) == "setup"]
    if len(setups) != 1:
        raise NotUnderstoodError
    given = {keyword.arg: keyword.value for keyword in setups[0].keywords}
    if name not in given and None in given:
        raise NotUnderstoodError
    return given.get(name)


class SetupScript:
    """Evaluates expressions of a `setup.py`.

    Parameters
    ----------
    tree : ast.Module
        The file.
    paths : list of str
        The package's files, relative to its folder.
    """

    def __init__(self, tree: ast.Module, paths: list[str]) -> None:
        self._paths = paths
        self._constants: dict[str, ast.expr | None] = {}
        self._steps = self._patterns = self._in_values = 0
        for node in _of_the_file(tree):
            if isinstance(node, ast.Assign):
                for target in node.targets:
                    self._assign(target, node.value)
            elif isinstance(node, ast.AnnAssign):
                self._assign(node.target, node.value)
            elif isinstance(node, (ast.AugAssign, ast.For, ast.NamedExpr)):
                self._assign(node.target, None)
            elif isinstance(node, ast.Attribute) and node.attr in _CHANGING:
                self._forget(node)

    def _assign(self, target: ast.expr, value: ast.expr | None) -> None:
        for node in ast.walk(target):
            if isinstance(node, ast.Name):
                known = node.id not in self._constants and target is node
                self._constants[node.id] = value if known else None

    def _forget(self, node: ast.expr) -> None:
        """Take the name before attributes, elements and calls for one whose value is not known."""
        while isinstance(node, (ast.Attribute, ast.Subscript, ast.Call)):
            node = node.func if isinstance(node, ast.Call) else node.value
        if isinstance(node, ast.Name):
            self._constants[node.id] = None

    def value(self, node: ast.expr, names: _Names | None = None, depth: int = 0) -> Any:
        """Return the value of an expression.

        Parameters
        ----------
        names : mapping, optional
            Names that comprehensions around it have given values.

        Raises
        ------
        NotUnderstoodError
            If only running it would tell; other errors of `UNREADABLE` where it is wrong.
        """
        self._steps += 1
        if depth > _MOST_DEPTH or self._steps > _MOST_STEPS:
            raise NotUnderstoodError
        reader = _READERS.get(type(node))
        if reader is None:
            raise NotUnderstoodError
        value = reader(self, node, names or {}, depth + 1)
        self._in_values += len(value) if isinstance(value, (str, bytes, list, dict)) else 0
        if self._in_values > _MOST_IN_VALUES:
            raise NotUnderstoodError
        return value

    # -- one method a kind of expression --------------------------------------------------------

    def _constant(self, node: ast.Constant, names: _Names, depth: int) -> Any:
        return node.value

    def _name(self, node: ast.Name, names: _Names, depth: int) -> Any:
        if node.id in names:
            return names[node.id]
        meant = self._constants.get(node.id)
        if meant is None:
            raise NotUnderstoodError
        return self.value(meant, {}, depth)

    def _list(self, node: ast.List | ast.Tuple | ast.Set, names: _Names, depth: int) -> list[Any]:
        return [self.value(item, names, depth) for item in node.elts]

    def _dict(self, node: ast.Dict, names: _Names, depth: int) -> dict[Any, Any]:
        if None in node.keys:
            raise NotUnderstoodError
        pairs = zip(node.keys, node.values, strict=True)
        return {self.value(k, names, depth): self.value(v, names, depth) for k, v in pairs if k is not None}

    def _binary(self, node: ast.BinOp, names: _Names, depth: int) -> Any:
        left, right = self.value(node.left, names, depth), self.value(node.right, names, depth)
        if isinstance(node.op, ast.Mod):
            return self._formatted(left.replace("%s", "{}"), right if isinstance(right, list) else [right])
        if not isinstance(node.op, ast.Add) or len(left) + len(right) > _LONGEST_VALUE:
            raise NotUnderstoodError
        return left + right

    def _f_string(self, node: ast.JoinedStr, names: _Names, depth: int) -> str:
        parts = [p.value if isinstance(p, ast.FormattedValue) else p for p in node.values]
        if any(isinstance(p, ast.FormattedValue) and (p.format_spec or p.conversion != -1) for p in node.values):
            raise NotUnderstoodError
        return self._formatted("{}" * len(parts), [self.value(part, names, depth) for part in parts])

    def _choice(self, node: ast.IfExp, names: _Names, depth: int) -> Any:
        return self.value(node.body if self.value(node.test, names, depth) else node.orelse, names, depth)

    def _element(self, node: ast.Subscript, names: _Names, depth: int) -> Any:
        return self.value(node.value, names, depth)[self.value(node.slice, names, depth)]

    def _not(self, node: ast.UnaryOp, names: _Names, depth: int) -> Any:
        value = self.value(node.operand, names, depth)
        if isinstance(node.op, ast.Not):
            return not value
        if isinstance(node.op, ast.USub) and isinstance(value, int):
            return -value
        raise NotUnderstoodError

    def _first_of(self, node: ast.BoolOp, names: _Names, depth: int) -> Any:
        value = None
        for part in node.values:
            value = self.value(part, names, depth)
            if bool(value) is isinstance(node.op, ast.Or):
                break
        return value

    def _comparison(self, node: ast.Compare, names: _Names, depth: int) -> bool:
        left, right = self.value(node.left, names, depth), self.value(node.comparators[0], names, depth)
        comparison = _COMPARISONS.get(type(node.ops[0]))
        if comparison is None or len(node.ops) > 1:
            raise NotUnderstoodError
        return comparison(left, right)

    def _comprehension(self, node: ast.ListComp | ast.SetComp | ast.GeneratorExp, names: _Names, depth: int) -> Any:
        return [self.value(node.elt, each, depth) for each in self._each(node.generators, names, depth)]

    def _dict_comprehension(self, node: ast.DictComp, names: _Names, depth: int) -> Any:
        each = self._each(node.generators, names, depth)
        return {self.value(node.key, n, depth): self.value(node.value, n, depth) for n in each}

    def _each(self, loops: list[ast.comprehension], names: _Names, depth: int) -> Iterator[_Names]:
        """Give the names with each round of the loops."""
        if not loops:
            yield names
            return
        first, *others = loops
        for item in self.value(first.iter, names, depth):
            inner = {**names, **_unpacked(first.target, item)}
            if all(self.value(test, inner, depth) for test in first.ifs):
                yield from self._each(others, inner, depth)

    def _call(self, node: ast.Call, names: _Names, depth: int) -> Any:
        name = _dotted(node.func)
        given = [self.value(argument, names, depth) for argument in node.args]
        if name == "dict" and not given:
            return {k.arg: self.value(k.value, names, depth) for k in node.keywords if k.arg is not None}
        if node.keywords:
            raise NotUnderstoodError
        if name in ("os.path.join", "path.join", "join"):
            return posixpath.join(*given)
        if name in ("glob", "glob.glob") and len(given) == 1:
            return self._glob(given[0])
        if name in _FUNCTIONS:
            return _FUNCTIONS[name](*given)
        if isinstance(node.func, ast.Attribute):
            return self._method(self.value(node.func.value, names, depth), node.func.attr, given)
        raise NotUnderstoodError

    def _method(self, value: Any, name: str, given: list[Any]) -> Any:
        if name == "format":
            return self._formatted(value, given)
        if name in ("items", "keys", "values") and isinstance(value, dict) and not given:
            return [list(pair) for pair in value.items()] if name == "items" else list(getattr(value, name)())
        if not isinstance(value, str) or name not in _OF_TEXT or not all(isinstance(g, (str, list)) for g in given):
            raise NotUnderstoodError
        if name in ("join", "replace") and _size(value, given) > _LONGEST_VALUE:
            raise NotUnderstoodError
        return getattr(value, name)(*given)

    def _formatted(self, template: str, given: list[Any]) -> str:
        parts = template.split("{}")
        if len(parts) != len(given) + 1 or any(c in part for part in parts for c in "{}%"):
            raise NotUnderstoodError
        if not all(isinstance(value, (str, int, float)) for value in given):
            raise NotUnderstoodError
        whole = [a + str(b) for a, b in zip(parts, [*given, ""], strict=True)]
        if sum(map(len, whole)) > _LONGEST_VALUE:
            raise NotUnderstoodError
        return "".join(whole)

    def _glob(self, pattern: str) -> list[str]:
        wanted = posixpath.normpath(pattern).split("/")
        self._patterns += 1
        if len(wanted) > _MOST_PARTS or self._patterns > _MOST_PATTERNS:
            raise NotUnderstoodError
        return [path for path in self._paths if _fits(wanted, path.split("/"))]


#: Methods that change a list in place, after which its literal says nothing.
_CHANGING = ("append", "extend", "insert", "remove", "pop", "update")
_OF_TEXT = ("join", "replace", "removeprefix", "removesuffix", "strip", "lower", "upper", "startswith", "endswith")
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "list": list,
    "sorted": sorted,
    "tuple": list,
    "str": lambda value: value if isinstance(value, str) else "",
    "zip": lambda *lists: [list(row) for row in zip(*lists, strict=False)],
    "enumerate": lambda values: [list(pair) for pair in enumerate(values)],
    "os.path.basename": posixpath.basename,
    "os.path.splitext": lambda path: list(posixpath.splitext(path)),
}
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: lambda a, b: bool(a == b),
    ast.NotEq: lambda a, b: bool(a != b),
    ast.In: lambda a, b: bool(a in b),
    ast.NotIn: lambda a, b: bool(a not in b),
}
_READERS: Mapping[type[ast.expr], Callable[..., Any]] = {
    ast.Constant: SetupScript._constant,
    ast.Name: SetupScript._name,
    ast.List: SetupScript._list,
    ast.Tuple: SetupScript._list,
    ast.Set: SetupScript._list,
    ast.Dict: SetupScript._dict,
    ast.BinOp: SetupScript._binary,
    ast.JoinedStr: SetupScript._f_string,
    ast.IfExp: SetupScript._choice,
    ast.Subscript: SetupScript._element,
    ast.UnaryOp: SetupScript._not,
    ast.BoolOp: SetupScript._first_of,
    ast.Compare: SetupScript._comparison,
    ast.ListComp: SetupScript._comprehension,
    ast.SetComp: SetupScript._comprehension,
    ast.GeneratorExp: SetupScript._comprehension,
    ast.DictComp: SetupScript._dict_comprehension,
    ast.Call: SetupScript._call,
}


def _of_the_file(tree: ast.Module) -> Iterator[ast.AST]:
    """Give each node but those within functions and classes: names there are not those of the file."""
    waiting = deque[ast.AST]([tree])
    while waiting:
        node = waiting.popleft()
        yield node
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)):
            waiting.extend(ast.iter_child_nodes(node))


def _dotted(node: ast.expr) -> str:
    """Return a name with points as it is written; empty for any other expression."""
    parts: list[str] = []
    while isinstance(node, ast.Attribute):
        parts.append(node.attr)
        node = node.value
    return ".".join([node.id, *reversed(parts)]) if isinstance(node, ast.Name) else ""


def _unpacked(target: ast.expr, item: Any) -> dict[str, Any]:
    """Return the names that a loop's target gets from an item."""
    if isinstance(target, ast.Name):
        return {target.id: item}
    if not isinstance(target, (ast.Tuple, ast.List)) or not isinstance(item, list) or len(item) != len(target.elts):
        raise NotUnderstoodError
    names: dict[str, Any] = {}
    for part, value in zip(target.elts, item, strict=True):
        names.update(_unpacked(part, value))
    return names


def _size(value: str, given: list[Any]) -> int:
    """Return the most characters that joining or replacing can give."""
    texts = [text for each in given for text in (each if isinstance(each, list) else [each])]
    longest = max((len(text) for text in texts), default=0)
    return (len(value) + 1) * (longest + 1) + sum(len(text) + len(value) for text in texts)


def _fits(wanted: list[str], path: list[str]) -> bool:
    """Whether a path has the form of a pattern; part by part, so that many `**` take no longer than one."""
    wanted = [part for part, before in zip(wanted, [None, *wanted], strict=False) if not part == before == "**"]
    reached = {0}  # how many parts of the pattern may be used up
    for part in path:
        ahead = {n for n in reached if n < len(wanted) and wanted[n] == "**"}
        reached |= {n + 1 for n in ahead}
        reached = ahead | {n + 1 for n in reached if n < len(wanted) and _is_like(part, wanted[n])}
    return len(wanted) in reached


def _is_like(part: str, wanted: str) -> bool:
    hidden = part.startswith(".") and not wanted.startswith(".")
    return wanted != "**" and not hidden and fnmatch.fnmatchcase(part, wanted)

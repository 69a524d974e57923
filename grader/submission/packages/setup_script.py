"""What a `setup.py` hands to `setup()`, by parsing alone: what students write there is never executed.

Read are literals, names that stand for them, and the few calls that installing is written with. Whatever else there is
only running it would tell, and it is for the caller to hold nothing against that.
"""

from __future__ import annotations

import ast
import fnmatch
import posixpath
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from grader.submission.python_source import parse_python

#: Patterns in one file, and characters of a text: more than of any path.
_MOST_PATTERNS, _LONGEST_TEXT = 100, 4096


class NotRecognisedError(Exception):
    """An expression whose value only running it could tell."""


def keyword_of_setup(text: str, name: str, paths: Sequence[str]) -> Any:
    """Return the value of a keyword of the only call of `setup`, None if it is not given; tuples are lists.

    The paths are those of the package's files, relative to its folder. Raises NotRecognisedError if only running it
    would tell, or if it is wrong; SyntaxError, ValueError, RecursionError or MemoryError if Python refuses the file.
    """
    tree = parse_python(text)
    setups = [
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and _called(node) == "setup"
    ]
    if len(setups) != 1:
        raise NotRecognisedError
    given = {keyword.arg: keyword.value for keyword in setups[0].keywords}
    if name not in given and None in given:
        raise NotRecognisedError
    return _Script(tree, paths).value(given[name]) if name in given else None


def data_files_of_setup(text: str, paths: Sequence[str]) -> dict[str, str] | None:
    """Return which files `data_files` installs: path below the prefix -> path below the package.

    None if it is not recognised.
    """
    installed: dict[str, str] = {}
    try:
        for folder, files in keyword_of_setup(text, "data_files", paths) or []:
            if not isinstance(folder, str) or not isinstance(files, list):
                return None
            for file in files:
                target = posixpath.normpath(posixpath.join(folder, posixpath.basename(file)))
                installed[target] = posixpath.normpath(file)
    except (NotRecognisedError, SyntaxError, ValueError, TypeError, RecursionError, MemoryError):
        return None
    return installed


class _Script:
    """Values of expressions, with the names that the file gives one value and does not change."""

    def __init__(self, tree: ast.Module, paths: Sequence[str]) -> None:
        self._paths = paths
        self._patterns = 0
        self._names: dict[str, Any] = {}
        names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
        bound = Counter(node.id for node in names if not isinstance(node.ctx, ast.Load))
        bound.update(node.arg for node in ast.walk(tree) if isinstance(node, ast.arg))
        used = Counter(node.id for node in names)
        for statement in tree.body:
            match statement:
                case (
                    ast.Assign(targets=[ast.Name(name)], value=value)
                    | ast.AnnAssign(target=ast.Name(name), value=ast.expr() as value)
                ) if bound[name] == 1:
                    with suppress(NotRecognisedError):
                        found = self.value(value)
                        # A list can be changed wherever it is used, unless that is the one use in `setup()`.
                        if isinstance(found, str) or used[name] == 2:
                            self._names[name] = found
                case _:
                    pass

    def value(self, node: ast.expr | None) -> Any:
        try:
            value = self._evaluated(node)
        except (TypeError, ValueError, RecursionError, MemoryError) as problem:
            raise NotRecognisedError from problem
        if isinstance(value, str) and len(value) > _LONGEST_TEXT:
            raise NotRecognisedError
        return value

    def _evaluated(self, node: ast.expr | None) -> Any:
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name) if name in self._names:
                return self._names[name]
            case ast.List(elts=items) | ast.Tuple(elts=items):
                return [self.value(item) for item in items]
            case ast.Dict(keys=keys, values=values):
                return {
                    self.value(key): self.value(value)
                    for key, value in zip(keys, values, strict=True)
                }
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                return self.value(left) + self.value(right)
            case ast.JoinedStr(values=parts):
                return "".join(str(self.value(part)) for part in parts)
            case ast.FormattedValue(value=inner, conversion=-1, format_spec=None):
                return self.value(inner)
            case ast.Call(args=arguments, keywords=[]) if (name := _called(node)) in (
                "join",
                "sorted",
                "glob",
            ):
                calls: dict[str, Callable[..., Any]] = {
                    "join": posixpath.join,
                    "sorted": sorted,
                    "glob": self._globbed,
                }
                return calls[name](*map(self.value, arguments))
            case _:
                raise NotRecognisedError

    def _globbed(self, pattern: str) -> list[str]:
        """Return the files that fit; each part of a path is tried alone, which takes no long time."""
        wanted = posixpath.normpath(pattern).split("/")
        self._patterns += 1
        if "**" in wanted or self._patterns > _MOST_PATTERNS:
            raise NotRecognisedError
        split = ((path, path.split("/")) for path in self._paths)
        return [
            path
            for path, parts in split
            if len(parts) == len(wanted) and all(map(_fits, parts, wanted))
        ]


def _called(call: ast.Call) -> str:
    """Return the name of what is called, without that of its module."""
    return getattr(call.func, "attr", "") or getattr(call.func, "id", "")


def _fits(part: str, wanted: str) -> bool:
    hidden = part.startswith(".") and not wanted.startswith(".")
    return not hidden and fnmatch.fnmatchcase(part, wanted)

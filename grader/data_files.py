"""Which of a package's files `colcon build` would install into its share folder, read by parsing alone.

`setup.py` says so in `data_files`, `CMakeLists.txt` in `install(DIRECTORY ...)` and `install(FILES ...)`. What is
written in a way that this reader does not follow is None, and then nothing is held against the student.
"""

from __future__ import annotations

import ast
import fnmatch
import posixpath
import re
from typing import Any

_MOST_DEPTH, _MOST_STEPS, _MOST_PARTS = 50, 5000, 12
#: Values that double each other, and lists of commands, would otherwise take without end.
_LONGEST_VALUE, _MOST_NAMES, _MOST_PATTERNS = 100_000, 500, 100


class _NotUnderstoodError(Exception):
    """An expression that only running it could tell."""


def data_files_of_setup(text: str, paths: list[str]) -> dict[str, str] | None:
    """Evaluate `data_files` of a `setup.py`: literals, constants, `+`, f-strings, os.path.join, glob.

    Parameters
    ----------
    text : str
        The file.
    paths : list of str
        The package's files, relative to its folder.

    Returns
    -------
    dict or None
        Path below the prefix -> path below the package; None if it is not understood.
    """
    try:
        tree = ast.parse(text)
        given = _keyword_of_setup(tree)
        if given is None:
            return {}
        entries = _Reader(tree, paths).value(given)
        return _laid_out(entries)
    except (SyntaxError, ValueError, TypeError, AttributeError, OverflowError, RecursionError, MemoryError):
        return None
    except _NotUnderstoodError:
        return None


def _keyword_of_setup(tree: ast.Module) -> ast.expr | None:
    calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call)]
    setups = [c for c in calls if (getattr(c.func, "id", None) or getattr(c.func, "attr", None)) == "setup"]
    if len(setups) != 1:
        raise _NotUnderstoodError
    given = {keyword.arg: keyword.value for keyword in setups[0].keywords}
    if "data_files" not in given and None in given:
        raise _NotUnderstoodError
    return given.get("data_files")


def _laid_out(entries: Any) -> dict[str, str]:
    installed: dict[str, str] = {}
    for folder, files in entries:
        if not isinstance(folder, str) or isinstance(files, str):
            raise _NotUnderstoodError
        for file in files:
            target = posixpath.normpath(posixpath.join(folder, posixpath.basename(file)))
            installed[target] = posixpath.normpath(file)
    return installed


class _Reader:
    """Evaluates expressions of a `setup.py`."""

    def __init__(self, tree: ast.Module, paths: list[str]) -> None:
        self._paths = paths
        self._names: dict[str, ast.expr | None] = {}
        self._steps = self._patterns = 0
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign):
                for target in node.targets:
                    self._assign(target, node.value)
            elif isinstance(node, (ast.AugAssign, ast.AnnAssign, ast.For, ast.NamedExpr)):
                self._assign(node.target, None)
            elif isinstance(node, ast.Attribute) and node.attr in ("append", "extend", "insert", "remove", "pop"):
                self._assign(node.value, None)

    def _assign(self, target: ast.expr, value: ast.expr | None) -> None:
        for node in ast.walk(target):
            if isinstance(node, ast.Name):
                known = node.id not in self._names and target is node
                self._names[node.id] = value if known else None

    def value(self, node: ast.expr, depth: int = 0) -> Any:
        """The value of an expression."""
        self._steps += 1
        if depth > _MOST_DEPTH or self._steps > _MOST_STEPS:
            raise _NotUnderstoodError
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name):
            meant = self._names.get(node.id)
            if meant is not None:
                return self.value(meant, depth + 1)
        elif isinstance(node, (ast.List, ast.Tuple)):
            return [self.value(item, depth + 1) for item in node.elts]
        elif isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Add, ast.Mod)):
            left, right = self.value(node.left, depth + 1), self.value(node.right, depth + 1)
            if isinstance(node.op, ast.Add):
                if len(left) + len(right) > _LONGEST_VALUE:
                    raise _NotUnderstoodError
                return left + right
            return self._formatted(left.replace("%s", "{}"), right if isinstance(right, list) else [right])
        elif isinstance(node, ast.JoinedStr):
            parts = [p.value if isinstance(p, ast.FormattedValue) else p for p in node.values]
            return self._formatted("{}" * len(parts), [self.value(part, depth + 1) for part in parts])
        elif isinstance(node, ast.Call):
            return self._call(node, depth)
        raise _NotUnderstoodError

    def _call(self, node: ast.Call, depth: int) -> Any:
        name = ast.unparse(node.func)
        given = [self.value(argument, depth + 1) for argument in node.args]
        if name in ("os.path.join", "path.join", "join"):
            return posixpath.join(*given)
        if name in ("glob", "glob.glob", "sorted", "list") and len(given) == 1:
            return self._glob(given[0]) if "glob" in name else given[0]
        if isinstance(node.func, ast.Attribute) and node.func.attr == "format" and not node.keywords:
            return self._formatted(self.value(node.func.value, depth + 1), given)
        raise _NotUnderstoodError

    def _formatted(self, template: str, given: list[str]) -> str:
        parts = template.split("{}")
        if len(parts) != len(given) + 1 or any(c in part for part in parts for c in "{}%"):
            raise _NotUnderstoodError
        whole = [a + str(b) for a, b in zip(parts, [*given, ""], strict=True)]
        if sum(map(len, whole)) > _LONGEST_VALUE:
            raise _NotUnderstoodError
        return "".join(whole)

    def _glob(self, pattern: str) -> list[str]:
        wanted = posixpath.normpath(pattern).split("/")
        self._patterns += 1
        if len(wanted) > _MOST_PARTS or self._patterns > _MOST_PATTERNS:
            raise _NotUnderstoodError
        return [path for path in self._paths if _fits(wanted, path.split("/"))]


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


_COMMAND = re.compile(r"\b(install|ament_auto_package)\s*\(([^()]{0,10000})\)", re.IGNORECASE)


def data_files_of_cmake(text: str, package: str, paths: list[str]) -> dict[str, str] | None:
    """Read `install(DIRECTORY ...)`, `install(FILES ...)` and `ament_auto_package(INSTALL_TO_SHARE ...)`.

    Parameters
    ----------
    text : str
        `CMakeLists.txt`.
    package : str
        The package's name.
    paths : list of str
        The package's files, relative to its folder.

    Returns
    -------
    dict or None
        Path below the prefix -> path below the package; None if it is not understood.
    """
    installed: dict[str, str] = {}
    named = 0
    text = re.sub(r"#[^\n]*", "", text).replace("${PROJECT_NAME}", package)
    text = re.sub(r"\$\{(CMAKE_CURRENT_SOURCE_DIR|CMAKE_SOURCE_DIR|PROJECT_SOURCE_DIR)\}/", "", text)
    for command, inside in _COMMAND.findall(text):
        words = [word.strip('"') for word in inside.split()]
        if command.lower() == "ament_auto_package":
            at = words.index("INSTALL_TO_SHARE") + 1 if "INSTALL_TO_SHARE" in words else len(words)
            names, destination, kind = words[at:], f"share/{package}", "DIRECTORY"
        elif words[:1] in (["DIRECTORY"], ["FILES"]) and "DESTINATION" in words[:-1]:
            at = words.index("DESTINATION")
            names, destination, kind = words[1:at], words[at + 1], words[0]
            if kind == "DIRECTORY" and {"PATTERN", "REGEX", "FILES_MATCHING"} & set(words):
                return None
        else:
            continue
        named += len(names)
        if named > _MOST_NAMES or any("$" in word for word in (*names, destination)):
            return None
        for name in names:
            installed.update(_copied(name, kind, destination, paths))
    return installed


def _copied(name: str, kind: str, destination: str, paths: list[str]) -> dict[str, str]:
    if kind == "FILES":
        return {posixpath.join(destination, posixpath.basename(name)): name} if name in paths else {}
    root = posixpath.normpath(name)
    above = root if name.endswith("/") else posixpath.dirname(root)
    inside = [path for path in paths if root == "." or path == root or path.startswith(f"{root}/")]
    below = 0 if above in ("", ".") else len(above) + 1
    return {posixpath.join(destination, path[below:]): path for path in inside}

"""What a `setup.py` hands to `setup()`, by parsing alone: what students write there is never executed.

Understood are literals, names and sums of them, paths that are joined, and glob. Whatever only running it would tell
is not recognised, and it is for the caller to hold nothing against that.
"""

from __future__ import annotations

import ast
import fnmatch
import posixpath
from collections.abc import Sequence
from typing import Any

from grader.python_source import Literals, NotRecognisedError, dotted, parse_python

_MOST_PATTERNS = 100


def keyword_of_setup(text: str, name: str, paths: Sequence[str]) -> Any:
    """Return the value of a keyword of the only call of `setup`, None if it is not given.

    Parameters
    ----------
    text : str
        The file.
    paths : sequence of str
        The package's files, relative to its folder.

    Raises
    ------
    NotRecognisedError
        If only running it would tell.
    SyntaxError, ValueError, RecursionError, MemoryError
        If Python refuses the file.
    """
    tree = parse_python(text)
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    setups = [call for call in calls if dotted(call.func).rpartition(".")[2] == "setup"]
    if len(setups) != 1:
        raise NotRecognisedError
    given = {keyword.arg: keyword.value for keyword in setups[0].keywords}
    if name not in given and None in given:
        raise NotRecognisedError
    return _SetupScript(tree, paths).value(given[name]) if name in given else None


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


class _SetupScript(Literals):
    def __init__(self, tree: ast.Module, paths: Sequence[str]) -> None:
        super().__init__(tree)
        self._paths = paths
        self._patterns = 0

    def called(self, name: str, given: list[Any], named: dict[str, Any]) -> Any:
        """Return what a call gives of the few that installing is written with."""
        if name == "dict" and not given and "" not in named:
            return named
        if named:
            raise NotRecognisedError
        if name in ("os.path.join", "path.join", "join"):
            return posixpath.join(*given)
        if name == "sorted":
            return sorted(*given)
        if name in ("glob", "glob.glob"):
            return self._globbed(*given)
        raise NotRecognisedError

    def _globbed(self, pattern: str) -> list[str]:
        """Return the files that fit; each part of a path is tried alone, which takes no long time."""
        wanted = posixpath.normpath(pattern).split("/")
        self._patterns += 1
        if "**" in wanted or self._patterns > _MOST_PATTERNS:
            raise NotRecognisedError
        split = ((path, path.split("/")) for path in self._paths)
        return [path for path, parts in split if len(parts) == len(wanted) and all(map(_fits, parts, wanted))]


def _fits(part: str, wanted: str) -> bool:
    hidden = part.startswith(".") and not wanted.startswith(".")
    return not hidden and fnmatch.fnmatchcase(part, wanted)

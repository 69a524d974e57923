"""Which of a package's files `colcon build` would install into its share folder, read by parsing alone.

`setup.py` says so in `data_files`, `CMakeLists.txt` in `install(DIRECTORY ...)` and `install(FILES ...)`. What is
written in a way that this reader does not follow is None, and then nothing is held against the student.
"""

from __future__ import annotations

import posixpath
from typing import Any

from grader.cmake_script import commands_of
from grader.python_source import parse_python
from grader.setup_script import UNREADABLE, NotUnderstoodError, SetupScript, keyword_of_setup

_MOST_NAMES = 500


def data_files_of_setup(text: str, paths: list[str]) -> dict[str, str] | None:
    """Evaluate `data_files` of a `setup.py`.

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
        tree = parse_python(text)
        given = keyword_of_setup(tree, "data_files")
        return _laid_out(SetupScript(tree, paths).value(given)) if given is not None else {}
    except UNREADABLE:
        return None


def _laid_out(entries: Any) -> dict[str, str]:
    installed: dict[str, str] = {}
    for folder, files in entries:
        if not isinstance(folder, str) or isinstance(files, str):
            raise NotUnderstoodError
        for file in files:
            target = posixpath.normpath(posixpath.join(folder, posixpath.basename(file)))
            installed[target] = posixpath.normpath(file)
    return installed


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
    for command in commands_of(text, package, paths):
        words = list(command.words)
        if command.name == "ament_auto_package":
            at = words.index("INSTALL_TO_SHARE") + 1 if "INSTALL_TO_SHARE" in words else len(words)
            names, destination, kind = words[at:], f"share/{package}", "DIRECTORY"
        elif command.name == "install" and words[:1] in (["DIRECTORY"], ["FILES"]) and "DESTINATION" in words[:-1]:
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

"""Programs that a `CMakeLists.txt` installs or compiles, by parsing alone.

Variables of `set` are substituted. A word that still has a `$` depends on CMake itself, as values of loops and patterns
do; callers must not count such a word against a student.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

_COMMAND = re.compile(r"\b([A-Za-z_]\w*)\s*\(([^()]{0,10000})\)")
_WORD = re.compile(r'"([^"]*)"|(\S+)')
_VARIABLE = re.compile(r"\$\{(\w+)\}")
_HERE = re.compile(
    r"\$\{(?:CMAKE_CURRENT_SOURCE_DIR|CMAKE_CURRENT_LIST_DIR|CMAKE_SOURCE_DIR|PROJECT_SOURCE_DIR)\}(/?)"
)
_MOST_COMMANDS = 2000
_MOST_WORDS = 500
_LONGEST_WORD = 1000
#: Commands that change a variable in an unknown way, with the index of its name.
_CHANGING = {"list": 1, "file": 1, "foreach": 0}
_KINDS = ("DIRECTORY", "FILES", "PROGRAMS")
#: Words that select files of a folder.
_SELECTING = frozenset({"PATTERN", "REGEX", "FILES_MATCHING"})


@dataclass(frozen=True)
class _Command:
    """A command that installs files or folders."""

    #: "DIRECTORY", "FILES" or "PROGRAMS".
    kind: str
    names: list[str]
    #: Folder below the prefix.
    folder: str
    #: All words of the command.
    words: list[str]
    #: New name of a single file; empty if the file keeps its name.
    new_name: str = ""

    @property
    def is_unknown(self) -> bool:
        """True if only CMake can tell the installed files."""
        if self.kind == "DIRECTORY" and not _SELECTING.isdisjoint(self.words):
            return True
        return any("$" in word for word in (*self.names, self.folder))


def programs_of(text: str, package: str, paths: Sequence[str]) -> Iterator[dict[str, str] | None]:
    """Yield the files that each command installs in the folder that `ros2 run` searches.

    Yields path below the prefix, and path below the package, which may be missing; None if only CMake can tell.

    Parameters
    ----------
    text
        The script.
    package
        Name of the package.
    paths
        The package's files, relative to its folder.
    """
    named = 0
    for name, words in commands_of(text, package):
        command = _installing(name, words)
        if command is None:
            continue
        named += len(command.names)
        if command.kind == "PROGRAMS" or command.folder.strip("/") == f"lib/{package}":
            is_known = named <= _MOST_WORDS and not command.is_unknown
            yield _files_of(command, paths) if is_known else None


#: Commands that compile an executable; its name is the first word.
_COMPILING = ("add_executable", "ament_auto_add_executable")
#: Endings of source files that a compiler reads.
COMPILED_SUFFIXES = (".c", ".cc", ".cpp", ".cxx")


def compiled_executables(text: str, package: str) -> dict[str, str]:
    """Return the executables that a `CMakeLists.txt` compiles, with their first source file.

    A name that only CMake can tell has a `$`. The source is empty if the command names none.

    Examples
    --------
    >>> compiled_executables("add_executable(talker src/talker.c src/text.c)", "arm")
    {'talker': 'src/talker.c'}
    """
    found: dict[str, str] = {}
    for name, words in commands_of(text, package):
        if name in _COMPILING:
            for executable in words[:1]:
                found.setdefault(executable, _first_source(words[1:]))
        elif name == "rclcpp_components_register_node":
            for word, following in pairwise(words):
                if word == "EXECUTABLE":
                    found.setdefault(following, "")
    return found


def _first_source(words: Sequence[str]) -> str:
    for word in words:
        if word.endswith(COMPILED_SUFFIXES):
            return posixpath.normpath(word)
    return ""


def _installing(name: str, words: list[str]) -> _Command | None:
    """Return a command that installs; None for another one."""
    if name != "install" or not words or words[0] not in _KINDS:
        return None
    if "DESTINATION" not in words[:-1]:
        return None
    at = words.index("DESTINATION")
    new_name = ""
    if "RENAME" in words[at:-1]:
        new_name = words[words.index("RENAME") + 1]
    return _Command(words[0], words[1:at], words[at + 1], words, new_name)


def _files_of(command: _Command, paths: Sequence[str]) -> dict[str, str]:
    """Return the files that a command copies: path below the prefix, and path below the package."""
    copied: dict[str, str] = {}
    for name in command.names:
        if command.kind == "DIRECTORY":
            copied.update(_files_in(name, command.folder, paths))
        else:
            copied.update(_file(name, command.folder))
    if len(copied) == 1 and command.new_name:
        target = posixpath.join(command.folder, command.new_name)
        (file,) = copied.values()
        return {target: file}
    return copied


def _files_in(name: str, folder: str, paths: Sequence[str]) -> dict[str, str]:
    """Return the files of a copied folder; the folder itself if it has none."""
    root = posixpath.normpath(name)
    inside = list(paths)
    if root != ".":
        inside = [path for path in paths if path.startswith(f"{root}/")]
    if not inside:
        return _file(name, folder)
    above = root if name.endswith("/") else posixpath.dirname(root)
    skipped = 0 if above in ("", ".") else len(above) + 1
    copied = {}
    for path in inside:
        copied[posixpath.join(folder, path[skipped:])] = path
    return copied


def _file(name: str, folder: str) -> dict[str, str]:
    path = posixpath.normpath(name)
    return {posixpath.join(folder, posixpath.basename(path)): path}


def commands_of(text: str, package: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the commands in order: name in lower case, and words without quotation marks, with variables substituted.

    `${PROJECT_NAME}` is the package's name.
    """
    text = re.sub(r"#[^\n]*", "", text)
    text = _HERE.sub(lambda match: "" if match[1] else ".", text)
    variables: dict[str, list[str]] = {"PROJECT_NAME": [package]}
    for command, inside in _COMMAND.findall(text)[:_MOST_COMMANDS]:
        name = command.lower()
        words = _words(inside, variables)
        yield name, words
        if name == "set" and words:
            variables[words[0]] = words[1:]
        elif name in _CHANGING and len(words) > _CHANGING[name]:
            variables.pop(words[_CHANGING[name]], None)


def _words(inside: str, variables: dict[str, list[str]]) -> list[str]:
    found: list[str] = []
    for quoted, bare in _WORD.findall(inside)[:_MOST_WORDS]:
        whole = _VARIABLE.fullmatch(bare)
        if whole is not None and whole[1] in variables:
            found += variables[whole[1]]
        else:
            found.append(_substituted(quoted or bare, variables))
    return found[:_MOST_WORDS]


def _substituted(word: str, variables: dict[str, list[str]]) -> str:
    """Return a word with the values of its variables that hold one word each."""

    def value(match: re.Match[str]) -> str:
        words = variables.get(match[1], [])
        return words[0] if len(words) == 1 else match[0]

    return _VARIABLE.sub(value, word[:_LONGEST_WORD])[:_LONGEST_WORD]

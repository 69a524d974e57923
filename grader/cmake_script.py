"""What a `CMakeLists.txt` installs, by parsing alone.

Variables that `set` gives are put in. A word that keeps a `$` holds something that only CMake could tell, such as what
loops and patterns give; it is for the caller to hold nothing against that.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

_COMMAND = re.compile(r"\b([A-Za-z_]\w*)\s*\(([^()]{0,10000})\)")
_WORD = re.compile(r'"([^"]*)"|(\S+)')
_VARIABLE = re.compile(r"\$\{(\w+)\}")
_HERE = re.compile(r"\$\{(?:CMAKE_CURRENT_SOURCE_DIR|CMAKE_CURRENT_LIST_DIR|CMAKE_SOURCE_DIR|PROJECT_SOURCE_DIR)\}(/?)")
_MOST_COMMANDS, _MOST_WORDS, _LONGEST_WORD = 2000, 500, 1000
#: Commands after which nothing is known of the variable that they name in this place.
_CHANGING = {"list": 1, "file": 1, "foreach": 0}


@dataclass(frozen=True)
class Command:
    """A command in lower case, and its words without their quotation marks."""

    name: str
    words: tuple[str, ...]


def commands_of(text: str, package: str) -> Iterator[Command]:
    """Give the commands of a package's `CMakeLists.txt` in order, with variables put in."""
    text = _HERE.sub(lambda match: "" if match[1] else ".", re.sub(r"#[^\n]*", "", text))
    variables: dict[str, list[str]] = {"PROJECT_NAME": [package]}
    for name, inside in _COMMAND.findall(text)[:_MOST_COMMANDS]:
        command = Command(name.lower(), tuple(_words(inside, variables)))
        yield command
        if command.name == "set" and command.words:
            variables[command.words[0]] = list(command.words[1:])
        elif command.name in _CHANGING and len(command.words) > _CHANGING[command.name]:
            variables.pop(command.words[_CHANGING[command.name]], None)


def _words(inside: str, variables: dict[str, list[str]]) -> list[str]:
    found: list[str] = []
    for quoted, bare in _WORD.findall(inside)[:_MOST_WORDS]:
        whole = _VARIABLE.fullmatch(bare)
        if whole is not None and whole[1] in variables:
            found += variables[whole[1]]
        else:
            found.append(_put_in(quoted or bare, variables))
    return found[:_MOST_WORDS]


def _put_in(word: str, variables: dict[str, list[str]]) -> str:
    """Return a word with the variables in it that hold one word each."""

    def value(match: re.Match[str]) -> str:
        words = variables.get(match[1], [])
        return words[0] if len(words) == 1 else match[0]

    return _VARIABLE.sub(value, word[:_LONGEST_WORD])[:_LONGEST_WORD]


def data_files_of_cmake(text: str, package: str, paths: Sequence[str]) -> dict[str, str] | None:
    """Return which of a package's files `install` and `ament_auto_package(INSTALL_TO_SHARE ...)` copy.

    Path below the prefix -> path below the package; None if it is not recognised.
    """
    installed: dict[str, str] = {}
    named = 0
    for command in commands_of(text, package):
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
        if named > _MOST_WORDS or any("$" in word for word in (*names, destination)):
            return None
        for name in names:
            installed.update(_copied(name, kind, destination, paths))
    return installed


def _copied(name: str, kind: str, destination: str, paths: Sequence[str]) -> dict[str, str]:
    if kind == "FILES":
        return {posixpath.join(destination, posixpath.basename(name)): name} if name in paths else {}
    root = posixpath.normpath(name)
    above = root if name.endswith("/") else posixpath.dirname(root)
    inside = [path for path in paths if root == "." or path == root or path.startswith(f"{root}/")]
    below = 0 if above in ("", ".") else len(above) + 1
    return {posixpath.join(destination, path[below:]): path for path in inside}

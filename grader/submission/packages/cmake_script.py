"""What a `CMakeLists.txt` installs, by parsing alone.

Variables that `set` gives are put in. A word that keeps a `$` holds something that only CMake could tell, such as what
loops and patterns give; it is for the caller to hold nothing against that.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

_COMMAND = re.compile(r"\b([A-Za-z_]\w*)\s*\(([^()]{0,10000})\)")
_WORD = re.compile(r'"([^"]*)"|(\S+)')
_VARIABLE = re.compile(r"\$\{(\w+)\}")
_HERE = re.compile(
    r"\$\{(?:CMAKE_CURRENT_SOURCE_DIR|CMAKE_CURRENT_LIST_DIR|CMAKE_SOURCE_DIR|PROJECT_SOURCE_DIR)\}(/?)"
)
_MOST_COMMANDS, _MOST_WORDS, _LONGEST_WORD = 2000, 500, 1000
#: Commands after which nothing is known of the variable that they name in this place.
_CHANGING = {"list": 1, "file": 1, "foreach": 0}


class Installed(NamedTuple):
    """What one command installs: path below the prefix -> path below the package, whether it is there or not.

    `files` is None where that is not recognised. `is_programs` is whether it goes to where `ros2 run` looks.
    """

    is_programs: bool
    files: dict[str, str] | None


def installs_of(text: str, package: str, paths: Sequence[str]) -> Iterator[Installed]:
    """Give what the `install` and `ament_auto_package(INSTALL_TO_SHARE ...)` commands of a `CMakeLists.txt` copy.

    The paths are those of the package's files, relative to its folder.
    """
    named = 0
    for name, words in commands_of(text, package):
        kind, at = words[0] if words else "", len(words)
        if name == "ament_auto_package" and "INSTALL_TO_SHARE" in words:
            kind, names, folder = (
                "DIRECTORY",
                words[words.index("INSTALL_TO_SHARE") + 1 :],
                f"share/{package}",
            )
        elif (
            name == "install"
            and kind in ("DIRECTORY", "FILES", "PROGRAMS")
            and "DESTINATION" in words[:-1]
        ):
            at = words.index("DESTINATION")
            names, folder = words[1:at], words[at + 1]
        else:
            continue
        named += len(names)
        unknown = named > _MOST_WORDS or any("$" in word for word in (*names, folder))
        unknown |= kind == "DIRECTORY" and not {"PATTERN", "REGEX", "FILES_MATCHING"}.isdisjoint(
            words
        )
        is_programs = kind == "PROGRAMS" or folder.strip("/") == f"lib/{package}"
        copied = (
            {}
            if unknown
            else {target: file for n in names for target, file in _copied(n, kind, folder, paths)}
        )
        if len(copied) == 1 and "RENAME" in words[at:-1]:
            copied = {
                posixpath.join(folder, words[words.index("RENAME") + 1]): file
                for file in copied.values()
            }
        yield Installed(is_programs, None if unknown else copied)


def commands_of(text: str, package: str) -> Iterator[tuple[str, list[str]]]:
    """Give the commands in order: name in lower case, and words without their quotation marks, with variables put in.

    `${PROJECT_NAME}` is the package's name.
    """
    text = _HERE.sub(lambda match: "" if match[1] else ".", re.sub(r"#[^\n]*", "", text))
    variables: dict[str, list[str]] = {"PROJECT_NAME": [package]}
    for command, inside in _COMMAND.findall(text)[:_MOST_COMMANDS]:
        name, words = command.lower(), _words(inside, variables)
        yield name, words
        if name == "set" and words:
            variables[words[0]] = words[1:]
        elif len(words) > _CHANGING.get(name, len(words)):
            variables.pop(words[_CHANGING[name]], None)


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


def _copied(name: str, kind: str, folder: str, paths: Sequence[str]) -> Iterator[tuple[str, str]]:
    root = posixpath.normpath(name)
    inside = (
        [path for path in paths if root == "." or path.startswith(f"{root}/")]
        if kind == "DIRECTORY"
        else []
    )
    above = root if name.endswith("/") else posixpath.dirname(root)
    for path in inside or [root]:
        below = path if not inside or above in ("", ".") else path[len(above) + 1 :]
        yield posixpath.join(folder, below if inside else posixpath.basename(path)), path

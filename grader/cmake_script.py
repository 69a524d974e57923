"""The commands of a `CMakeLists.txt` with their words, by parsing alone.

Variables that `set`, `list(APPEND ...)`, `file(GLOB ...)` and `foreach` give are put in; a word that keeps a `$` holds
something that only CMake could tell.
"""

from __future__ import annotations

import fnmatch
import posixpath
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

_COMMAND = re.compile(r"\b([A-Za-z_]\w*)\s*\(([^()]{0,10000})\)")
_WORD = re.compile(r'"([^"]*)"|(\S+)')
_VARIABLE = re.compile(r"\$\{(\w+)\}")
_HERE = re.compile(r"\$\{(?:CMAKE_CURRENT_SOURCE_DIR|CMAKE_CURRENT_LIST_DIR|CMAKE_SOURCE_DIR|PROJECT_SOURCE_DIR)\}(/?)")
_MOST_COMMANDS, _MOST_WORDS, _LONGEST_WORD = 2000, 500, 1000
_MOST_PATTERNS, _DEEPEST_LOOP = 40, 20
#: Characters of commands that are read, those in loops each time.
_MOST_CHARACTERS = 500_000


@dataclass(frozen=True)
class Command:
    """A command in lower case, and its words without their quotation marks."""

    name: str
    words: tuple[str, ...]


def commands_of(text: str, package: str, paths: Sequence[str]) -> list[Command]:
    """Return the commands of a `CMakeLists.txt` in order, with variables and loops put in.

    Parameters
    ----------
    package : str
        The package's name, for ``${PROJECT_NAME}``.
    paths : sequence of str
        The package's files, relative to its folder.
    """
    text = _HERE.sub(lambda match: "" if match[1] else ".", re.sub(r"#[^\n]*", "", text))
    raw = [(name.lower(), inside) for name, inside in _COMMAND.findall(text)][:_MOST_COMMANDS]
    reader = _Reader({"PROJECT_NAME": [package]}, paths)
    return list(reader.read(raw))


class _Reader:
    """Follows the variables from command to command."""

    def __init__(self, variables: dict[str, list[str]], paths: Sequence[str]) -> None:
        self._variables = variables
        self._paths = paths
        self._read = self._patterns = self._characters = 0

    def read(self, raw: Sequence[tuple[str, str]], depth: int = 0) -> Iterator[Command]:
        """Give the commands, those in loops for each value; what is in too many loops is left out."""
        at = 0
        while at < len(raw) and self._read < _MOST_COMMANDS:
            self._read += 1
            name, inside = raw[at]
            at += 1
            self._characters += len(inside)
            if self._characters > _MOST_CHARACTERS:
                return
            words = self._words(inside)
            if name == "foreach":
                end = _end_of_loop(raw, at)
                yield from self._loop(words, raw[at:end], depth + 1)
                at = end + 1
            elif not self._takes(name, words):
                yield Command(name, tuple(words[:_MOST_WORDS]))

    def _loop(self, words: list[str], body: Sequence[tuple[str, str]], depth: int) -> Iterator[Command]:
        if not words or depth > _DEEPEST_LOOP:
            return
        values = [w for w in words[1:] if w not in ("IN", "ITEMS", "LISTS")]
        if "LISTS" in words[1:3]:
            values = [value for name in values for value in self._variables.get(name, [f"${{{name}}}"])]
        for value in values[:_MOST_WORDS]:
            self._variables[words[0]] = [value]
            yield from self.read(body, depth)

    def _takes(self, name: str, words: list[str]) -> bool:
        """Take over what a command says of variables, and tell whether it was about them alone."""
        if name == "set" and words:
            self._variables[words[0]] = words[1 : 1 + _MOST_WORDS]
        elif name == "list" and words[:1] == ["APPEND"] and len(words) > 1:
            self._variables[words[1]] = [*self._variables.get(words[1], []), *words[2:]][:_MOST_WORDS]
        elif name == "file" and words[:1] in (["GLOB"], ["GLOB_RECURSE"]) and len(words) > 1:
            self._variables[words[1]] = self._globbed(words[2:], deep=words[0] == "GLOB_RECURSE")
        else:
            return False
        return True

    def _globbed(self, words: list[str], *, deep: bool) -> list[str]:
        if "RELATIVE" in words:
            at = words.index("RELATIVE")
            words = words[:at] + words[at + 2 :]
        patterns = [posixpath.normpath(w) for w in words if w != "CONFIGURE_DEPENDS"]
        patterns = patterns[: _MOST_PATTERNS - self._patterns]
        self._patterns += len(patterns)
        return [path for path in self._paths if any(_is_like(path, pattern, deep) for pattern in patterns)]

    def _words(self, inside: str) -> list[str]:
        found: list[str] = []
        for quoted, bare in _WORD.findall(inside):
            word = quoted or bare
            whole = _VARIABLE.fullmatch(word)
            if whole is not None and whole[1] in self._variables and not quoted:
                found += self._variables[whole[1]]
            else:
                found.append(_VARIABLE.sub(lambda m: _put_in(m, self._variables), word)[:_LONGEST_WORD])
            if len(found) > 2 * _MOST_WORDS:
                break
        return found


def _put_in(match: re.Match[str], variables: Mapping[str, list[str]]) -> str:
    """Return a variable's value, or the variable itself where nothing is known of it."""
    if match[1] not in variables:
        return match[0]
    # Of a long list no more than is kept: it may be put in thousands of times.
    kept, length = [], 0
    for word in variables[match[1]]:
        kept.append(word)
        length += len(word) + 1
        if length > _LONGEST_WORD:
            break
    return ";".join(kept)[:_LONGEST_WORD]


def _end_of_loop(raw: Sequence[tuple[str, str]], start: int) -> int:
    """Return the place of the `endforeach` that belongs to the loop whose body starts here."""
    depth = 1
    for at in range(start, len(raw)):
        depth += {"foreach": 1, "endforeach": -1}.get(raw[at][0], 0)
        if not depth:
            return at
    return len(raw)


def _is_like(path: str, pattern: str, deep: bool) -> bool:
    folder, name = posixpath.split(pattern)
    place, file = posixpath.split(path)
    there = place == folder or (deep and (not folder or place.startswith(f"{folder}/")))
    return there and fnmatch.fnmatchcase(file, name)

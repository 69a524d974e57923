"""Texts that are hard for a regular expression: matches of each of its repetitions, over and over."""

from __future__ import annotations

import random
import re
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any

#: Internal form of a pattern in `re`.
_NEWER = sys.version_info >= (3, 11)
codes: Any = import_module("re._constants" if _NEWER else "sre_constants")
parser: Any = import_module("re._parser" if _NEWER else "sre_parse")

#: The three parts of a text: its beginning, its repeated part, and its end.
Parts = tuple[str, str, str]

_REPEATS = (codes.MAX_REPEAT, codes.MIN_REPEAT)
#: A repetition of fewer than these costs no more than it costs.
_MANY = 8
_LETTERS = "a1 -.é_\"([{<:=\n\t/'`,;A\x00"
_ENDS = ("", "\x00", "\na")
_CLASSES = {
    codes.CATEGORY_DIGIT: r"\d",
    codes.CATEGORY_NOT_DIGIT: r"\D",
    codes.CATEGORY_SPACE: r"\s",
    codes.CATEGORY_NOT_SPACE: r"\S",
    codes.CATEGORY_WORD: r"\w",
    codes.CATEGORY_NOT_WORD: r"\W",
}


def hard_texts(pattern: str, flags: int) -> list[Parts]:
    """Return texts that a pattern may take long for; the same ones each time."""
    tree, chance = list(parser.parse(pattern, flags)), random.Random(pattern)
    found = {("", _sample(tree, chance), end) for end in _ENDS}
    for before, body in _repetitions(tree, []):
        for _ in range(2):
            begin, once = _sample(before, chance), _sample(body, chance)
            mixed = "".join(_sample(body, chance) for _ in range(6))
            again = [
                (begin, once),
                (begin, mixed),
                ("", begin),
                ("", once),
                ("", begin + once),
                ("", f"{once}\n"),
            ]
            found |= {(first, repeated, end) for first, repeated in again for end in _ENDS}
    return sorted(parts for parts in found if parts[1])


def _repetitions(
    items: Sequence[Any], before: Sequence[Any]
) -> Iterator[tuple[Sequence[Any], Sequence[Any]]]:
    """Yield the part before each long repetition in a pattern, and the repeated part."""
    for item in items:
        code, value = item
        if code in _REPEATS:
            if value[1] > _MANY:
                yield before, value[2]
            yield from _repetitions(value[2], before)
        elif code is codes.BRANCH:
            for branch in value[1]:
                yield from _repetitions(branch, before)
        elif code is codes.SUBPATTERN:
            yield from _repetitions(value[3], before)
        elif code in (codes.ASSERT, codes.ASSERT_NOT):
            yield from _repetitions(value[1], before)
        before = [*before, item]


def _sample(items: Sequence[Any], chance: random.Random) -> str:
    """Return a text that a pattern, or a part of it, matches as a rule."""
    text = ""
    for code, value in items:
        if code is codes.LITERAL:
            text += chr(value)
        elif code in (codes.NOT_LITERAL, codes.IN, codes.ANY):
            text += _letter(code, value, chance)
        elif code is codes.BRANCH:
            text += _sample(chance.choice(value[1]), chance)
        elif code is codes.SUBPATTERN:
            text += _sample(value[3], chance)
        elif code in _REPEATS:
            least, most, body = value
            often = chance.choice([least, max(least, min(most, 1)), min(most, least + 2)])
            text += "".join(_sample(body, chance) for _ in range(min(often, 40)))
    return text


def _letter(code: Any, value: Any, chance: random.Random) -> str:
    if code is codes.ANY:
        return chance.choice("a1 ")
    if code is codes.NOT_LITERAL:
        members = [(codes.NEGATE, None), (codes.LITERAL, value)]
    else:
        members = list(value)
    negated = members[0][0] is codes.NEGATE
    members = members[negated:]
    letters = set(_LETTERS)
    for kind, what in members:
        letters |= (
            {chr(what)}
            if kind is codes.LITERAL
            else {*map(chr, what)}
            if kind is codes.RANGE
            else set()
        )
    fitting = []
    for letter in sorted(letters):
        if any(_is(letter, *member) for member in members) is not negated:
            fitting.append(letter)
    return str(chance.choice(fitting or ["a"]))


def _is(letter: str, code: Any, value: Any) -> bool:
    if code is codes.LITERAL:
        return bool(ord(letter) == value)
    if code is codes.RANGE:
        return bool(value[0] <= ord(letter) <= value[1])
    return re.match(_CLASSES[value], letter) is not None

"""Templates of texts: `{0} messages on {1}`, the texts that it matches, and its translations."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

#: First of the characters of Unicode's private use that stand for pieces which are never translated.
FIRST_MARK = 0xE000
LAST_MARK = 0xF8FF
_PIECE = re.compile(r"(`[^`]*`|\{\d+\})")
_LETTER = re.compile(r"[^\W\d_]")
_WORD = re.compile(r"\w+")

#: A translated template: texts, and numbers of inserted values.
Translation: TypeAlias = tuple[str | int, ...]


def is_mark(text: str) -> bool:
    """Tell whether a text is a single mark for a piece that is not translated."""
    return len(text) == 1 and FIRST_MARK <= ord(text) <= LAST_MARK


@dataclass(frozen=True)
class Template:
    """A template in pieces: the literal texts around its inserted values.

    A piece of code between backticks counts as an inserted value, because pages show it as an element.
    """

    literals: tuple[str, ...]
    #: The inserted values as written, such as `{0}`.
    names: tuple[str, ...]
    #: Numbers of the inserted values that are code.
    code: frozenset[int]
    #: Number of letters in its literal texts.
    weight: int

    @classmethod
    def of(cls, english: str) -> Template:
        """Return the template of a message."""
        values: list[str] = []
        literals: list[str] = [""]
        for number, piece in enumerate(_PIECE.split(english)):
            if number % 2:
                values.append(piece)
                literals.append("")
            else:
                literals[-1] = _unescaped(piece)
        code = frozenset(n for n, value in enumerate(values) if value.startswith("`"))
        weight = sum(len(_LETTER.findall(literal)) for literal in literals)
        return cls(tuple(literals), tuple(values), code, weight)

    def translation(self, text: str) -> Translation:
        """Return the pieces of a translation; raises ValueError unless each value stands in it once."""
        pieces: list[str | int] = []
        missing = list(enumerate(self.names))
        for number, piece in enumerate(_PIECE.split(text)):
            if number % 2 == 0:
                pieces.append(_unescaped(piece))
                continue
            same = [entry for entry in missing if entry[1] == piece]
            if not same:
                raise ValueError(f"{piece} is not in the English text, or stands there less often")
            missing.remove(same[0])
            pieces.append(same[0][0])
        if missing:
            raise ValueError(f"{missing[0][1]} is missing")
        return tuple(pieces)

    def anchors(self) -> list[str]:
        """Return the whole words in its literal texts, which each matching text has."""
        words = []
        last = len(self.literals) - 1
        for number, literal in enumerate(self.literals):
            for found in _WORD.finditer(literal):
                begins_inside = found.start() > 0 or number == 0
                ends_inside = found.end() < len(literal) or number == last
                if begins_inside and ends_inside:
                    words.append(found[0])
        return words

    def values_in(self, text: str) -> list[str] | None:
        """Return the inserted values of a text; None if the template does not match it.

        Each literal text is sought at its first possible place, so that the time is linear in the text.
        """
        first, last = self.literals[0], self.literals[-1]
        if not text.startswith(first) or len(text) < len(first) + len(last):
            return None
        if not text.endswith(last):
            return None
        end = len(text) - len(last)
        values = []
        at = len(first)
        for literal in self.literals[1:-1]:
            found = text.find(literal, at, end)
            if found < 0:
                return None
            values.append(text[at:found])
            at = found + len(literal)
        values.append(text[at:end])
        for number in self.code:
            if not is_mark(values[number]):
                return None
        return values


def _unescaped(text: str) -> str:
    return text.replace("{{", "{").replace("}}", "}")


def filled(translation: Translation, values: Sequence[str]) -> str:
    """Return a translated template with inserted values."""
    pieces = []
    for piece in translation:
        if isinstance(piece, int):
            piece = values[piece]
        pieces.append(piece)
    return "".join(pieces)

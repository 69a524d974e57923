"""Parts of a finished English text, as found among the messages; each language puts them into its own words."""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeAlias


class Words(Protocol):
    """The words of a language for parts of texts."""

    def number(self, text: str) -> str:
        """Return an English text with its numbers in the form of the language."""
        raise NotImplementedError

    def message(self, english: str) -> str:
        """Return the translation of a message without values."""
        raise NotImplementedError

    def filled(self, template: int, values: list[str]) -> str:
        """Return the translation of a template, by its number in the phrasebook, with inserted values."""
        raise NotImplementedError


class English(NamedTuple):
    """A text without a message, such as a name; only its numbers take another form."""

    text: str

    def said_in(self, words: Words) -> str:
        """Return the text in a language."""
        return words.number(self.text)


class Whole(NamedTuple):
    """A message without values."""

    english: str

    def said_in(self, words: Words) -> str:
        """Return the message in a language."""
        return words.message(self.english)


class Filled(NamedTuple):
    """A template, by its number in the phrasebook, and its inserted values."""

    template: int
    values: tuple[Parts, ...]

    def said_in(self, words: Words) -> str:
        """Return the template in a language, with its values."""
        values = [text_of(value, words) for value in self.values]
        return words.filled(self.template, values)


class Capital(NamedTuple):
    """Parts at the beginning of a sentence."""

    parts: Parts

    def said_in(self, words: Words) -> str:
        """Return the parts in a language, with a capital first letter."""
        text = text_of(self.parts, words)
        return text[0].upper() + text[1:]


#: A string is the same in each language.
Part: TypeAlias = str | English | Whole | Filled | Capital
Parts: TypeAlias = tuple[Part, ...]


class Found(NamedTuple):
    """The parts of a text, and the number of its words that stay English."""

    parts: Parts
    left: int = 0


def text_of(parts: Parts, words: Words) -> str:
    """Return parts of a text in a language."""
    pieces = []
    for part in parts:
        if not isinstance(part, str):
            part = part.said_in(words)
        pieces.append(part)
    return "".join(pieces)

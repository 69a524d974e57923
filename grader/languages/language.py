"""Translate finished English texts by the messages of a catalogue.

The phrasebook finds the messages in a text; each language has its own words for these.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from grader.languages.catalogue import Message
from grader.languages.found import text_of
from grader.languages.phrasebook import phrasebook_of, words_left
from grader.languages.template import FIRST_MARK, LAST_MARK, Template, Translation, filled

#: Longest text that is translated; pages cut longer ones.
_LONGEST = 4000
#: Code between backticks, and passages that are quoted from a student's text.
_KEPT = re.compile(r"`[^`\n]*`|“[^”]{60,}(?:”|$)")
_MARKS = re.compile(f"[{chr(FIRST_MARK)}-{chr(LAST_MARK)}]")
#: Numbers with a decimal point; neither versions nor parts of code.
DECIMAL_NUMBER = (
    r"(?<![^\s(±+−–<>≈-])(?<!\w\()(?<!Python )(?<!ROS 2 )(?<!version )(?<!= )"
    r"(\d+)\.(\d+)(?=$|[\s),;%°–:]|\.(?!\d)|ms|s\b)"
)
_DECIMAL = re.compile(DECIMAL_NUMBER)


@dataclass(frozen=True)
class Translated:
    """A translated text, and the number of its words that stay English."""

    text: str
    left: int = 0


class Language:
    """A language with its messages."""

    def __init__(self, tag: str, messages: Iterable[Message]) -> None:
        self.tag = tag
        self.decimal = _decimal_sign(tag)
        #: Templates of messages that scripts compose, with their translations.
        self.of_scripts: list[tuple[str, str]] = []
        self._whole: dict[str, str] = {}
        #: The translations of the phrasebook's templates.
        self._templates: list[Translation] = []
        known = [message for message in messages if message.translation]
        for message in known:
            if any(file.endswith(".js") for file in message.files):
                self.of_scripts.append((message.english, message.translation))
            template = Template.of(message.english)
            translation = template.translation(message.translation)
            if template.names:
                self._templates.append(translation)
            else:
                self._whole.setdefault(template.literals[0], filled(translation, ()))
        #: The English messages.
        self.phrases = phrasebook_of(tuple(message.english for message in known))

    def text(self, english: str) -> str:
        """Return a text in this language, as far as it is known; code between backticks stays."""
        return self.translated(english).text

    def translated(self, english: str) -> Translated:
        """Return a text in this language, with the number of words that stay English.

        Characters of private use stand for elements of a page, and are kept, perhaps in another order.
        """
        if self.tag == "en":
            return Translated(english)
        if len(english) > _LONGEST:
            return Translated(english, words_left(english))
        marked, code = _with_marks(english)
        found = self.phrases.found(marked)
        text = text_of(found.parts, self)
        for mark, piece in code.items():
            text = text.replace(mark, piece)
        return Translated(text, found.left)

    def message(self, english: str) -> str:
        """Return the translation of a message without values."""
        return self._whole[english]

    def filled(self, template: int, values: Sequence[str]) -> str:
        """Return the translation of a template, by its number in the phrasebook, with inserted values."""
        return filled(self._templates[template], values)

    def number(self, text: str) -> str:
        """Return a text with its numbers in this language's form: `98,4` for `98.4`."""
        if self.decimal == "." or "." not in text:
            return text
        return _DECIMAL.sub(rf"\g<1>{self.decimal}\g<2>", text)


def _with_marks(text: str) -> tuple[str, dict[str, str]]:
    """Return a text with a mark for each piece of code or quotation, and the pieces by their marks."""
    used = {ord(mark) for mark in _MARKS.findall(text)}
    pieces: dict[str, str] = {}
    number = max(used, default=FIRST_MARK - 1)

    def mark(found: re.Match[str]) -> str:
        nonlocal number
        if number >= LAST_MARK:
            return found[0]
        number += 1
        pieces[chr(number)] = found[0]
        return chr(number)

    return _KEPT.sub(mark, text), pieces


def _decimal_sign(tag: str) -> str:
    """Return a language's sign between whole and fraction, without Babel, which takes 20 ms to load."""
    sign = ","
    if tag == "en":
        sign = "."
    return sign


ENGLISH = Language("en", ())


@dataclass(frozen=True)
class Languages:
    """The languages of a page or a mail besides English, and the tag of the first one shown."""

    others: tuple[Language, ...] = ()
    first: str = "en"

    def of(self, tag: str) -> Language:
        """Return the language with a tag; the first one shown for an empty tag, and English for an unknown one."""
        wanted = tag or self.first
        for language in self.others:
            if language.tag == wanted:
                return language
        return ENGLISH


ENGLISH_ONLY = Languages()

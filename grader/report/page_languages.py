"""Give a page its translations: a dictionary of exactly its texts for each language, compressed within the page.

The page stays English; `templates/language.js` replaces its texts. A unit is a row of text and elements within a
sentence (links, emphasis, code), such as `Run <code>grade</code>, then <a>look</a>.` Its elements are marks: characters of
private use, which no shown text has. Both sides find units and hashes in the same way; a browser test compares them.
Code, output and files are no units, and a translation can only move elements, never make any.
"""

from __future__ import annotations

import base64
import html
import json
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

from grader.languages.catalogue import NAMES
from grader.languages.language import DECIMAL_NUMBER, Language, Languages
from grader.languages.template import FIRST_MARK, LAST_MARK

#: Elements within a sentence that have text, and those whose content is not translated.
_INLINE = frozenset({"a", "em"})
_WHOLE = frozenset({"code", "kbd", "samp", "wbr"})
#: Elements that part no text, and a text itself.
_WITHIN_SENTENCE = frozenset({*_INLINE, *_WHOLE, "none"})
#: Elements without any unit.
_SKIPPED = frozenset({"script", "style", "pre", "textarea"})
_VOID = frozenset({"br", "hr", "img", "input", "link", "meta", "wbr"})
_TOKEN = re.compile(r"<(/?)([a-zA-Z][\w-]*+)((?:[^<>\"]++|\"[^\"]*+\")*+)>|([^<]+)|<")
_ATTRIBUTE = re.compile(r"(?<=\s)(?:aria-label|title|placeholder|label)=\"([^\"]*)\"")
_BLANKS = re.compile(r"[ \t\n\r\f]+")
_LETTERS = re.compile(r"[^\W\d_]{2}")
_MARKS = re.compile(f"[{chr(FIRST_MARK)}-{chr(LAST_MARK)}]")


@dataclass(frozen=True)
class Unit:
    """A text of a page with marks for its elements."""

    text: str
    pairs: tuple[tuple[str, str], ...] = ()

    def allows(self, translation: str) -> bool:
        """Tell whether a translation has each mark once, and elements end in the reverse order of their beginnings."""
        if sorted(_MARKS.findall(translation)) != sorted(_MARKS.findall(self.text)):
            return False
        ends = dict(self.pairs)
        closing = set(ends.values())
        open_ends: list[str] = []
        for mark in _MARKS.findall(translation):
            if mark in ends:
                open_ends.append(ends[mark])
            elif mark in closing:
                if open_ends[-1:] != [mark]:
                    return False
                open_ends.pop()
        return not open_ends


def units_of(page: str) -> list[Unit]:
    """Return the units of a page, and the texts of its attributes, in the order of the page."""
    reader = _Reader(page)
    reader.read()
    return reader.units


class _Reader:
    """Reads the units of a page from its tags and texts."""

    def __init__(self, page: str) -> None:
        self.units: list[Unit] = []
        self._tokens = list(_TOKEN.finditer(page))
        self._begin()

    def _begin(self) -> None:
        """Begin a unit."""
        self._text = ""
        self._count = 0
        #: Marks that begin an element, with marks that end it.
        self._pairs: list[tuple[str, str]] = []
        #: Marks of the elements that have not ended.
        self._opened: list[str] = []

    def _end(self) -> None:
        """Finish the present unit, and keep it if it has a word."""
        self._keep(self._text, tuple(self._pairs))
        self._begin()

    def _keep(self, raw: str, pairs: tuple[tuple[str, str], ...] = ()) -> None:
        if not _LETTERS.search(raw):
            return
        text = _BLANKS.sub(" ", raw).strip(" ")
        self.units.append(Unit(text, pairs))

    def _mark(self) -> str:
        """Add a mark for an element to the text, and return it."""
        mark = chr(FIRST_MARK + self._count)
        self._count += 1
        self._text += mark
        return mark

    def read(self) -> None:
        """Read the whole page."""
        number = 0
        while number < len(self._tokens):
            closes, name, attributes, text = self._tokens[number].groups()
            if name is None:
                self._text += html.unescape(text or "<")
                number += 1
            elif closes:
                number = self._read_end(number, name.lower())
            else:
                number = self._read_start(number, name.lower(), attributes)
        self._end()

    def _read_start(self, number: int, name: str, attributes: str) -> int:
        """Read the beginning of an element; returns the number of the next token."""
        is_name = 'translate="no"' in attributes
        if name in _SKIPPED:
            self._end()
            return self._after(number, name)
        if name in _WHOLE:
            self._mark()
            return self._after(number, name)
        if is_name:
            return self._read_name(number, name)
        for value in _ATTRIBUTE.findall(attributes):
            self._keep(html.unescape(value))
        if self._is_within_sentence(number, name, 1):
            self._opened.append(self._mark())
        else:
            self._end()
        return number + 1

    def _read_name(self, number: int, name: str) -> int:
        """Pass an element that is not translated; returns the number of the next token."""
        if name in _INLINE:
            self._mark()
        else:
            self._end()
        return self._after(number, name)

    def _read_end(self, number: int, name: str) -> int:
        """Read the end of an element; returns the number of the next token."""
        if not self._is_within_sentence(number, name, -1):
            self._end()
        elif self._opened:
            opened = self._opened.pop()
            self._pairs.append((opened, self._mark()))
        return number + 1

    def _after(self, start: int, name: str) -> int:
        """Return the number of the token after an element that begins at a token."""
        if name in _VOID:
            return start + 1
        depth = 0
        for number in range(start, len(self._tokens)):
            token = self._tokens[number]
            if str(token[2]).lower() == name:
                depth += -1 if token[1] else 1
            if depth == 0:
                return number + 1
        return len(self._tokens)

    def _is_within_sentence(self, at: int, name: str, step: int) -> bool:
        """Tell whether an inline element, read from its first or last token, holds no element that parts texts."""
        number = at + step
        while name in _INLINE and 0 <= number < len(self._tokens):
            other = str(self._tokens[number][2]).lower()
            if other == name:
                return True
            if other not in _WITHIN_SENTENCE:
                return False
            number += step
        return False


def hash_of(text: str) -> str:
    """Return four letters for a text: 24 bits of its hash by Fowler, Noll and Vo (FNV-1a) over UTF-16."""
    value = 0x811C9DC5
    units = text.encode("utf-16-le", "surrogatepass")
    for at in range(0, len(units), 2):
        value ^= units[at] | units[at + 1] << 8
        value = value * 0x01000193 & 0xFFFFFFFF
    return base64.urlsafe_b64encode((value & 0xFFFFFF).to_bytes(3, "big")).decode()


def with_languages(page: str, languages: Languages) -> str:
    """Return a page with its translations, before the scripts at its end."""
    units = list(dict.fromkeys(units_of(page)))
    hashed = _with_hashes(units)
    texts = [unit.text for unit in units]
    attributes = ""
    for language in languages.others:
        packed = _packed(hashed, texts, language)
        attributes += f' data-{language.tag}="{packed}"'
    names = html.escape(json.dumps({each.tag: NAMES[each.tag] for each in languages.others}))
    holder = f'<div id="languages" hidden data-chosen="{languages.first}" data-names="{names}"{attributes}></div>\n'
    before, script, after = page.rpartition("<script>")
    return before + holder + script + after


def _with_hashes(units: Sequence[Unit]) -> list[tuple[str, Unit]]:
    """Return the units with their hashes; of two texts with one hash, the first one."""
    hashed = []
    taken: dict[str, str] = {}
    for unit in units:
        key = hash_of(unit.text)
        first = taken.setdefault(key, unit.text)
        if first == unit.text:
            hashed.append((key, unit))
    return hashed


def _packed(hashed: Sequence[tuple[str, Unit]], texts: Sequence[str], language: Language) -> str:
    """Return the dictionary of a language for units with their hashes: JSON, compressed, in Base64.

    Its parts are the hashes of the units in a row, their translations, the templates of texts composed by scripts, the
    sign between whole and fraction, and the pattern of numbers.
    """
    found: dict[str, str] = {}
    for key, unit in hashed:
        translation = _of_unit(unit.text, texts, language)
        is_other = translation != language.number(unit.text)
        if is_other and unit.allows(translation):
            found[key] = translation
    content = [
        "".join(found),
        list(found.values()),
        language.of_scripts,
        language.decimal,
        DECIMAL_NUMBER,
    ]
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"))
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = packer.compress(text.encode())
    packed += packer.flush()
    return base64.b64encode(packed).decode()


def _of_unit(text: str, others: Sequence[str], language: Language) -> str:
    """Return the translation of a unit; of one that was cut, the beginning of the whole text's, if the page has it."""
    if not text.endswith("…"):
        return language.text(text)
    beginning = text[:-1]
    for other in others:
        is_whole = len(other) > len(text) and other.startswith(beginning)
        if is_whole and not _MARKS.search(other):
            return language.text(other)[: len(beginning)] + "…"
    return language.text(text)

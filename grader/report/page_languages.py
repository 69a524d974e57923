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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from grader.languages.catalogue import NAMES
from grader.languages.language import DECIMAL_NUMBER, Language, Languages
from grader.languages.template import FIRST_MARK, LAST_MARK

#: Elements within a sentence that have text, and those whose content is not translated.
_INLINE = frozenset({"a", "em"})
_WHOLE = frozenset({"code", "kbd", "samp", "wbr"})
#: Elements without any unit.
_SKIPPED = frozenset({"script", "style", "pre", "textarea"})
_VOID = frozenset({"br", "hr", "img", "input", "link", "meta", "wbr"})
_TOKEN = re.compile(r"<(/?)([a-zA-Z][\w-]*)((?:[^>\"]|\"[^\"]*\")*)>|([^<]+)|<")
_ATTRIBUTE = re.compile(r"(?<=\s)(?:aria-label|title|placeholder|label)=\"([^\"]*)\"")
_BLANKS = re.compile(r"[ \t\n\r\f]+")
_LETTERS = re.compile(r"[^\W\d_]{2}")
_MARKS = re.compile(f"[{chr(FIRST_MARK)}-{chr(LAST_MARK)}]")


@dataclass
class _Unit:
    """A unit in the making: its text with marks, and the marks of its open elements."""

    text: str = ""
    count: int = 0
    #: Marks that begin an element, with those that end it.
    pairs: tuple[tuple[str, str], ...] = ()
    opened: tuple[str, ...] = ()

    def mark(self) -> str:
        """Add a mark, and return it."""
        mark = chr(FIRST_MARK + self.count)
        self.count += 1
        self.text += mark
        return mark


@dataclass(frozen=True)
class Unit:
    """A text of a page with marks for its elements."""

    text: str
    pairs: tuple[tuple[str, str], ...] = ()

    def allows(self, translation: str) -> bool:
        """Tell whether a translation has each mark once, and elements end in the order in which they began."""
        if sorted(_MARKS.findall(translation)) != sorted(_MARKS.findall(self.text)):
            return False
        ends = dict(self.pairs)
        closing = set(ends.values())
        open_ends: list[str] = []
        for mark in _MARKS.findall(translation):
            if mark in ends:
                open_ends.append(ends[mark])
            elif mark in closing and (not open_ends or open_ends.pop() != mark):
                return False
        return not open_ends


def units_of(page: str) -> Iterator[Unit]:
    """Yield the units of a page, and the texts of its attributes, in the order of the page."""
    tokens = list(_TOKEN.finditer(page))
    unit = _Unit()
    skipped = 0
    for number, token in enumerate(tokens):
        closes, name, attributes, text = token.groups()
        if number < skipped:
            continue
        if name is None:
            unit.text += html.unescape(text or "<")
            continue
        name = name.lower()
        if not closes:
            if name in _SKIPPED or 'translate="no"' in attributes:
                skipped = _end_of(tokens, number, name)
                if name in _SKIPPED or name not in _INLINE:
                    yield from _finished(unit)
                    unit = _Unit()
                else:
                    unit.mark()
                continue
            for value in _ATTRIBUTE.findall(attributes):
                yield from _finished(_Unit(html.unescape(value)))
        if name in _WHOLE:
            if not closes:
                skipped = _end_of(tokens, number, name)
                unit.mark()
        elif name in _INLINE and _is_within_sentence(tokens, number, name):
            _add_inline(unit, bool(closes))
        else:
            yield from _finished(unit)
            unit = _Unit()
    yield from _finished(unit)


def _end_of(tokens: Sequence[re.Match[str]], start: int, name: str) -> int:
    """Return the number of the token after an element that begins at a token."""
    if name in _VOID:
        return start + 1
    depth = 0
    for number in range(start, len(tokens)):
        if tokens[number][2] and tokens[number][2].lower() == name:
            depth += -1 if tokens[number][1] else 1
        if depth == 0:
            return number + 1
    return len(tokens)


def _is_within_sentence(tokens: Sequence[re.Match[str]], at: int, name: str) -> bool:
    """Tell whether an inline element, by its first or last token, holds no element that parts texts."""
    step = -1 if tokens[at][1] else 1
    number = at + step
    while 0 <= number < len(tokens):
        other = tokens[number][2]
        if other:
            other = other.lower()
            if other == name:
                return True
            if other not in _INLINE and other not in _WHOLE:
                return False
        number += step
    return False


def _add_inline(unit: _Unit, closes: bool) -> None:
    if not closes:
        unit.opened = (*unit.opened, unit.mark())
    elif unit.opened:
        *others, opened = unit.opened
        unit.opened = tuple(others)
        unit.pairs = (*unit.pairs, (opened, unit.mark()))


def _finished(unit: _Unit) -> Iterator[Unit]:
    """Yield a unit if it has a word."""
    text = _BLANKS.sub(" ", unit.text).strip(" ")
    if _LETTERS.search(text):
        yield Unit(text, unit.pairs)


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
    attributes = ""
    for language in languages.others:
        attributes += f' data-{language.tag}="{_packed(units, language)}"'
    names = html.escape(json.dumps({each.tag: NAMES[each.tag] for each in languages.others}))
    holder = f'<div id="languages" hidden data-chosen="{languages.first}" data-names="{names}"{attributes}></div>\n'
    before, script, after = page.rpartition("<script>")
    return before + holder + script + after


def _packed(units: Sequence[Unit], language: Language) -> str:
    """Return the dictionary of a language: JSON, compressed, in Base64.

    It has hashes of the units in a row, their translations, the templates of texts that scripts compose, and the sign
    between whole and fraction.
    """
    texts = [unit.text for unit in units]
    found: dict[str, str] = {}
    taken: dict[str, str] = {}
    for unit in units:
        key = hash_of(unit.text)
        # Of two units with one hash, the first is translated.
        if taken.setdefault(key, unit.text) != unit.text:
            continue
        translation = _of_unit(unit.text, texts, language)
        if translation != language.number(unit.text) and unit.allows(translation):
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
    packed = packer.compress(text.encode()) + packer.flush()
    return base64.b64encode(packed).decode()


def _of_unit(text: str, others: Sequence[str], language: Language) -> str:
    """Return the translation of a unit; of one that was cut, the beginning of the whole text's, if the page has it."""
    if not text.endswith("…"):
        return language.text(text)
    beginning = text[:-1]
    for other in others:
        if len(other) > len(text) and other.startswith(beginning) and not _MARKS.search(other):
            return language.text(other)[: len(beginning)] + "…"
    return language.text(text)

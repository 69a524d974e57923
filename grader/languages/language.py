"""Translate finished English texts by the templates of a catalogue.

A text is sought as a whole, then by the template with the most letters that matches, then sentence by sentence, then in
the parts of a list. The rest stays English: names, paths, and sentences of other programs.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from grader.languages.catalogue import NAMES, Message, engine_catalogues, read_catalogues
from grader.languages.template import FIRST_MARK, LAST_MARK, Template, is_mark

#: Longest text that is translated; pages cut longer ones.
_LONGEST = 4000
#: Most pieces of a text that are looked up: enough for any text of the grader's, and a bound for others.
_MOST_LOOKUPS = 200
_MOST_MATCHES = 8
_MOST_DEPTH = 9
#: Most texts that are remembered with their translations.
_MOST_REMEMBERED = 20_000
_MOST_HEADS = 24
#: Letters of a template that is used even if a value in it stays English; lighter ones match by chance.
_LEAST_WEIGHT = 7
_WORD = re.compile(r"\w+")
#: Code between backticks, and passages that are quoted from a student's text.
_KEPT = re.compile(r"`[^`\n]*`|“[^”]{60,}(?:”|$)")
_MARKS = re.compile(f"[{chr(FIRST_MARK)}-{chr(LAST_MARK)}]")
_SENTENCE_END = re.compile(rf"(?<=[.!?])\s+(?=[/A-Z0-9“‘'\"(±{chr(FIRST_MARK)}-{chr(LAST_MARK)}])")
#: Plain lower-case words, as in prose; names have other signs, and values capitals.
_PROSE = re.compile(
    r"(?<![^\s(“‘'])[a-z]{2,}(?:[’'](?:s|t))?(?![^\s),.;:!?”’'…])|\b[A-Z][a-z]+ [a-z]{2,}\b"
)
#: Names, and values of texts, between single quotation marks.
_QUOTED = re.compile(r"(?<!\w)'[^']*'")
_UNITS = frozenset({"ms", "rad", "µs", "mm"})
#: Numbers with a decimal point; neither versions nor parts of code.
DECIMAL_NUMBER = (
    r"(?<![^\s(±+−–<>≈-])(?<!\w\()(?<!Python )(?<!ROS 2 )(?<!version )(?<!= )"
    r"(\d+)\.(\d+)(?=$|[\s),;%°–:]|\.(?!\d)|ms|s\b)"
)
_DECIMAL = re.compile(DECIMAL_NUMBER)
_LOWER = re.compile(r"[A-Z][a-z]")
#: Signs between the parts of a list or a label and its text, the wider ones first.
_SEPARATORS = ("; ", " · ", ". ", ": ", " (", ", ", " – ", " → ", " and ", " or ", " to ", " = ")
_AROUND = (("(", ")"), ("“", "”"), ("‘", "’"), ("'", "'"))
_OPENING = ("'", "‘", "“", "„", "«")
_ENDS = ".:;,…?"
_NUMBER_FIRST = re.compile(r"([−+±≈<>]?\d[\d.,]*(?: ?%)?) (?=\S)")


@dataclass(frozen=True)
class Translated:
    """A translated text, and the number of its words that stay English."""

    text: str
    left: int = 0


@dataclass
class _Work:
    """One text under translation: the results for its pieces, and the number of further lookups."""

    known: dict[str, Translated] = field(default_factory=dict)
    lookups: int = _MOST_LOOKUPS


class Language:
    """A language with its messages."""

    def __init__(self, tag: str, messages: Iterable[Message]) -> None:
        self.tag = tag
        self.decimal = _decimal_sign(tag)
        self._whole: dict[str, str] = {}
        self._templates: dict[str, list[Template]] = defaultdict(list)
        self._texts: dict[str, Translated] = {}
        #: Templates of messages that scripts compose, with their translations.
        self.of_scripts: list[tuple[str, str]] = []
        self._ways = (
            self._by_known_items,
            self._by_strict_templates,
            self._by_sentences,
            self._by_known_head,
            self._by_end,
            self._by_templates,
            self._without_around,
            self._by_number,
            self._by_lower_case,
            self._by_marks,
            self._by_list,
            self._by_separators,
        )
        made: list[Template] = []
        for message in messages:
            if not message.translation:
                continue
            if any(file.endswith(".js") for file in message.files):
                self.of_scripts.append((message.english, message.translation))
            template = Template.of(message.english, message.translation)
            if len(template.literals) > 1:
                made.append(template)
                continue
            whole = template.literals[0]
            self._whole.setdefault(whole, template.filled(()))
        self._index(made)

    def _index(self, templates: list[Template]) -> None:
        """Keep each template under the word that the fewest others have; under an empty one without a word."""
        words = [template.anchors() for template in templates]
        counts = Counter(itertools.chain.from_iterable(words))
        for template, anchors in zip(templates, words, strict=True):
            rarest = min(anchors, key=counts.__getitem__, default="")
            self._templates[rarest].append(template)

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
            return Translated(english, _words_left(english))
        known = self._texts.get(english)
        if known is None:
            known = self._without_memory(english)
            if len(self._texts) >= _MOST_REMEMBERED:
                self._texts.clear()
            self._texts[english] = known
        return known

    def _without_memory(self, english: str) -> Translated:
        """Return a text in this language, with the pieces of code and quotations in their places."""
        marked, code = _with_marks(english)
        found = self._phrase(marked, _Work(), 0)
        text = found.text
        for mark, piece in code.items():
            text = text.replace(mark, piece)
        return Translated(text, found.left)

    # -- the ways to a translation -----------------------------------------------------------------

    def _phrase(self, text: str, work: _Work, depth: int) -> Translated:
        """Return a piece in this language: the way that leaves the fewest words English."""
        core = text.strip()
        if not core:
            return Translated(text)
        if is_mark(core):
            return Translated(text)
        known = work.known.get(core)
        if known is None:
            known = self._looked_up(core, work, depth)
        start = text.index(core)
        end = start + len(core)
        return Translated(text[:start] + known.text + text[end:], known.left)

    def _looked_up(self, text: str, work: _Work, depth: int) -> Translated:
        """Return a piece without blanks at its ends in this language, and remember it."""
        whole = self._known_as_whole(text)
        if whole is not None:
            return Translated(whole)
        found = Translated(self.number(text), _words_left(text))
        # A single word within a text can be a name, which nobody translates.
        if depth > 0 and " " not in text:
            found = replace(found, left=0)
        if depth == _MOST_DEPTH or work.lookups == 0:
            return found
        work.lookups -= 1
        found = self._best(text, found, work, depth)
        work.known[text] = found
        return found

    def _best(self, text: str, found: Translated, work: _Work, depth: int) -> Translated:
        """Return the translation that leaves the fewest words English, or the text itself."""
        best = replace(found, left=found.left + 1)
        for way in self._ways:
            if best.left == 0:
                break
            for other in way(text, work, depth + 1):
                if other.left < best.left:
                    best = other
                if best.left == 0:
                    break
        return found if best.left > found.left else best

    def _known_as_whole(self, text: str) -> str | None:
        """Return the translation of a text without values, also with another first letter."""
        found = self._whole.get(text)
        if found is not None or not text[:1].isupper():
            return found
        found = self._whole.get(_lower(text))
        if found is None:
            return None
        return _upper(found)

    def _by_strict_templates(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield translations by templates whose values hold no end of a sentence."""
        for template, values in self._matches(text):
            if _is_strict(template, values):
                yield from self._filled(template, values, work, depth)

    def _by_templates(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        for template, values in self._matches(text):
            yield from self._filled(template, values, work, depth)

    def _filled(
        self, template: Template, values: list[str], work: _Work, depth: int
    ) -> Iterator[Translated]:
        """Yield the translation by a template; none if it has few letters, and a value stays English."""
        texts = []
        left = 0
        for number, value in enumerate(values):
            translated = Translated(value)
            # A single word between quotation marks is a name, also if a message reads the same.
            if " " in value or not template.literals[number].endswith(_OPENING):
                translated = self._phrase(value, work, depth)
            texts.append(translated.text)
            left += translated.left
        if left == 0 or template.weight >= _LEAST_WEIGHT:
            yield Translated(template.filled(texts), left)

    def _matches(self, text: str) -> Iterator[tuple[Template, list[str]]]:
        """Yield the templates that match, with the inserted values.

        The order is by letters, most first, and then by whether a template begins with its own text.
        """
        possible: list[Template] = list(self._templates.get("", ()))
        for word in dict.fromkeys(_WORD.findall(text)):
            possible += self._templates.get(word, ())
        possible.sort(key=_first_tried)
        count = 0
        for template in possible:
            values = template.values_in(text)
            # A value that is the whole text again would never come to an end.
            if values is None or text in values:
                continue
            yield template, values
            count += 1
            if count == _MOST_MATCHES:
                return

    def _by_sentences(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield the translation of a text of sentences, the longest known rows of them first."""
        starts = [0, *(found.end() for found in _SENTENCE_END.finditer(text)), len(text)]
        if len(starts) < 3:
            return
        pieces = []
        left = 0
        at = 0
        last = len(starts) - 1
        while at < last:
            end = self._longest_row(text, starts, at)
            row = self._phrase(text[starts[at] : starts[end]], work, depth)
            pieces.append(row.text)
            left += row.left
            at = end
        yield Translated("".join(pieces), left)

    def _longest_row(self, text: str, starts: list[int], at: int) -> int:
        """Return the end of the longest row of sentences that is one message; of a single sentence without one."""
        last = len(starts) - 1
        for end in range(min(last, at + 4), at + 1, -1):
            row = text[starts[at] : starts[end]].strip()
            if (at, end) == (0, last):
                continue
            if self._is_message(row):
                return end
        return at + 1

    def _by_end(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield the translation of a text without its last sign, such as a full stop."""
        if len(text) > 1 and text[-1] in _ENDS:
            found = self._phrase(text[:-1], work, depth)
            yield Translated(found.text + text[-1], found.left)
        if len(text) > 2 and text[0] in ",;·.":
            found = self._phrase(text[1:], work, depth)
            yield Translated(text[0] + found.text, found.left)

    def _without_around(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield the translation of a text in brackets or quotation marks."""
        for opening, closing in _AROUND:
            if len(text) > 2 and text[0] == opening and text[-1] == closing:
                found = self._phrase(text[1:-1], work, depth)
                yield Translated(opening + found.text + closing, found.left)

    def _by_lower_case(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield the translation of a text that begins a sentence, by a template that does not."""
        if _LOWER.match(text):
            found = self._phrase(_lower(text), work, depth)
            yield Translated(_upper(found.text), found.left)

    def _by_number(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield the translation of a number and what it counts."""
        number = _NUMBER_FIRST.match(text)
        if number is not None:
            found = self._phrase(text[number.end() :], work, depth)
            yield Translated(f"{self.number(number[1])} {found.text}", found.left)

    def _by_marks(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield the translation of the pieces between the elements of a page."""
        parts = _MARKS.split(text)
        if len(parts) > 1:
            yield self._joined(parts, _MARKS.findall(text), work, depth)

    def _by_known_items(self, text: str, _work: _Work, _depth: int) -> Iterator[Translated]:
        """Yield the translation of a list of which each item is a message without values."""
        items = self._items(text, ", ")
        known = [self._known_as_whole(item) for item in items]
        if len(items) > 1 and None not in known:
            yield Translated(", ".join(filter(None, known)))

    def _by_list(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield the translation of a list, item by item; an item can hold the separator."""
        for separator in ("; ", " · ", ", "):
            items = self._items(text, separator)
            if len(items) > 1:
                yield self._joined(items, [separator] * (len(items) - 1), work, depth)

    def _items(self, text: str, separator: str) -> list[str]:
        """Return the items of a list; a known item can hold the separator."""
        parts = text.split(separator)
        items = []
        while parts:
            length = self._item_length(parts, separator)
            items.append(separator.join(parts[:length]))
            parts = parts[length:]
        return items

    def _item_length(self, parts: list[str], separator: str) -> int:
        """Return the number of parts that are one known item; one without a known item."""
        for length in range(min(6, len(parts)), 1, -1):
            item = separator.join(parts[:length])
            if self._known_as_whole(item):
                return length
        return 1

    def _joined(
        self, parts: list[str], separators: list[str], work: _Work, depth: int
    ) -> Translated:
        """Return the translation of parts with their separators."""
        first, *others = [self._phrase(part, work, depth) for part in parts]
        text = first.text
        for separator, other in zip(separators, others, strict=True):
            text += separator + other.text
        return Translated(text, first.left + sum(other.left for other in others))

    def _by_known_head(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield the translation of the longest known beginning up to a separator, and of the rest."""
        ends: set[int] = set()
        for separator in _SEPARATORS:
            at = text.find(separator, 1)
            while at > 0:
                # The sign of the separator can belong to the beginning.
                ends.update((at, at + 1))
                at = text.find(separator, at + 1)
        for end in reversed(sorted(ends)[:_MOST_HEADS]):
            head = text[:end].strip()
            if self._is_message(head):
                first = self._phrase(text[:end], work, depth)
                rest = self._phrase(text[end:], work, depth)
                yield Translated(first.text + rest.text, first.left + rest.left)
                return

    def _is_message(self, text: str) -> bool:
        """Tell whether a text is one message, without the end of a sentence in its values."""
        if text in self._whole:
            return True
        for template, values in self._matches(text):
            if _is_strict(template, values):
                return True
        return False

    def _by_separators(self, text: str, work: _Work, depth: int) -> Iterator[Translated]:
        """Yield translations of both parts of a list, of a label and its text, or of a text and its addition."""
        for separator in _SEPARATORS:
            at = text.find(separator, 1)
            while at > 0:
                head = self._phrase(text[:at], work, depth)
                after = self._phrase(text[at + len(separator) :], work, depth)
                yield Translated(head.text + separator + after.text, head.left + after.left)
                # The sign of the separator can belong to the first or to the second template.
                rest = self._phrase(text[at:].strip(), work, depth)
                blank = " " if text[at] == " " else ""
                yield Translated(head.text + blank + rest.text, head.left + rest.left)
                whole = self._phrase(text[: at + 1], work, depth)
                blank = "" if text[at] == " " else " "
                yield Translated(whole.text + blank + after.text, whole.left + after.left)
                at = text.find(separator, at + 1)

    def number(self, text: str) -> str:
        """Return a text with its numbers in this language's form: `98,4` for `98.4`."""
        if self.decimal == ".":
            return text
        return _DECIMAL.sub(rf"\g<1>{self.decimal}\g<2>", text)


def _first_tried(template: Template) -> tuple[int, bool]:
    """Return the sorting key of a template."""
    return -template.weight, not template.literals[0]


def _lower(text: str) -> str:
    """Return a text with a small first letter."""
    return text[0].lower() + text[1:]


def _upper(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[0].upper() + text[1:]


def _is_strict(template: Template, values: Iterable[str]) -> bool:
    """Tell whether a template has many letters, and its values hold no end of a sentence."""
    if template.weight < _LEAST_WEIGHT:
        return False
    for value in values:
        if _SENTENCE_END.search(value):
            return False
    return True


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


def _words_left(text: str) -> int:
    """Return the number of words of prose in a text."""
    words = _PROSE.findall(_QUOTED.sub("", text))
    return sum(word not in _UNITS for word in words)


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


def language_of(tag: str, lab_catalogues: Iterable[Path] = ()) -> Language:
    """Return a language with the grader's messages, and those of a lab.

    Parameters
    ----------
    tag
        One of `NAMES`.
    lab_catalogues
        Catalogues of the lab, which count before the grader's own.
    """
    assert tag in NAMES
    paths = (*lab_catalogues, *engine_catalogues(tag))
    states = tuple((path, path.stat().st_mtime_ns) for path in paths)
    return _made(tag, states)


@functools.lru_cache(maxsize=8)
def _made(tag: str, states: tuple[tuple[Path, int], ...]) -> Language:
    return Language(tag, read_catalogues(path for path, _ in states))

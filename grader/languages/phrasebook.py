"""Find finished English texts among the messages of a catalogue, once for all languages with the same messages.

A text is sought as a whole, then by the template with the most letters that matches, then sentence by sentence, then in
the parts of a list. The rest stays English: names, paths, and sentences of other programs.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import NamedTuple, TypeAlias, TypeVar

from grader.languages.found import Capital, English, Filled, Found, Part, Whole
from grader.languages.template import FIRST_MARK, LAST_MARK, Template, is_mark

T = TypeVar("T")

#: Most pieces of a text that are looked up: enough for any text of the grader's, and a bound for others.
_MOST_LOOKUPS = 200
_MOST_MATCHES = 8
_MOST_DEPTH = 9
#: Most texts, and most pieces of texts, that are remembered, and the longest such piece.
_MOST_REMEMBERED = 20_000
_LONGEST_REMEMBERED = 200
_MOST_HEADS = 24
#: Letters of a template that is used even if a value in it stays English; lighter ones match by chance.
_LEAST_WEIGHT = 7
_WORD = re.compile(r"\w+")
_MARKS = re.compile(f"[{chr(FIRST_MARK)}-{chr(LAST_MARK)}]")
_SENTENCE_END = re.compile(rf"(?<=[.!?])\s+(?=[/A-Z0-9“‘'\"(±{chr(FIRST_MARK)}-{chr(LAST_MARK)}])")
#: Plain lower-case words, as in prose; names have other signs, and values capitals.
_PROSE = re.compile(
    r"(?<![^\s(“‘'])[a-z]{2,}(?:[’'](?:s|t))?(?![^\s),.;:!?”’'…])|\b[A-Z][a-z]+ [a-z]{2,}\b"
)
#: Names, and values of texts, between single quotation marks.
_QUOTED = re.compile(r"(?<!\w)'[^']*'")
_UNITS = frozenset({"ms", "rad", "µs", "mm"})
_LOWER = re.compile(r"[A-Z][a-z]")
#: Signs between the parts of a list or a label and its text, the wider ones first.
_SEPARATORS = ("; ", " · ", ". ", ": ", " (", ", ", " – ", " → ", " and ", " or ", " to ", " = ")
_OF_LISTS = ("; ", " · ", ", ")
_AROUND = (("(", ")"), ("“", "”"), ("‘", "’"), ("'", "'"))
_OPENING = ("'", "‘", "“", "„", "«")
_ENDS = ".:;,…?"
_NUMBER_FIRST = re.compile(r"([−+±≈<>]?\d[\d.,]*(?: ?%)?) (?=\S)")


class _Match(NamedTuple):
    """A template that matches a text, by its number, and its inserted values.

    A match is strict if the template has many letters, and its values hold no end of a sentence.
    """

    number: int
    values: list[str]
    is_strict: bool


class _Entry(NamedTuple):
    """A template by its number, with its first and last literal texts; `order` sorts the ones to be tried first."""

    order: int
    number: int
    first: str
    last: str

    @classmethod
    def of(cls, number: int, template: Template) -> _Entry:
        """Return the entry of a template."""
        first, *_, last = template.literals
        return cls(2 * -template.weight + (not first), number, first, last)


_order = attrgetter("order")


@dataclass
class _Work:
    """One text under search: the results for its pieces, and the number of further lookups."""

    known: dict[str, Found] = field(default_factory=dict)
    lookups: int = _MOST_LOOKUPS


#: A way to the parts of a text, with the number of phrases around it.
_Way: TypeAlias = Callable[[str, _Work, int], Iterator[Found]]


class Phrasebook:
    """The English messages of a catalogue, and the texts found among them."""

    def __init__(self, messages: Sequence[str]) -> None:
        #: Messages without values.
        self.whole: set[str] = set()
        #: The other messages.
        self.templates: list[Template] = []
        self._by_word: dict[str, list[_Entry]] = defaultdict(list)
        self._matching: dict[str, tuple[_Match, ...]] = {}
        self._beginnings: dict[str, list[_Entry]] = {}
        self._texts: dict[str, Found] = {}
        for message in messages:
            template = Template.of(message)
            if len(template.literals) > 1:
                self.templates.append(template)
            else:
                self.whole.add(template.literals[0])
        #: Beginnings of the former up to and with a separator of lists.
        self._with_separator = set(itertools.chain.from_iterable(map(_first_items, self.whole)))
        self._index()

    def __getstate__(self) -> dict[str, object]:
        """Return the state to be kept in a cache: without remembered texts, because these can be students'."""
        state = dict(vars(self))
        for name in ("_matching", "_beginnings", "_texts"):
            state[name] = {}
        return state

    def _index(self) -> None:
        """Keep each template under the word that the fewest others have; under an empty one without a word."""
        words = [template.anchors() for template in self.templates]
        counts = Counter(itertools.chain.from_iterable(words))
        for number, template in enumerate(self.templates):
            rarest = min(words[number], key=counts.__getitem__, default="")
            self._by_word[rarest].append(_Entry.of(number, template))

    def found(self, text: str) -> Found:
        """Return the parts of a text."""
        known = self._texts.get(text)
        if known is None:
            known = self._phrase(text, _Work(), 0)
            if len(self._texts) >= _MOST_REMEMBERED:
                self._texts.clear()
            self._texts[text] = known
        return known

    # -- the ways to the parts ---------------------------------------------------------------------

    def _phrase(self, text: str, work: _Work, depth: int) -> Found:
        """Return the parts of a piece, found in the way that leaves the fewest words English."""
        core = text.strip()
        if not core or is_mark(core):
            return Found((text,))
        known = work.known.get(core)
        if known is None:
            known = self._looked_up(core, work, depth)
        if len(core) == len(text):
            return known
        start = text.index(core)
        end = start + len(core)
        return Found((text[:start], *known.parts, text[end:]), known.left)

    def _looked_up(self, text: str, work: _Work, depth: int) -> Found:
        """Return the parts of a piece without blanks at its ends, and remember them."""
        whole = self._known_as_whole(text)
        if whole is not None:
            return Found((whole,))
        if depth == _MOST_DEPTH or work.lookups == 0:
            return _unknown(text, depth)
        work.lookups -= 1
        found = self._best(text, work, depth)
        work.known[text] = found
        return found

    def _best(self, text: str, work: _Work, depth: int) -> Found:
        """Return the parts that leave the fewest words English; the text itself only if each way leaves more."""
        unknown: Found | None = None
        best: Found | None = None
        limit = 0
        for way in self._ways_for(text):
            for other in way(text, work, depth + 1):
                if other.left == 0:
                    return other
                # Counting the words of each text takes a tenth of the time, and most texts are found.
                if unknown is None:
                    unknown = _unknown(text, depth)
                    limit = unknown.left + 1
                if other.left < limit:
                    best = other
                    limit = other.left
        return best or unknown or _unknown(text, depth)

    def _ways_for(self, text: str) -> Iterator[_Way]:
        """Yield the ways to the parts of a text that its signs permit, in the order of trial."""
        # Most ways divide a text at its blanks.
        is_word = len(text.split(maxsplit=1)) == 1
        if ", " in text:
            yield self._by_known_items
        yield self._by_strict_templates
        if not is_word:
            yield self._by_sentences
            yield self._by_known_head
        yield self._by_end
        yield self._by_templates
        yield self._without_around
        if not is_word:
            yield self._by_number
        yield self._by_lower_case
        yield self._by_marks
        if not is_word:
            yield self._by_list
            yield self._by_separators

    def _known_as_whole(self, text: str) -> Part | None:
        """Return a message without values, also with another first letter; None if the text is none."""
        if text in self.whole:
            return Whole(text)
        if not text[:1].isupper():
            return None
        lower = _lower(text)
        if lower not in self.whole:
            return None
        return Capital((Whole(lower),))

    def _by_strict_templates(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield translations by templates whose values hold no end of a sentence."""
        for match in self._matches(text):
            if match.is_strict:
                yield from self._filled(match, work, depth)

    def _by_templates(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield translations by the other templates."""
        for match in self._matches(text):
            if not match.is_strict:
                yield from self._filled(match, work, depth)

    def _filled(self, match: _Match, work: _Work, depth: int) -> Iterator[Found]:
        """Yield a template with its values; none if it has few letters, and a value stays English."""
        template = self.templates[match.number]
        values = []
        left = 0
        for number, value in enumerate(match.values):
            found = Found((value,))
            # A single word between quotation marks is a name, also if a message reads the same.
            if " " in value or not template.literals[number].endswith(_OPENING):
                found = self._phrase(value, work, depth)
            values.append(found.parts)
            left += found.left
        if left == 0 or template.weight >= _LEAST_WEIGHT:
            yield Found((Filled(match.number, tuple(values)),), left)

    def _matches(self, text: str, entries: list[_Entry] | None = None) -> tuple[_Match, ...]:
        """Return the first templates that match a text, and remember them; they are among some entries, if given."""
        known = self._matching.get(text)
        if known is not None:
            return known
        if entries is None:
            entries = self._beginning(text)
        known = tuple(self._matches_among(entries, text))
        _remember(self._matching, text, known)
        return known

    def _matches_among(self, entries: Iterable[_Entry], text: str) -> Iterator[_Match]:
        """Yield the first templates, among some, that match a text, with the inserted values."""
        count = 0
        for entry in entries:
            if count == _MOST_MATCHES:
                return
            if not text.endswith(entry.last):
                continue
            template = self.templates[entry.number]
            values = template.values_in(text)
            # A value that is the whole text again would never come to an end.
            if values is not None and text not in values:
                count += 1
                yield _Match(entry.number, values, _is_strict(template, values))

    def _beginning(self, text: str) -> list[_Entry]:
        """Return the templates with the beginning and a word of a text, and remember them.

        The order is by letters, most first, and then by whether a template begins with its own text.
        """
        known = self._beginnings.get(text)
        if known is not None:
            return known
        found: list[_Entry] = []
        for word in ("", *dict.fromkeys(_WORD.findall(text))):
            for entry in self._by_word.get(word, ()):
                if text.startswith(entry.first):
                    found.append(entry)
        found.sort(key=_order)
        _remember(self._beginnings, text, found)
        return found

    def _by_sentences(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield the translation of a text of sentences, the longest known rows of them first."""
        starts = [0, *(found.end() for found in _SENTENCE_END.finditer(text)), len(text)]
        if len(starts) < 3:
            return
        parts: list[Part] = []
        left = 0
        at = 0
        last = len(starts) - 1
        while at < last:
            end = self._longest_row(text, starts, at)
            row = self._phrase(text[starts[at] : starts[end]], work, depth)
            parts += row.parts
            left += row.left
            at = end
        yield Found(tuple(parts), left)

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

    def _by_end(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield the translation of a text without its last sign, such as a full stop."""
        if len(text) > 1 and text[-1] in _ENDS:
            found = self._phrase(text[:-1], work, depth)
            yield Found((*found.parts, text[-1]), found.left)
        if len(text) > 2 and text[0] in ",;·.":
            found = self._phrase(text[1:], work, depth)
            yield Found((text[0], *found.parts), found.left)

    def _without_around(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield the translation of a text in brackets or quotation marks."""
        for opening, closing in _AROUND:
            if len(text) > 2 and text[0] == opening and text[-1] == closing:
                found = self._phrase(text[1:-1], work, depth)
                yield Found((opening, *found.parts, closing), found.left)

    def _by_lower_case(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield the translation of a text that begins a sentence, by a template that does not."""
        if _LOWER.match(text):
            found = self._phrase(_lower(text), work, depth)
            yield Found((Capital(found.parts),), found.left)

    def _by_number(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield the translation of a number and what it counts."""
        number = _NUMBER_FIRST.match(text)
        if number is not None:
            found = self._phrase(text[number.end() :], work, depth)
            yield Found((English(number[1]), " ", *found.parts), found.left)

    def _by_marks(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield the translation of the pieces between the elements of a page."""
        parts = _MARKS.split(text)
        if len(parts) > 1:
            yield self._joined(parts, _MARKS.findall(text), work, depth)

    def _by_known_items(self, text: str, _work: _Work, _depth: int) -> Iterator[Found]:
        """Yield the translation of a list of which each item is a message without values; a full stop may end it."""
        end = ""
        if text.endswith("."):
            end = "."
            text = text[:-1]
        items = self._items(text, ", ")
        if len(items) < 2:
            return
        parts: list[Part] = []
        for item in items:
            known = self._known_as_whole(item)
            if known is None:
                return
            parts += (", ", known)
        if end:
            parts.append(end)
        yield Found(tuple(parts[1:]))

    def _by_list(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield the translation of a list, item by item; an item can hold the separator."""
        for separator in _OF_LISTS:
            items = self._items(text, separator)
            if len(items) > 1:
                yield self._joined(items, [separator] * (len(items) - 1), work, depth)

    def _items(self, text: str, separator: str) -> list[str]:
        """Return the items of a list; a known item can hold the separator."""
        if separator not in text:
            return [text]
        parts = text.split(separator)
        items = []
        while parts:
            length = self._item_length(parts, separator)
            items.append(separator.join(parts[:length]))
            parts = parts[length:]
        return items

    def _item_length(self, parts: list[str], separator: str) -> int:
        """Return the number of parts that are one known item; one without a known item."""
        beginning = parts[0] + separator
        if beginning not in self._with_separator and _lower(beginning) not in self._with_separator:
            return 1
        for length in range(min(6, len(parts)), 1, -1):
            item = separator.join(parts[:length])
            if self._known_as_whole(item):
                return length
        return 1

    def _joined(self, parts: list[str], separators: list[str], work: _Work, depth: int) -> Found:
        """Return the translation of parts with their separators."""
        joined: list[Part] = []
        left = 0
        for part, separator in zip(parts, (*separators, ""), strict=True):
            found = self._phrase(part, work, depth)
            joined += (*found.parts, separator)
            left += found.left
        return Found(tuple(joined), left)

    def _by_known_head(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield the translation of the longest known beginning up to a separator, and of the rest."""
        # A separator ends each word, so that the beginning has no template that the text does not begin with.
        entries = self._beginning(text)
        for end in reversed(_ends_of_heads(text)):
            head = text[:end].strip()
            if self._is_message(head, entries):
                first = self._phrase(text[:end], work, depth)
                rest = self._phrase(text[end:], work, depth)
                yield Found(first.parts + rest.parts, first.left + rest.left)
                return

    def _is_message(self, text: str, entries: list[_Entry] | None = None) -> bool:
        """Tell whether a text is one message, without the end of a sentence in its values."""
        if text in self.whole:
            return True
        for match in self._matches(text, entries):
            if match.is_strict:
                return True
        return False

    def _by_separators(self, text: str, work: _Work, depth: int) -> Iterator[Found]:
        """Yield translations of both parts of a list, of a label and its text, or of a text and its addition."""
        for separator in _SEPARATORS:
            at = text.find(separator, 1)
            while at > 0:
                head = self._phrase(text[:at], work, depth)
                after = self._phrase(text[at + len(separator) :], work, depth)
                yield Found((*head.parts, separator, *after.parts), head.left + after.left)
                # The sign of the separator can belong to the first or to the second template.
                rest = self._phrase(text[at:].strip(), work, depth)
                blank = " " if text[at] == " " else ""
                yield Found((*head.parts, blank, *rest.parts), head.left + rest.left)
                whole = self._phrase(text[: at + 1], work, depth)
                blank = "" if text[at] == " " else " "
                yield Found((*whole.parts, blank, *after.parts), whole.left + after.left)
                at = text.find(separator, at + 1)


def _unknown(text: str, depth: int) -> Found:
    """Return a text without a message, at a number of phrases around it."""
    left = 0
    # A single word within a text can be a name, which nobody translates.
    if depth == 0 or " " in text:
        left = words_left(text)
    return Found((English(text),), left)


def _remember(memory: dict[str, T], text: str, value: T) -> None:
    """Remember a value for a text, unless the text is long."""
    if len(text) > _LONGEST_REMEMBERED:
        return
    if len(memory) >= _MOST_REMEMBERED:
        memory.clear()
    memory[text] = value


def _first_items(text: str) -> Iterator[str]:
    """Yield the beginning of a text with the first separator of each kind of list."""
    for separator in _OF_LISTS:
        first, found, _ = text.partition(separator)
        if found:
            yield first + found


def _ends_of_heads(text: str) -> list[int]:
    """Return the first places before and after the first sign of a separator, in their order."""
    ends: set[int] = set()
    for separator in _SEPARATORS:
        at = text.find(separator, 1)
        while at > 0:
            # The sign of the separator can belong to the beginning.
            ends.update((at, at + 1))
            at = text.find(separator, at + 1)
    return sorted(ends)[:_MOST_HEADS]


def _lower(text: str) -> str:
    """Return a text with a small first letter."""
    return text[0].lower() + text[1:]


def _is_strict(template: Template, values: Iterable[str]) -> bool:
    """Tell whether a template has many letters, and its values hold no end of a sentence."""
    if template.weight < _LEAST_WEIGHT:
        return False
    for value in values:
        if _SENTENCE_END.search(value):
            return False
    return True


def words_left(text: str) -> int:
    """Return the number of words of prose in a text."""
    if "'" in text:
        text = _QUOTED.sub("", text)
    words = _PROSE.findall(text)
    return sum(word not in _UNITS for word in words)


@functools.lru_cache(maxsize=8)
def phrasebook_of(messages: tuple[str, ...]) -> Phrasebook:
    """Return the phrasebook of messages, which all languages with exactly these messages share."""
    return Phrasebook(messages)

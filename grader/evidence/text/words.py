"""Words in any script: counting them, folding them, and finding terms among them.

Counts are comparable between scripts with and without spaces between words. Terms are found regardless of case and
accents. Every function is linear in the length of its text.
"""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import regex

from grader.lab.patterns import compiled_once, search

#: Han and kana characters with as much meaning as one spaced word.
IDEOGRAPHS_PER_WORD = 2
#: Letters of Thai, Lao, Khmer and Burmese with as much meaning as one word.
LETTERS_PER_UNSPACED_WORD = 4

_IDEOGRAPH = (
    "\u3041-\u30ff\u31f0-\u31ff\u3400-\u4dbf\u4e00-\u9fff\uf900-\ufaff\U00020000-\U0003ffff"
)
_UNSPACED = "\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff"
_WORD = re.compile(rf"[{_IDEOGRAPH}]|[{_UNSPACED}]+|(?:(?![{_IDEOGRAPH}{_UNSPACED}])[^\W_])+")
_IS_IDEOGRAPH = re.compile(f"[{_IDEOGRAPH}]").match
_IS_UNSPACED = re.compile(f"[{_UNSPACED}]").match
#: Combining marks without which a letter stays the same (not Indic vowels).
_ACCENT = re.compile("[\u0300-\u036f\u064b-\u0652]")
_SENTENCE_END = re.compile(r"(?<=[.!?])\s+|[。！？；।؟۔]+|\n[ \t]*\n")
#: Characters of the longest sentence; longer ones are split.
_SENTENCE_LIMIT = 20_000
#: Hexadecimal digits of a fingerprint.
_FINGERPRINT_DIGITS = 16
#: Characters of a text that are examined for a placeholder.
_START = 400
_BRACKETED = re.compile(r"^\W{0,80}[<\[{][^<>\[\]{}]{0,80}[>\]}]\W*$")


def fold(text: str) -> str:
    """Return a text in lower case without accents, for comparisons; dotless and dotted i become the same letter.

    The length can change.
    """
    if text.isascii():
        return text.lower()
    plain = unicodedata.normalize("NFKD", text.casefold().replace("ı", "i"))
    return unicodedata.normalize("NFC", _ACCENT.sub("", plain))


def words(text: str) -> list[str]:
    """Return the words of a text, folded; each ideograph is an item of its own.

    Marks inside a word, such as Indic vowel signs, do not split it.
    """
    folded = fold(text)
    if folded.isascii():
        return _WORD.findall(folded)
    joined = "".join(c for c in folded if not unicodedata.category(c).startswith("M"))
    return _WORD.findall(joined)


def measure(items: Iterable[str]) -> int:
    """Return the amount of text in distinct items of `words`, as a number of words of a spaced script.

    Numbers and single Latin letters do not count.
    """
    ideographs = 0
    unspaced = 0
    spaced = 0
    for item in set(items):
        if _IS_IDEOGRAPH(item):
            ideographs += 1
        elif _IS_UNSPACED(item):
            unspaced += len(item)
        elif not item[0].isdigit() and (len(item) > 1 or not item.isascii()):
            spaced += 1
    return spaced + ideographs // IDEOGRAPHS_PER_WORD + unspaced // LETTERS_PER_UNSPACED_WORD


def substance(text: str) -> int:
    """Return the number of distinct words of a text; two ideographs count as a word. See `measure`."""
    return measure(words(text))


def normal_form(text: str) -> str:
    """Return a text reduced to its folded words, so that repetitions are equal regardless of their punctuation."""
    return " ".join(words(text))


def fingerprint(text: str) -> str:
    """Return a digest of a text's words, equal for texts that differ in punctuation and layout alone."""
    return hashlib.sha256(normal_form(text).encode()).hexdigest()[:_FINGERPRINT_DIGITS]


def is_placeholder(text: str, patterns: Sequence[str] = ()) -> bool:
    """Return whether a text is a placeholder: dots, a template's field, or a match of one of the patterns."""
    stripped = text.strip()[:_START]
    if not any(map(str.isalnum, stripped)) or _BRACKETED.match(stripped):
        return True
    return any(search(pattern, stripped, ignore_case=True) for pattern in patterns)


def sentences(text: str) -> list[str]:
    """Return the sentences of a text, without empty ones; a paragraph without full stops is one sentence."""
    found = []
    for part in _SENTENCE_END.split(text):
        for start in range(0, len(part), _SENTENCE_LIMIT):
            sentence = part[start : start + _SENTENCE_LIMIT].strip()
            if sentence:
                found.append(sentence)
    return found


@dataclass(frozen=True)
class Terms:
    """A set of terms to be found in texts of any language.

    A term in a spaced script is found at the start of a word; a term that starts with `*`, also inside a word
    (German compounds); a term that ends with `$`, only as a whole word. Blanks, hyphens and underscores in a
    term stand for each other or for nothing. A term of ideographs, or of a script that joins articles and
    particles to its words, is found anywhere.
    """

    #: Pattern for folded text; without a term it matches nothing.
    pattern: regex.Pattern[str]

    @classmethod
    def of(cls, terms: Iterable[str], ending: int | None = None) -> Terms:
        """Return terms from their spellings; up to `ending` letters may follow each, or any number."""
        return _terms_of(tuple(terms), ending)

    def count(self, text: str) -> int:
        """Return the number of occurrences of terms in a text."""
        return len(self.pattern.findall(fold(text)))

    def found(self, text: str) -> bool:
        """Return whether any of the terms occurs in a text."""
        return self.pattern.search(fold(text)) is not None

    def place(self, text: str) -> int | None:
        """Return the start of the first term in the folded text; None if it contains no term."""
        match = self.pattern.search(fold(text))
        return match.start() if match is not None else None

    def without(self, text: str) -> str:
        """Return the folded text with every term blanked out, to the end of its word."""
        return self.pattern.sub(" ", fold(text))


# Submissions of a lab are read by the same terms, and compiling them takes a tenth of judging.
@lru_cache(maxsize=256)
def _terms_of(terms: tuple[str, ...], ending: int | None) -> Terms:
    unique = {fold(term).strip() for term in terms}
    shapes: dict[tuple[str, str], list[str]] = {}
    for term in sorted(unique, key=lambda term: (-len(term), term)):
        if term.strip("*$ \t\n_-"):
            bodies = shapes.setdefault(_surroundings(term, ending), [])
            bodies.append(_body(term))
    # Terms of one shape share their surroundings, because a class of letters takes `re` about 6 ms to compile.
    patterns = []
    for (before, after), bodies in shapes.items():
        choices = "|".join(bodies)
        patterns.append(f"{before}(?:{choices}){after}")
    return Terms(compiled_once("|".join(patterns) or r"(?!)"))


_JOINED = "\u0590-\u08ff\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff\u2e80-\U0003ffff"
_SPACED_LETTER = rf"[^\W\d_{_JOINED}]"
_SPACED_WORD = rf"[^\W_{_JOINED}]"


def _body(term: str) -> str:
    parts = filter(None, re.split(r"[\s_-]+", term.strip("*$")))
    return r"[\s_-]{0,2}".join(map(re.escape, parts))


def _surroundings(term: str, ending: int | None) -> tuple[str, str]:
    """Return the patterns before and after a term."""
    if re.search(f"[{_JOINED}]", term):
        return "", ""
    before = "" if term.startswith("*") else f"(?<!{_SPACED_WORD})"
    if term.endswith("$"):
        ending = 0
    if ending is None:
        return before, f"{_SPACED_LETTER}*"
    return before, f"{_SPACED_LETTER}{{0,{ending}}}(?!{_SPACED_WORD})"

"""Words in any script: counting them, folding them, and finding terms among them.

Words are counted alike for scripts that part words by spaces and for those that do not, and terms are found regardless
of case and accents. Every function is linear in the length of its text.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import regex

from grader.lab.patterns import search

#: Han and kana characters that say as much as one spaced word.
IDEOGRAPHS_PER_WORD = 2
#: Letters of Thai, Lao, Khmer and Burmese that say as much as one word.
LETTERS_PER_UNSPACED_WORD = 4

_IDEOGRAPH = (
    "\u3041-\u30ff\u31f0-\u31ff\u3400-\u4dbf\u4e00-\u9fff\uf900-\ufaff\U00020000-\U0003ffff"
)
_UNSPACED = "\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff"
_WORD = re.compile(rf"[{_IDEOGRAPH}]|[{_UNSPACED}]+|(?:(?![{_IDEOGRAPH}{_UNSPACED}])[^\W_])+")
_IS_IDEOGRAPH = re.compile(f"[{_IDEOGRAPH}]").match
_IS_UNSPACED = re.compile(f"[{_UNSPACED}]").match
#: Combining marks of scripts where leaving one out keeps the letter (not Indic vowels).
_ACCENT = re.compile("[\u0300-\u036f\u064b-\u0652]")
_SENTENCE_END = re.compile(r"(?<=[.!?])\s+|[。！？；।؟۔]+|\n[ \t]*\n")
_SENTENCE_LIMIT = 20_000
_BRACKETED = re.compile(r"^\W{0,80}[<\[{][^<>\[\]{}]{0,80}[>\]}]\W*$")


def fold(text: str) -> str:
    """Lower case without accents, for comparisons; dotless and dotted i are the same letter.

    The result may differ from `text` in length.
    """
    if text.isascii():
        return text.lower()
    plain = unicodedata.normalize("NFKD", text.casefold().replace("ı", "i"))
    return unicodedata.normalize("NFC", _ACCENT.sub("", plain))


def words(text: str) -> list[str]:
    """Words of `text`, folded; each ideograph is an item of its own.

    Marks inside a word (as Indic vowel signs) do not part it.
    """
    folded = fold(text)
    if folded.isascii():
        return _WORD.findall(folded)
    joined = "".join(c for c in folded if not unicodedata.category(c).startswith("M"))
    return _WORD.findall(joined)


def measure(items: Iterable[str]) -> int:
    """Amount of text in `items` of `words`, counting each distinct item once, in words of a spaced script.

    Numbers and single Latin letters do not count.
    """
    unique = set(items)
    ideographs = sum(1 for item in unique if _IS_IDEOGRAPH(item))
    unspaced = sum(len(item) for item in unique if _IS_UNSPACED(item))
    others = (
        item
        for item in unique
        if not _IS_IDEOGRAPH(item) and not _IS_UNSPACED(item) and not item[0].isdigit()
    )
    spaced = sum(1 for item in others if len(item) > 1 or not item.isascii())
    return spaced + ideographs // IDEOGRAPHS_PER_WORD + unspaced // LETTERS_PER_UNSPACED_WORD


def substance(text: str) -> int:
    """Distinct words in `text`; two ideographs count as a word. See `measure`."""
    return measure(words(text))


def normal_form(text: str) -> str:
    """`text` reduced to its folded words, so that repeats are seen whatever their punctuation."""
    return " ".join(words(text))


def is_placeholder(text: str, patterns: Sequence[str] = ()) -> bool:
    """Whether `text` only holds the place of a text: dots, a template's field, or what one of the patterns finds."""
    stripped = text.strip()[:400]
    if not any(c.isalnum() for c in stripped) or _BRACKETED.match(stripped):
        return True
    return any(search(pattern, stripped, ignore_case=True) for pattern in patterns)


def sentences(text: str) -> list[str]:
    """Sentences of `text`, without empty ones; a paragraph without full stops is one sentence."""
    parts = _SENTENCE_END.split(text)
    pieces = (
        part[i : i + _SENTENCE_LIMIT]
        for part in parts
        for i in range(0, len(part), _SENTENCE_LIMIT)
    )
    return [piece.strip() for piece in pieces if piece.strip()]


@dataclass(frozen=True)
class Terms:
    """A set of terms to be found in texts of any language.

    A term in a spaced script is found where a word begins; one that starts with `*`, also inside a word
    (German compounds); one that ends with `$`, only as a whole word. Blanks, hyphens and underscores in a
    term stand for each other or for nothing. A term of ideographs, or of a script that joins articles and
    particles to its words, is found anywhere.
    """

    #: Matches in folded text; nothing when there is no term.
    pattern: regex.Pattern[str]

    @classmethod
    def of(cls, terms: Iterable[str], ending: int | None = None) -> Terms:
        """Terms from their spellings; up to `ending` letters may follow one, None for any number."""
        unique = sorted({fold(term).strip() for term in terms}, key=lambda term: (-len(term), term))
        shapes: dict[tuple[str, str], list[str]] = {}
        for term in unique:
            if term.strip("*$ \t\n_-"):
                shapes.setdefault(_surroundings(term, ending), []).append(_body(term))
        # Terms of one shape share their surroundings: each class of letters is costly to compile (by `re` some 6 ms).
        patterns = [
            f"{before}(?:{'|'.join(bodies)}){after}" for (before, after), bodies in shapes.items()
        ]
        return cls(regex.compile("|".join(patterns) or r"(?!)"))

    def count(self, text: str) -> int:
        """How often any of the terms occurs in `text`."""
        return sum(1 for _ in self.pattern.finditer(fold(text)))

    def found(self, text: str) -> bool:
        """Whether any of the terms occurs in `text`."""
        return self.pattern.search(fold(text)) is not None

    def place(self, text: str) -> int | None:
        """Where in the folded `text` the first of the terms begins, None if there is none."""
        match = self.pattern.search(fold(text))
        return match.start() if match is not None else None

    def without(self, text: str) -> str:
        """Folded `text` with every term blanked out, to the end of the word that it begins."""
        return self.pattern.sub(" ", fold(text))


_JOINED = "\u0590-\u08ff\u0e00-\u0eff\u1000-\u109f\u1780-\u17ff\u2e80-\U0003ffff"
_SPACED_LETTER = rf"[^\W\d_{_JOINED}]"
_SPACED_WORD = rf"[^\W_{_JOINED}]"


def _body(term: str) -> str:
    parts = [re.escape(part) for part in re.split(r"[\s_-]+", term.strip("*$")) if part]
    return r"[\s_-]{0,2}".join(parts)


def _surroundings(term: str, ending: int | None) -> tuple[str, str]:
    """What may stand before and after a term."""
    if re.search(f"[{_JOINED}]", term):
        return "", ""
    before = "" if term.startswith("*") else f"(?<!{_SPACED_WORD})"
    if term.endswith("$"):
        ending = 0
    if ending is None:
        return before, f"{_SPACED_LETTER}*"
    return before, f"{_SPACED_LETTER}{{0,{ending}}}(?!{_SPACED_WORD})"

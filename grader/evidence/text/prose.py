"""Texts of a student: how to run the work, the task of each part, the reasons for its design.

A text counts by its own words. Headings, names, links, code, placeholders, and a sentence repeated for each part add
none. The language does not matter; the rubric gives the terms to look for.
"""

from __future__ import annotations

import ast
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from grader.evidence.text.markup import Block, Section, code_spans, own_text, plain_text
from grader.evidence.text.source import SourceFacts
from grader.evidence.text.syntax import normalise, tree_of
from grader.evidence.text.words import (
    Terms,
    fingerprint,
    fold,
    is_placeholder,
    measure,
    normal_form,
    sentences,
    words,
)
from grader.lab.patterns import search

#: Characters of a line that are read as a command.
COMMAND_LIMIT = 500
#: Words, and characters of them, in which a sentence names its action.
_OPENING_WORDS = 3
_OPENING_LENGTH = 40
#: Statements of source code that prose does not have.
_OF_SOURCE = (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
#: Names of concepts per own word above which a text lists them only.
_STUFFING_RATIO = 1.5
_COMMAND_START = re.compile(r"^[\s>*+-]{0,8}(?:[$#%]\s+)?")
#: Average words between two punctuation marks from which words are only strung together.
_LONG_STRETCH = 8
#: Distinct words, and distinct concepts, from which a short passage may discuss.
_SHORT_WORDS = 8
_SHORT_CONCEPTS = 2
#: Share of numbers among the words of a passage above which the passage is data.
_SHARE_OF_NUMBERS = 0.25
#: Own words, besides names, that connect these.
_SHORT_OWN_WORDS = 3
#: Share of connectives below which words are only strung together, or in a language unknown here.
_FEW_CONNECTIVES = 0.1
_MARKS = re.compile(r"[.,;:!?()|/\"“”„«»—–\n]+")
_SCRIPTS = ("LATIN", "CYRILLIC")


@dataclass(frozen=True)
class Passage:
    """A piece of connected text, with its file, its first line, and the heading above it."""

    text: str
    file: str
    line: int
    heading: str = ""


@dataclass(frozen=True)
class Discussion:
    """Concepts that are discussed, and passages that weigh them against each other."""

    #: Concepts in the order of the lexicon, each with its passage, at the first line that names it: of the passages that
    #: discuss it, the first with the most concepts.
    discussed: Mapping[str, Passage]
    #: Passages that relate two or more concepts, with a word of reason or comparison, or at length.
    related: tuple[Passage, ...]
    #: Passages with words strung together without sentences, see `lacks_sentences`.
    strung: tuple[Passage, ...]
    #: Passages on the subject that may discuss it: short ones, and ones in words unknown here.
    unclear: tuple[Passage, ...] = ()


# -- visible text ---------------------------------------------------------------------------------------


def is_source(text: str) -> bool:
    """Return whether a text is Python source: it parses, and imports or defines something."""
    tree = tree_of(normalise(text))
    if tree is None:
        return False
    return any(isinstance(node, _OF_SOURCE) for node in tree.body)


def visible(
    document: Sequence[Section], names: Terms, placeholders: Sequence[str]
) -> tuple[list[Block], list[Section]]:
    """Return the blocks of a document that carry information, in order, and its headings without text below.

    A heading with text below becomes a block of kind "heading", or "title" if it is the heading of the whole document.
    Pasted source code and placeholders carry no information, not even after the name of a part.

    Parameters
    ----------
    document
        The sections.
    names
        Names of the parts.
    placeholders
        Regular expressions of placeholders.
    """
    shown: list[Block] = []
    empty: list[Section] = []
    below: list[tuple[int, bool]] = []
    title = _title_of(document)
    for section in reversed(document):
        blocks = [block for block in section.blocks if _is_informative(block, names, placeholders)]
        filled = bool(blocks)
        while below and below[-1][0] > section.level:
            filled |= below.pop()[1]
        below.append((section.level, filled))
        shown += reversed(blocks)
        if not section.level:
            continue
        if filled:
            kind = "title" if section is title else "heading"
            shown.append(Block(kind, section.title, section.line))
        else:
            empty.append(section)
    shown.reverse()
    empty.reverse()
    return shown, empty


def _title_of(document: Sequence[Section]) -> Section | None:
    """Return the only section of the highest level, if there is one."""
    levels = [section.level for section in document if section.level]
    highest = min(levels, default=0)
    tops = [section for section in document if section.level == highest]
    return tops[0] if len(tops) == 1 else None


def _is_informative(block: Block, names: Terms, placeholders: Sequence[str]) -> bool:
    if is_source(block.text):
        return False
    if block.kind == "code":
        return bool(block.text.strip())
    plain = plain_text(block.text)
    own = names.without(plain)
    has_own_words = any(map(str.isalnum, own))
    if not has_own_words and names.found(plain):
        # The bare name of a part.
        return True
    return not is_placeholder(own, placeholders)


def mention(blocks: Sequence[Block], names: Terms, synonyms: Terms) -> int | None:
    """Return the line with the first of a part's names, or else the first of its synonyms; None if there is no such line."""
    line = _first_line(blocks, names)
    if line is None:
        line = _first_line([block for block in blocks if block.kind != "title"], synonyms)
    return line


def _first_line(blocks: Iterable[Block], terms: Terms) -> int | None:
    for block in blocks:
        place = terms.place(block.text)
        if place is not None:
            return block.line + fold(block.text).count("\n", 0, place)
    return None


# -- commands and instructions ---------------------------------------------------------------------------


def command_lines(blocks: Sequence[Block], patterns: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yield each line with a command that matches one of the patterns, and the command.

    Code, code spans and plain lines are searched, regardless of case, because many READMEs do not mark commands.
    """
    for block in blocks:
        for offset, line in enumerate(block.text.split("\n")):
            for command in _commands(block.kind, line):
                if any(search(pattern, command, ignore_case=True) for pattern in patterns):
                    yield block.line + offset, command


def instruction_line(blocks: Sequence[Block], run_words: Sequence[str]) -> int | None:
    """Return the line of the first instruction to run the work.

    An instruction is a heading with a word for running, a sentence that begins with one, or else a sentence with such
    a word beside a code span, as "The nodes are started with `python3`".
    """
    terms = Terms.of(f"{word}$" for word in run_words)
    for block in blocks:
        if block.kind == "code":
            continue
        for line, sentence in _lines_of(block):
            text = block.text if block.kind == "heading" else _opening(sentence)
            if terms.found(text):
                return line
    for block in blocks:
        for line, sentence in _lines_of(block):
            if block.kind != "code" and code_spans(sentence) and terms.found(sentence):
                return line
    return None


def _opening(sentence: str) -> str:
    first = plain_text(sentence).split()[:_OPENING_WORDS]
    return " ".join(first)[:_OPENING_LENGTH]


def _lines_of(block: Block) -> Iterator[tuple[int, str]]:
    """Yield the sentences of a block with their first lines, which are approximate if a sentence spans lines."""
    line = block.line
    position = 0
    for sentence in sentences(block.text):
        start = block.text.find(sentence, position)
        if start >= 0:
            line += block.text.count("\n", position, start)
            position = start
        yield line, sentence


def _commands(kind: str, line: str) -> Iterator[str]:
    if kind == "code":
        yield _COMMAND_START.sub("", line[:COMMAND_LIMIT]).strip()
        return
    for span in code_spans(line):
        yield span[:COMMAND_LIMIT]
    yield _COMMAND_START.sub("", plain_text(line[:COMMAND_LIMIT])).strip()


# -- discussed concepts ----------------------------------------------------------------------------------


def document_passages(document: Sequence[Section], file: str) -> tuple[Passage, ...]:
    """Return the text of a document as passages: paragraphs, lists and tables, with their headings.

    A heading helps to tell the subject of a passage; its words do not count.
    """
    passages: list[Passage] = []
    for section in document:
        for _, run in groupby(section.blocks, _passage_key):
            blocks = list(run)
            if blocks[0].kind != "code":
                text = "\n\n".join(block.text for block in blocks)
                passages.append(Passage(text, file, blocks[0].line, section.title))
    return tuple(passages)


def _passage_key(block: Block) -> str | int:
    """Return a key that consecutive items of a list, or rows of a table, share."""
    if block.kind in ("item", "row"):
        return block.kind
    return block.line


def source_passages(facts: SourceFacts) -> tuple[Passage, ...]:
    """Return the explaining docstrings and comments of a source as passages, with their code as heading."""
    passages = []
    for note in facts.notes:
        if not note.fault:
            passages.append(Passage(note.text, facts.path, note.line, note.beside))
    return tuple(passages)


def concepts(
    passages: Iterable[Passage],
    lexicon: Mapping[str, Sequence[str]],
    reasons: Sequence[str] = (),
    anchors: Sequence[str] = (),
    min_words: int = 8,
    connectives: Sequence[str] = (),
    given: Collection[str] = (),
) -> Discussion:
    """Find the concepts that passages discuss. All words are `Terms` in any languages.

    Parameters
    ----------
    passages
        The passages; repetitions do not count.
    lexicon
        Words for each concept. A passage discusses a concept if it names it, and does not name more concepts than it
        has words.
    reasons
        Words of reason or comparison. Without one, a passage relates two concepts if it has twice `min_words`.
    anchors
        Words of the subject; if there are any, a passage must have one in its text or its heading.
    min_words
        Distinct own words, besides the names of all concepts, that a passage must have.
    connectives
        Words that connect others, see `lacks_sentences`.
    given
        Fingerprints of the handout's sentences, which do not count.
    """
    reader = _DiscussionReader(lexicon, reasons, min_words, connectives)
    every = Terms.of(stem for stems in lexicon.values() for stem in stems)
    for own in _own_texts(_on_topic(passages, anchors), every, given):
        reader.read(own)
    return reader.discussion()


def _on_topic(passages: Iterable[Passage], anchors: Sequence[str]) -> Iterator[Passage]:
    anchor = Terms.of(anchors)
    for passage in passages:
        if not anchors or anchor.found(plain_text(f"{passage.heading}\n{passage.text}")):
            yield passage


def lacks_sentences(text: str, connectives: Sequence[str]) -> bool:
    """Return whether a text is long rows of words with hardly a connective; False for unknown scripts."""
    if not connectives:
        return False
    plain = plain_text(text)
    spoken = words(plain)
    if not all(map(_is_known, spoken)):
        return False
    rows = list(filter(str.strip, _MARKS.split(plain)))
    if len(spoken) < _LONG_STRETCH * max(1, len(rows)):
        return False
    connecting = {fold(word) for word in connectives}
    found = sum(word in connecting for word in spoken)
    return found < _FEW_CONNECTIVES * len(spoken)


def _is_known(word: str) -> bool:
    return unicodedata.name(word[0], "").startswith(_SCRIPTS)


@dataclass(frozen=True)
class _Own:
    """A passage with its text, without sentences of previous passages, and its own words."""

    passage: Passage
    text: str
    words: list[str]
    #: Number of names of concepts.
    names: int

    def discusses(self, min_words: int) -> bool:
        """Tell whether there are enough own words; names must stand among them, rather than be strewn or listed."""
        amount = measure(self.words)
        return amount >= max(min_words, 1) and 0 < self.names <= amount * _STUFFING_RATIO

    def may_discuss(self, concepts: int) -> bool:
        """Tell whether a passage of few own words may say something about some concepts."""
        if concepts < _SHORT_CONCEPTS or measure(self.words) < _SHORT_OWN_WORDS:
            return False
        spoken = words(self.text)
        numbers = sum(word[0].isdigit() for word in spoken)
        # A table of results is not a text.
        if numbers > _SHARE_OF_NUMBERS * len(spoken):
            return False
        return measure(spoken) >= _SHORT_WORDS

    def is_foreign(self, connectives: Collection[str]) -> bool:
        """Tell whether hardly a word is a known connective; False if none are known."""
        if not connectives:
            return False
        spoken = words(self.text)
        known = sum(word in connectives for word in spoken)
        return all(map(_is_known, spoken)) and known < _FEW_CONNECTIVES * len(spoken)


class _DiscussionReader:
    """Collects what passages discuss."""

    def __init__(
        self,
        lexicon: Mapping[str, Sequence[str]],
        reasons: Sequence[str],
        min_words: int,
        connectives: Sequence[str],
    ) -> None:
        self._terms = {name: Terms.of(stems) for name, stems in lexicon.items()}
        self._reasoning = Terms.of(reasons)
        self._min_words = min_words
        self._connectives = connectives
        self._connecting = frozenset(map(fold, connectives))
        self._discussed: dict[str, Passage] = {}
        self._related: list[Passage] = []
        self._strung: list[Passage] = []
        self._unclear: list[Passage] = []
        #: Number of concepts in the passage of each concept.
        self._concepts_beside: dict[str, int] = {}

    def read(self, own: _Own) -> None:
        """Add a passage."""
        named = [name for name, terms in self._terms.items() if terms.found(own.text)]
        if not own.discusses(self._min_words):
            if own.may_discuss(len(named)):
                self._unclear.append(own.passage)
            return
        for name in named:
            if len(named) > self._concepts_beside.get(name, 0):
                self._concepts_beside[name] = len(named)
                self._discussed[name] = _at_first(own.passage, self._terms[name])
        is_long = measure(own.words) >= 2 * self._min_words
        if len(named) > 1 and (is_long or self._reasoning.found(own.text)):
            self._related.append(own.passage)
        if is_long and own.is_foreign(self._connecting):
            self._unclear.append(own.passage)
        if lacks_sentences(own.passage.text, self._connectives):
            self._strung.append(own.passage)

    def discussion(self) -> Discussion:
        """Return all that was read, with the concepts in the lexicon's order."""
        in_order = {name: self._discussed[name] for name in self._terms if name in self._discussed}
        return Discussion(
            in_order,
            tuple(self._related),
            tuple(self._strung),
            tuple(self._unclear),
        )


def _at_first(passage: Passage, terms: Terms) -> Passage:
    """Return a passage with the line that names one of some terms first, where its text has the file's lines.

    Items of a list, and rows of a table, stand further apart in the file than in the text of a passage.
    """
    if not passage.file.endswith(".py") and "\n\n" in passage.text:
        return passage
    for offset, line in enumerate(passage.text.split("\n")):
        if terms.found(line):
            return replace(passage, line=passage.line + offset)
    return passage


def _own_texts(passages: Iterable[Passage], every: Terms, given: Collection[str]) -> Iterator[_Own]:
    """Yield the student's own text of passages; a repeated sentence counts once in all of them, a given one never."""
    seen = {""}
    for passage in passages:
        fresh: list[str] = []
        for sentence in sentences(passage.text):
            form = normal_form(sentence)
            if form not in seen and fingerprint(sentence) not in given:
                seen.add(form)
                fresh.append(sentence)
        joined = "\n".join(fresh)
        text = plain_text(joined)
        own = words(every.without(own_text(joined)))
        yield _Own(passage, text, own, every.count(text))

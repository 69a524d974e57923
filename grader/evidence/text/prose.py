"""What a student put into words: how to run the work, what each part does, why it is as it is.

A text counts by its own words: not by headings, names, links, code, places held for a later text, or the same sentence
said of everything. Any language counts; what to look for is given by the rubric.
"""

from __future__ import annotations

import ast
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, groupby

from grader.evidence.text.markup import Block, Section, code_spans, own_text, plain_text
from grader.evidence.text.source import SourceFacts
from grader.evidence.text.syntax import normalise, tree_of
from grader.evidence.text.words import (
    Terms,
    fold,
    is_placeholder,
    measure,
    normal_form,
    sentences,
    words,
)
from grader.lab.patterns import search

COMMAND_LIMIT = 500
_OPENING_WORDS, _OPENING_LENGTH = 3, 40
_OF_SOURCE = (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
_STUFFING_RATIO = 1.5
_COMMAND_START = re.compile(r"^[\s>*+-]{0,8}(?:[$#%]\s+)?")


@dataclass(frozen=True)
class Passage:
    """A piece of connected text, with the file and line where it begins, and the heading above it."""

    text: str
    file: str
    line: int
    heading: str = ""


@dataclass(frozen=True)
class Discussion:
    """Which concepts are discussed, and how they are weighed against each other."""

    #: Concepts in the order of the lexicon, each with the first passage that discusses it.
    discussed: Mapping[str, Passage]
    #: Passages that set two or more concepts in relation: with a word of reason or comparison, or at length.
    related: tuple[Passage, ...]
    #: Passages whose words are strung together without sentences, see `lacks_sentences`.
    strung: tuple[Passage, ...]
    #: Distinct own words of all passages that discuss, besides the concepts' names.
    words: int


# -- what a reader sees --------------------------------------------------------------------------------


def is_source(text: str) -> bool:
    """Whether a text is Python source: it parses, and imports or defines something."""
    tree = tree_of(normalise(text))
    return tree is not None and any(isinstance(node, _OF_SOURCE) for node in tree.body)


def visible(
    document: Sequence[Section], names: Terms, placeholders: Sequence[str]
) -> tuple[list[Block], list[Section]]:
    """Return the pieces of a document that say something, in order, and the headings with nothing below them.

    A heading says something where something stands below it, and is a block of kind "heading" or, if it is the title
    of it all, "title". Pasted source code says nothing, and neither does what only holds the place of a text, be it
    behind the name of a part.
    """
    shown: list[Block] = []
    empty: list[Section] = []
    below: list[tuple[int, bool]] = []
    least = min((s.level for s in document if s.level), default=0)
    tops = [s for s in document if s.level == least]
    for section in reversed(document):
        blocks = [block for block in section.blocks if _says_something(block, names, placeholders)]
        filled = bool(blocks)
        while below and below[-1][0] > section.level:
            filled |= below.pop()[1]
        below.append((section.level, filled))
        shown += reversed(blocks)
        if section.level and filled:
            is_title = len(tops) == 1 and section is tops[0]
            shown.append(Block("title" if is_title else "heading", section.title, section.line))
        elif section.level:
            empty.append(section)
    return shown[::-1], empty[::-1]


def _says_something(block: Block, names: Terms, placeholders: Sequence[str]) -> bool:
    if is_source(block.text):
        return False
    if block.kind == "code":
        return bool(block.text.strip())
    plain = plain_text(block.text)
    own = names.without(plain)
    is_bare_name = not any(character.isalnum() for character in own) and names.found(plain)
    return is_bare_name or not is_placeholder(own, placeholders)


def mention(blocks: Sequence[Block], names: Terms, synonyms: Terms) -> int | None:
    """Return the line in which a part is mentioned by one of its names, or else by a synonym; None if it is in none."""
    by_name = ((block, names.place(block.text)) for block in blocks)
    by_synonym = ((block, synonyms.place(block.text)) for block in blocks if block.kind != "title")
    found = ((block, place) for block, place in chain(by_name, by_synonym) if place is not None)
    return next(
        (block.line + fold(block.text).count("\n", 0, place) for block, place in found), None
    )


# -- how to run it -------------------------------------------------------------------------------------


def command_line(blocks: Sequence[Block], patterns: Sequence[str]) -> tuple[int, str] | None:
    """Return the first line with a command that matches one of `patterns`, and the command.

    Lines of code, code spans and lines of text are searched, regardless of case: many a README has its commands
    unmarked.
    """
    for block in blocks:
        for offset, line in enumerate(block.text.split("\n")):
            for command in _commands(block.kind, line):
                if any(search(pattern, command, ignore_case=True) for pattern in patterns):
                    return block.line + offset, command
    return None


def instruction_line(blocks: Sequence[Block], run_words: Sequence[str]) -> int | None:
    """Return the line of a heading, or of a sentence that begins so, by which the work seems to be run."""
    terms = Terms.of(f"{word}$" for word in run_words)
    for block in blocks:
        for line, sentence in _lines_of(block) if block.kind != "code" else ():
            opening = " ".join(plain_text(sentence).split()[:_OPENING_WORDS])[:_OPENING_LENGTH]
            if terms.found(block.text if block.kind == "heading" else opening):
                return line
    return None


def _lines_of(block: Block) -> Iterator[tuple[int, str]]:
    """Sentences of a block with the lines that they begin on, roughly where a sentence spans lines."""
    line, position = block.line, 0
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


# -- what is discussed ---------------------------------------------------------------------------------


def document_passages(document: Sequence[Section], file: str) -> tuple[Passage, ...]:
    """Text of a document as passages: paragraphs, each list and each table as a whole, with their headings.

    A heading helps to tell what a passage is about; it has no words of its own.
    """
    passages: list[Passage] = []
    for section in document:
        runs = groupby(
            section.blocks,
            lambda block: block.kind if block.kind in ("item", "row") else block.line,
        )
        for blocks in (list(run) for _, run in runs):
            if blocks[0].kind != "code":
                text = "\n\n".join(block.text for block in blocks)
                passages.append(Passage(text, file, blocks[0].line, section.title))
    return tuple(passages)


def source_passages(facts: SourceFacts) -> tuple[Passage, ...]:
    """Docstrings and comments of a source that explain something, as passages below the code that they stand beside."""
    return tuple(
        Passage(note.text, facts.path, note.line, note.beside)
        for note in facts.notes
        if not note.fault
    )


def concepts(
    passages: Iterable[Passage],
    lexicon: Mapping[str, Sequence[str]],
    reasons: Sequence[str] = (),
    anchors: Sequence[str] = (),
    min_words: int = 8,
    connectives: Sequence[str] = (),
) -> Discussion:
    """Which concepts of `lexicon` the passages discuss; its words and all others are `Terms` in any languages.

    A concept is discussed where a passage names it and has at least `min_words` distinct own words besides
    the names of all concepts, and not more names than words. Passages that repeat another do not count. Where `anchors`
    are given, only passages that have one of them in them or in their heading are about the matter at all. In a
    language without any of the `reasons`, a passage of twice `min_words` that names two concepts relates them too.
    """
    anchor = Terms.of(anchors)
    on_topic = (
        p for p in passages if not anchors or anchor.found(plain_text(f"{p.heading}\n{p.text}"))
    )
    every = Terms.of(stem for stems in lexicon.values() for stem in stems)
    terms, reasoning = {name: Terms.of(stems) for name, stems in lexicon.items()}, Terms.of(reasons)
    discussed: dict[str, Passage] = {}
    related: list[Passage] = []
    strung: list[Passage] = []
    said: set[str] = set()
    for passage, text, own in _discussing(on_topic, every, min_words):
        said.update(own)
        named = [name for name in lexicon if terms[name].found(text)]
        for name in named:
            discussed.setdefault(name, passage)
        if len(named) > 1 and (reasoning.found(text) or measure(own) >= 2 * min_words):
            related.append(passage)
        if lacks_sentences(passage.text, connectives):
            strung.append(passage)
    in_order = {name: discussed[name] for name in lexicon if name in discussed}
    return Discussion(in_order, tuple(related), tuple(strung), measure(said))


#: Words that stand between two marks, on average, and how few of them connect others, where they are only strung.
_LONG_STRETCH, _FEW_CONNECTIVES = 8, 0.1
_MARKS = re.compile(r"[.,;:!?()|/\"“”„«»—–\n]+")


def lacks_sentences(text: str, connectives: Sequence[str]) -> bool:
    """Whether a text is words in long rows, of which next to none connects others; unknown scripts never are."""
    spoken = words(plain_text(text))
    known = [
        word for word in spoken if unicodedata.name(word[0], "").startswith(("LATIN", "CYRILLIC"))
    ]
    rows = [row for row in _MARKS.split(plain_text(text)) if row.strip()]
    if (
        not connectives
        or len(known) < len(spoken)
        or len(spoken) < _LONG_STRETCH * max(1, len(rows))
    ):
        return False
    connecting = {fold(word) for word in connectives}
    return sum(word in connecting for word in known) < _FEW_CONNECTIVES * len(known)


def _discussing(
    passages: Iterable[Passage], every: Terms, min_words: int
) -> Iterator[tuple[Passage, str, list[str]]]:
    """Passages with enough own words, with their text and these words; each sentence counts once in all."""
    seen: set[str] = set()
    for passage in passages:
        fresh: list[str] = []
        for sentence in sentences(passage.text):
            form = normal_form(sentence)
            if form and form not in seen:
                seen.add(form)
                fresh.append(sentence)
        text = plain_text("\n".join(fresh))
        own = words(every.without(own_text("\n".join(fresh))))
        # The concepts' names stand among words, rather than being strewn or listed.
        if 0 < every.count(text) <= measure(own) * _STUFFING_RATIO and measure(own) >= max(
            min_words, 1
        ):
            yield passage, text, own

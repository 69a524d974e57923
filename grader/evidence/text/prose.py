"""What a student put into words: how to run the work, what each part does, why it is as it is.

A text counts by its own words: not by headings, names, links, code, places held for a later text, or the same
sentence said of everything. Any language counts; what to look for is given by the rubric, in as many
languages as it likes.
"""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from grader.evidence.text.markup import Block, Document, Section, code_spans, own_text, plain_text
from grader.evidence.text.source import SourceFacts
from grader.evidence.text.words import Terms, fold, is_placeholder, measure, normal_form, sentences, words
from grader.lab.patterns import search

DESCRIPTION_WORDS = 4
"""Distinct own words from which a part counts as described."""

DISCUSSION_WORDS = 8
"""Distinct own words, besides the concepts' names, from which a passage discusses."""

COMMAND_LIMIT = 500
_TOPIC_ENDING = 3
_OPENING_LENGTH = 4
_STUFFING_RATIO = 1.5
_LISTING = re.compile(r"[,;/&、，،]")
_COMMAND_START = re.compile(r"^[\s>*+-]{0,8}(?:[$#%]\s+)?")


@dataclass(frozen=True)
class TopicWords:
    """What a README may call one part of the submission."""

    #: Name of the artifact in the rubric.
    id: str
    #: Names that mean this part alone: file, executable, node.
    names: tuple[str, ...]
    #: What it may be called besides, in any language. A sentence with a name of one part and only synonyms of
    #: another is about the first.
    synonyms: tuple[str, ...] = ()


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


# -- what each part does -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Topic:
    id: str
    names: Terms
    synonyms: Terms


@dataclass(frozen=True)
class _Saying:
    """A sentence said of some topics; `form` is the sentence without their names."""

    topics: tuple[str, ...]
    line: int
    form: str


def descriptions(
    document: Document, topics: Sequence[TopicWords], min_words: int = DESCRIPTION_WORDS
) -> dict[str, int]:
    """Return the ids of the topics that `document` describes, each with the line where it begins to.

    A sentence counts for the topic that it names first, or else for that of the heading above it; one that names
    none continues the one before. One that lists three or more counts for none, and so does the same sentence said
    of several topics, names aside.
    """
    known = [_Topic(t.id, Terms.of(t.names, _TOPIC_ENDING), Terms.of(t.synonyms, _TOPIC_ENDING)) for t in topics]
    every = Terms.of((w for t in topics for w in (*t.names, *t.synonyms)), _TOPIC_ENDING)
    sayings = list(_sayings(document, known, every, min_words))
    said_of = Counter(form for _, form in {(s.topics, s.form) for s in sayings})
    found: dict[str, int] = {}
    for topic in known:
        said = [s for s in sayings if topic.id in s.topics and said_of[s.form] == 1]
        if measure(word for s in said for word in s.form.split()) >= max(min_words, 1):
            found[topic.id] = said[0].line
    return found


def _sayings(document: Document, topics: Sequence[_Topic], every: Terms, min_words: int) -> Iterator[_Saying]:
    title = _document_title(document, topics)
    outer: list[tuple[int, tuple[str, ...]]] = []
    for section in document.sections:
        while outer and outer[-1][0] >= section.level:
            outer.pop()
        named = () if section is title else _about(section.title, topics)
        heading = named or (outer[-1][1] if outer else ())
        outer.append((section.level, heading))
        current = heading
        for block in section.blocks:
            if block.kind == "code":
                continue
            amount = 0
            for line, sentence in _lines_of(block):
                current = _subjects(sentence, heading, current, topics, every)
                form = normal_form(every.without(own_text(sentence)))
                amount += measure(form.split())
                if form and len(current) in (1, 2) and not is_placeholder(own_text(sentence)):
                    yield _Saying(current, line, form)
            if amount >= min_words:
                current = heading


def _subjects(
    sentence: str, heading: tuple[str, ...], current: tuple[str, ...], topics: Sequence[_Topic], every: Terms
) -> tuple[str, ...]:
    """Return the topics that a sentence is about.

    One that opens with a part's name is about that part, whatever the heading. One that lists others is still about
    the part in the heading: what starts them, say.
    """
    plain = plain_text(sentence)
    named = _about(sentence, topics)
    places = [place for topic in topics if (place := topic.names.place(plain)) is not None]
    if min(places, default=_OPENING_LENGTH) < _OPENING_LENGTH:
        return named[:1] if len(named) < 3 or _is_subject(plain, named, topics, every) else named
    if len(heading) == 1:
        return heading
    return named[:1] if len(named) < 3 and named else named or current


def _is_subject(plain: str, named: tuple[str, ...], topics: Sequence[_Topic], every: Terms) -> bool:
    """Whether the first of the parts named does something with the others, rather than being listed with them."""
    terms = {t.id: t.names if any(u.names.found(plain) for u in topics) else t.synonyms for t in topics}
    first, second = (terms[topic].place(plain) or 0 for topic in named[:2])
    between = every.without(fold(plain)[first:second])
    return bool(words(between)) and not _LISTING.search(between)


def _document_title(document: Document, topics: Sequence[_Topic]) -> Section | None:
    """The heading of the whole document, unless it names a topic (by more than a synonym)."""
    titled = [section for section in document.sections if section.level]
    if len(titled) < 2 or any(titled[0].level >= section.level for section in titled[1:]):
        return None
    return None if any(topic.names.found(titled[0].title) for topic in topics) else titled[0]


def _lines_of(block: Block) -> Iterator[tuple[int, str]]:
    """Sentences of a block with the lines that they begin on, roughly where a sentence spans lines."""
    line, position = block.line, 0
    for sentence in sentences(block.text):
        start = block.text.find(sentence, position)
        if start >= 0:
            line += block.text.count("\n", position, start)
            position = start
        yield line, sentence


def _about(text: str, topics: Sequence[_Topic]) -> tuple[str, ...]:
    """The topics that a text names, or else those that it calls by a synonym, in the text's order."""
    plain = plain_text(text)
    for terms in ([(t.id, t.names) for t in topics], [(t.id, t.synonyms) for t in topics]):
        if places := sorted((place, name) for name, term in terms if (place := term.place(plain)) is not None):
            return tuple(name for _, name in places)
    return ()


# -- how to run it -------------------------------------------------------------------------------------


def run_lines(document: Document, patterns: Sequence[str]) -> list[int]:
    """Return the lines of `document` with a command that matches one of `patterns`.

    Lines of code, code spans and lines of text are searched, as many a README has its commands unmarked. A
    pattern is a regular expression of the rubric, searched regardless of case.
    """
    return [
        block.line + offset
        for block in document.blocks()
        for offset, line in enumerate(block.text.split("\n"))
        if any(search(p, command, ignore_case=True) for command in _commands(block.kind, line) for p in patterns)
    ]


def _commands(kind: str, line: str) -> Iterator[str]:
    if kind == "code":
        yield _COMMAND_START.sub("", line[:COMMAND_LIMIT]).strip()
        return
    for span in code_spans(line):
        yield span[:COMMAND_LIMIT]
    yield _COMMAND_START.sub("", plain_text(line[:COMMAND_LIMIT])).strip()


# -- what is discussed ---------------------------------------------------------------------------------


def document_passages(document: Document, file: str) -> tuple[Passage, ...]:
    """Text of a document as passages: paragraphs, each list and each table as a whole, with their headings.

    A heading helps to tell what a passage is about; it has no words of its own.
    """
    passages: list[Passage] = []
    for section in document.sections:
        runs = groupby(section.blocks, lambda block: block.kind if block.kind in ("item", "row") else block.line)
        for blocks in (list(run) for _, run in runs):
            if blocks[0].kind != "code":
                text = "\n\n".join(block.text for block in blocks)
                passages.append(Passage(text, file, blocks[0].line, section.title))
    return tuple(passages)


def source_passages(facts: SourceFacts) -> tuple[Passage, ...]:
    """Docstrings and explaining comments of a source as passages; comments on consecutive lines are one."""
    passages = [Passage(d.docstring, facts.path, d.line) for d in facts.definitions if d.docstring]
    last = -1
    for comment in facts.explaining:
        if comment.line == last + 1 and not comment.inline and passages:
            before = passages[-1]
            passages[-1] = Passage(f"{before.text}\n{comment.text}", before.file, before.line)
        else:
            passages.append(Passage(comment.text, facts.path, comment.line))
        last = comment.line
    return tuple(passages)


def concepts(
    passages: Iterable[Passage],
    lexicon: Mapping[str, Sequence[str]],
    reasons: Sequence[str] = (),
    anchors: Sequence[str] = (),
    min_words: int = DISCUSSION_WORDS,
    connectives: Sequence[str] = (),
) -> Discussion:
    """Which concepts of `lexicon` the passages discuss.

    A concept is discussed where a passage names it and has at least `min_words` distinct own words besides
    the names of all concepts, and not more names than words. Passages that repeat another do not count.

    Parameters
    ----------
    passages : iterable of Passage
        From `document_passages` and `source_passages`.
    lexicon : mapping of str to sequence of str
        Stems of each concept in any languages, see `Terms`.
    reasons : sequence of str
        Words of reason and comparison in any languages. In a language without any here, a passage of twice
        `min_words` that names two concepts relates them too.
    anchors : sequence of str
        Where given, only passages that have one of these terms in them or in their heading are about the
        matter at all.
    min_words : int
        Own words from which a passage discusses.
    connectives : sequence of str
        Words that hold a sentence together, in any languages.
    """
    anchor = Terms.of(anchors)
    on_topic = (p for p in passages if not anchors or anchor.found(plain_text(f"{p.heading}\n{p.text}")))
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
    known = [word for word in spoken if unicodedata.name(word[0], "").startswith(("LATIN", "CYRILLIC"))]
    rows = [row for row in _MARKS.split(plain_text(text)) if row.strip()]
    if not connectives or len(known) < len(spoken) or len(spoken) < _LONG_STRETCH * max(1, len(rows)):
        return False
    connecting = {fold(word) for word in connectives}
    return sum(word in connecting for word in known) < _FEW_CONNECTIVES * len(known)


def _discussing(passages: Iterable[Passage], every: Terms, min_words: int) -> Iterator[tuple[Passage, str, list[str]]]:
    """Passages with enough own words, with their text and these words; each sentence counts once in all."""
    seen: set[str] = set()
    for passage in passages:
        fresh: list[str] = []
        for sentence in sentences(passage.text):
            form = normal_form(sentence)
            if form and form not in seen and not is_placeholder(sentence):
                seen.add(form)
                fresh.append(sentence)
        text = plain_text("\n".join(fresh))
        own = words(every.without(own_text("\n".join(fresh))))
        # The concepts' names stand among words, rather than being strewn or listed.
        if 0 < every.count(text) <= measure(own) * _STUFFING_RATIO and measure(own) >= max(min_words, 1):
            yield passage, text, own

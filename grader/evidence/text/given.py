"""Texts of a lab's own, and of this program's, which are no text of a student's."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from grader.evidence.text.markup import Block, Section, read_markdown
from grader.evidence.text.sources import read_sources
from grader.evidence.text.words import fingerprint, normal_form, sentences
from grader.lab.rubric import FINGERPRINTS_ENDING
from grader.result import EVIDENCE_LINE
from grader.submission.file_names import C_SUFFIXES

#: Words from which a sentence is known again; anybody may write a shorter one.
_LEAST_WORDS = 5
_SOURCE_ENDINGS = (".py", *C_SUFFIXES)


@dataclass(frozen=True)
class GivenText:
    """Sentences and blocks that all students were given.

    Attributes
    ----------
    sentences
        Fingerprints of the sentences of five words or more.
    blocks
        Fingerprints of the paragraphs, items, rows and code.
    """

    sentences: frozenset[str] = frozenset()
    blocks: frozenset[str] = frozenset()

    @classmethod
    def of(cls, texts: dict[str, str]) -> GivenText:
        """Return the sentences of texts by their paths: documents, docstrings and comments of sources, fingerprints."""
        sources = {}
        blocks: list[Block] = []
        known: list[str] = []
        for path, text in texts.items():
            if path.endswith(FINGERPRINTS_ENDING):
                known += text.split()
            elif path.endswith(_SOURCE_ENDINGS):
                sources[path] = text
            else:
                blocks += _blocks(read_markdown(text))
        said = _said(blocks)
        for facts in read_sources(sources):
            for note in facts.notes:
                said += _known_sentences(note.text)
        forms = [fingerprint(block.text) for block in blocks]
        return cls(frozenset(said + known), frozenset(forms + known))

    def fingerprints(self) -> str:
        """Return all fingerprints, one a line, as a file that stands for the texts."""
        return "".join(f"{each}\n" for each in sorted(self.sentences | self.blocks))

    def without(self, document: Sequence[Section]) -> tuple[Section, ...]:
        """Return a document without its given paragraphs, items and rows.

        A student's README may repeat a command of the handout: given code and short texts are only left out where at
        least half of the document's sentences are given.
        """
        if not self.sentences:
            return tuple(document)
        said = _said(_blocks(document))
        given = sum(form in self.sentences for form in said)
        is_copy = 2 * given >= max(len(said), 1)
        own = []
        for section in document:
            blocks = [block for block in section.blocks if not self._holds(block, is_copy)]
            own.append(replace(section, blocks=blocks))
        return tuple(own)

    def _holds(self, block: Block, is_copy: bool) -> bool:
        if is_copy and fingerprint(block.text) in self.blocks:
            return True
        if block.kind == "code":
            return False
        forms = _known_sentences(block.text)
        if not forms:
            return False
        return self.sentences.issuperset(forms)


def is_own_export(text: str) -> bool:
    """Return whether this program wrote a text: a CI job can leave the summary of its last run in the checkout."""
    return EVIDENCE_LINE in text


def _blocks(document: Sequence[Section]) -> list[Block]:
    blocks = []
    for section in document:
        blocks += section.blocks
    return blocks


def _said(blocks: Iterable[Block]) -> list[str]:
    """Return the sentences of blocks, without those of code."""
    said = []
    for block in blocks:
        if block.kind != "code":
            said += _known_sentences(block.text)
    return said


def _known_sentences(text: str) -> list[str]:
    found = []
    for sentence in sentences(text):
        if normal_form(sentence).count(" ") >= _LEAST_WORDS - 1:
            found.append(fingerprint(sentence))
    return found


def main(paths: Sequence[str]) -> None:
    """Print the fingerprints of texts."""
    texts = {path: Path(path).read_text(encoding="utf-8") for path in paths}
    print(GivenText.of(texts).fingerprints(), end="")


if __name__ == "__main__":
    main(sys.argv[1:])

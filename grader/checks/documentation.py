"""Checks of what is written: README, docstrings, comments, discussion. All from the text, in any language."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import PurePosixPath

from pydantic import Field

from grader.checks.base import Context, apart, failed, graded, inconclusive, percent
from grader.evidence.text.lexicon import one_of
from grader.evidence.text.markup import Document, read_markdown
from grader.evidence.text.prose import TopicWords, concepts, descriptions, document_passages, run_lines, source_passages
from grader.evidence.text.source import SourceFacts, docstring_share, parse
from grader.lab import references as ref
from grader.lab.references import Parameters, Pattern, Share
from grader.result import Finding, Location

#: What a README is called in other languages.
_README = re.compile(one_of("readme_names"), re.IGNORECASE)
_WRITTEN = (".md", ".markdown", ".rst", ".txt", ".adoc", ".org", "")
#: Texts that are there for programs.
_FOR_PROGRAMS = ("requirements", "cmakelists", "constraints", "license", "licence", "copying", "manifest", "top_level")
#: Documents that people read and the grader does not.
_NOT_READ = (".pdf", ".docx", ".doc", ".odt", ".rtf", ".pages", ".html", ".htm", ".ipynb", ".tex")


#: Characters of all documents together after which no other is read.
_MOST_CHARACTERS = 300_000


@functools.lru_cache(maxsize=256)
def _facts(path: str, text: str) -> SourceFacts:
    return parse(path, text)


def readmes(context: Context) -> list[tuple[str, Document]]:
    """Return the READMEs of a submission, the one nearest to its root first; without any, what else is written."""
    written = [p for p in map(PurePosixPath, context.submission.texts) if p.suffix.lower() in _WRITTEN]
    paths = [p for p in written if _README.match(p.stem)]
    if not paths:
        paths = [p for p in written if p.suffix and not p.stem.lower().startswith(_FOR_PROGRAMS)]
    paths.sort(key=lambda p: (len(p.parts), str(p)))
    return list(_read(context, map(str, paths)))


def _read(context: Context, paths: Iterable[str]) -> Iterator[tuple[str, Document]]:
    """Read documents one after the other, as many as anybody would."""
    left = _MOST_CHARACTERS
    for path in paths:
        if left > 0:
            left -= len(context.submission.texts[path])
            yield path, read_markdown(context.submission.texts[path])


def _not_read(context: Context) -> list[str]:
    """Return the documents that may say what is looked for, but in a form that only people can read."""
    paths = [PurePosixPath(f.path) for f in context.submission.files if f.size_bytes]
    found = [p for p in paths if p.suffix.lower() in _NOT_READ and not p.name.startswith(".")]
    return [str(p) for p in sorted(found, key=lambda p: (_README.match(p.stem) is None, len(p.parts), str(p)))][:3]


def _for_a_person(expected: str, paths: Sequence[str]) -> Finding:
    reason = f"The grader cannot read {', '.join(paths)}; a person has to."
    return inconclusive(expected, "not read", reason, where=[Location(file=path) for path in paths], retry=False)


def sources(context: Context, artifacts: tuple[str, ...]) -> list[SourceFacts]:
    """Return the facts of those artifacts that were handed in."""
    paths = dict.fromkeys(context.path_of(artifact) for artifact in artifacts)  # one file may hold several
    texts = context.submission.texts
    return [_facts(path, texts[path]) for path in paths if path is not None and path in texts]


class _OfFiles(Parameters):
    """What is judged by files alone, without a recording."""

    of_session = False


class Part(Parameters):
    """What a README may call one part of the submission."""

    artifact: ref.Artifact
    names: tuple[str, ...]
    synonyms: tuple[str, ...] = ()


class Readme(_OfFiles):
    """The README says how to run the work (a part) and what each part of it does (a part each)."""

    parts: tuple[Part, ...]
    words_each: int = Field(8, description="Distinct words of its own that a description has at least.")
    commands: tuple[Pattern, ...] = Field(description="Regular expressions of commands that run something.")
    run_weight: Share = Field(0.25, description="Share of the credit for the commands.")


def readme(context: Context, p: Readme) -> Finding:
    """Judge commands and descriptions; a bare list of names describes nothing."""
    # What was not handed in is charged where it is missing.
    parts = [part for part in p.parts if context.path_of(part.artifact) is not None] or list(p.parts)
    expected = f"commands to run it ({p.run_weight:.0%}), and a description of {_parts(len(parts))} (the rest)"
    documents = readmes(context)
    if not documents and (unread := _not_read(context)):
        return _for_a_person(expected, unread)
    if not documents:
        return failed(expected, "no README", "There is no README.", hint="Write a README.md beside the code.")
    commands = [Location(file=path, line=line) for path, d in documents for line in run_lines(d, p.commands)]
    topics = [TopicWords(part.artifact, part.names, part.synonyms) for part in parts]
    described = {
        topic: Location(file=path, line=line)
        for path, d in reversed(documents)
        for topic, line in descriptions(d, topics, p.words_each).items()
    }
    lacking = [part for part in parts if part.artifact not in described]
    share = p.run_weight * bool(commands) + (1 - p.run_weight) * len(described) / len(parts)
    first = PurePosixPath(documents[0][0])
    reasons = [] if _README.match(first.stem) else [f"There is no README; {first} was read in its place."]
    if not commands:
        reasons.append("It does not say by which commands the work is run.")
    if lacking:
        reasons.append(
            f"It does not say what {', '.join(part.names[0] for part in lacking)} "
            + ("does." if len(lacking) == 1 else "do.")
        )
    measured = f"{len(commands)} commands, {len(described)} of {len(parts)} parts described"
    where = [*commands[:1], *described.values()]
    return graded(share, expected, measured, " ".join(reasons), where=where or (Location(file=documents[0][0]),))


def _parts(count: int) -> str:
    return "the one part" if count == 1 else f"each of {count} parts"


class Docstrings(_OfFiles):
    """Modules, classes and functions have docstrings that say something."""

    artifacts: tuple[ref.Artifact, ...]
    full_from: Share
    zero_to: Share = 0.0


def docstrings(context: Context, p: Docstrings) -> Finding:
    """Judge the weighted share of definitions with a docstring; missing files do not count."""
    facts = sources(context, p.artifacts)
    expected = f"docstrings on at least {percent(p.full_from)} of modules, classes and functions"
    expected += f"; no credit up to {percent(p.zero_to)}" if p.zero_to else ""
    if not facts:
        return failed(expected, "no source files", "There is no source to read.")
    if unread := [f.path for f in facts if not f.readable]:
        return _for_a_person(expected, unread)
    share = docstring_share(facts)
    weight = apart(100 * float(share.share), 100 * p.full_from, 100 * p.zero_to, places=0)
    measured = f"{share.documented} of {share.needed} documented ({weight}% by weight)"
    lacking = [f"{u.definition.label} ({u.reason})" for u in share.undocumented[:4]]
    more = f" and {len(share.undocumented) - 4} more" if len(share.undocumented) > 4 else ""
    reason = f"Without a docstring that says something: {', '.join(lacking)}{more}."
    where = [Location(file=u.path, line=u.definition.line) for u in share.undocumented[:6]]
    credit = (float(share.share) - p.zero_to) / (p.full_from - p.zero_to)
    return graded(credit, expected, measured, reason, where=where)


class Comments(_OfFiles):
    """Comments explain the code; commented-out code, banners and repeats do not."""

    artifacts: tuple[ref.Artifact, ...]
    full_per_100_lines: float = Field(gt=0)
    zero_to_per_100_lines: float = Field(0, ge=0, description="Up to this there is no credit.")


def comments(context: Context, p: Comments) -> Finding:
    """Judge the number of explaining comments against the lines of code."""
    facts = sources(context, p.artifacts)
    expected = f"at least {p.full_per_100_lines:g} explaining comments in 100 lines of code"
    expected += f"; no credit up to {p.zero_to_per_100_lines:g}" if p.zero_to_per_100_lines else ""
    lines = sum(f.code_lines for f in facts)
    if not lines:
        return failed(expected, "no source files", "There is no source to read.")
    explaining = sum(len(f.explaining) for f in facts)
    others = [c for f in facts for c in f.comments if c.kind in ("code", "repeated", "echo")]
    density = 100 * explaining / lines
    measured = f"{explaining} in {lines} lines of code ({apart(density, p.full_per_100_lines, places=1)} in 100)"
    wanted = math.ceil(p.full_per_100_lines * lines / 100)
    said = f"{explaining} comment explains" if explaining == 1 else f"{explaining} comments explain"
    reason = f"{said} something; for {lines} lines of code {wanted} give{'s' * (wanted == 1)} full credit"
    reason += (
        f". {len(others)} more {'is' if len(others) == 1 else 'are'} commented-out code, repeats or echoes of the code."
        if others
        else "."
    )
    bare = sorted(facts, key=lambda f: len(f.explaining) / max(1, f.code_lines))[:3]
    share = (density - p.zero_to_per_100_lines) / (p.full_per_100_lines - p.zero_to_per_100_lines)
    return graded(share, expected, measured, reason, where=[Location(file=f.path) for f in bare])


class ConceptsExplained(_OfFiles):
    """Concepts are discussed in writing, in the README or in the source, and weighed against each other."""

    artifacts: tuple[ref.Artifact, ...] = Field((), description="Sources whose docstrings and comments count too.")
    concepts: Mapping[str, tuple[str, ...]] = Field(description="Concept -> word stems in any languages.")
    reasons: tuple[str, ...] = Field((), description="Words of reason and comparison in any languages.")
    anchors: tuple[str, ...] = Field((), description="A passage without any of these is about something else.")
    connectives: tuple[str, ...] = Field(
        (), description="Words that hold sentences together; a text almost without them is pointed out to a person."
    )
    min_words: int = Field(8, description="Words of its own from which a passage discusses.")
    full_concepts: int
    least_concepts: int = Field(1, description="With fewer there is no credit.")


def concepts_explained(context: Context, p: ConceptsExplained) -> Finding:
    """Judge the number of concepts discussed (two thirds), and whether any are weighed against each other (a third).

    Without that, what is named may be no more than a list of settings, and earns half of what it would.
    """
    passages = [passage for path, d in readmes(context) for passage in document_passages(d, path)]
    other = [path for path in context.submission.texts if PurePosixPath(path).suffix.lower() in (".md", ".rst", ".txt")]
    known = {passage.file for passage in passages}
    passages += [
        q
        for path, document in _read(context, (path for path in sorted(other) if path not in known))
        for q in document_passages(document, path)
    ]
    passages += [passage for facts in sources(context, p.artifacts) for passage in source_passages(facts)]
    found = concepts(passages, p.concepts, p.reasons, p.anchors, p.min_words, p.connectives)
    expected = (
        f"{p.full_concepts} of {len(p.concepts)} concepts discussed (two thirds), and weighed with reasons (one third)"
    )
    measured = f"{', '.join(found.discussed) or 'none'} discussed in {found.words} words"
    where = [Location(file=passage.file, line=passage.line) for passage in found.discussed.values()]
    if len(found.discussed) < p.least_concepts and (unread := _not_read(context)):
        return _for_a_person(expected, unread)
    if len(found.discussed) < p.least_concepts:
        return failed(expected, measured, "There is next to nothing in writing about the trade-offs.", where=where)
    covered = min(1.0, len(found.discussed) / p.full_concepts)
    share = 2 / 3 * covered + 1 / 3 if found.related else 1 / 3 * covered
    reasons = [] if found.related else ["They are not set in relation to each other: when which, and at what price?"]
    if len(found.discussed) < p.full_concepts:
        missing = [name for name in p.concepts if name not in found.discussed]
        reasons.insert(0, f"Nothing is said about {', '.join(missing)}.")
    notes = [f"For a person to read: {s.file}, line {s.line}, seems to be words, not sentences." for s in found.strung]
    return graded(share, expected, measured, " ".join(reasons), where=where, notes=notes)

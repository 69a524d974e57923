"""Checks of what is written: README, docstrings, comments, discussion. All from the text, in any language.

In doubt they are for the student: points are lost only for what is surely not there. What the grader does not
understand keeps its points, and a note asks a person to look.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, groupby
from pathlib import PurePosixPath

from pydantic import Field

from grader.checks.base import Context, apart, failed, graded, inconclusive, passed, percent
from grader.evidence.text.markup import Block, Section, plain_text, read_markdown
from grader.evidence.text.prose import (
    command_line,
    concepts,
    document_passages,
    instruction_line,
    is_source,
    mention,
    source_passages,
    visible,
)
from grader.evidence.text.source import Note, Rules, SourceFacts, Unit, read_sources
from grader.evidence.text.words import Terms, substance
from grader.lab import references as ref
from grader.lab.patterns import search
from grader.lab.references import Parameters, Pattern, Share
from grader.result import FOR_A_PERSON, Finding, Location

_WRITTEN = (".md", ".markdown", ".rst", ".txt", ".adoc", ".org", "")
#: Texts that are there for programs.
_FOR_PROGRAMS = (
    "requirements",
    "cmakelists",
    "constraints",
    "license",
    "licence",
    "copying",
    "manifest",
    "top_level",
)
#: Documents that people read and the grader does not.
_NOT_READ = (".pdf", ".docx", ".doc", ".odt", ".rtf", ".pages", ".html", ".htm", ".ipynb", ".tex")
#: Of launch files that are not Python.
_LAUNCH_ENDINGS = (".xml", ".yaml", ".yml")
#: Characters of all documents together after which no other is read.
_MOST_CHARACTERS = 300_000
#: Letters that may follow a name, as in `publishers`.
_ENDING = 3
#: Lines that are listed of what does not count.
_MOST_LISTED = 12
#: Letters of a passage that are quoted.
_QUOTED = 300


def _documents(context: Context) -> list[PurePosixPath]:
    """Return all documents of a submission that people and the grader read, those nearest to its root first."""
    written = [
        p for p in map(PurePosixPath, context.submission.texts) if p.suffix.lower() in _WRITTEN
    ]
    return sorted(written, key=lambda p: (len(p.parts), str(p)))


def _read(
    context: Context, paths: Iterable[PurePosixPath]
) -> Iterator[tuple[str, tuple[Section, ...]]]:
    """Read documents one after the other, as many as anybody would."""
    left = _MOST_CHARACTERS
    for path in map(str, paths):
        if left > 0:
            left -= len(context.submission.texts[path])
            yield path, read_markdown(context.submission.texts[path])


def _not_read(context: Context) -> list[str]:
    """Return the documents that may say what is looked for, but in a form that only people can read."""
    paths = [PurePosixPath(f.path) for f in context.submission.files if f.size_bytes]
    found = [p for p in paths if p.suffix.lower() in _NOT_READ and not p.name.startswith(".")]
    return [str(p) for p in sorted(found, key=lambda p: (len(p.parts), str(p)))][:3]


def _sources(
    context: Context, artifacts: Sequence[str], rules: Rules | None = None
) -> list[SourceFacts]:
    """Return the facts of those artifacts that were handed in as Python; one file may hold several."""
    paths = filter(None, dict.fromkeys(context.path_of(artifact) for artifact in artifacts))
    texts = context.submission.texts
    python = (
        path
        for path in paths
        if path in texts and PurePosixPath(path).suffix.lower() not in _LAUNCH_ENDINGS
    )
    return read_sources({path: texts[path] for path in python}, rules)


def _for_a_person(file: str, line: int, seen: str) -> str:
    return f"{FOR_A_PERSON} {file}, line {line}, {seen}. The points are given."


class _OfFiles(Parameters):
    """What is judged by files alone, without a recording."""

    of_session = False


class Part(Parameters):
    """What a README may call one part of the submission."""

    artifact: ref.Artifact
    names: tuple[str, ...]
    synonyms: tuple[str, ...] = ()
    shown_by: ref.Artifact | None = Field(
        None, description="Part by which it is found where the README names others too."
    )


class Readme(_OfFiles):
    """The README says how to run the work (a part), and lets a reader find each part of it (the rest)."""

    titles: tuple[Pattern, ...] = Field(
        description="How the names of READMEs begin, as regular expressions."
    )
    parts: tuple[Part, ...] = Field(min_length=1)
    commands: tuple[Pattern, ...] = Field(
        description="Regular expressions of commands that run something."
    )
    run_words: tuple[str, ...] = Field(
        (), description="Words of a heading or a sentence about running the work."
    )
    run_weight: Share = Field(0.5, description="Share of the credit for saying how to run it.")
    placeholders: tuple[Pattern, ...] = Field(
        (), description="Regular expressions of texts that wait to be written."
    )
    doubt_words: int = Field(
        60,
        description="Distinct words from which a text that mentions no part may do so in words unknown here.",
    )


def readme(context: Context, p: Readme) -> Finding:
    """Judge whether it tells how to run the work and names each part; templates and pasted code say nothing."""
    expected = f"it says how to run the work ({p.run_weight:.0%}), and each part can be found in it (the rest)"
    documents = _documents(context)
    paths = [
        path
        for path in documents
        if any(search(title, path.stem, ignore_case=True) for title in p.titles)
    ]
    # Without a README, what else is written may stand for it.
    paths = paths or [
        q for q in documents if q.suffix and not q.stem.lower().startswith(_FOR_PROGRAMS)
    ]
    unread = _not_read(context)
    if not paths and not unread:
        return failed(
            expected, "no README", "There is no README.", hint="Write a README.md beside the code."
        )
    # What was not handed in is charged where it is missing.
    parts = [part for part in p.parts if context.path_of(part.artifact) is not None] or list(
        p.parts
    )
    # What the student called it is a name of it too.
    own = {part: PurePosixPath(context.path_of(part.artifact) or "") for part in parts}
    names = {part: (*part.names, path.name, path.stem) for part, path in own.items()}
    texts, hollow = _visible(
        context, paths, Terms.of(chain(*names.values()), _ENDING), p.placeholders
    )
    run, notes = _how_to_run(texts, p)
    found = {
        part: line
        for part in parts
        if (line := _mentioned(texts, names[part], part.synonyms)) is not None
    }
    if len(found) > 1:  # Where others are named too, a part may be found by one of them.
        lines = {part.artifact: line for part, line in found.items()}
        found = {part: lines[part.shown_by] for part in parts if part.shown_by in lines} | found
    said = " ".join(block.text for _, shown in texts for block in shown if block.kind != "code")
    if not found and texts and substance(said) >= p.doubt_words:  # It may call them by other names.
        found = dict.fromkeys(parts, (texts[0][0], 1))
        notes.append(
            _for_a_person(texts[0][0], 1, "names no part of the work by a name known to the grader")
        )
    share = p.run_weight * bool(run) + (1 - p.run_weight) * len(found) / len(parts)
    if share < 1 and unread:
        notes = [
            f"{FOR_A_PERSON} {', '.join(unread)}, which the grader cannot. The points are given."
        ]
        share = 1.0
    where = [Location(file=str(path)) for path in [*paths[:1], *unread]]
    measured = (
        f"how to run it: {'yes' if run else 'not found'}; {len(found)} of {len(parts)} parts found"
    )
    nothing = ", ".join(hollow[:_MOST_LISTED])
    reasons = (
        []
        if run
        else ["The grader found no command and no sentence that says how to run the work."]
    )
    if lacking := ", ".join(part.names[0] for part in parts if part not in found):
        reasons.append(f"It found no mention of {lacking}.")
    if reasons and hollow:
        reasons.append(f"Nothing of its own stands under {nothing}.")
    counted = [f"How to run it: {run or 'not found'}"]
    counted += [
        f"{part.names[0]}: {_at(*found[part]) if part in found else 'not found'}" for part in parts
    ]
    counted += [f"Not counted, as nothing of its own stands there: {nothing}"] if hollow else []
    finding = graded(share, expected, measured, " ".join(reasons), where=where, notes=notes)
    return replace(finding, counted=tuple(counted))


#: READMEs by their paths, with what they show.
_Texts = list[tuple[str, list[Block]]]


def _visible(
    context: Context, paths: Sequence[PurePosixPath], names: Terms, placeholders: Sequence[str]
) -> tuple[_Texts, list[str]]:
    """Return what READMEs show, and the sections and files in which nothing of their own stands."""
    texts: _Texts = []
    hollow: list[str] = []
    for path, document in _read(context, paths):
        if is_source(context.submission.texts[path]):
            hollow.append(f"{path} (source code)")
            continue
        shown, empty = visible(document, names, placeholders)
        texts.append((path, shown))
        hollow += [
            f"'{section.title}' ({path}, line {section.line})" for section in empty if section.title
        ]
    return texts, hollow


def _mentioned(
    texts: _Texts, names: Sequence[str], synonyms: Sequence[str]
) -> tuple[str, int] | None:
    """Return file and line of the first README that mentions a part."""
    terms = Terms.of(names, _ENDING), Terms.of(synonyms, _ENDING)
    lines = ((path, mention(shown, *terms)) for path, shown in texts)
    return next(((path, line) for path, line in lines if line is not None), None)


def _how_to_run(texts: _Texts, p: Readme) -> tuple[str, list[str]]:
    """Return where and how it is said how the work is run, if it is, and what a person should look at."""
    for path, shown in texts:
        if (found := command_line(shown, p.commands)) is not None:
            return f"{_at(path, found[0])}, {found[1][:80]}", []
    for path, shown in texts:
        if (line := instruction_line(shown, p.run_words)) is not None:
            note = _for_a_person(
                path, line, "may say how the work is run, though without a command"
            )
            return f"{_at(path, line)}, in words", [note]
    return "", []


def _at(file: str, line: int) -> str:
    return f"{file}, line {line}"


class CodeExplained(_OfFiles):
    """Files (half), and classes and functions of some length, are explained by docstrings or comments, whichever."""

    artifacts: tuple[ref.Artifact, ...]
    full_from: Share = Field(
        description="Share of them that earns full credit; less earns in proportion."
    )
    function_lines: int = Field(
        5, description="A function whose body has fewer lines speaks for itself."
    )
    min_words: int = Field(2, description="Distinct words from which a text explains.")
    placeholders: tuple[Pattern, ...] = Field(
        (), description="Regular expressions of texts that wait to be written."
    )
    fillers: tuple[str, ...] = Field(
        (), description="Words that add nothing to the name of what they stand beside."
    )


def code_explained(context: Context, p: CodeExplained) -> Finding:
    """Judge the share of files, classes and functions whose purpose or reason is said somewhere."""
    rules = Rules(p.min_words, p.function_lines, p.placeholders, p.fillers)
    facts = _sources(context, p.artifacts, rules)
    expected = f"a docstring or a comment explains at least {percent(p.full_from)}: of the files (half), and of classes "
    expected += f"and functions of {p.function_lines} lines or more (half)"
    units = [(f, unit) for f in facts for unit in f.units if unit.needed]
    if not facts:
        return failed(expected, "no source files", "There is no source to read.")
    if not units:
        return passed(expected, "nothing that needs an explanation")
    bare = [(f.path, unit) for f, unit in units if unit.explained_by is None]
    # A file is as many as there are artifacts in it.
    paths = [context.path_of(artifact) for artifact in p.artifacts]
    files = [unit for f, unit in units if unit is f.units[0] for path in paths if path == f.path]
    inner = [unit for f, unit in units if unit is not f.units[0]]
    shares = [
        sum(unit.explained_by is not None for unit in some) / len(some)
        for some in (files, inner)
        if some
    ]
    share = sum(shares) / len(shares)
    measured = f"{len(units) - len(bare)} of {len(units)} explained, half by files, half by what is in them: "
    measured += f"{apart(100 * share, 100 * p.full_from, places=0)}%"
    names = [unit.name for _, unit in bare]
    more = f" and {len(names) - 6} more" if len(names) > 6 else ""
    reason = f"Neither a docstring nor a comment explains {', '.join(names[:6])}{more}."
    faults = {note.fault for f in facts for note in f.notes if note.fault}
    reason += (
        f" What was found there does not count: {', '.join(sorted(faults))}." if faults else ""
    )
    where = [Location(file=path, line=unit.line) for path, unit in bare[:6]]
    notes = [
        f"{FOR_A_PERSON} Python cannot read {f.path}, so only its comments were counted."
        for f in facts
        if not f.readable
    ]
    finding = graded(share / p.full_from, expected, measured, reason, where=where, notes=notes)
    return replace(finding, counted=tuple(map(_listed, facts)))


def _listed(facts: SourceFacts) -> str:
    """List what explains each part of a file, and what does not count."""
    units = [unit for unit in facts.units if unit.needed]
    said = [
        f"{'the file' if unit is facts.units[0] else unit.name} ({_kind(unit)})" for unit in units
    ]
    faults = sorted(
        (note for note in facts.notes if note.fault), key=lambda note: (note.fault, note.line)
    )
    listed = [
        f"{fault} (at {', '.join(_lines(note) for note in list(notes)[:_MOST_LISTED])})"
        for fault, notes in groupby(faults, key=lambda note: note.fault)
    ]
    return f"{facts.path}: {'; '.join(said)}" + (
        f". Not counted: {'; '.join(listed)}" if listed else ""
    )


def _kind(unit: Unit) -> str:
    note = unit.explained_by
    return f"{note.kind}, line {note.line}" if note is not None else "nothing"


def _lines(note: Note) -> str:
    return f"line {note.line}" if note.line == note.last else f"lines {note.line}–{note.last}"


class ConceptsExplained(_OfFiles):
    """Concepts are discussed in writing, in the README or in the source, and weighed against each other."""

    artifacts: tuple[ref.Artifact, ...] = Field(
        (), description="Sources whose docstrings and comments count too."
    )
    concepts: Mapping[str, tuple[str, ...]] = Field(
        description="Concept -> word stems in any languages."
    )
    reasons: tuple[str, ...] = Field(
        (), description="Words of reason and comparison in any languages."
    )
    anchors: tuple[str, ...] = Field(
        (), description="A passage without any of these is about something else."
    )
    connectives: tuple[str, ...] = Field(
        (),
        description="Words that hold sentences together; a text almost without them is pointed out to a person.",
    )
    min_words: int = Field(8, description="Words of its own from which a passage discusses.")
    full_concepts: int
    least_concepts: int = Field(1, description="With fewer there is no credit.")


def concepts_explained(context: Context, p: ConceptsExplained) -> Finding:
    """Judge the number of concepts discussed (two thirds), and whether any are weighed against each other (a third).

    Without that, what is named may be no more than a list of settings, and earns half of what it would.
    """
    documents = [
        path for path in _documents(context) if not path.stem.lower().startswith(_FOR_PROGRAMS)
    ]
    passages = [
        q for path, document in _read(context, documents) for q in document_passages(document, path)
    ]
    passages += [
        passage for facts in _sources(context, p.artifacts) for passage in source_passages(facts)
    ]
    found = concepts(passages, p.concepts, p.reasons, p.anchors, p.min_words, p.connectives)
    expected = f"{p.full_concepts} of {len(p.concepts)} concepts discussed (two thirds), and weighed with reasons (one third)"
    measured = f"{', '.join(found.discussed) or 'none'} discussed in {found.words} words"
    where = [Location(file=passage.file, line=passage.line) for passage in found.discussed.values()]
    if len(found.discussed) < p.least_concepts and (unread := _not_read(context)):
        reason = f"The grader cannot read {', '.join(unread)}; a person has to."
        return inconclusive(
            expected,
            "not read",
            reason,
            where=[Location(file=path) for path in unread],
            retry=False,
        )
    if len(found.discussed) < p.least_concepts:
        reason = "The grader found no text about this, neither in a README nor in the program."
        return failed(expected, measured, reason, where=where)
    covered = min(1.0, len(found.discussed) / p.full_concepts)
    share = 2 / 3 * covered + 1 / 3 if found.related else 1 / 3 * covered
    reasons = (
        []
        if found.related
        else ["It recognised no passage that weighs them: when which, and at what price?"]
    )
    if len(found.discussed) < p.full_concepts:
        missing = ", ".join(name for name in p.concepts if name not in found.discussed)
        recognised = f"The grader recognised {len(found.discussed)} of {len(p.concepts)} subjects"
        reasons.insert(
            0, f"{recognised}; {p.full_concepts} give full credit. Not recognised: {missing}."
        )
    notes = [
        f"{FOR_A_PERSON} {s.file}, line {s.line}, seems to be words, not sentences."
        for s in found.strung
    ]
    finding = graded(
        share, expected, measured, " ".join(reasons), where=[] if reasons else where, notes=notes
    )
    places = {name: _at(passage.file, passage.line) for name, passage in found.discussed.items()}
    listed = [f"{name}: {places.get(name, 'not recognised')}" for name in p.concepts]
    related = ", ".join(_at(passage.file, passage.line) for passage in found.related[:_MOST_LISTED])
    listed.append(f"weighed with reasons: {related or 'not recognised'}")
    for passage in found.related[:1]:
        quote = " ".join(plain_text(passage.text).split())
        cut = quote if len(quote) <= _QUOTED else f"{quote[: _QUOTED - 1]}…"
        listed.append(f"{_at(passage.file, passage.line)}: “{cut}”")
    return replace(finding, counted=tuple(listed))

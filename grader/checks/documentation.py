"""Checks of written text: README, docstrings, comments and discussion, in any language.

Points are lost only for text that is surely missing. Text that the grader does not understand keeps
its points, and a note asks a person to look.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import PurePosixPath

from pydantic import Field

from grader.checks.base import Context, apart, failed, graded, inconclusive, passed, percent
from grader.evidence.text.given import GivenText, is_own_export
from grader.evidence.text.markup import Block, Section, plain_text, read_markdown
from grader.evidence.text.prose import (
    Discussion,
    Passage,
    command_lines,
    concepts,
    document_passages,
    instruction_line,
    is_source,
    mention,
    source_passages,
    visible,
)
from grader.evidence.text.source import Note, Rules, SourceFacts, Unit
from grader.evidence.text.sources import read_sources
from grader.evidence.text.words import Terms, substance
from grader.lab import references as ref
from grader.lab.patterns import search
from grader.lab.references import Parameters, Pattern, Share
from grader.result import FOR_A_PERSON, Finding, Location

_WRITTEN = (".md", ".markdown", ".rst", ".txt", ".adoc", ".org", "")
#: Beginnings of the names of texts for programs.
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
#: Endings of documents that people read and the grader cannot.
_NOT_READ = (".pdf", ".docx", ".doc", ".odt", ".rtf", ".pages", ".html", ".htm", ".ipynb", ".tex")
#: Endings of launch files in other languages than Python.
_LAUNCH_ENDINGS = (".xml", ".yaml", ".yml")
#: Number of characters in all documents after which no further document is read.
_MOST_CHARACTERS = 300_000
#: Number of letters that may follow a name, as in `publishers`.
_ENDING = 3
#: Greatest number of uncounted lines that are listed.
_MOST_LISTED = 12
#: Greatest number of unexplained classes and functions that are named.
_MOST_NAMED = 6
#: Greatest number of documents that a person is asked to read.
_MOST_UNREAD = 3
#: Number of letters that are quoted from a passage.
_QUOTED = 300


def _nearest_to_root(path: PurePosixPath) -> tuple[int, str]:
    return len(path.parts), str(path)


def _documents(context: Context) -> list[PurePosixPath]:
    """Return the readable documents of a submission, those nearest to its root first."""
    texts = context.submission.texts
    paths = [PurePosixPath(name) for name in texts]
    written = []
    for path in paths:
        if path.suffix.lower() in _WRITTEN and not is_own_export(texts[str(path)]):
            written.append(path)
    return sorted(written, key=_nearest_to_root)


def _given(context: Context) -> GivenText:
    """Return the lab's own text; several checks of one submission ask for it."""
    return _read_given(tuple(context.submission.given_texts.items()))


@functools.lru_cache(maxsize=1)
def _read_given(texts: tuple[tuple[str, str], ...]) -> GivenText:
    return GivenText.of(dict(texts))


def _is_for_programs(path: PurePosixPath) -> bool:
    return path.stem.lower().startswith(_FOR_PROGRAMS)


def _read(
    context: Context, paths: Iterable[PurePosixPath]
) -> Iterator[tuple[str, tuple[Section, ...]]]:
    """Read the student's own text in documents, one after the other, up to a number of characters."""
    given = _given(context)
    left = _MOST_CHARACTERS
    for path in map(str, paths):
        if left <= 0:
            return
        text = context.submission.texts[path]
        left -= len(text)
        yield path, given.without(read_markdown(text))


def _not_read(context: Context) -> list[str]:
    """Return the documents that only people can read."""
    found = []
    for file in context.submission.files:
        path = PurePosixPath(file.path)
        is_hidden = path.name.startswith(".")
        if file.size_bytes and path.suffix.lower() in _NOT_READ and not is_hidden:
            found.append(path)
    found.sort(key=_nearest_to_root)
    return [str(path) for path in found[:_MOST_UNREAD]]


def _sources(
    context: Context, artifacts: Sequence[str], rules: Rules | None = None
) -> list[SourceFacts]:
    """Return the facts of each source that holds one or more of the artifacts."""
    texts = context.submission.texts
    sources = {}
    for artifact in artifacts:
        path = context.path_of(artifact)
        if not path or path not in texts:
            continue
        if PurePosixPath(path).suffix.lower() not in _LAUNCH_ENDINGS:
            sources[path] = texts[path]
    return read_sources(sources, rules)


def _for_a_person(file: str, line: int, seen: str) -> str:
    return f"{FOR_A_PERSON} {file}, line {line}, {seen}. The points are given."


def _to_read(documents: Sequence[str]) -> str:
    """Ask a person to read the documents that the grader cannot."""
    return f"{FOR_A_PERSON} {', '.join(documents)}, which the grader cannot. The points are given."


class _OfFiles(Parameters):
    """Parameters of a check of files alone, without a recording."""

    of_session = False


class Part(Parameters):
    """Names for one part of the submission in a README."""

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
    absent_costs: Share = Field(
        0.0,
        description="Share of the credit for each file that the README names and the submission does not have.",
    )


#: File and line of a mention.
_Place = tuple[str, int]
#: READMEs by their paths, with their visible blocks.
_Texts = list[tuple[str, list[Block]]]


@dataclass(frozen=True)
class _ReadmeFacts:
    """Contents of the READMEs, as far as the grader recognised them."""

    #: Place and text of the instruction to run the work; empty if none was found.
    run: str
    #: Parts of the work that the READMEs should mention.
    parts: Sequence[Part]
    #: First mention of each part that is mentioned.
    found: Mapping[Part, _Place]
    #: Headings and files without a text of their own.
    hollow: Sequence[str]
    #: Texts that a person should look at.
    notes: Sequence[str]
    #: The first command for other work, if there is none for this one.
    foreign: str = ""
    #: Files that they promise, and that are not there.
    absent: Mapping[str, _Place] = field(default_factory=dict)

    def share(self, run_weight: float, absent_costs: float) -> float:
        """Return the share of credit for the instruction and the mentions together, less the cost of absent files."""
        mentioned = (1 - run_weight) * len(self.found) / len(self.parts)
        share = run_weight * bool(self.run) + mentioned
        return share * max(0.0, 1 - absent_costs * len(self.absent))

    def missing(self) -> list[str]:
        """Return the names of the parts without a mention."""
        return [part.names[0] for part in self.parts if part not in self.found]

    def hint(self) -> str:
        """Ask for the missing texts alone."""
        hints = []
        if not self.run:
            hints.append("Give the commands that run the work.")
        missing = self.missing()
        if missing:
            hints.append(f"Add a few words about {', '.join(missing)}.")
        if self.absent:
            hints.append(f"Hand in {', '.join(self.absent)}, or take the names out.")
        return " ".join(hints)

    def reasons(self) -> list[str]:
        """Say which texts are missing."""
        reasons = []
        if not self.run:
            reasons.append(
                "The grader found no command and no sentence that says how to run the work."
            )
        if self.foreign:
            reasons.append(f"The README's commands run other work: {self.foreign}.")
        missing = self.missing()
        if missing:
            reasons.append(f"The grader found no mention of {', '.join(missing)}.")
        if self.absent:
            named = []
            for name, place in self.absent.items():
                named.append(f"{name} ({_at(*place)})")
            reasons.append(f"The submission has no {', '.join(named[:_MOST_LISTED])}.")
        if reasons and self.hollow:
            reasons.append(f"Nothing of its own stands under {self._listed_hollow()}.")
        return reasons

    def counted(self) -> tuple[str, ...]:
        """List the recognised texts, a line each, and the headings that did not count."""
        lines = [f"How to run it: {self.run or 'not found'}"]
        for part in self.parts:
            place = self.found.get(part)
            at = _at(*place) if place is not None else "not found"
            lines.append(f"{part.names[0]}: {at}")
        if self.hollow:
            lines.append(
                f"Not counted, as nothing of its own stands there: {self._listed_hollow()}"
            )
        return tuple(lines)

    def _listed_hollow(self) -> str:
        return ", ".join(self.hollow[:_MOST_LISTED])


def readme(context: Context, p: Readme) -> Finding:
    """Judge whether the README tells how to run the work and names each part.

    Templates and pasted code do not count.
    """
    expected = f"it says how to run the work ({p.run_weight:.0%}), and each part can be found in it (the rest)"
    paths = _readme_paths(context, p.titles)
    unread = _not_read(context)
    if not paths and not unread:
        hint = "Write a README.md beside the code."
        return failed(expected, "no README", "There is no README.", hint=hint)
    facts = _readme_facts(context, paths, p)
    share = facts.share(p.run_weight, p.absent_costs)
    notes = facts.notes
    if share < 1 and unread:
        notes = [_to_read(unread)]
        share = 1.0
    where = [Location(file=str(path)) for path in [*paths[:1], *unread]]
    run = "yes" if facts.run else "not found"
    measured = f"how to run it: {run}; {len(facts.found)} of {len(facts.parts)} parts found"
    reasons = " ".join(facts.reasons())
    hint = facts.hint()
    finding = graded(share, expected, measured, reasons, hint=hint, where=where, notes=notes)
    return replace(finding, counted=facts.counted())


def _readme_paths(context: Context, titles: Sequence[str]) -> list[PurePosixPath]:
    """Return the READMEs of a submission, or all its other documents if it has no README."""
    documents = _documents(context)
    paths = []
    for path in documents:
        if any(search(title, path.stem, ignore_case=True) for title in titles):
            paths.append(path)
    if paths:
        return paths
    return [path for path in documents if path.suffix and not _is_for_programs(path)]


def _readme_facts(context: Context, paths: Sequence[PurePosixPath], p: Readme) -> _ReadmeFacts:
    """Read the READMEs, and look for the instruction to run the work and for its parts."""
    # Other checks charge the files that were not handed in.
    parts = [part for part in p.parts if context.path_of(part.artifact) is not None]
    parts = parts or list(p.parts)
    names = {part: _names_of(context, part) for part in parts}
    texts, hollow = _visible(context, paths, names, p.placeholders)
    found = _found_parts(texts, names)
    own = _own_text(context, p)
    in_other_words = not found and _is_long(texts, p.doubt_words)
    if len(found) < _FEW_PARTS and not in_other_words:
        foreign = _command_of_other_work(texts, p, own)
        if foreign:
            return _ReadmeFacts("", parts, found, hollow, (), foreign)
    run, notes = _how_to_run(texts, p, own)
    if in_other_words:
        # A long text may call the parts and the programs by other names.
        run, notes = _how_to_run(texts, p, None)
        found = dict.fromkeys(parts, (texts[0][0], 1))
        seen = "names no part of the work by a name known to the grader"
        notes.append(_for_a_person(texts[0][0], 1, seen))
    absent = _absent_files(texts, p, own, names_all=len(found) == len(parts))
    if absent:
        # Commands for absent files alone are no instruction.
        if _command_of_other_work(texts, p, own):
            run = ""
    return _ReadmeFacts(run, parts, found, hollow, notes, absent=absent)


#: Names of files in a text, with their folders, e.g. `config/arm.yaml`.
_FILE_NAME = re.compile(
    r"(?<![\w*<>{}$.~/-])(?:[\w-]{1,60}/){0,5}[\w.-]{0,60}\w\."
    r"(?:py|xml|ya?ml|sh|md|csv|png|jpe?g|pdf|rviz|urdf|xacro|json|ipynb)\b(?![\w*/.-]*[*/])"
)
#: Folders that a build makes.
_BUILT = ("build/", "install/", "log/")
#: Number of absent files from which a README promises them; one alone may be a memory of an earlier state.
_FEW_ABSENT = 2


def _absent_files(texts: _Texts, p: Readme, own: str, *, names_all: bool) -> dict[str, _Place]:
    """Return the files of the READMEs that are not there, with their first mention.

    A single one counts only in a command that starts it, and not in a README that names all parts: there it stands for
    each of them, as in `python3 file.py`. Files that a program or the handout names may be made later.
    """
    if not p.absent_costs:
        return {}
    absent: dict[str, _Place] = {}
    for path, shown in texts:
        for block in shown:
            for offset, text in enumerate(block.text.split("\n")):
                for match in _FILE_NAME.finditer(text):
                    if _is_absent(match[0], own):
                        absent.setdefault(match[0], (path, block.line + offset))
    if len(absent) >= _FEW_ABSENT:
        return absent
    if not names_all and _starts_absent(texts, p, own):
        return absent
    return {}


def _starts_absent(texts: _Texts, p: Readme, own: str) -> bool:
    """Tell whether a command starts a Python file that is not there."""
    for _, shown in texts:
        for _, command in command_lines(shown, p.commands):
            for match in _STARTED.finditer(command):
                if match[3] is None:
                    continue
                if not _is_named(match[3], own):
                    return True
    return False


def _is_absent(name: str, own: str) -> bool:
    if name.startswith(_BUILT):
        return False
    return not _is_named(name, own)


#: Stems that every program holds, as in `def main` and `"__main__"`. They name a file only with its ending.
_IN_EVERY_PROGRAM = ("main", "__main__")


def _is_named(name: str, own: str) -> bool:
    """Tell whether a submission has or names a file, a program or a package."""
    stem = PurePosixPath(name).stem
    if stem in _IN_EVERY_PROGRAM:
        return f"{stem}.py" in own
    return stem in own


#: Number of parts from which a README is about this work.
_FEW_PARTS = 2
_STARTED = re.compile(
    r"ros2\s+(?:run|launch)\s+([\w./-]+)(?:\s+([\w./-]+))?|python3?\s+([\w./-]+)\.py\b"
)


def _command_of_other_work(texts: _Texts, p: Readme, own: str) -> str:
    """Return the first command if no command starts anything of the submission or of the lab; empty otherwise.

    Example
    -------
    `ros2 run turtlesim turtlesim_node`, beside a submission that does not name turtlesim.
    """
    others = []
    for _, shown in texts:
        for _, command in command_lines(shown, p.commands):
            if not _is_of_other_work(command, own):
                return ""
            others.append(command)
    return others[0] if others else ""


def _own_text(context: Context, p: Readme) -> str:
    """Return the names of the lab's parts, and the paths and the contents of the submission without its documents."""
    documents = set(map(str, _documents(context)))
    own: list[str] = []
    for part in p.parts:
        own += part.names
    own += [file.path for file in context.submission.files]
    own += context.submission.left_out
    own += context.submission.given_texts.values()
    for path, text in context.submission.texts.items():
        if path not in documents:
            own.append(text)
    return "\n".join(own)


def _is_of_other_work(command: str, own: str) -> bool:
    """Tell whether a command starts programs, and the submission names none of them."""
    names: list[str] = []
    for match in _STARTED.finditer(command):
        names += filter(None, match.groups())
    for name in names:
        if _is_named(name, own):
            return False
    return bool(names)


def _names_of(context: Context, part: Part) -> tuple[str, ...]:
    """Return the names of a part in the rubric, and the student's name of its file."""
    path = PurePosixPath(context.path_of(part.artifact) or "")
    return (*part.names, path.name, path.stem)


def _is_long(texts: _Texts, doubt_words: int) -> bool:
    """Tell whether READMEs say enough outside code to mention the parts in unknown words."""
    said = []
    for _, shown in texts:
        said += [block.text for block in shown if block.kind != "code"]
    return substance(" ".join(said)) >= doubt_words


def _found_parts(texts: _Texts, names: Mapping[Part, Sequence[str]]) -> dict[Part, _Place]:
    """Return the first mention of each part; a part can be found by another part that shows it.

    The latter needs a README that mentions several parts.
    """
    found: dict[Part, _Place] = {}
    for part in names:
        place = _mentioned(texts, names[part], part.synonyms)
        if place is not None:
            found[part] = place
    if len(found) <= 1:
        return found
    places = {part.artifact: place for part, place in found.items()}
    shown: dict[Part, _Place] = {}
    for part in names:
        if part.shown_by in places:
            shown[part] = places[part.shown_by]
    return shown | found


def _visible(
    context: Context,
    paths: Sequence[PurePosixPath],
    names: Mapping[Part, Sequence[str]],
    placeholders: Sequence[str],
) -> tuple[_Texts, list[str]]:
    """Return the visible blocks of READMEs, and the sections and files without a text of their own."""
    terms = Terms.of(chain(*names.values()), _ENDING)
    texts: _Texts = []
    hollow: list[str] = []
    for path, document in _read(context, paths):
        if is_source(context.submission.texts[path]):
            hollow.append(f"{path} (source code)")
            continue
        shown, empty = visible(document, terms, placeholders)
        texts.append((path, shown))
        for section in empty:
            if section.title:
                hollow.append(f"'{section.title}' ({path}, line {section.line})")
    return texts, hollow


def _mentioned(texts: _Texts, names: Sequence[str], synonyms: Sequence[str]) -> _Place | None:
    """Return the first mention of a part in the READMEs."""
    by_name = Terms.of(names, _ENDING)
    by_synonym = Terms.of(synonyms, _ENDING)
    for path, shown in texts:
        line = mention(shown, by_name, by_synonym)
        if line is not None:
            return path, line
    return None


def _how_to_run(texts: _Texts, p: Readme, own: str | None) -> tuple[str, list[str]]:
    """Return the place and text of the instruction to run the work, and notes for a person about it.

    Commands for other work are no instruction, unless any command will do (own: None).
    """
    for path, shown in texts:
        for line, command in command_lines(shown, p.commands):
            is_other = False
            if own is not None:
                is_other = _is_of_other_work(command, own)
            if not is_other:
                return f"{_at(path, line)}, {command[:80]}", []
    for path, shown in texts:
        in_words = instruction_line(shown, p.run_words)
        if in_words is not None:
            seen = "may say how the work is run, though without a command"
            return f"{_at(path, in_words)}, in words", [_for_a_person(path, in_words, seen)]
    return "", []


def _at(file: str, line: int) -> str:
    return f"{file}, line {line}"


class CodeExplained(_OfFiles):
    """Docstrings or comments explain the files (a part), and their classes and functions of some length (the rest)."""

    artifacts: tuple[ref.Artifact, ...]
    full_from: Share = Field(
        description="Share of them that earns full credit; less earns in proportion."
    )
    function_lines: int = Field(
        5, description="A function whose body has fewer lines speaks for itself."
    )
    min_words: int = Field(2, description="Distinct words from which a text explains.")
    file_weight: Share = Field(0.5, description="Share of the credit for the files.")
    file_words: int = Field(
        0,
        description="Distinct words from which comments explain a file that has no docstring of its own or of its class.",
    )
    placeholders: tuple[Pattern, ...] = Field(
        (), description="Regular expressions of texts that wait to be written."
    )
    fillers: tuple[str, ...] = Field(
        (), description="Words that add nothing to the name of what they stand beside."
    )


@dataclass(frozen=True)
class _Explained:
    """Explained and unexplained units of all files: the files themselves, their classes and functions."""

    #: Units that need an explanation, and the paths of their files.
    units: Sequence[tuple[str, Unit]]
    #: Units of whole files, repeated for each artifact in a file.
    files: Sequence[Unit]
    #: Units of classes and functions.
    inner: Sequence[Unit]

    def share(self, file_weight: float) -> float:
        """Return the weighted mean of the explained shares of files and of their classes and functions."""
        if not self.inner:
            return _explained_share(self.files)
        if not self.files:
            return _explained_share(self.inner)
        of_files = file_weight * _explained_share(self.files)
        return of_files + (1 - file_weight) * _explained_share(self.inner)

    def counts(self) -> str:
        """Return the numbers of explained units in words."""
        once = list({id(unit): unit for unit in self.files}.values())
        files = f"files: {_explained_in(once)} of {len(once)}"
        inner = f"classes and functions: {_explained_in(self.inner)} of {len(self.inner)}"
        return f"{files}; {inner}"

    def bare(self) -> list[tuple[str, Unit]]:
        """Return the units without an explanation, and the paths of their files."""
        return [(path, unit) for path, unit in self.units if unit.explained_by is None]


def _explained_in(units: Sequence[Unit]) -> int:
    return sum(unit.explained_by is not None for unit in units)


def _explained_share(units: Sequence[Unit]) -> float:
    return _explained_in(units) / len(units)


def code_explained(context: Context, p: CodeExplained) -> Finding:
    """Judge the share of files, classes and functions with a docstring or comment that explains them."""
    rules = Rules(p.min_words, p.function_lines, p.placeholders, p.fillers, p.file_words)
    facts = _sources(context, p.artifacts, rules)
    expected = (
        f"a docstring or a comment explains at least {percent(p.full_from)}: of the files ({percent(p.file_weight)}), "
        f"and of classes and functions with a body of {p.function_lines} lines or more (the rest); constructors, "
        "main and the only class of a file do not count"
    )
    if p.file_words:
        expected += f"; comments explain a file from {p.file_words} words on"
    if not facts:
        return failed(expected, "no source files", "There is no source to read.")
    explained = _units_of(facts, list(map(context.path_of, p.artifacts)))
    if not explained.units:
        return passed(expected, "nothing that needs an explanation")
    share = explained.share(p.file_weight)
    bare = explained.bare()
    shown_share = apart(100 * share, 100 * p.full_from, places=0)
    measured = f"{explained.counts()}; with these weights {shown_share}%"
    reason = _not_explained(bare, facts)
    where = [Location(file=path, line=unit.line) for path, unit in bare[:_MOST_NAMED]]
    share /= p.full_from
    finding = graded(share, expected, measured, reason, where=where, notes=_unreadable(facts))
    return replace(finding, counted=tuple(map(_listed, facts)))


def _units_of(facts: Sequence[SourceFacts], paths: Sequence[str | None]) -> _Explained:
    """Sort the units that need an explanation into files, and classes and functions."""
    units = []
    files = []
    inner = []
    for file in facts:
        for unit in file.units:
            if not unit.needed:
                continue
            units.append((file.path, unit))
            if unit is file.units[0]:
                # A file counts once for each artifact in it.
                files += [unit] * paths.count(file.path)
            else:
                inner.append(unit)
    return _Explained(units, files, inner)


def _not_explained(bare: Sequence[tuple[str, Unit]], facts: Sequence[SourceFacts]) -> str:
    """Name the units without an explanation, and the faults of texts that do not count."""
    names = [unit.name for _, unit in bare]
    more = ""
    if len(names) > _MOST_NAMED:
        more = f" and {len(names) - _MOST_NAMED} more"
    named = ", ".join(names[:_MOST_NAMED])
    reason = f"Neither a docstring nor a comment explains {named}{more}."
    faults: set[str] = set()
    for file in facts:
        faults.update(note.fault for note in file.notes if note.fault)
    if faults:
        reason += f" What was found there does not count: {', '.join(sorted(faults))}."
    return reason


def _unreadable(facts: Sequence[SourceFacts]) -> list[str]:
    """Ask a person to look at the files that Python cannot read."""
    notes = []
    for file in facts:
        if not file.readable:
            notes.append(
                f"{FOR_A_PERSON} Python cannot read {file.path}, so only its comments were counted."
            )
    return notes


def _listed(facts: SourceFacts) -> str:
    """List the explanation of each part of a file, and the texts that do not count."""
    said = []
    for unit in facts.units:
        if unit.needed:
            name = unit.name
            if unit is facts.units[0]:
                name = "the file"
            said.append(f"{name} ({_kind(unit)})")
    line = f"{facts.path}: {'; '.join(said)}"
    faults = _listed_faults(facts.notes)
    if faults:
        line += f". Not counted: {'; '.join(faults)}"
    return line


def _listed_faults(notes: Sequence[Note]) -> list[str]:
    """List each fault of notes, with the first lines that have it."""
    lines_by_fault: dict[str, list[str]] = {}
    for note in sorted(notes, key=lambda note: (note.fault, note.line)):
        if note.fault:
            lines_by_fault.setdefault(note.fault, []).append(_lines(note))
    listed = []
    for fault, lines in lines_by_fault.items():
        at = ", ".join(lines[:_MOST_LISTED])
        listed.append(f"{fault} (at {at})")
    return listed


def _kind(unit: Unit) -> str:
    note = unit.explained_by
    if note is not None:
        return f"{note.kind}, line {note.line}"
    return "nothing"


def _lines(note: Note) -> str:
    if note.line == note.last:
        return f"line {note.line}"
    return f"lines {note.line}–{note.last}"


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
    figures_by: ref.EarlierCheckId | None = Field(
        None, description="Check of the measured figures from which a text may argue."
    )
    unfounded_credit: Share = Field(
        1.0, description="Share that a text with figures keeps if that check earns half or less."
    )


def concepts_explained(context: Context, p: ConceptsExplained) -> Finding:
    """Judge the number of discussed concepts (two thirds) and their comparison (a third).

    Without a comparison the text may be a mere list of settings, and earns half as much.
    """
    passages = _passages(context, p.artifacts)
    given = _given(context).sentences
    found = concepts(passages, p.concepts, p.reasons, p.anchors, p.min_words, p.connectives, given)
    expected = f"{p.full_concepts} of {len(p.concepts)} concepts discussed (two thirds), and weighed with reasons (one third)"
    measured = f"{', '.join(found.discussed) or 'none'} discussed"
    if found.unclear and 2 * len(found.discussed) < p.full_concepts:
        return _unclear(expected, measured, found.unclear)
    if len(found.discussed) < p.least_concepts:
        return _too_little(context, expected, measured, found, p.artifacts)
    return _judge_discussion(context, expected, measured, found, p)


def _judge_discussion(
    context: Context, expected: str, measured: str, found: Discussion, p: ConceptsExplained
) -> Finding:
    """Judge the text that was found, and list its places."""
    covered = min(1.0, len(found.discussed) / p.full_concepts)
    if found.related:
        share = 2 / 3 * covered + 1 / 3
    else:
        share = 1 / 3 * covered
    missing = _missing_discussion(found, p)
    where = [] if missing else _locations(found)
    unfounded = _unfounded(context, p)
    if unfounded is not None:
        share *= p.unfounded_credit
        missing.append(unfounded.reason)
        where = [unfounded.where]
    reason = " ".join(missing)
    notes = []
    for passage in found.strung:
        at = _at(passage.file, passage.line)
        notes.append(f"{FOR_A_PERSON} {at}, seems to be words, not sentences.")
    hint = _discussion_hint(found, p)
    finding = graded(share, expected, measured, reason, hint=hint, where=where, notes=notes)
    return replace(finding, counted=_counted_concepts(found, p))


#: A measured figure of a text, such as `0.55ms` or `1001 msgs`.
_FIGURE = re.compile(r"\d\s{0,2}(?:ms|µs|us|msgs?|messages?)(?![a-z])")
#: Number of figures from which a text reports a measurement; one may be a period.
_LEAST_FIGURES = 2
#: Credit of the check of figures up to which a text cannot argue from them.
_REFUTED = 0.5


@dataclass(frozen=True)
class _Unfounded:
    """Figures in a document that the recording refutes."""

    reason: str
    where: Location


def _unfounded(context: Context, p: ConceptsExplained) -> _Unfounded | None:
    """Return the figures from which a document argues although the check of figures refutes them."""
    if not _are_refuted(context, p.figures_by):
        return None
    title = context.titles.get(str(p.figures_by), "")
    for path in map(str, _documents(context)):
        text = context.submission.texts[path][:_MOST_CHARACTERS]
        figures = list(_FIGURE.finditer(text))
        if len(figures) < _LEAST_FIGURES:
            continue
        line = text.count("\n", 0, figures[0].start()) + 1
        reason = f"{path} argues from measured figures, which are wrong, as '{title}' says."
        return _Unfounded(reason, Location(file=path, line=line))
    return None


def _are_refuted(context: Context, check: str | None) -> bool:
    """Tell whether a check of figures took at least half of its points."""
    if check is None:
        return False
    finding = context.findings.get(check)
    if finding is None:
        return False
    if not finding.outcome.took_points:
        return False
    return finding.credit <= _REFUTED


def _passages(context: Context, artifacts: Sequence[str]) -> list[Passage]:
    """Return the passages of all documents, and of the docstrings and comments of artifacts."""
    documents = [path for path in _documents(context) if not _is_for_programs(path)]
    passages: list[Passage] = []
    for path, document in _read(context, documents):
        passages += document_passages(document, path)
    for facts in _sources(context, artifacts):
        passages += source_passages(facts)
    return passages


def _locations(found: Discussion) -> list[Location]:
    passages = found.discussed.values()
    return [Location(file=passage.file, line=passage.line) for passage in passages]


def _unclear(expected: str, measured: str, passages: Sequence[Passage]) -> Finding:
    """Leave a short text, or one in words unknown here, to a person."""
    places = [_at(passage.file, passage.line) for passage in passages[:_MOST_LISTED]]
    reason = (
        "The text about this is short, or in words that the grader does not know; a person "
        f"has to read it: {', '.join(places)}."
    )
    where = [Location(file=passage.file, line=passage.line) for passage in passages]
    return inconclusive(expected, measured, reason, where=where, retry=False)


def _too_little(
    context: Context, expected: str, measured: str, found: Discussion, artifacts: Sequence[str]
) -> Finding:
    """State that too few concepts are discussed, or that a person must read the documents."""
    unread = _not_read(context)
    if unread:
        reason = f"The grader cannot read {', '.join(unread)}; a person has to."
        where = [Location(file=path) for path in unread]
        return inconclusive(expected, "not read", reason, where=where, retry=False)
    reason = f"The grader found no text about this. {_sought(context, artifacts)}"
    return failed(expected, measured, reason, where=_locations(found))


def _sought(context: Context, artifacts: Sequence[str]) -> str:
    """Name the documents and programs that were read for a text, and those that are missing."""
    read = [str(path) for path in _documents(context) if not _is_for_programs(path)]
    missing = []
    if not read:
        missing.append("README")
    for artifact in artifacts:
        fact = context.submission.artifact(artifact)
        if fact is None:
            continue
        if fact.path is None:
            missing.append(fact.expected)
        else:
            read.append(fact.path)
    said = []
    if read:
        said.append(f"It read {', '.join(read[:_MOST_LISTED])}.")
    if missing:
        said.append(f"There is no {' and no '.join(missing)}.")
    return " ".join(said)


def _missing_concepts(found: Discussion, p: ConceptsExplained) -> str:
    return ", ".join(name for name in p.concepts if name not in found.discussed)


def _discussion_hint(found: Discussion, p: ConceptsExplained) -> str:
    """Ask for the missing concepts if nothing else is missing; empty leaves the hint to the rubric."""
    if len(found.discussed) >= p.full_concepts or not found.related:
        return ""
    lacking = p.full_concepts - len(found.discussed)
    sentences = "one sentence" if lacking == 1 else f"{lacking} sentences"
    return f"Add {sentences} in the README about one of these each: {_missing_concepts(found, p)}."


def _missing_discussion(found: Discussion, p: ConceptsExplained) -> list[str]:
    """Say which concepts were not recognised, and that no comparison was."""
    reasons = []
    if len(found.discussed) < p.full_concepts:
        missing = _missing_concepts(found, p)
        recognised = f"The grader recognised {len(found.discussed)} of {len(p.concepts)} subjects"
        reasons.append(
            f"{recognised}; {p.full_concepts} give full credit. Not recognised: {missing}."
        )
    if not found.related:
        reasons.append("It recognised no passage that weighs them: when which, and at what price?")
    return reasons


def _counted_concepts(found: Discussion, p: ConceptsExplained) -> tuple[str, ...]:
    """List the place of each concept and of the comparisons, a line each, and quote the first."""
    lines = []
    for name in p.concepts:
        passage = found.discussed.get(name)
        place = "not recognised"
        if passage is not None:
            place = _at(passage.file, passage.line)
        lines.append(f"{name}: {place}")
    places = [_at(passage.file, passage.line) for passage in found.related[:_MOST_LISTED]]
    lines.append(f"weighed with reasons: {', '.join(places) or 'not recognised'}")
    if found.related:
        lines.append(f"{places[0]}: “{_quoted(found.related[0])}”")
    return tuple(lines)


def _quoted(passage: Passage) -> str:
    """Return the text of a passage on one line, cut to a length."""
    quote = " ".join(plain_text(passage.text).split())
    if len(quote) <= _QUOTED:
        return quote
    return f"{quote[: _QUOTED - 1]}…"

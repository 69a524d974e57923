"""Code that programs of a class share, except code from the lab and common code: facts without a verdict. Pure.

A source in Python, C or C++ is parsed by tree-sitter, which also accepts incorrect ones. It becomes the kinds of its
syntax nodes in their order: without names, texts, numbers, comments, types, imports and layout. Each `LENGTH`
consecutive nodes are a fingerprint. Two submissions share the longest runs of equal fingerprints, wherever these are;
each node is in one run at most.

References
----------
Schleimer, S., Wilkerson, D. S. and Aiken, A. (2003). Winnowing: local algorithms for document fingerprinting.
SIGMOD 2003, 76-85. A class is small enough to keep every fingerprint; none is winnowed.

Prechelt, L., Malpohl, G. and Philippsen, M. (2002). Finding plagiarisms among a set of programs with JPlag.
Journal of Universal Computer Science 8, 1016-1038.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import PurePosixPath

import numpy as np
import numpy.typing as npt
import tree_sitter

from grader.evidence.text.concrete_syntax import concrete_tree
from grader.recording.submission import FileFact, SubmissionRecord
from grader.submission.file_names import C_SUFFIXES

#: Nodes of a fingerprint. On 66 disguised copies and the 125 fixtures, 8 nodes list more pairs with almost no line in
#: common, and 15 nodes find less of the disguised code.
LENGTH = 12
#: Least number of common nodes of a listed pair, some 35 lines, and their least share of one submission's own nodes.
#: The disguises of `tests/cohort/disguises.py` leave a share of 0.7 or more; docs/similarity.md has the fixtures' pairs.
LEAST_NODES, LEAST_SHARE = 100, 0.4
#: Most submissions, or most of the class as a share, that have a piece of code before it counts as common.
MOST_HOLDERS, MOST_HOLDERS_SHARE = 10, 0.1
#: Size below which files are alike by chance.
LEAST_BYTES = 200
#: Bounds far beyond real submissions: nodes of a submission, positions of a fingerprint in it, and compared pairs.
MOST_NODES, MOST_PLACES, MOST_PAIRS = 100_000, 20, 500
#: Bounds of a shown pair: passages, lines of each, and characters of a line.
MOST_SPANS, MOST_LINES, MOST_CHARACTERS = 60, 200, 160
#: Lines between two runs that are shown as one.
_GAP = 2
#: Factor of the rolling hash: 2**64 divided by the golden ratio.
_FACTOR = np.uint64(0x9E3779B97F4A7C15)

#: Index of a file in the paths of a program, and line from 1.
_Line = tuple[int, int]
_Numbers = npt.NDArray[np.uint64]
_Flags = npt.NDArray[np.bool_]

#: Syntax nodes that are left out with all nodes in them.
_LEFT_OUT = frozenset(
    (
        *("comment", "type", "import_statement", "import_from_statement"),
        *("future_import_statement", "preproc_include", "using_declaration", "type_descriptor"),
    )
)
#: Syntax nodes that are left out by themselves, because they tell nothing about a program's structure.
_PASSED_OVER = frozenset(
    (
        *("identifier", "module", "block", "expression_statement", "parenthesized_expression"),
        *("decorator", "argument_list", "parameters", "typed_parameter", "typed_default_parameter"),
        *("float", "integer", "ERROR"),
        *("translation_unit", "compound_statement", "field_identifier", "type_identifier"),
        *("namespace_identifier", "qualified_identifier", "primitive_type", "number_literal"),
        *("sized_type_specifier", "parameter_list", "parameter_declaration", "template_type"),
        *("template_argument_list", "type_qualifier", ";", "::", "<", ">", "&"),
        *(":", ",", ".", "(", ")", "[", "]", "{", "}", "@"),
    )
)


#: Texts; their parts are not compared.
_TEXTS = frozenset(("string", "string_literal", "raw_string_literal", "char_literal"))
#: Added to the kinds of C and C++, so that none is a kind of Python.
_KINDS_OF_C = 10_000


@dataclass(frozen=True)
class Program:
    """The sources of a submission, as the kinds of their syntax nodes one after the other."""

    name: str
    sha256: str
    texts: dict[str, str]
    files: tuple[FileFact, ...]
    #: Each node's kind, the index of its file in `paths`, and its line from 1.
    kinds: tuple[int, ...]
    places: tuple[int, ...]
    lines: tuple[int, ...]
    paths: tuple[str, ...]
    #: True if it has more than `MOST_NODES` nodes; the others are not compared.
    cut: bool = False


@dataclass(frozen=True)
class Span:
    """Lines of a file, from 1, the last one included."""

    path: str
    first: int
    last: int
    #: Texts of the lines, as far as `MOST_LINES` and `MOST_CHARACTERS` allow.
    texts: tuple[str, ...]


@dataclass(frozen=True)
class Pair:
    """Two submissions that share code."""

    names: tuple[str, str]
    #: Common nodes, and their share of each submission's own nodes, from 0 to 1.
    nodes: int
    shares: tuple[float, float]
    #: Number of lines with common nodes in each.
    lines: tuple[int, int]
    spans: tuple[tuple[Span, Span], ...]


@dataclass(frozen=True)
class Copies:
    """The same file in several submissions."""

    size_bytes: int
    #: Names of the submissions, each with the file's path in it.
    found: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Similarity:
    """The code that submissions of a class share."""

    #: Hash of each submission that was compared.
    compared: dict[str, str]
    #: Reasons why some were not compared, or only in part.
    problems: dict[str, str]
    #: Folders with code that does not count.
    common: tuple[str, ...]
    pairs: tuple[Pair, ...]
    copies: tuple[Copies, ...]

    @property
    def clusters(self) -> tuple[tuple[str, ...], ...]:
        """Groups of three or more submissions that pairs connect, the largest first."""
        groups: dict[str, set[str]] = {}
        for pair in self.pairs:
            joined = set(pair.names)
            for name in pair.names:
                joined |= groups.get(name, set())
            for name in joined:
                groups[name] = joined
        found = set()
        for names in groups.values():
            if len(names) > 2:
                found.add(tuple(sorted(names)))
        return tuple(sorted(found, key=lambda names: (-len(names), names)))


# -- a submission ------------------------------------------------------------------------------


def nodes_of(text: str, most: int = MOST_NODES, language: str = "python") -> list[tuple[int, int]]:
    """Return kind and line of a text's structural nodes, at most some number of them.

    A text that takes the parser too long for code has none.
    """
    found: list[tuple[int, int]] = []
    tree = concrete_tree(text.encode("utf-8", "replace"), language)
    added = 0
    if language != "python":
        added = _KINDS_OF_C
    if tree is None:
        return found
    waiting = [tree.root_node]
    while waiting and len(found) < most:
        node = waiting.pop()
        if node.type in _LEFT_OUT or _is_docstring(node):
            continue
        if node.type not in _PASSED_OVER:
            found.append((node.kind_id + added, node.start_point[0] + 1))
        if node.type not in _TEXTS:
            waiting += reversed(node.children)
    return found


def _is_docstring(node: tree_sitter.Node) -> bool:
    if node.type != "expression_statement":
        return False
    return [child.type for child in node.children] == ["string"]


def _language(path: str) -> str:
    """Return the language of a source by its ending; empty for another file."""
    suffix = PurePosixPath(path).suffix
    if suffix in C_SUFFIXES:
        return "cpp"
    if suffix == ".py":
        return "python"
    return ""


def program_of(record: SubmissionRecord) -> Program:
    """Return the sources of a submission; if these are too much, the largest are left out."""
    texts = {}
    for path, text in record.texts.items():
        if _language(path):
            texts[path] = text

    def size(path: str) -> tuple[int, str]:
        return len(texts[path]), path

    paths = sorted(texts, key=size)
    kinds: list[int] = []
    places: list[int] = []
    lines: list[int] = []
    for place, path in enumerate(paths):
        # One node too many shows that the program was cut.
        left = MOST_NODES + 1 - len(kinds)
        for kind, line in nodes_of(texts[path], left, _language(path)):
            kinds.append(kind)
            places.append(place)
            lines.append(line)
    return Program(
        name=record.name,
        sha256=record.sha256,
        texts=texts,
        files=tuple(record.files),
        kinds=tuple(kinds[:MOST_NODES]),
        places=tuple(places[:MOST_NODES]),
        lines=tuple(lines[:MOST_NODES]),
        paths=tuple(paths),
        cut=len(kinds) > MOST_NODES,
    )


# -- fingerprints ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Prints:
    """The fingerprints of a program: one for each node, which is its first."""

    program: Program
    values: _Numbers
    #: Fingerprints within one file that neither the lab nor many of the class have.
    own: _Flags

    @classmethod
    def of(cls, program: Program) -> _Prints:
        """Compute the fingerprints of a program."""
        count = max(0, len(program.kinds) - LENGTH + 1)
        kinds = np.array(program.kinds, dtype=np.uint64)
        values = np.zeros(count, dtype=np.uint64)
        for offset in range(LENGTH):
            nodes = kinds[offset : offset + count]
            values = values * _FACTOR + nodes + np.uint64(1)
        within_file = np.zeros(count, dtype=bool)
        if count:
            places = np.array(program.places)
            within_file = places[:count] == places[LENGTH - 1 :]
        return cls(program, values, within_file)

    def without(self, values: _Numbers) -> _Prints:
        """Return the fingerprints, with those of some values no longer counted as own."""
        return replace(self, own=self.own & ~np.isin(self.values, values))

    @property
    def unique(self) -> _Numbers:
        """Different values of the own fingerprints."""
        return np.unique(self.values[self.own])

    @cached_property
    def own_nodes(self) -> int:
        """Number of nodes in own fingerprints."""
        covered = np.zeros(len(self.program.kinds), dtype=bool)
        for start in np.flatnonzero(self.own):
            covered[start : start + LENGTH] = True
        return int(covered.sum())

    def share_of(self, nodes: int) -> float:
        """Return a number of nodes as a share of all own nodes."""
        if not self.own_nodes:
            return 0.0
        return nodes / self.own_nodes

    def listed(self) -> list[int]:
        """Return the values, with 0 for each fingerprint that is not own."""
        listed: list[int] = np.where(self.own, self.values, np.uint64(0)).tolist()
        return listed


def _own_prints(programs: Sequence[Program], common: Sequence[Program]) -> list[_Prints]:
    """Return the fingerprints of programs, without those of common code."""
    given = _joined(_Prints.of(program).values for program in common)
    prints = [_Prints.of(program).without(given) for program in programs]
    values, holders = np.unique(_joined(each.unique for each in prints), return_counts=True)
    usual = values[holders > _most_holders(programs)]
    return [each.without(usual) for each in prints]


def _joined(parts: Iterable[_Numbers]) -> _Numbers:
    """Return arrays as one; an empty one if there are none."""
    return np.concatenate([np.zeros(0, dtype=np.uint64), *parts])


def _most_holders(programs: Sequence[Program]) -> float:
    """Return how many programs of a class may have a piece of code before it counts as common."""
    return max(MOST_HOLDERS, MOST_HOLDERS_SHARE * len(programs))


# -- pairs -------------------------------------------------------------------------------------


def pairs_of(programs: Sequence[Program], common: Sequence[Program] = ()) -> list[Pair]:
    """Return the pairs that share enough code besides common code, the largest share first."""
    prints = _own_prints(programs, common)
    shown = []
    for one, other in _candidates(prints):
        pair = _pair(prints[one], prints[other])
        if pair.nodes >= LEAST_NODES and max(pair.shares) >= LEAST_SHARE:
            shown.append(pair)

    def rank(pair: Pair) -> tuple[float, int, tuple[str, str]]:
        return -max(pair.shares), -pair.nodes, pair.names

    return sorted(shown, key=rank)


def _candidates(prints: Sequence[_Prints]) -> list[tuple[int, int]]:
    """Return the indexes of pairs with enough common fingerprints, those with most of them first."""
    holders: defaultdict[int, list[int]] = defaultdict(list)
    for place, each in enumerate(prints):
        for value in each.unique.tolist():
            holders[value].append(place)
    counts: Counter[tuple[int, int]] = Counter()
    for value in sorted(holders):
        counts.update(combinations(holders[value], 2))
    least = LEAST_NODES / LENGTH
    return [pair for pair, count in counts.most_common(MOST_PAIRS) if count >= least]


def _pair(a: _Prints, b: _Prints) -> Pair:
    runs = _Comparison(a, b).runs()
    shared = 0
    mine: set[_Line] = set()
    theirs: set[_Line] = set()
    for run in runs:
        shared += len(run.mine)
        mine |= _lines(a.program, run.mine)
        theirs |= _lines(b.program, run.theirs)
    return Pair(
        names=(a.program.name, b.program.name),
        nodes=shared,
        shares=(a.share_of(shared), b.share_of(shared)),
        lines=(len(mine), len(theirs)),
        spans=tuple(_spans(a.program, b.program, runs)),
    )


def _lines(program: Program, nodes: range) -> set[_Line]:
    """Return the lines of nodes."""
    places = program.places[nodes.start : nodes.stop]
    lines = program.lines[nodes.start : nodes.stop]
    return set(zip(places, lines, strict=True))


# -- runs of equal nodes -----------------------------------------------------------------------


@dataclass(frozen=True)
class _Run:
    """Equal nodes in two programs, by their numbers."""

    mine: range
    theirs: range


class _Comparison:
    """The search for runs of equal fingerprints in two programs."""

    def __init__(self, a: _Prints, b: _Prints) -> None:
        self.mine = a.listed()
        self.theirs = b.listed()
        #: Positions of each fingerprint in the second program.
        self.places: defaultdict[int, list[int]] = defaultdict(list)
        for place, value in enumerate(self.theirs):
            self.places[value].append(place)
        #: Nodes of the second program that are in a run.
        self.used = bytearray(len(self.theirs) + LENGTH)

    def runs(self) -> list[_Run]:
        """Return the longest runs in the order of the first program; no node is in two of them."""
        runs = []
        start = 0
        while start < len(self.mine):
            run = self._longest_run(start)
            if run is None:
                start += 1
                continue
            runs.append(run)
            self.used[run.theirs.start : run.theirs.stop] = b"\1" * len(run.theirs)
            start = run.mine.stop
        return runs

    def _longest_run(self, start: int) -> _Run | None:
        """Return the longest run from a node of the first program on, by unused nodes of the second."""
        value = self.mine[start]
        if not value:
            return None
        longest, place = 0, 0
        for at in self.places.get(value, ())[:MOST_PLACES]:
            length = self._length(start, at)
            if length > longest:
                longest, place = length, at
        if not longest:
            return None
        nodes = longest + LENGTH - 1
        mine = range(start, start + nodes)
        return _Run(mine, range(place, place + nodes))

    def _length(self, start: int, at: int) -> int:
        """Return how many equal fingerprints with unused nodes follow one another from two positions on."""
        mine_left = len(self.mine) - start
        theirs_left = len(self.theirs) - at
        most = min(mine_left, theirs_left)
        for length in range(most):
            value = self.theirs[at + length]
            if not value or value != self.mine[start + length]:
                return length
            place = at + length
            if any(self.used[place : place + LENGTH]):
                return length
        return most


# -- lines to be shown -------------------------------------------------------------------------


@dataclass(frozen=True)
class _Block:
    """Lines of a program's file, from 1, the last one included."""

    program: Program
    #: Index of the file in the program's paths.
    file: int
    first: int
    last: int

    @classmethod
    def of(cls, program: Program, nodes: range) -> _Block:
        """Return the lines of a run's nodes."""
        file = program.places[nodes.start]
        lines = program.lines[nodes.start : nodes.stop]
        return cls(program, file, lines[0], max(lines))

    def reaches(self, other: _Block) -> bool:
        """Return whether another block follows in the same file, with a small gap at most."""
        gap = other.first - self.last
        return self.file == other.file and 0 <= gap <= _GAP

    @property
    def span(self) -> Span:
        """The lines with their texts."""
        path = self.program.paths[self.file]
        lines = self.program.texts[path].split("\n")
        shown = lines[self.first - 1 : self.last][:MOST_LINES]
        texts = tuple(line[:MOST_CHARACTERS] for line in shown)
        return Span(path, self.first, self.last, texts)


def _spans(a: Program, b: Program, runs: Sequence[_Run]) -> list[tuple[Span, Span]]:
    """Return the lines of runs in both programs; runs that are near each other in both are joined."""
    blocks: list[tuple[_Block, _Block]] = []
    for run in runs:
        mine = _Block.of(a, run.mine)
        theirs = _Block.of(b, run.theirs)
        if blocks:
            my_last, their_last = blocks[-1]
            if my_last.reaches(mine) and their_last.reaches(theirs):
                blocks.pop()
                mine = replace(my_last, last=mine.last)
                theirs = replace(their_last, last=theirs.last)
        blocks.append((mine, theirs))
    return [(mine.span, theirs.span) for mine, theirs in blocks[:MOST_SPANS]]


# -- equal files -------------------------------------------------------------------------------


def copies_of(programs: Sequence[Program], common: Sequence[Program] = ()) -> list[Copies]:
    """Return the files that are the same in several submissions, except common files."""
    given = {file.sha256 for program in common for file in program.files}
    holders: defaultdict[str, dict[str, FileFact]] = defaultdict(dict)
    for program in programs:
        for file in program.files:
            if file.size_bytes >= LEAST_BYTES and file.sha256 not in given:
                holders[file.sha256].setdefault(program.name, file)
    most = _most_holders(programs)
    copies = []
    for files in holders.values():
        if 1 < len(files) <= most:
            copies.append(_copies(files))
    return sorted(copies, key=lambda copy: (-copy.size_bytes, copy.found))


def _copies(files: dict[str, FileFact]) -> Copies:
    """Return one file of several submissions."""
    found = [(name, file.path) for name, file in sorted(files.items())]
    first, *_ = files.values()
    return Copies(first.size_bytes, tuple(found))

"""Which programs of a class share code that neither the lab gave out nor many have: facts, without a verdict. Pure.

A Python file is parsed by tree-sitter, which also reads what is no correct Python, and becomes the kinds of its
syntax nodes in order: without names, texts, numbers, comments, annotations, imports and layout. Each `LENGTH` nodes
that follow one another are a fingerprint. What two submissions have in common are the longest runs of equal
fingerprints, each node in one of them, wherever they stand; all else is their own.

References
----------
Schleimer, S., Wilkerson, D. S. and Aiken, A. (2003). Winnowing: local algorithms for document fingerprinting.
SIGMOD 2003, 76-85. A class is small enough to keep every fingerprint, so that none is winnowed.

Prechelt, L., Malpohl, G. and Philippsen, M. (2002). Finding plagiarisms among a set of programs with JPlag.
Journal of Universal Computer Science 8, 1016-1038.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, groupby, islice

import numpy as np
import numpy.typing as npt
import tree_sitter
import tree_sitter_python

from grader.recording.submission import FileFact, SubmissionRecord

#: Nodes of a fingerprint. On 66 disguised copies and the 125 fixtures, 8 lists more pairs that have next to no line in
#: common, and 15 finds less of what was disguised.
LENGTH = 12
#: A pair is shown with so many nodes in common, some 35 lines, if they are this share of what is one's own. The least
#: that a disguise of `tests/cohort/disguises.py` leaves is 0.7; of the fixtures' pairs, see docs/similarity.md.
LEAST_NODES, LEAST_SHARE = 100, 0.4
#: Code that more have than these, or than this share of the class, is what one writes in such a lab.
MOST_HOLDERS, MOST_HOLDERS_SHARE = 10, 0.1
#: Smaller files are alike by chance.
LEAST_BYTES = 200
#: Beyond what anybody writes for a lab: nodes of a submission, places of a fingerprint in it, pairs looked at.
MOST_NODES, MOST_PLACES, MOST_PAIRS = 100_000, 20, 500
#: What is shown of a pair: places, lines of each, characters of a line.
MOST_SPANS, MOST_LINES, MOST_CHARACTERS = 60, 200, 160
#: Lines between two runs over which they are shown as one.
_GAP = 2

_Numbers = npt.NDArray[np.uint64]

#: What says nothing of a program's structure; the first are left out with all that is in them.
_LEFT_OUT = {
    "comment",
    "type",
    "import_statement",
    "import_from_statement",
    "future_import_statement",
}
_PASSED_OVER = {
    *(
        "identifier",
        "module",
        "block",
        "expression_statement",
        "parenthesized_expression",
        "decorator",
    ),
    *(
        "argument_list",
        "parameters",
        "typed_parameter",
        "typed_default_parameter",
        "float",
        "integer",
    ),
    *(":", ",", ".", "(", ")", "[", "]", "{", "}", "@", "ERROR"),
}


@dataclass(frozen=True)
class Program:
    """The Python files of a submission, as the kinds of their syntax nodes one after the other."""

    name: str
    sha256: str
    texts: dict[str, str]
    files: tuple[FileFact, ...]
    #: Of each node its kind, the place of its file in `paths`, and its line from 1.
    kinds: tuple[int, ...]
    places: tuple[int, ...]
    lines: tuple[int, ...]
    paths: tuple[str, ...]
    #: Whether it has more nodes than are compared.
    cut: bool = False


@dataclass(frozen=True)
class Span:
    """Lines of a file, from 1, the last one included."""

    path: str
    first: int
    last: int
    #: Their texts, cut where they are more or longer than anybody reads.
    texts: tuple[str, ...]


@dataclass(frozen=True)
class Pair:
    """Two submissions that share code."""

    names: tuple[str, str]
    #: Nodes that they share, and the shares of what is each one's own, from 0 to 1.
    nodes: int
    shares: tuple[float, float]
    #: Lines on which these stand, in each.
    lines: tuple[int, int]
    spans: tuple[tuple[Span, Span], ...]


@dataclass(frozen=True)
class Copies:
    """A file that several handed in byte for byte; each with the path that it has there."""

    size_bytes: int
    found: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Similarity:
    """What a class has in common."""

    #: Hash of each submission that was compared.
    compared: dict[str, str]
    #: Why some were not, or not all of them.
    problems: dict[str, str]
    #: The folders whose code does not count.
    common: tuple[str, ...]
    pairs: tuple[Pair, ...]
    copies: tuple[Copies, ...]

    @property
    def clusters(self) -> tuple[tuple[str, ...], ...]:
        """Groups of three or more that pairs connect, the largest first."""
        group = {name: {name} for pair in self.pairs for name in pair.names}
        for one, other in (pair.names for pair in self.pairs):
            if group[one] is not group[other]:
                group[one] |= group[other]
                group.update(dict.fromkeys(group[other], group[one]))
        found = {tuple(sorted(names)) for names in group.values() if len(names) > 2}
        return tuple(sorted(found, key=lambda names: (-len(names), names)))


# -- a submission ------------------------------------------------------------------------------


@cache
def _parser() -> tree_sitter.Parser:
    return tree_sitter.Parser(tree_sitter.Language(tree_sitter_python.language()))


def nodes_of(text: str, most: int = MOST_NODES) -> list[tuple[int, int]]:
    """Return kind and line of the nodes of a Python text that tell its structure, so many at most."""
    found: list[tuple[int, int]] = []
    waiting = [_parser().parse(text.encode("utf-8", "replace")).root_node]
    while waiting and len(found) < most:
        node = waiting.pop()
        if node.type in _LEFT_OUT or _is_docstring(node):
            continue
        if node.type not in _PASSED_OVER:
            found.append((node.kind_id, node.start_point[0] + 1))
        if node.type != "string":
            waiting += reversed(node.children)
    return found


def _is_docstring(node: tree_sitter.Node) -> bool:
    return node.type == "expression_statement" and [child.type for child in node.children] == [
        "string"
    ]


def program_of(record: SubmissionRecord) -> Program:
    """Return what is compared of a submission; the largest files are left out where there is too much of it."""
    texts = {path: text for path, text in record.texts.items() if path.endswith(".py")}
    nodes: list[tuple[int, int, int]] = []
    paths = sorted(texts, key=lambda path: (len(texts[path]), path))
    for place, path in enumerate(paths):
        nodes += (
            (kind, place, line) for kind, line in nodes_of(texts[path], MOST_NODES + 1 - len(nodes))
        )
    kinds, places, lines = zip(*nodes[:MOST_NODES], strict=True) if nodes else ((), (), ())
    cut = len(nodes) > MOST_NODES
    return Program(
        record.name,
        record.sha256,
        texts,
        tuple(record.files),
        kinds,
        places,
        lines,
        tuple(paths),
        cut,
    )


# -- a class -----------------------------------------------------------------------------------


class _Prints:
    """The fingerprints of a program: of each node, that which begins with it."""

    def __init__(self, program: Program) -> None:
        self.program = program
        number = max(0, len(program.kinds) - LENGTH + 1)
        kinds, places = np.array(program.kinds, dtype=np.uint64), np.array(program.places)
        self.all: _Numbers = np.zeros(number, dtype=np.uint64)
        for n in range(LENGTH):
            self.all = (
                self.all * np.uint64(0x9E3779B97F4A7C15) + kinds[n : n + number] + np.uint64(1)
            )
        #: Those that lie within a file and are the submission's own.
        self.own = places[:number] == places[LENGTH - 1 :] if number else np.zeros(0, dtype=bool)

    def leave_out(self, prints: _Numbers) -> None:
        self.own &= ~np.isin(self.all, prints)

    @property
    def unique(self) -> _Numbers:
        return np.unique(self.all[self.own])

    @property
    def own_nodes(self) -> int:
        covered = np.zeros(len(self.program.kinds), dtype=bool)
        for start in np.flatnonzero(self.own):
            covered[start : start + LENGTH] = True
        return int(covered.sum())


def pairs_of(programs: Sequence[Program], common: Sequence[Program] = ()) -> list[Pair]:
    """Return the pairs that share enough code beside what is common ground, that with the largest share first."""
    prints = [_Prints(program) for program in programs]
    given = np.concatenate(
        [np.zeros(0, dtype=np.uint64), *(_Prints(program).all for program in common)]
    )
    for each in prints:
        each.leave_out(given)
    found, held = np.unique(
        np.concatenate([given[:0], *(each.unique for each in prints)]), return_counts=True
    )
    usual = found[held > max(MOST_HOLDERS, MOST_HOLDERS_SHARE * len(programs))]
    for each in prints:
        each.leave_out(usual)
    own = [each.own_nodes for each in prints]
    pairs = [_pair(prints[a], prints[b], own[a], own[b]) for a, b in _candidates(prints)]
    shown = (
        pair for pair in pairs if pair.nodes >= LEAST_NODES and max(pair.shares) >= LEAST_SHARE
    )
    return sorted(shown, key=lambda pair: (-max(pair.shares), -pair.nodes, pair.names))


def _candidates(prints: Sequence[_Prints]) -> list[tuple[int, int]]:
    """Return which have enough fingerprints in common to be looked at, those with most first."""
    holders = ((value, n) for n, each in enumerate(prints) for value in each.unique.tolist())
    counts: Counter[tuple[int, int]] = Counter()
    for _, group in groupby(sorted(holders), key=lambda pair: pair[0]):
        counts.update(combinations([n for _, n in group], 2))
    return [
        pair for pair, number in counts.most_common(MOST_PAIRS) if number * LENGTH >= LEAST_NODES
    ]


def _pair(a: _Prints, b: _Prints, own_a: int, own_b: int) -> Pair:
    runs = _runs(a, b)
    shared = sum(length for _, _, length in runs)
    shares = (shared / own_a if own_a else 0.0, shared / own_b if own_b else 0.0)
    lines = (
        _lines(a.program, [run[0::2] for run in runs]),
        _lines(b.program, [run[1:] for run in runs]),
    )
    spans = tuple(islice(_spans(a.program, b.program, runs), MOST_SPANS))
    return Pair((a.program.name, b.program.name), shared, shares, lines, spans)


def _lines(program: Program, runs: Iterable[tuple[int, ...]]) -> int:
    """Return on how many lines the nodes of runs stand, each given by its begin and length."""
    nodes = (n for start, length in runs for n in range(start, start + length))
    return len({(program.places[n], program.lines[n]) for n in nodes})


def _runs(a: _Prints, b: _Prints) -> list[tuple[int, int, int]]:
    """Return where runs of equal nodes begin in both, and how long they are; no node is in two of them."""
    mine, theirs = (np.where(each.own, each.all, np.uint64(0)).tolist() for each in (a, b))
    places: defaultdict[int, list[int]] = defaultdict(list)
    for place, value in enumerate(theirs):
        places[value].append(place)
    used = bytearray(len(theirs) + LENGTH)
    runs, start = [], 0
    while start < len(mine):
        near = places.get(mine[start], ())[:MOST_PLACES] if mine[start] else ()
        length, place = max(
            ((_run(mine, theirs, used, start, at), -at) for at in near), default=(0, 0)
        )
        if length:
            length += LENGTH - 1
            runs.append((start, -place, length))
            used[-place : -place + length] = b"\1" * length
        start += max(1, length)
    return runs


def _run(mine: Sequence[int], theirs: Sequence[int], used: bytearray, start: int, at: int) -> int:
    """Return how many fingerprints from two places on are equal, and none's nodes in use."""
    length = 0
    while (
        start + length < len(mine)
        and at + length < len(theirs)
        and mine[start + length] == theirs[at + length] != 0
        and not any(used[at + length : at + length + LENGTH])
    ):
        length += 1
    return length


def _spans(
    a: Program, b: Program, runs: Sequence[tuple[int, int, int]]
) -> Iterable[tuple[Span, Span]]:
    """Return the lines of runs in both, near ones as one."""
    shown: list[list[tuple[int, int, int]]] = []
    for start, at, length in sorted(runs):
        both = [
            (program.places[n], program.lines[n], max(program.lines[n : n + length]))
            for program, n in ((a, start), (b, at))
        ]
        last = shown[-1] if shown else None
        if last and all(
            new[0] == old[0] and 0 <= new[1] - old[2] <= _GAP
            for old, new in zip(last, both, strict=True)
        ):
            shown[-1] = [(old[0], old[1], new[2]) for old, new in zip(last, both, strict=True)]
        else:
            shown.append(both)
    return ((_span(a, *one), _span(b, *other)) for one, other in shown)


def _span(program: Program, place: int, first: int, last: int) -> Span:
    path = program.paths[place]
    lines = program.texts[path].split("\n")[first - 1 : last][:MOST_LINES]
    return Span(path, first, last, tuple(line[:MOST_CHARACTERS] for line in lines))


def copies_of(programs: Sequence[Program], common: Sequence[Program] = ()) -> list[Copies]:
    """Return the files that several handed in byte for byte, and that are neither common ground nor usual."""
    given = {file.sha256 for program in common for file in program.files}
    found: defaultdict[str, dict[str, FileFact]] = defaultdict(dict)
    for program in programs:
        for file in program.files:
            if file.size_bytes >= LEAST_BYTES and file.sha256 not in given:
                found[file.sha256].setdefault(program.name, file)
    most = max(MOST_HOLDERS, MOST_HOLDERS_SHARE * len(programs))
    copies = [
        Copies(
            next(iter(by.values())).size_bytes,
            tuple((name, file.path) for name, file in sorted(by.items())),
        )
        for by in found.values()
        if 1 < len(by) <= most
    ]
    return sorted(copies, key=lambda each: (-each.size_bytes, each.found))

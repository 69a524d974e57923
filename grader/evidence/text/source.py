"""Explanations in a student's source: files, classes and functions, and the notes that explain them.

Text is parsed, never imported or run. Lines that Python refuses are left out, because a typing error must not cost
points a second time as missing documentation.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import PurePosixPath

from grader.evidence.text.comments import CodeFinder, is_for_programs, is_licence
from grader.evidence.text.syntax import blank_out, normalise, spans, tree_of
from grader.evidence.text.words import fold, is_placeholder, measure, words
from grader.submission.python_source import parse_python

_DEFINITION_LINE = re.compile(r" *(?:async +)?(?:def|class) +[^\W\d]\w*")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
#: Lines of a file that are left out because they are not Python.
_MOST_REPAIRS = 20
#: Characters that are parsed to find these lines.
_MOST_PARSED = 400_000
_EMPTY_BLOCK = re.compile(r"expected an indented block after .* on line (\d+)")
#: First lines of a file that can hold a licence.
_LAST_LICENCE_LINE = 10
#: Characters of a note that are read for its words.
_NOTE_START = 2000
#: Characters of a line of code beside a note that are read.
_CODE_START = 1000
_COMMENTED_OUT = "commented-out code"
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
_Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


@dataclass(frozen=True)
class Rules:
    """Requirements of a rubric for an explanation."""

    #: Distinct words from which a text explains.
    min_words: int = 2
    #: Lines of a body from which a function needs an explanation.
    function_lines: int = 5
    #: Regular expressions of placeholders.
    placeholders: tuple[str, ...] = ()
    #: Words that add nothing to a name.
    fillers: tuple[str, ...] = ()
    #: Distinct words from which comments explain a whole file.
    file_words: int = 0


@dataclass
class Note:
    """A docstring, another string that stands alone, or comments on consecutive lines."""

    #: "docstring" or "comment".
    kind: str
    text: str
    #: First line.
    line: int
    #: Last line.
    last: int
    #: True if code comes before the note on its line.
    inline: bool = False
    #: The reason why the note explains nothing, such as "commented-out code"; empty if it explains.
    fault: str = ""
    #: The line of code next to the note, or the file's name.
    beside: str = ""
    #: True for a docstring in front of its class or function, as in C++.
    in_front: bool = False


@dataclass
class Unit:
    """A file, class or function, with the notes about it."""

    #: Name of the file, class or function.
    name: str
    line: int
    notes: list[Note] = field(default_factory=list)
    #: True if an explanation is required.
    needed: bool = True
    #: Distinct words from which comments explain it; a docstring does with fewer.
    comment_words: int = 0

    @property
    def explained_by(self) -> Note | None:
        """The first note that explains the unit, if there is one."""
        first = None
        said: list[str] = []
        for note in self.notes:
            if note.fault:
                continue
            if note.kind == "docstring":
                return note
            first = first or note
            said += words(note.text[:_NOTE_START])
        if measure(said) < self.comment_words:
            return None
        return first


@dataclass(frozen=True)
class SourceFacts:
    """Units and notes of one file."""

    path: str
    #: The file first, then its classes and functions.
    units: tuple[Unit, ...]
    #: In the order of their lines.
    notes: tuple[Note, ...]
    #: True if the definitions are known: the parser accepts the file, possibly without a few lines.
    readable: bool = True


def read_python(path: str, text: str, rules: Rules, said: set[str]) -> SourceFacts:
    """Read a Python file. A text in `said` explains nothing again. Never raises.

    A note explains the innermost unit around it or directly below it. Some units share the notes of the unit around
    them: a constructor, a short or nested function, the only class of a file, and the only function of a file without
    classes. `main` needs no explanation if there is another unit.
    """
    whole = normalise(text)
    blank = blank_out(whole)
    tree = tree_of(whole) or _repaired(whole, blank)
    code = [*blank.split("\n"), ""]
    file = file_unit(path, blank, rules)
    scopes: list[Scope] = []
    if tree is not None:
        scopes += _scopes(tree, file, rules)
    notes = [*_comments(whole, code), *_strings(tree)]
    return Reader(path, file, code, scopes, rules).read(notes, tree is not None, said)


def file_unit(path: str, blank: str, rules: Rules) -> Unit:
    """Return the unit of a whole file; a file without code needs no explanation."""
    is_empty = not blank.strip("_ \n")
    return Unit(PurePosixPath(path).name, 1, needed=not is_empty, comment_words=rules.file_words)


@dataclass(frozen=True)
class Scope:
    """The lines of a class or function."""

    #: First line, with the decorators.
    first: int
    last: int
    #: Line of the name.
    head: int
    unit: Unit
    is_class: bool


class Reader:
    """Gives the notes of one file to its units."""

    def __init__(
        self, path: str, file: Unit, code: list[str], scopes: list[Scope], rules: Rules
    ) -> None:
        self._path = path
        self._rules = rules
        self._code = code
        self._below = _next_lines_of_code(code)
        self._file = file
        self._scopes = scopes
        #: The innermost scope of each line, from 1.
        self._owners: list[Scope | None] = [None] * (len(code) + 1)
        self._begins: dict[int, Scope] = {}
        for scope in scopes:
            size = scope.last + 1 - scope.first
            self._owners[scope.first : scope.last + 1] = [scope] * size
            self._begins[scope.first] = scope

    def read(self, notes: list[Note], readable: bool, said: set[str]) -> SourceFacts:
        """Return the facts of the file, and add the texts of its notes to those already said."""
        notes.sort(key=lambda note: note.line)
        for note in notes:
            owner = self._owner(note)
            note.beside = self._beside(note, owner)
            if not note.fault:
                note.fault = _fault(note.text, note.beside, self._rules, said)
            unit = owner.unit if owner is not None else self._file
            unit.notes.append(note)
        units = _units(self._file, self._scopes)
        return SourceFacts(self._path, units, tuple(notes), readable)

    def _owner(self, note: Note) -> Scope | None:
        """Return the scope that begins below a comment, or else the innermost scope around a note."""
        if _is_above_code(note):
            owner = self._begins.get(self._below[note.last])
            if owner is not None:
                return owner
        return self._owners[note.line]

    def _beside(self, note: Note, owner: Scope | None) -> str:
        """Return the line of code that a note is about, or the file's name."""
        if note.kind == "docstring":
            if owner is None:
                return PurePosixPath(self._path).stem
            return self._code[owner.head - 1]
        line = self._below[note.last] if _is_above_code(note) else note.line
        return self._code[line - 1]


def _is_above_code(note: Note) -> bool:
    if note.inline:
        return False
    return note.kind == "comment" or note.in_front


def _scopes(tree: ast.Module, file: Unit, rules: Rules) -> Iterator[Scope]:
    """Yield classes and functions, the outer ones first; without recursion, because trees can be deep."""
    alone = _only_unit(tree)
    stack: list[tuple[ast.AST, Unit, bool]] = [(tree, file, False)]
    while stack:
        node, unit, within = stack.pop()
        if isinstance(node, _Definition):
            is_function = isinstance(node, _FUNCTIONS)
            is_class_of_file = unit is file and not is_function
            shares_notes = within or node is alone
            if is_function and _speaks_for_itself(node, rules):
                shares_notes = True
            if not shares_notes:
                unit = Unit(node.name, node.lineno, needed=node.name != "main")
            within = within or is_function
            yield Scope(
                _first_line(node),
                node.end_lineno or node.lineno,
                node.lineno,
                unit,
                is_class_of_file,
            )
        inner = []
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, ast.expr):
                inner.append((child, unit, within))
        stack += reversed(inner)


@lru_cache(maxsize=8)
def _only_unit(tree: ast.Module) -> ast.AST | None:
    """Return the only class of a file, or the only function of a file without classes, `main` left out."""
    found: list[ast.AST] = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    if not found:
        for node in tree.body:
            if isinstance(node, _FUNCTIONS) and node.name != "main":
                found.append(node)
    return found[0] if len(found) == 1 else None


def _first_line(node: _Definition) -> int:
    """Return the first line of a definition, with its decorators."""
    first = node.lineno
    for decorator in node.decorator_list:
        first = min(first, decorator.lineno)
    return first


def _speaks_for_itself(node: _Definition, rules: Rules) -> bool:
    if node.name.startswith("__") and node.name.endswith("__"):
        return True
    body = node.body
    if ast.get_docstring(node) is not None:
        body = body[1:]
    lines = 0
    if body:
        lines = (body[-1].end_lineno or 0) - body[0].lineno + 1
    return lines < rules.function_lines and node.name != "main"


def _units(file: Unit, scopes: Sequence[Scope]) -> tuple[Unit, ...]:
    """Return all units. Classes explain their file too, and so does `main` if it is the only unit."""
    by_id: dict[int, Unit] = {}
    for scope in scopes:
        if scope.unit is not file:
            by_id[id(scope.unit)] = scope.unit
    others = by_id.values()
    if not any(unit.needed for unit in others):
        for unit in others:
            file.notes += unit.notes
    for scope in scopes:
        if scope.is_class and scope.unit is not file:
            file.notes += scope.unit.notes
    return file, *others


def _next_lines_of_code(code: list[str]) -> list[int]:
    """Return for each line, counted from 1, the next line with code; the last line if there is none."""
    found = [len(code)] * (len(code) + 1)
    for number in range(len(code) - 1, 0, -1):
        found[number] = found[number + 1]
        if code[number].strip():
            found[number] = number + 1
    return found


def _strings(tree: ast.Module | None) -> Iterator[Note]:
    """Yield the strings that stand alone: docstrings, and strings that are used as comments."""
    if tree is None:
        return
    finder = CodeFinder()
    for node in ast.walk(tree):
        match node:
            case ast.Expr(ast.Constant(str(text))):
                lines = [line.strip() for line in text.strip().split("\n")]
                is_code = len(finder.lines_of_code(lines)) == len(lines)
                fault = _COMMENTED_OUT if is_code else ""
                last = node.end_lineno or node.lineno
                yield Note("docstring", text, node.lineno, last, fault=fault)


def _comments(text: str, code: list[str]) -> Iterator[Note]:
    """Yield the comments of a normalised text.

    Consecutive lines at one column are one comment, except for commented-out code among them.
    """
    finder = CodeFinder()
    for block in _blocks(text, code):
        bodies = [comment.body for comment in block]
        first = block[0].line
        if first <= _LAST_LICENCE_LINE and is_licence(bodies):
            last = first + len(block) - 1
            yield Note("comment", "\n".join(bodies), first, last, fault="a licence")
            continue
        switched_off = finder.lines_of_code([body.lstrip("#!:").strip() for body in bodies])
        for start, end in _runs(len(bodies), switched_off):
            said = []
            for body in bodies[start:end]:
                if not is_for_programs(body):
                    said.append(body.strip())
            joined = "\n".join(said)
            if any(map(str.isalnum, joined)):
                line = first + start
                inline = bool(code[line - 1].strip())
                fault = _COMMENTED_OUT if start in switched_off else ""
                yield Note("comment", joined, line, first + end - 1, inline, fault)


def _runs(count: int, marked: set[int]) -> Iterator[tuple[int, int]]:
    """Yield start and end of each run of numbers below a count that are all marked, or all unmarked."""
    start = 0
    for number in range(1, count + 1):
        if number == count or (number in marked) != (start in marked):
            yield start, number
            start = number


@dataclass(frozen=True)
class _Comment:
    """A comment on one line."""

    line: int
    column: int
    body: str


def _blocks(text: str, code: list[str]) -> Iterator[list[_Comment]]:
    """Yield blocks of comments on consecutive lines at one column; a comment after code is a block of its own."""
    block: list[_Comment] = []
    line = 1
    position = 0
    for span in spans(text):
        start = span.start()
        line += text.count("\n", position, start)
        position = start
        body = span["comment"]
        if body is None:
            continue
        column = position - text.rfind("\n", 0, position) - 1
        comment = _Comment(line, column, body[1:])
        if block and not _continues(block[-1], comment, code):
            yield block
            block = []
        block.append(comment)
    if block:
        yield block


def _continues(previous: _Comment, comment: _Comment, code: list[str]) -> bool:
    """Return whether a comment belongs to the block of the previous one."""
    if (comment.line, comment.column) != (previous.line + 1, previous.column):
        return False
    is_behind_code = code[comment.line - 1].strip() or code[previous.line - 1].strip()
    return not is_behind_code


def _fault(text: str, beside: str, rules: Rules, said: set[str]) -> str:
    """Return why a text beside some code explains nothing; if it explains, return nothing and add it to `said`."""
    found = words(text[:_NOTE_START])
    if is_placeholder(text, rules.placeholders):
        return "a placeholder"
    if measure(found) < rules.min_words:
        return f"fewer than {rules.min_words} words, without numbers"
    code = beside[:_CODE_START]
    known = set(words(code))
    known.update(words(_HUMP.sub(" ", code)))
    known.update(map(fold, rules.fillers))
    if known.issuperset(word for word in found if not word[0].isdigit()):
        return "repeats the code"
    form = " ".join(found)
    if form in said:
        return "said before"
    said.add(form)
    return ""


def _repaired(text: str, blank: str) -> ast.Module | None:
    """Return the tree of a text without the lines that Python refuses; None if there are too many of them."""
    lines = text.replace("\0", " ").expandtabs(4).split("\n")
    bare = blank.split("\n")
    replaced: set[int] = set()
    affordable = 1 + _MOST_PARSED // (len(text) + 1)
    for _ in range(min(_MOST_REPAIRS, affordable)):
        try:
            return parse_python("\n".join(lines))
        except SyntaxError as problem:
            empty = _EMPTY_BLOCK.search(problem.msg)
            number = int(empty[1]) if empty else problem.lineno or 0
        except (ValueError, RecursionError, MemoryError):
            return None
        at = number - 1
        if not 0 <= at < len(lines):
            return None
        if empty:
            lines[at] = f"{bare[at]} pass"
        elif at in replaced:
            lines[at] = ""
        else:
            lines[at] = _replacement(lines, at)
        replaced.add(at)
    return None


def _replacement(lines: Sequence[str], at: int) -> str:
    """Return correct Python for a line that Python refuses, with the same indentation."""
    head = _DEFINITION_LINE.match(lines[at])
    if head is not None:
        return f"{head[0]}():"
    indent = _indent(lines[at])
    statement = "pass"
    for below in lines[at + 1 :]:
        if below.strip():
            if _indent(below) > indent:
                statement = "if 1:"
            break
    return " " * indent + statement


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))

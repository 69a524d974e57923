"""What a student's Python source says of itself: which of its files, classes and functions are explained, and by what.

Text is parsed, never imported or run. A text that Python refuses is read without the lines that it refuses, so that a
typing error is not charged a second time as missing documentation.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from operator import itemgetter
from pathlib import PurePosixPath

from grader.evidence.text.comments import CodeFinder, is_for_programs, is_licence
from grader.evidence.text.syntax import blank_out, normalise, spans, tree_of
from grader.evidence.text.words import fold, is_placeholder, measure, words
from grader.submission.python_source import parse_python

_DEFINITION_LINE = re.compile(r" *(?:async +)?(?:def|class) +[^\W\d]\w*")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
#: Lines of a file that are left out for being no Python, and characters that are parsed to find them.
_MOST_REPAIRS, _MOST_PARSED = 20, 400_000
_EMPTY_BLOCK = re.compile(r"expected an indented block after .* on line (\d+)")
#: A licence stands in the first lines of a file.
_LAST_LICENCE_LINE = 10


@dataclass(frozen=True)
class Rules:
    """What a rubric asks of an explanation."""

    #: Distinct words from which a text explains.
    min_words: int = 2
    #: A function whose body has fewer lines speaks for itself.
    function_lines: int = 5
    #: Regular expressions of texts that hold the place of one to come.
    placeholders: tuple[str, ...] = ()
    #: Words that add nothing to a name.
    fillers: tuple[str, ...] = ()


@dataclass
class Note:
    """A docstring, another string that stands alone, or comments on consecutive lines."""

    #: "docstring" or "comment".
    kind: str
    text: str
    #: Its first and last line.
    line: int
    last: int
    #: Whether code stands before it on its line.
    inline: bool = False
    #: Why it explains nothing, e.g. "commented-out code"; empty if it explains.
    fault: str = ""
    #: The line of code that it is about, or the file's name.
    beside: str = ""


@dataclass
class Unit:
    """A file, class or function, with what is said about it."""

    #: Its name; a file's is that of the file.
    name: str
    line: int
    notes: list[Note] = field(default_factory=list)
    #: Whether it should be explained.
    needed: bool = True

    @property
    def explained_by(self) -> Note | None:
        """The first of its notes that explains, if any does."""
        return next((note for note in self.notes if not note.fault), None)


@dataclass(frozen=True)
class SourceFacts:
    """What the text of one Python file says of itself."""

    path: str
    #: The file first, then its classes and functions.
    units: tuple[Unit, ...]
    #: In the order of their lines.
    notes: tuple[Note, ...]
    #: Whether the definitions are known: Python takes the file, or all of it but for a few lines.
    readable: bool = True


def read_sources(texts: Mapping[str, str], rules: Rules | None = None) -> list[SourceFacts]:
    """Read Python files, given by their paths. What is said twice in the same words explains once. Never raises.

    A note explains the innermost unit that it stands in or directly above. A constructor, a short or nested function
    and a file's only class are one with what they stand in, and so is the only function of a file without classes.
    `main` needs no explanation where there is anything else.
    """
    said: set[str] = set()
    return [_read(path, text, rules or Rules(), said) for path, text in texts.items()]


def _read(path: str, text: str, rules: Rules, said: set[str]) -> SourceFacts:
    whole = normalise(text)
    blank = blank_out(whole)
    tree = tree_of(whole) or _repaired(whole, blank)
    code = [*blank.split("\n"), ""]
    file = Unit(PurePosixPath(path).name, 1, needed=bool(blank.strip("_ \n")))
    scopes = list(_scopes(tree, file, rules)) if tree is not None else []
    owners: list[_Scope | None] = [None] * (len(code) + 1)
    for scope in scopes:
        owners[scope.first : scope.last + 1] = [scope] * (scope.last + 1 - scope.first)
    below = _next_lines_of_code(code)
    begins = {scope.first: scope for scope in scopes}
    notes = sorted([*_comments(whole, code), *_strings(tree)], key=lambda note: note.line)
    for note in notes:
        is_above = note.kind == "comment" and not note.inline
        owner = begins.get(below[note.last]) if is_above else None
        owner = owner or owners[note.line]
        if note.kind == "docstring":
            note.beside = code[owner.head - 1] if owner is not None else PurePosixPath(path).stem
        else:
            note.beside = code[(below[note.last] if is_above else note.line) - 1]
        note.fault = note.fault or _fault(note.text, note.beside, rules, said)
        (owner.unit if owner is not None else file).notes.append(note)
    return SourceFacts(path, _units(file, scopes), tuple(notes), tree is not None)


@dataclass(frozen=True)
class _Scope:
    """The lines of a class or function, the first with its decorators, and the line of its name."""

    first: int
    last: int
    head: int
    unit: Unit
    is_class: bool


def _scopes(tree: ast.Module, file: Unit, rules: Rules) -> Iterator[_Scope]:
    """Yield classes and functions, the outer ones first; without recursion, as trees may be deep."""
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    functions = [node for node in tree.body if isinstance(node, _FUNCTIONS) and node.name != "main"]
    alone = (
        classes if len(classes) == 1 else functions if not classes and len(functions) == 1 else []
    )
    stack: list[tuple[ast.AST, Unit, bool]] = [(tree, file, False)]
    while stack:
        node, unit, within = stack.pop()
        if isinstance(node, (*_FUNCTIONS, ast.ClassDef)):
            is_function = not isinstance(node, ast.ClassDef)
            is_one_with = (
                node in alone or within or (is_function and _speaks_for_itself(node, rules))
            )
            owner, unit = (
                unit,
                unit if is_one_with else Unit(node.name, node.lineno, needed=node.name != "main"),
            )
            within = within or is_function
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            yield _Scope(
                first,
                node.end_lineno or node.lineno,
                node.lineno,
                unit,
                owner is file and not is_function,
            )
        inner = [child for child in ast.iter_child_nodes(node) if not isinstance(child, ast.expr)]
        stack += [(child, unit, within) for child in reversed(inner)]


_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def _speaks_for_itself(
    node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef, rules: Rules
) -> bool:
    body = node.body[1:] if ast.get_docstring(node) is not None else node.body
    lines = (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
    is_special = node.name.startswith("__") and node.name.endswith("__")
    return is_special or (lines < rules.function_lines and node.name != "main")


def _units(file: Unit, scopes: Sequence[_Scope]) -> tuple[Unit, ...]:
    """Return all units; a file is explained by its classes too, and by `main` where it has nothing else."""
    others = list(
        {id(scope.unit): scope.unit for scope in scopes if scope.unit is not file}.values()
    )
    if not any(unit.needed for unit in others):
        file.notes += [note for unit in others for note in unit.notes]
    file.notes += [
        note
        for scope in scopes
        if scope.is_class and scope.unit is not file
        for note in scope.unit.notes
    ]
    return file, *others


def _next_lines_of_code(code: list[str]) -> list[int]:
    """Return for each line, counted from 1, the first one behind it that holds code; else the last of all."""
    found = [len(code)] * (len(code) + 1)
    for number in range(len(code) - 1, 0, -1):
        found[number] = number + 1 if code[number].strip() else found[number + 1]
    return found


def _strings(tree: ast.Module | None) -> Iterator[Note]:
    """Yield the strings that stand alone: docstrings, and strings that are used as comments."""
    finder = CodeFinder()
    for node in ast.walk(tree) if tree is not None else ():
        match node:
            case ast.Expr(ast.Constant(str(text))):
                lines = [line.strip() for line in text.strip().split("\n")]
                is_code = len(finder.lines_of_code(lines)) == len(lines)
                fault = "commented-out code" if is_code else ""
                yield Note(
                    "docstring", text, node.lineno, node.end_lineno or node.lineno, fault=fault
                )


def _comments(text: str, code: list[str]) -> Iterator[Note]:
    """Yield the comments of a normalised text; consecutive lines at one column are one, but for code among them."""
    finder = CodeFinder()
    for block in _blocks(text, code):
        bodies = [body for _, _, body in block]
        first = block[0][0]
        if first <= _LAST_LICENCE_LINE and is_licence(bodies):
            yield Note(
                "comment", "\n".join(bodies), first, first + len(block) - 1, fault="a licence"
            )
            continue
        switched_off = finder.lines_of_code([body.lstrip("#!:").strip() for body in bodies])
        marked = [(number in switched_off, number, body) for number, body in enumerate(bodies)]
        for is_code, run in groupby(marked, key=itemgetter(0)):
            _, numbers, lines = zip(*run, strict=True)
            said = "\n".join(line.strip() for line in lines if not is_for_programs(line))
            if any(character.isalnum() for character in said):
                line, last = first + numbers[0], first + numbers[-1]
                inline = bool(code[line - 1].strip())
                yield Note(
                    "comment", said, line, last, inline, "commented-out code" if is_code else ""
                )


def _blocks(text: str, code: list[str]) -> Iterator[list[tuple[int, int, str]]]:
    """Yield line, column and text of comments, block by block; one behind code is a block of its own."""
    block: list[tuple[int, int, str]] = []
    line, position = 1, 0
    for span in spans(text):
        line += text.count("\n", position, position := span.start())
        if (body := span["comment"]) is None:
            continue
        column = position - text.rfind("\n", 0, position) - 1
        follows = bool(block) and (line, column) == (block[-1][0] + 1, block[-1][1])
        if block and not (
            follows and not code[line - 1].strip() and not code[block[-1][0] - 1].strip()
        ):
            yield block
            block = []
        block.append((line, column, body[1:]))
    if block:
        yield block


def _fault(text: str, beside: str, rules: Rules, said: set[str]) -> str:
    """Return why a text beside some code explains nothing, empty if it does. Adds it to what was `said`."""
    found = words(text[:2000])
    if is_placeholder(text, rules.placeholders):
        return "a placeholder"
    if measure(found) < rules.min_words:
        return f"fewer than {rules.min_words} words"
    known = {
        *words(beside[:1000]),
        *words(_HUMP.sub(" ", beside[:1000])),
        *map(fold, rules.fillers),
    }
    if set(found) <= known:
        return "repeats the code"
    form = " ".join(found)
    if form in said:
        return "said before"
    said.add(form)
    return ""


def _repaired(text: str, blank: str) -> ast.Module | None:
    """Tree of a text that Python refuses, without what it refuses; None where that is more than slips of typing."""
    lines, bare = text.replace("\0", " ").expandtabs(4).split("\n"), blank.split("\n")
    replaced: set[int] = set()
    for _ in range(min(_MOST_REPAIRS, 1 + _MOST_PARSED // (len(text) + 1))):
        try:
            return parse_python("\n".join(lines))
        except SyntaxError as problem:
            empty = _EMPTY_BLOCK.search(problem.msg)
            at = int(empty[1]) - 1 if empty else (problem.lineno or 0) - 1
        except (ValueError, RecursionError, MemoryError):
            return None
        if not 0 <= at < len(lines):
            return None
        head = _DEFINITION_LINE.match(lines[at])
        indent = _indent(lines[at])
        if empty:
            lines[at] = f"{bare[at]} pass"
        elif at in replaced:
            lines[at] = ""
        elif head is not None:
            lines[at] = f"{head[0]}():"
        else:
            below = next((line for line in lines[at + 1 :] if line.strip()), "")
            lines[at] = " " * indent + ("if 1:" if _indent(below) > indent else "pass")
        replaced.add(at)
    return None


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))

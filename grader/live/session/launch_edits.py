"""One edit that mends a launch file in Python, e.g. a missing comma.

`edit` returns the mended text with the edit in words. An edited text is only known to be syntactically correct; the next
evaluation shows whether it launches.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from itertools import islice
from typing import NamedTuple

from grader.evidence.newer_python import python_needed
from grader.submission.python_source import parse_python
from launch_plan.plan import Problem

#: Most characters of a file that is edited, and most texts that are tried.
_MOST_CHARACTERS = 100_000
_MOST_TRIED = 400
#: Lines before and behind an error that are searched for a missing bracket.
_REACH = 15
_FUNCTION = "generate_launch_description"
_CLOSING = (")", "]", "}")
#: Gaps inside a line for a missing comma: between `)` and `(`, or between a quote and a name.
_GAP = re.compile(r"(?<=[\w)\]}'\"])\s*(?=[(\[{'\"])|(?<=[\w)\]}'\"])\s+(?=\w)")


class Edit(NamedTuple):
    """A text after an edit, and the edit in words, as done and as to be done."""

    text: str
    done: str
    remedy: str


def edit(text: str, problem: Problem) -> Edit | None:
    """Return a launch file with one edit that mends a problem; None if no edit does."""
    if len(text) > _MOST_CHARACTERS:
        return None
    if python_needed(text):
        return None
    for find in _BY_KIND.get(problem.kind, ()):
        for candidate in islice(find(text, problem), _MOST_TRIED):
            if candidate.text == text:
                continue
            if _is_python(candidate.text):
                return candidate
    return None


def _is_python(text: str) -> bool:
    try:
        parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return False
    return True


def _tree(text: str) -> ast.Module:
    """Return the syntax tree of a text, an empty one if Python refuses the text."""
    try:
        return parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return ast.Module([], [])


class _Lines:
    """The lines of a text, one of them to be changed."""

    def __init__(self, text: str) -> None:
        self.lines = text.split("\n")

    def near(self, line: int | None) -> list[int]:
        """Return the numbers of lines with code, the nearest to an error first."""
        at = 1 if line is None else line
        before = range(at - 1, at - _REACH, -1)
        behind = range(at + 1, at + _REACH)
        known = range(1, len(self.lines) + 1)
        nearest: list[int] = []
        for number in (at, *before, *behind):
            if number in known and self.code(number):
                nearest.append(number)
        return nearest

    def code(self, number: int) -> str:
        """Return a line without its comment and the blanks behind its code; quotes are not looked at."""
        return self.lines[number - 1].partition(" #")[0].rstrip()

    def with_line(self, number: int, line: str) -> str:
        """Return the text with another line."""
        return "\n".join([*self.lines[: number - 1], line, *self.lines[number:]])

    def inserted(self, number: int, at: int, sign: str) -> Edit:
        """Return the text with a sign at a place of a line."""
        line = self.lines[number - 1]
        named = "a comma" if sign == "," else f"'{sign}'"
        text = self.with_line(number, f"{line[:at]}{sign}{line[at:]}")
        return Edit(text, f"{named} was added in line {number}", f"Add {named} in line {number}.")

    def removed(self, number: int, at: int) -> Edit:
        """Return the text without the sign at a place of a line."""
        line = self.lines[number - 1]
        named = "a comma" if line[at] == "," else f"'{line[at]}'"
        text = self.with_line(number, line[:at] + line[at + 1 :])
        done = f"{named} was taken out of line {number}"
        return Edit(text, done, f"Take {named} out of line {number}.")


def _signs(text: str, problem: Problem) -> Iterator[Edit]:
    """Yield the text with a comma, bracket or colon more near the error, or with one less."""
    lines = _Lines(text)
    near = lines.near(problem.line)
    for number in near[:2]:
        code = lines.code(number)
        yield lines.inserted(number, len(code), ",")
        for gap in _GAP.finditer(code):
            yield lines.inserted(number, gap.start(), ",")
        yield lines.inserted(number, len(code), ":")
    for number in near:
        code = lines.code(number)
        for sign in _CLOSING:
            yield lines.inserted(number, len(code.removesuffix(",")), sign)
    for number in near[:2]:
        for at, sign in enumerate(lines.code(number)):
            if sign in (",", *_CLOSING):
                yield lines.removed(number, at)


def _gaps(text: str, problem: Problem) -> Iterator[Edit]:
    """Yield the text with a comma between two brackets that Python reads as a call."""
    lines = _Lines(text)
    if re.search(r"is not callable|indices must be", problem.message) is None:
        return
    for number in lines.near(problem.line)[:2]:
        for gap in re.finditer(r"(?<=[)\]}'\"])\s*(?=[(\[])", lines.code(number)):
            yield lines.inserted(number, gap.start(), ",")
        yield lines.inserted(number, len(lines.code(number)), ",")


def _tuples(text: str, problem: Problem) -> Iterator[Edit]:
    """Yield the text without the comma behind an assigned or returned call."""
    lines = _Lines(text)
    for node in ast.walk(_tree(text)):
        only = _only_item(node)
        if only is None:
            continue
        number = _end_of(only)
        at = lines.lines[number - 1].rfind(",")
        if at >= 0:
            yield lines.removed(number, at)


def _only_item(node: ast.AST) -> ast.Call | None:
    """Return the call that a comma makes a tuple in an assignment or a `return`."""
    if not isinstance(node, (ast.Assign, ast.Return)):
        return None
    if not isinstance(node.value, ast.Tuple):
        return None
    match node.value.elts:
        case [ast.Call() as only]:
            return only
    return None


def _end_of(node: ast.stmt | ast.expr) -> int:
    """Return the number of the line on which a node ends."""
    return node.lineno if node.end_lineno is None else node.end_lineno


def _returns(text: str, problem: Problem) -> Iterator[Edit]:
    """Yield the text with `return` for the description that the function makes."""
    lines = _Lines(text)
    for function in ast.walk(_tree(text)):
        if not isinstance(function, ast.FunctionDef):
            continue
        if function.name != _FUNCTION:
            continue
        last = function.body[-1]
        if isinstance(last, ast.Expr) and _makes_description(last.value):
            line = lines.lines[last.lineno - 1]
            at = last.col_offset
            yield _returning(lines.with_line(last.lineno, f"{line[:at]}return {line[at:]}"), last)
        for statement in function.body:
            if isinstance(statement, ast.Assign) and _makes_description(statement.value):
                target = ast.unparse(statement.targets[0])
                end = _end_of(last)
                line = lines.lines[end - 1]
                following = f"{line}\n{' ' * last.col_offset}return {target}"
                yield _returning(lines.with_line(end, following), last)


def _makes_description(value: ast.expr) -> bool:
    return isinstance(value, ast.Call) and ast.unparse(value.func).endswith("LaunchDescription")


def _returning(text: str, last: ast.stmt) -> Edit:
    done = f"the description was returned at the end of {_FUNCTION}(), line {last.lineno}"
    return Edit(text, done, f"Return the description at the end of {_FUNCTION}().")


def _renamed(text: str, problem: Problem) -> Iterator[Edit]:
    """Yield the text with the function's name in place of the likest one."""
    meant = re.match(r"Rename '(\w{1,100})'", problem.remedy)
    if meant is not None:
        name = meant[1]
        yield Edit(
            re.sub(rf"\b{name}\b", _FUNCTION, text),
            f"'{name}' was read as '{_FUNCTION}'",
            problem.remedy,
        )


def _imported(text: str, problem: Problem) -> Iterator[Edit]:
    """Yield the text with an import of a name from its home."""
    name = re.search(r"(?:has no|name) '(\w{1,100})'", problem.message)
    home = re.search(
        r"Import it(?: from '|: from )((?:launch|launch_ros)[\w.]{0,100})", problem.remedy
    )
    if name is None:
        return
    if home is None:
        return
    line = f"from {home[1]} import {name[1]}"
    lines = _Lines(text)
    done = f"'{line}' was added"
    for node in ast.walk(_tree(text)):
        if not isinstance(node, ast.ImportFrom):
            continue
        kept = [alias for alias in node.names if alias.name != name[1]]
        if problem.kind == "unknown_import" and len(kept) < len(node.names):
            moved = [line]
            if kept:
                moved.insert(0, ast.unparse(ast.ImportFrom(node.module, kept, node.level)))
            before = lines.lines[: node.lineno - 1]
            behind = lines.lines[_end_of(node) :]
            yield Edit("\n".join([*before, *moved, *behind]), done, problem.remedy)
    if problem.kind == "unknown_name":
        at = _end_of_imports(text)
        added = "\n".join([*lines.lines[:at], line, *lines.lines[at:]])
        yield Edit(added, done, problem.remedy)


def _end_of_imports(text: str) -> int:
    """Return the number of the line on which the last import at the top ends; 0 if there is none."""
    ends = [0]
    for node in _tree(text).body:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            ends.append(_end_of(node))
    return max(ends)


_Finder = Callable[[str, Problem], Iterator[Edit]]
#: Finders of edits by the kind of the problem.
_BY_KIND: dict[str, tuple[_Finder, ...]] = {
    "syntax_error": (_signs,),
    "exception": (_gaps,),
    "wrong_return": (_tuples, _returns),
    "not_an_action": (_tuples,),
    "no_generate_function": (_renamed,),
    "unknown_import": (_imported,),
    "unknown_name": (_imported,),
}

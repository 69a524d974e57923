"""Comments of a Python text that are commented-out code, and comments for programs.

A comment counts as prose until shown otherwise, because prose of any language can parse: `x` and `not used` are Python
as well as English.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence

from grader.evidence.text.syntax import expression_tree

#: Fragments of a file that are tried as Python; commented-out lines beyond that count as prose.
PARSE_BUDGET = 2000
#: Lines over which an open bracket of a comment is followed.
SPAN_LINES = 25
#: Characters of a comment that are examined for tools and licences.
_START = 300
#: Characters of a line that are examined for code.
_LINE_START = 400
_LONGEST_FRAGMENT = 4000

_FOR_PROGRAMS = re.compile(
    r"!|\s*-\*-|\s*(?:vim?|emacs|ex)?:.*\b(?:set|coding)\b|\s*coding[:=]|\s*(?:type:|noqa\b|pylint:|flake8:|mypy:|ruff:"
    r"|fmt:|isort:|yapf:|pragma:|nosec\b|pyright:|region\b|endregion\b|%%)"
)
_LICENCE = re.compile(
    r"copyright|\(c\) ?\d{4}|spdx-|licen[cs]ed under|all rights reserved", re.IGNORECASE
)
_CODE_HINT = re.compile(
    r"[=(\[{@]|\bimport\b|:$|^\W*(?:return|raise|del|pass|break|continue|else|try|finally)\b"
)
#: The first bracket after a blank, or at the beginning.
_BRACKET_IN_PROSE = re.compile(r"(?:[^(]*\s)?\(")
#: Heads that complete the second part of a compound statement.
_HEADS = {"else": "if x: pass\n", "except": "try: pass\n", "finally": "try: pass\n"}
#: Statements that prose never looks like.
_SURELY_CODE = (
    ast.FunctionDef,
    ast.AsyncFunctionDef,
    ast.ClassDef,
    ast.ImportFrom,
    ast.Raise,
    ast.AugAssign,
)
#: Statements with a body, which prose looks like by their heads alone.
_WITH_BODY = (ast.If, ast.For, ast.While, ast.With, ast.Try)
#: A call or an assignment in C, C++ and their relatives; a semicolon ends the line.
_OTHER_LANGUAGE = re.compile(r"\w\(|[^=!<>]=[^=]")
_BRACES = frozenset("{}; ")


def is_for_programs(body: str) -> bool:
    """Return whether the text after a `#` is a shebang, an encoding, or an instruction to a tool."""
    return _FOR_PROGRAMS.match(body[:_START]) is not None


def is_licence(bodies: Sequence[str]) -> bool:
    """Return whether lines of comments are the head of a licence."""
    return any(_LICENCE.search(body[:_START]) for body in bodies)


class CodeFinder:
    """Separates code from prose in the comments of one file, within a budget of attempts."""

    def __init__(self) -> None:
        self._left = PARSE_BUDGET

    def lines_of_code(self, lines: Sequence[str]) -> set[int]:
        """Return the indices of the lines that are code: clearly code, or next to code and Python too."""
        depths = [_depth(line[:_LINE_START]) for line in lines]
        parses: list[int] = []
        heads: set[int] = set()
        code: set[int] = set()
        at = 0
        while at < len(lines):
            size, fragment, statement = self._statement(lines, depths, at)
            span = range(at, at + size)
            if statement is not None:
                parses += span
                if isinstance(statement, _WITH_BODY):
                    heads.add(at + size - 1)
                if _is_surely_code(statement, fragment):
                    code.update(span)
            elif _is_other_language(lines[at][:_LINE_START]):
                code.add(at)
            at += size
        for head in heads.intersection(number - 1 for number in parses):
            code.update((head, head + 1))
        for index in (*parses, *reversed(parses)):
            if code & {index - 1, index + 1}:
                code.add(index)
        return code

    def _statement(
        self, lines: Sequence[str], depths: Sequence[int], at: int
    ) -> tuple[int, str, ast.stmt | None]:
        """Return the number of lines of the statement that begins at a line, its text and its tree; one line if none does."""
        if _CODE_HINT.search(lines[at][:_LINE_START]):
            for size in _sizes(depths[at : at + SPAN_LINES]):
                fragment = "\n".join(lines[at : at + size])
                statement = self._last_statement(_completed(fragment))
                if statement is not None:
                    return size, fragment, statement
        return 1, "", None

    def _last_statement(self, text: str) -> ast.stmt | None:
        self._left -= 1
        if self._left < 0 or len(text) > _LONGEST_FRAGMENT:
            return None
        tree = expression_tree(text)
        if tree is None or not tree.body:
            return None
        return tree.body[-1]


def _is_other_language(line: str) -> bool:
    """Return whether a line is a statement or a brace of C, C++ or a relative."""
    if not line.endswith(";"):
        return "}" in line and _BRACES.issuperset(line.replace("else", ""))
    return _OTHER_LANGUAGE.search(line) is not None


def _depth(line: str) -> int:
    """Return the number of brackets that a line opens, less those that it closes."""
    opened = sum(map(line.count, "([{"))
    closed = sum(map(line.count, ")]}"))
    return opened - closed


def _sizes(depths: Sequence[int]) -> Sequence[int]:
    """Return the sizes in which a fragment is tried: up to the line that closes its brackets, then one line."""
    depth = 0
    for size, change in enumerate(depths, 1):
        depth += change
        if depth <= 0:
            return (size, 1) if size > 1 else (1,)
    return (1,)


def _completed(fragment: str) -> str:
    """Return a fragment with a body after a head, a head before a body, and without the comma of a list."""
    fragment = re.sub(r"^elif\b", "if", fragment.rstrip(", "))
    if fragment.startswith("@") and not fragment.endswith(":"):
        return f"{fragment}\ndef f(): pass"
    if not fragment.endswith(":"):
        return fragment
    first = fragment.split(None, 1)[0].rstrip(":")
    completed = f"{_HEADS.get(first, '')}{fragment} pass"
    if first == "try":
        completed += "\nfinally: pass"
    return completed


def _is_surely_code(statement: ast.stmt, fragment: str) -> bool:
    """Return whether a statement can be neither prose nor a formula.

    For example `return value` and `error = command - state` can be both. A definition, an import from a module or a
    raise is code. A call or an attribute is code too, except in a formula as `rms = sqrt(mean(error**2))`, or with
    a bracket after a blank as in prose.
    """
    nodes = list(ast.walk(statement))
    if not all(map(_has_ascii_name, nodes)):
        return False
    if isinstance(statement, _SURELY_CODE) or _sets_constants(statement):
        return True
    if isinstance(statement, ast.Expr):
        value = statement.value
        if isinstance(value, ast.Await | ast.Lambda):
            return True
        if not isinstance(value, ast.Call) or _BRACKET_IN_PROSE.match(fragment):
            return False
    kinds = set(map(type, nodes))
    if ast.Attribute in kinds:
        return True
    return ast.Call in kinds and ast.BinOp not in kinds


def _sets_constants(statement: ast.stmt) -> bool:
    """Return whether a statement assigns values without names, as `last_state = None`; a formula has names."""
    if not isinstance(statement, ast.Assign):
        return False
    return not any(isinstance(node, ast.Name) for node in ast.walk(statement.value))


def _has_ascii_name(node: ast.AST) -> bool:
    name = getattr(node, "attr", "") or getattr(node, "id", "")
    return str(name).isascii()

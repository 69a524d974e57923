"""Which comments of a Python text are code that was switched off, and which are there for programs.

A comment is prose until shown otherwise: prose of any language must not be taken for code because it happens
to parse (`x` and `not used` are Python as well as English).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from itertools import accumulate

from grader.evidence.text.syntax import expression_tree

#: Fragments tried as Python in one file; more commented-out lines than that are prose to us.
PARSE_BUDGET = 2000
#: Lines over which a bracket that is open in a comment is followed.
SPAN_LINES = 25

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
#: The first bracket behind a blank, or at the beginning.
_BRACKET_IN_PROSE = re.compile(r"(?:[^(]*\s)?\(")
_LONGEST_FRAGMENT = 4000


def is_for_programs(body: str) -> bool:
    """Whether what stands behind a `#` is a shebang, an encoding, or a word to a tool."""
    return _FOR_PROGRAMS.match(body[:300]) is not None


def is_licence(bodies: Sequence[str]) -> bool:
    """Whether lines of comments are the head of a licence."""
    return any(_LICENCE.search(body[:300]) for body in bodies)


class CodeFinder:
    """Tells code from prose in the lines of one file's comments, and tries only so many of them."""

    def __init__(self) -> None:
        self._left = PARSE_BUDGET

    def lines_of_code(self, lines: Sequence[str]) -> set[int]:
        """Return which of consecutive lines of comments are code: what surely is, and what parses beside it."""
        depths = [
            sum(map(line[:400].count, "([{")) - sum(map(line[:400].count, ")]}")) for line in lines
        ]
        parses: list[int] = []
        code: set[int] = set()
        at = 0
        while at < len(lines):
            size, statement = 1, None
            if _CODE_HINT.search(lines[at][:400]):
                # Up to the line that closes what the first one opens.
                open_brackets = enumerate(accumulate(depths[at : at + SPAN_LINES]), 1)
                for size in dict.fromkeys(
                    (next((size for size, depth in open_brackets if depth <= 0), 1), 1)
                ):
                    fragment = "\n".join(lines[at : at + size])
                    if (statement := self._last_statement(_completed(fragment))) is not None:
                        break
            if statement is not None:
                parses += range(at, at + size)
                code |= set(range(at, at + size)) if _is_surely_code(statement, fragment) else set()
            at += size
        for index in (*parses, *reversed(parses)):
            if code & {index - 1, index + 1}:
                code.add(index)
        return code

    def _last_statement(self, text: str) -> ast.stmt | None:
        self._left -= 1
        tree = expression_tree(text) if self._left >= 0 and len(text) <= _LONGEST_FRAGMENT else None
        return tree.body[-1] if tree is not None and tree.body else None


def _completed(fragment: str) -> str:
    """The head of a compound statement completed to a whole one, an item of a list taken out of it."""
    fragment = re.sub(r"^elif\b", "if", fragment.rstrip(", "))
    if not fragment.endswith(":"):
        return f"{fragment}\ndef f(): pass" if fragment.startswith("@") else fragment
    before = {"else": "if x: pass\n", "except": "try: pass\n", "finally": "try: pass\n"}
    first = fragment.split(None, 1)[0].rstrip(":")
    return f"{before.get(first, '')}{fragment} pass" + ("\nfinally: pass" if first == "try" else "")


def _is_surely_code(statement: ast.stmt, fragment: str) -> bool:
    """Whether a statement is none that may be prose or a formula, as `return value` or `error = command - state`.

    It is one where it defines, imports from, raises or adds up, and where it calls something or looks into an object,
    but for a call as in `rms = sqrt(mean(error**2))` and a bracket behind a blank as in prose.
    """
    nodes = list(ast.walk(statement))
    names = (getattr(node, "attr", "") or str(getattr(node, "id", "")) for node in nodes)
    if not all(map(str.isascii, names)):
        return False
    match statement:
        case (
            ast.FunctionDef()
            | ast.AsyncFunctionDef()
            | ast.ClassDef()
            | ast.ImportFrom()
            | ast.Raise()
        ):
            return True
        case ast.AugAssign() | ast.Expr(ast.Await()):
            return True
        case ast.Expr(value) if not isinstance(value, ast.Call) or _BRACKET_IN_PROSE.match(
            fragment
        ):
            return False
    kinds = {type(node) for node in nodes}
    return ast.Attribute in kinds or (ast.Call in kinds and ast.BinOp not in kinds)

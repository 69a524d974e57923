"""What each comment of a Python text is worth: an explanation, a heading, code put aside, an echo.

A comment explains until shown otherwise: prose of any language must not be taken for code because it happens
to parse (`x` and `not used` are Python as well as English).
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from grader.evidence.text.lexicon import words_of
from grader.evidence.text.syntax import expression_tree, spans
from grader.evidence.text.words import is_placeholder, measure, normal_form, words

PARSE_BUDGET = 2000
"""Fragments tried as Python in one file; more commented-out lines than that are prose to us."""

SPAN_LINES = 25
"""Lines over which a bracket that is open in a comment is followed."""

_MARKER = re.compile(
    r"!|\s*-\*-|\s*(?:vim?|emacs|ex)?:.*\b(?:set|coding)\b|\s*coding[:=]|\s*(?:type:|noqa\b|pylint:|flake8:|mypy:|ruff:"
    r"|fmt:|isort:|yapf:|pragma:|nosec\b|pyright:|region\b|endregion\b|%%)"
)
_UNDONE = re.compile(r"\s*(?:todo|fixme|xxx|hack|bug)\b[\s:.!()\w]{0,20}$|\s*(?:todo|fixme|xxx)\b\W*$", re.IGNORECASE)
_LICENCE = re.compile(r"copyright|\(c\) ?\d{4}|spdx-|licen[cs]ed under|all rights reserved", re.IGNORECASE)
_RULE = re.compile(r"[-=*#~_+<>/|.\s]{3}")
_BANNER_WORDS = 4
_UNDONE_WORDS = 5
_CODE_HINT = re.compile(r"[=(\[{@]|\bimport\b|:$|^\W*(?:return|raise|del|pass|break|continue|else|try|finally)\b")
_LONGEST_FRAGMENT = 4000
_FORMULA_NAMES, _PACKAGES, _TYPES = map(words_of, ("formula_names", "imported_packages", "annotation_types"))


@dataclass
class Comment:
    """A comment."""

    #: Where it stands; its line counts from 1.
    line: int
    column: int
    #: All behind its `#`.
    body: str
    #: Whether code stands before it on its line.
    inline: bool = False
    #: "explains", "code" (commented-out code), "banner" (rules, headings of a word), "marker" (for tools:
    #: shebang, encoding, noqa; licence; a bare TODO), "repeated" (same text as an earlier comment), "echo"
    #: (says the code on its line again) or "empty".
    kind: str = ""

    @property
    def text(self) -> str:
        """The comment without its outer marks and blanks."""
        return self.body.lstrip("#!:").strip()


def comments_of(text: str, blank: str) -> tuple[Comment, ...]:
    """Comments of normalised `text`, given its code with comments blanked out."""
    lines = blank.split("\n")
    comments: list[Comment] = []
    line, position = 1, 0
    for span in spans(text):
        line += text.count("\n", position, position := span.start())
        if (body := span["comment"]) is not None:
            column = position - text.rfind("\n", 0, position) - 1
            comments.append(Comment(line, column, body[1:], bool(lines[line - 1].strip())))
    budget = _Budget(PARSE_BUDGET)
    for block in _blocks(comments):
        _mark_code(block, budget)
        if block[0].line <= 10 and any(_LICENCE.search(comment.body[:300]) for comment in block):
            for comment in block:
                comment.kind = "marker"
    seen: set[str] = set()
    for comment in comments:
        comment.kind = comment.kind or _kind(comment, lines, seen)
    return tuple(comments)


def _blocks(comments: Sequence[Comment]) -> list[list[Comment]]:
    """Comments on consecutive lines at the same column; a comment behind code is a block of its own."""
    blocks: list[list[Comment]] = []
    for comment in comments:
        last = blocks[-1][-1] if blocks else comment
        follows = (comment.line, comment.column) == (last.line + 1, last.column)
        if follows and not comment.inline and not last.inline:
            blocks[-1].append(comment)
        else:
            blocks.append([comment])
    return blocks


def _kind(comment: Comment, lines: Sequence[str], seen: set[str]) -> str:
    body, text = comment.body, comment.text
    if not any(character.isalnum() for character in text):
        return "banner" if body.strip() and not body.startswith("!") else "empty"
    is_undone = _UNDONE.match(text[:200]) or is_placeholder(text, _UNDONE_WORDS)
    if (comment.line <= 2 and body.startswith("!")) or _MARKER.match(body[:300]) or is_undone:
        return "marker"
    found = words(text[:2000])
    amount = measure(found)
    is_ruled = _RULE.fullmatch(text[:3]) or _RULE.fullmatch(text[-3:])
    if amount < 2 or (amount <= _BANNER_WORDS and is_ruled):
        return "banner"
    form = normal_form(text[:2000])
    if form in seen:
        return "repeated"
    seen.add(form)
    return "echo" if _is_echo(comment, found, lines) else "explains"


def _is_echo(comment: Comment, found: Sequence[str], lines: Sequence[str]) -> bool:
    """Whether it says no word that the code beside it, or exactly the words of the line below it."""
    if comment.inline:
        code = set(_code_words(lines[comment.line - 1]))
        return len(code) > 0 and set(found) <= code
    below = lines[comment.line] if comment.line < len(lines) else ""
    return bool(below.strip()) and len(found) > 1 and list(found) == _code_words(below)


def _code_words(line: str) -> list[str]:
    spread = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", line[:1000])
    return words(spread)


# -- commented-out code ------------------------------------------------------------------------------------


class _Budget:
    """How many fragments may still be parsed."""

    def __init__(self, left: int) -> None:
        self.left = left

    def last_statement(self, text: str) -> ast.stmt | None:
        """Return the last statement of a text that is Python; None also where the budget is spent."""
        self.left -= 1
        tree = expression_tree(text) if self.left >= 0 and len(text) <= _LONGEST_FRAGMENT else None
        return tree.body[-1] if tree is not None and tree.body else None


def _mark_code(block: Sequence[Comment], budget: _Budget) -> None:
    """Mark what is surely code, and what parses and stands beside it."""
    depths = [_depth(comment.text[:400]) for comment in block]
    parses: list[int] = []
    at = 0
    while at < len(block):
        size, statement = 1, None
        if _CODE_HINT.search(block[at].text[:400]):
            for size in dict.fromkeys((_closed_after(depths[at : at + SPAN_LINES]), 1)):
                fragment = "\n".join(comment.text for comment in block[at : at + size])
                if (statement := budget.last_statement(_completed(fragment))) is not None:
                    break
        if statement is not None:
            parses += range(at, at + size)
            for comment in block[at : at + size] if _is_surely_code(statement, fragment) else ():
                comment.kind = "code"
        at += size
    for index in (*parses, *reversed(parses)):
        if any(near.kind == "code" for near in block[max(index - 1, 0) : index + 2]):
            block[index].kind = "code"


def _depth(line: str) -> int:
    return sum(line.count(c) for c in "([{") - sum(line.count(c) for c in ")]}")


def _closed_after(depths: Sequence[int]) -> int:
    """How many lines there are up to the one that closes what the first one opens; one if none does."""
    return next((size for size, depth in enumerate(accumulate(depths), 1) if depth <= 0), 1)


def _completed(fragment: str) -> str:
    """The head of a compound statement completed to a whole one, an item of a list taken out of it."""
    fragment = re.sub(r"^elif\b", "if", fragment.rstrip(", "))
    if not fragment.endswith(":"):
        return f"{fragment}\ndef f(): pass" if fragment.startswith("@") else fragment
    before = {"else": "if x: pass\n", "except": "try: pass\n", "finally": "try: pass\n"}
    first = fragment.split(None, 1)[0].rstrip(":")
    return f"{before.get(first, '')}{fragment} pass" + ("\nfinally: pass" if first == "try" else "")


def _is_surely_code(statement: ast.stmt, fragment: str) -> bool:
    """Whether a statement is none that may be prose or a formula, as `return value` or `error = command - state`."""
    nodes = list(ast.walk(statement))
    if not all(_name(node).isascii() for node in nodes):
        return False
    match statement:
        case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef() | ast.ImportFrom() | ast.Raise():
            return True
        case ast.AugAssign() | ast.Assign(targets=[ast.Attribute() | ast.Subscript(), *_]) | ast.Expr(ast.Await()):
            return True
        case ast.Import(names=names):
            roots = [alias.name.partition(".")[0] for alias in names]
            known = _PACKAGES | sys.stdlib_module_names
            return any(root in known or root.endswith(("_msgs", "_srvs", "_interfaces")) for root in roots)
        case ast.AnnAssign(annotation=annotation, value=value):
            return value is not None and (not isinstance(annotation, ast.Name) or annotation.id in _TYPES)
        case ast.Assign(targets=[ast.Name(name)], value=ast.Constant()) if "_" in name:
            return True
        case ast.Expr(ast.Call()) if not re.search(r"\s\(|^\(", fragment[: fragment.find("(") + 1]):
            return any(map(_is_technical, nodes))
        case ast.Expr():
            return False
        case ast.Try(handlers=[ast.ExceptHandler(type=ast.expr()), *_]):
            return True
        case _:
            return any(map(_is_technical, nodes))


def _name(node: ast.AST) -> str:
    return getattr(node, "attr", "") or str(getattr(node, "id", ""))


def _is_technical(node: ast.AST) -> bool:
    """Whether it is what prose and formulas lack: a call (but of mathematics), `self.`, a list of values."""
    match node:
        case ast.Call(func=function):
            return _name(function) not in _FORMULA_NAMES
        case ast.Attribute(value=ast.Name("self" | "msg")):
            return True
        case ast.List() | ast.Dict():
            return any(isinstance(part, ast.Constant) and part.value is not ... for part in ast.walk(node))
        case _:
            return False

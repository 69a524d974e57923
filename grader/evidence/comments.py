"""What each comment of a Python text is worth: an explanation, a heading, code put aside, an echo.

A comment explains until shown otherwise: prose of any language must not be taken for code because it happens
to parse (`x` and `not used` are Python as well as English).
"""

from __future__ import annotations

import ast
import keyword
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from grader.evidence.lexicon import words_of
from grader.evidence.syntax import Span, expression_tree
from grader.evidence.words import is_placeholder, measure, normal_form, words

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
_RULED = re.compile(r"[-=*#~_+<>/|.\s]{3,}")
_BANNER_WORDS = 4
_UNDONE_WORDS = 5
_CODE_HINT = re.compile(r"[=(\[{@]|\bimport\b|:$|^\W*(?:return|raise|del|pass|break|continue|else|try|finally)\b")
_DECORATOR = re.compile(r"@[A-Za-z_][\w.]{0,80}(?:\(.*\))?$")
_FORMULA_NAMES, _PACKAGES, _TYPES = map(words_of, ("formula_names", "imported_packages", "annotation_types"))


@dataclass(frozen=True)
class Comment:
    """A comment, without its `#` and outer blanks.

    Attributes
    ----------
    kind : str
        "explains", "code" (commented-out code), "banner" (rules, headings of a word), "marker" (for tools:
        shebang, encoding, noqa; licence; a bare TODO), "repeated" (same text as an earlier comment),
        "echo" (says the code on its line again) or "empty".
    inline : bool
        Whether code stands before it on its line.
    """

    line: int
    text: str
    kind: str
    inline: bool = False


@dataclass
class _Raw:
    line: int
    column: int
    body: str
    inline: bool
    kind: str = ""

    @property
    def text(self) -> str:
        return self.body.lstrip("#!:").strip()


class _Budget:
    """How many fragments may still be parsed."""

    def __init__(self, left: int) -> None:
        self.left = left

    def tree(self, text: str) -> ast.Module | None:
        """Tree of `text`, None also when the budget is spent."""
        if self.left <= 0 or len(text) > 4000:
            return None
        self.left -= 1
        return expression_tree(text)


def comments_of(text: str, found: Sequence[Span], blank: str) -> tuple[Comment, ...]:
    """Comments of normalised `text`, given its spans and its code with comments blanked out."""
    lines = blank.split("\n")
    raw = [_raw(text, span, lines) for span in found if span.kind == "comment"]
    budget = _Budget(PARSE_BUDGET)
    for block in _blocks(raw):
        _mark_code(block, budget)
        if block[0].line <= 10 and any(_LICENCE.search(comment.body[:300]) for comment in block):
            for comment in block:
                comment.kind = "marker"
    seen: set[str] = set()
    for comment in raw:
        comment.kind = comment.kind or _kind(comment, lines, seen)
    return tuple(Comment(c.line, c.text, c.kind, c.inline) for c in raw)


def _raw(text: str, span: Span, lines: Sequence[str]) -> _Raw:
    start = text.rfind("\n", 0, span.start) + 1
    inline = bool(lines[span.line - 1].strip())
    return _Raw(span.line, span.start - start, text[span.start + 1 : span.end], inline)


def _blocks(raw: Sequence[_Raw]) -> list[list[_Raw]]:
    """Comments on consecutive lines at the same column; a comment behind code is a block of its own."""
    blocks: list[list[_Raw]] = []
    for comment in raw:
        last = blocks[-1][-1] if blocks else None
        if (
            last is not None
            and not comment.inline
            and not last.inline
            and comment.line == last.line + 1
            and comment.column == last.column
        ):
            blocks[-1].append(comment)
        else:
            blocks.append([comment])
    return blocks


def _kind(comment: _Raw, lines: Sequence[str], seen: set[str]) -> str:
    body, text = comment.body, comment.text
    if not any(character.isalnum() for character in text):
        return "banner" if body.strip() and not body.startswith("!") else "empty"
    if (comment.line <= 2 and body.startswith("!")) or _MARKER.match(body[:300]) or _is_undone(text):
        return "marker"
    found = words(text[:2000])
    amount = measure(found)
    if amount == 0 or amount < 2 or (_is_ruled(text) and amount <= _BANNER_WORDS):
        return "banner"
    form = normal_form(text[:2000])
    if form in seen:
        return "repeated"
    seen.add(form)
    return "echo" if _is_echo(comment, found, lines) else "explains"


def _is_undone(text: str) -> bool:
    return bool(_UNDONE.match(text[:200])) or is_placeholder(text, _UNDONE_WORDS)


def _is_ruled(text: str) -> bool:
    """Whether a rule of dashes or the like stands before or behind the words."""
    head, tail = text[:3], text[-3:]
    return bool(_RULED.fullmatch(head) or _RULED.fullmatch(tail)) and len(text) > 3


def _is_echo(comment: _Raw, found: Sequence[str], lines: Sequence[str]) -> bool:
    """Whether it says no word that the code beside it, or exactly the words of the line below it."""
    if comment.inline:
        code = set(_code_words(lines[comment.line - 1]))
        return len(code) > 0 and set(found) <= code
    below = lines[comment.line] if comment.line < len(lines) else ""
    return bool(below.strip()) and len(found) > 1 and list(found) == _code_words(below)


def _code_words(line: str) -> list[str]:
    spread = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", line[:1000])
    return words(spread)


def _mark_code(block: Sequence[_Raw], budget: _Budget) -> None:
    """Mark the lines of a block that are code: first what is surely code, then what leans on it."""
    position = 0
    leaning: set[int] = set()
    depths = [_depth(comment.body) for comment in block]
    while position < len(block):
        size, certainty = _code_from(block, depths, position, budget)
        for index in range(position, position + size):
            if certainty == "sure":
                block[index].kind = "code"
            elif certainty == "leaning":
                leaning.add(index)
        position += max(size, 1)
    for order in (range(len(block)), range(len(block) - 1, -1, -1)):
        for index in order:
            near = [block[i].kind for i in (index - 1, index + 1) if 0 <= i < len(block)]
            if index in leaning and "code" in near:
                block[index].kind = "code"


def _code_from(block: Sequence[_Raw], depths: Sequence[int], position: int, budget: _Budget) -> tuple[int, str]:
    """How many lines from `position` on belong to one statement, and whether it is code."""
    line = block[position].text
    if not _CODE_HINT.search(line[:400]):
        return 1, ""
    depth, size = depths[position], 1
    while depth > 0 and size < SPAN_LINES and position + size < len(block):
        depth += depths[position + size]
        size += 1
    if size > 1 and depth == 0:
        certainty = _certainty("\n".join(c.text for c in block[position : position + size]), budget)
        if certainty:
            return size, certainty
    return 1, _certainty(line, budget)


def _depth(line: str) -> int:
    line = line[:400]
    return sum(line.count(c) for c in "([{") - sum(line.count(c) for c in ")]}")


def _certainty(fragment: str, budget: _Budget) -> str:
    """How certainly the fragment is a statement of Python: "sure", "leaning", or "" for prose."""
    if _DECORATOR.match(fragment):
        return "sure"
    tree = budget.tree(_completed(fragment))
    if tree is None or not tree.body:
        return ""
    return _statement(tree.body[-1], fragment)


def _completed(fragment: str) -> str:
    """The head of a compound statement completed to a whole one, an item of a list taken out of it."""
    fragment = fragment.rstrip(", ")
    if not fragment.endswith(":"):
        return fragment
    first = fragment.split(None, 1)[0].rstrip(":")
    if first == "elif":
        return fragment[2:] + " pass"
    if first in ("else",):
        return f"if x: pass\n{fragment} pass"
    if first in ("except", "finally"):
        return f"try: pass\n{fragment} pass"
    if first == "try":
        return f"{fragment} pass\nfinally: pass"
    return fragment + " pass"


def _statement(node: ast.stmt, fragment: str) -> str:
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.ImportFrom, ast.Raise)):
        return "sure"
    if isinstance(node, ast.Import):
        return _import(node)
    if isinstance(node, ast.AugAssign):
        return "sure"
    if isinstance(node, ast.Assign):
        return _assignment(node)
    if isinstance(node, ast.AnnAssign):
        typed = not isinstance(node.annotation, ast.Name) or node.annotation.id in _TYPES
        return "sure" if node.value is not None and typed and _is_technical(node.target) else ""
    if isinstance(node, ast.Expr):
        return _expression(node.value, fragment)
    if isinstance(node, ast.Return):
        return "sure" if node.value is not None and _has_code(node.value) else "leaning"
    if isinstance(node, (ast.If, ast.While)):
        return "sure" if _has_code(node.test) else "leaning"
    if isinstance(node, (ast.For, ast.AsyncFor)):
        return "sure" if _has_code(node.iter) else "leaning"
    if isinstance(node, (ast.With, ast.AsyncWith)):
        return "sure" if any(_has_code(item.context_expr) for item in node.items) else "leaning"
    if isinstance(node, ast.Try):
        return "sure" if any(h.type is not None for h in node.handlers) else "leaning"
    return "leaning"


def _import(node: ast.Import) -> str:
    known = _PACKAGES | sys.stdlib_module_names
    for alias in node.names:
        root = alias.name.split(".")[0]
        if alias.asname or "." in alias.name or root in known or root.endswith(("_msgs", "_srvs", "_interfaces")):
            return "sure"
    return "leaning"


def _assignment(node: ast.Assign) -> str:
    """`self.x = 1` is code; `error = command - state` may explain."""
    if any(isinstance(n, ast.Constant) and n.value is ... for n in ast.walk(node.value)):
        return ""
    if all(isinstance(target, (ast.Attribute, ast.Subscript)) for target in node.targets):
        return "sure" if _is_technical(node.targets[0]) else "leaning"
    if _has_code(node.value):
        return "sure"
    target = node.targets[0]
    if isinstance(target, ast.Name) and "_" in target.id and isinstance(node.value, ast.Constant):
        return "sure"
    return "leaning"


def _expression(node: ast.expr, fragment: str) -> str:
    if isinstance(node, ast.Await):
        return "sure"
    if not isinstance(node, ast.Call) or not _has_code(node):
        return ""
    opening = fragment.find("(")
    return "sure" if opening > 0 and not fragment[opening - 1].isspace() else ""


def _has_code(node: ast.expr) -> bool:
    """Whether an expression has what prose and formulas lack: calls (but of mathematics), `self.`, lists."""
    for part in ast.walk(node):
        if isinstance(part, ast.Call) and _is_technical(part.func) and _last_name(part.func) not in _FORMULA_NAMES:
            return True
        if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and part.value.id in ("self", "msg"):
            return True
        if isinstance(part, (ast.List, ast.Dict)) and any(isinstance(c, ast.Constant) for c in ast.walk(part)):
            return True
    return False


def _last_name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _is_technical(node: ast.expr) -> bool:
    """Whether all names in it are ASCII, as those of code nearly always are."""
    names = [_last_name(part) for part in ast.walk(node) if isinstance(part, (ast.Name, ast.Attribute))]
    return all(name.isascii() and not keyword.iskeyword(name) for name in names)

"""Python text taken apart without running it: its tree, its comments, its string literals.

The text may be anything that a student hands in. Nothing here raises on it, and all is bounded in time.
"""

from __future__ import annotations

import ast
import functools
import re
import warnings
from dataclasses import dataclass

from grader.python_source import parse_python

SIZE_LIMIT = 200_000
"""Characters that are read; no file written by hand comes near."""

_OUTSIDE = re.compile(r"#|'''|\"\"\"|'|\"")
_INSIDE = {
    "'": re.compile(r"\\.|'|\n", re.DOTALL),
    '"': re.compile(r"\\.|\"|\n", re.DOTALL),
    "'''": re.compile(r"\\.|'''", re.DOTALL),
    '"""': re.compile(r"\\.|\"\"\"", re.DOTALL),
}


@dataclass(frozen=True)
class Span:
    """A comment or a string literal in a text, with its place in characters and its first and last line."""

    kind: str  # "comment" or "string"
    start: int
    end: int
    line: int
    end_line: int


def normalise(text: str) -> str:
    """`text` as Python reads it (no byte order mark, line feeds only), cut off at `SIZE_LIMIT`.

    Lone surrogates, which come from undecodable bytes, become replacement characters.
    """
    text = text[: 4 * SIZE_LIMIT].removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    if len(text) > SIZE_LIMIT:
        text = text[:SIZE_LIMIT]
        text = text[: text.rfind("\n") + 1] or text
    if text.isascii():
        return text
    return text.encode("utf-8", errors="replace").decode("utf-8")


#: Python's compiler compares each function, class and comprehension with those like it, so its time grows by the square
#: of their number: 12,000 in a file take 20 s, 1,000 take 0.2 s. Files of students have some dozens.
_MOST_SCOPES = 1000
_SCOPES = (
    *(ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda),
    *(ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp),
)


@functools.lru_cache(maxsize=8)  # Each file is read for several checks, one after the other.
def tree_of(text: str) -> ast.Module | None:
    """Syntax tree of normalised `text`; None for what Python refuses, and for what nobody has written."""
    tree = expression_tree(text)
    try:
        if tree is not None and sum(isinstance(node, _SCOPES) for node in ast.walk(tree)) <= _MOST_SCOPES:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                compile(text, "<submission>", "exec", dont_inherit=True)
    except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError):
        return None
    return tree


def expression_tree(text: str) -> ast.Module | None:
    """Tree of a fragment of Python, None where it is not Python."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError):
        return None


def spans(text: str) -> list[Span]:
    """Comments and string literals of normalised `text`, in order, also where it is not valid Python.

    Notes
    -----
    A literal in an f-string's replacement field that reuses the string's own quotes (Python 3.12) is taken
    for the string's end; such a mistake ends with the line.
    """
    found: list[Span] = []
    position, line = 0, 1
    while match := _OUTSIDE.search(text, position):
        line += text.count("\n", position, match.start())
        opening = match.group()
        end = _comment_end(text, match.start()) if opening == "#" else _string_end(text, match.end(), opening)
        end_line = line + text.count("\n", match.start(), end)
        found.append(Span("comment" if opening == "#" else "string", match.start(), end, line, end_line))
        position, line = end, end_line
    return found


def _comment_end(text: str, start: int) -> int:
    end = text.find("\n", start)
    return len(text) if end < 0 else end


def _string_end(text: str, position: int, quotes: str) -> int:
    """Where the literal that opened with `quotes` before `position` ends, behind its closing quotes."""
    while match := _INSIDE[quotes].search(text, position):
        if match.group() == quotes:
            return match.end()
        if match.group() == "\n":
            return match.start()
        position = match.end()
    return len(text)


def blank_out(text: str, found: list[Span]) -> str:
    """`text` with comments blanked out and strings replaced by underscores, line for line."""
    pieces: list[str] = []
    position = 0
    for span in found:
        pieces.append(text[position : span.start])
        if span.kind == "string":
            pieces.append("_" + "\n_" * (span.end_line - span.line))
        position = span.end
    pieces.append(text[position:])
    return "".join(pieces)

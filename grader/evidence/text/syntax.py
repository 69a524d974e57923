"""Python text taken apart without running it: its tree, its comments, its string literals.

Students can submit any text. No function raises, and each is bounded in time.
"""

from __future__ import annotations

import ast
import functools
import re
import warnings

from grader.submission.python_source import parse_python

#: Characters that are read; no file written by hand comes near.
SIZE_LIMIT = 200_000

#: A comment or a string literal; an unclosed literal ends with its line, or with the text.
_SPAN = re.compile(
    r"""(?P<comment>\#[^\n]*)
    | \"{3} (?: [^"\\] | \\. | "(?!"") )* (?:\"{3}|\\?\Z)  | \'{3} (?: [^'\\] | \\. | '(?!'') )* (?:\'{3}|\\?\Z)
    | " (?: [^"\\\n] | \\. )* "?                      | ' (?: [^'\\\n] | \\. )* '?""",
    re.DOTALL | re.VERBOSE,
)


def normalise(text: str) -> str:
    """Return a text as Python reads it (no byte order mark, line feeds only), cut off at `SIZE_LIMIT`.

    Lone surrogates (from undecodable bytes) become replacement characters.
    """
    text = text[: 4 * SIZE_LIMIT].removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    if len(text) > SIZE_LIMIT:
        text = text[:SIZE_LIMIT]
        text = text[: text.rfind("\n") + 1] or text
    if text.isascii():
        return text
    return text.encode("utf-8", errors="replace").decode("utf-8")


def expression_tree(text: str) -> ast.Module | None:
    """Return the syntax tree of a fragment of Python; None if the parser refuses it, or if it is absurdly deep."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError):
        return None


#: Syntax tree of a whole normalised file; several checks in a row read each file.
tree_of = functools.lru_cache(maxsize=8)(expression_tree)


def code_of(node: ast.AST) -> str:
    """Return the code of a node; empty if it is nested too deeply to be written."""
    try:
        return ast.unparse(node)
    except (RecursionError, MemoryError):
        return ""


def spans(text: str) -> list[re.Match[str]]:
    """Return comments (with the group `comment`) and string literals of a normalised text, which may not be Python.

    A literal in an f-string with the same quotes (Python 3.12) counts as the end of the f-string.
    """
    return list(_SPAN.finditer(text))


@functools.lru_cache(maxsize=8)
def blank_out(text: str) -> str:
    """Return a text without comments, and with underscores for strings, line for line."""
    return _SPAN.sub(_blank, text)


def _blank(span: re.Match[str]) -> str:
    if span["comment"]:
        return ""
    return "_" + "\n_" * span[0].count("\n")

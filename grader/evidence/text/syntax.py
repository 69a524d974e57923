"""Python text taken apart without running it: its tree, its comments, its string literals.

The text may be anything that a student hands in. Nothing here raises on it, and all is bounded in time.
"""

from __future__ import annotations

import ast
import functools
import re
import warnings

from grader.submission.python_source import parse_python

#: Characters that are read; no file written by hand comes near.
SIZE_LIMIT = 200_000

#: A comment or a string literal; one that is not closed goes to the end of its line, or of the text.
_SPAN = re.compile(
    r"""(?P<comment>\#[^\n]*)
    | \"{3} (?: [^"\\] | \\. | "(?!"") )* (?:\"{3}|\\?\Z)  | \'{3} (?: [^'\\] | \\. | '(?!'') )* (?:\'{3}|\\?\Z)
    | " (?: [^"\\\n] | \\. )* "?                      | ' (?: [^'\\\n] | \\. )* '?""",
    re.DOTALL | re.VERBOSE,
)


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


def expression_tree(text: str) -> ast.Module | None:
    """Syntax tree of a fragment of Python; None for what its parser refuses, and for what nobody has written."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return parse_python(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError):
        return None


#: The same for a whole normalised file; each is read for several checks, one after the other.
tree_of = functools.lru_cache(maxsize=8)(expression_tree)


def spans(text: str) -> list[re.Match[str]]:
    """Comments (whose group `comment` matches) and string literals of normalised `text`, whether it is Python or not.

    A literal within an f-string that reuses its quotes (Python 3.12) is taken for its end, until the line ends.
    """
    return list(_SPAN.finditer(text))


def blank_out(text: str) -> str:
    """`text` without comments, and with strings replaced by underscores, line for line."""
    return _SPAN.sub(
        lambda span: "" if span["comment"] else "_" + "\n_" * span[0].count("\n"), text
    )

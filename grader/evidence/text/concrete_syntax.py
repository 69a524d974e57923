"""Concrete syntax of texts in Python, C and C++, correct or not; tree-sitter parses it within a bound."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import tree_sitter
import tree_sitter_cpp
import tree_sitter_python


class _Bound(NamedTuple):
    """Steps of a parser, some 100 operations each: for any text, and for each byte of it."""

    steps: int
    steps_a_byte: float


#: Python takes a step for 25 bytes or more. Another text can take the square of its length: 1,000 times `<!--` takes
#: 20,000, 2,000 times 80,000. C++ takes a step for some 100 bytes; steps of texts like `a::b<c>::` are slower.
_BOUNDS = {"python": _Bound(5_000, 0.1), "cpp": _Bound(1_000, 0.03)}
#: Bytes that the parser is given at a time.
_SLICE_BYTES = 8_192


def concrete_tree(content: bytes, language: str = "python") -> tree_sitter.Tree | None:
    """Return the tree of a text in UTF-8; None if it takes more steps than code of its length.

    The bound is no time, so that a text has the same answer on every machine.

    Parameters
    ----------
    language
        "python", or "cpp" for C and C++.
    """
    bound = _BOUNDS[language]
    most = bound.steps + bound.steps_a_byte * len(content)
    steps = 0
    parser = _parser(language)

    def has_enough(offset: int, has_error: bool) -> bool:
        nonlocal steps
        steps += 1
        return steps > most

    def rest(offset: int, point: tree_sitter.Point) -> bytes:
        return content[offset : offset + _SLICE_BYTES]

    try:
        # Only a text that the parser asks for can be left in between.
        return parser.parse(rest, progress_callback=has_enough)
    except ValueError:
        parser.reset()  # or the next text is taken for the rest of this one
        return None


@cache
def _parser(language: str) -> tree_sitter.Parser:
    grammar = tree_sitter_python.language()
    if language == "cpp":
        grammar = tree_sitter_cpp.language()
    return tree_sitter.Parser(tree_sitter.Language(grammar))

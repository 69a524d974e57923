"""Concrete syntax of Python texts of any version, correct or not; tree-sitter parses it within a bound."""

from __future__ import annotations

from functools import cache

import tree_sitter
import tree_sitter_python

#: Steps of the parser, some 100 operations each: for any text, and for each byte of it. Code takes a step for 25 bytes or
#: more. A text that is no Python can take the square of its length: 1,000 times `<!--` takes 20,000, 2,000 times 80,000.
_STEPS, _STEPS_A_BYTE = 5_000, 0.1
#: Bytes that the parser is given at a time.
_SLICE_BYTES = 8_192


def concrete_tree(content: bytes) -> tree_sitter.Tree | None:
    """Return the tree of a text in UTF-8; None if it takes more steps than code of its length.

    The bound is no time, so that a text has the same answer on every machine.
    """
    most = _STEPS + _STEPS_A_BYTE * len(content)
    steps = 0

    def has_enough(offset: int, has_error: bool) -> bool:
        nonlocal steps
        steps += 1
        return steps > most

    def rest(offset: int, point: tree_sitter.Point) -> bytes:
        return content[offset : offset + _SLICE_BYTES]

    try:
        # Only a text that the parser asks for can be left in between.
        return _parser().parse(rest, progress_callback=has_enough)
    except ValueError:
        _parser().reset()  # or the next text is taken for the rest of this one
        return None


@cache
def _parser() -> tree_sitter.Parser:
    return tree_sitter.Parser(tree_sitter.Language(tree_sitter_python.language()))

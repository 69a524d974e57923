"""The parser of all texts, and its bound."""

from __future__ import annotations

import time
from pathlib import Path

from grader.evidence.text.concrete_syntax import concrete_tree


def test_a_text_that_takes_too_long_is_left() -> None:
    """Each wrong sign of this text has the parser look at all others; the next text is read as if nothing had been."""
    began_s = time.process_time()
    assert concrete_tree(b"<!--" * 15_000) is None
    assert time.process_time() - began_s < 15.0
    tree = concrete_tree(b"x = 1\n")
    assert tree is not None
    assert [node.type for node in tree.root_node.children] == ["expression_statement"]


def test_a_long_program_is_read_whole() -> None:
    """The bound is far beyond what students write: here twenty times a module of 12 kB."""
    content = Path(__file__).with_name("test_prose.py").read_bytes() * 20
    tree = concrete_tree(content)
    assert tree is not None
    assert (tree.root_node.end_byte, tree.root_node.has_error) == (len(content), False)

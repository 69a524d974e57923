"""Tell whether a Python text is correct, but only by the syntax of a newer Python.

Two parsers answer together. The grammar of tree-sitter finds the newer constructs: type aliases, type parameters,
f-strings with freer fields, t-strings. Each is then rewritten as an older Python has it, and the
interpreter's own parser must accept every part of it and all of the result. A text that no Python accepts stays an
error of its author.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache, lru_cache

import tree_sitter
import tree_sitter_python

from grader.evidence.text.syntax import expression_tree, normalise, tree_of

#: Largest depth of nested f-strings with newer fields; people write two.
_MOST_NESTED = 20
#: The newer prefix, which is `t`, as `f`.
_OLDER_PREFIX = str.maketrans("tT", "fF")
#: The nodes of a field, in an f-string and in the format of another field.
_FIELDS = ("interpolation", "format_expression")
#: The nodes after a field's expression.
_AFTER_EXPRESSION = ("=", "type_conversion", "format_specifier", "}")
_CONVERSIONS = ("!r", "!s", "!a")
#: Expressions that need parentheses within a field, and the nodes that have brackets of their own.
_NOT_BARE = ("lambda", "named_expression", "list_splat")
_BRACKETED = (
    "argument_list",
    "dictionary",
    "dictionary_comprehension",
    "generator_expression",
    "list",
    "list_comprehension",
    "parenthesized_expression",
    "set",
    "set_comprehension",
    "string",
    "subscript",
    "tuple",
)
#: Stars before type parameters: `[*Ts, **P]`.
_STARS = re.compile(r"(^|,)\s*\*{1,2}")
_DEFINITIONS = ("function_definition", "class_definition")


@lru_cache(maxsize=16)
def is_newer_python(text: str) -> bool:
    """Tell whether a text is correct by the syntax of Python 3.12 or later, and not by an older one's."""
    text = normalise(text)
    older = _as_older(text, _MOST_NESTED)
    return older is not None and older != text and tree_of(older) is not None


class _Wrong(Exception):
    """Raised for a text that no Python accepts."""


def _as_older(text: str, levels: int) -> str | None:
    """Return a text with its newer constructs rewritten; None where no Python accepts them."""
    content = text.encode("utf-8", "replace")
    rewriting = _Rewriting()
    try:
        rewriting.read(_parser().parse(content).root_node)
        _require_expressions(rewriting.expressions, levels)
    except _Wrong:
        return None
    parts, end = [], 0
    for start, stop, replacement in sorted(rewriting.edits):
        parts += [content[end:start], replacement]
        end = stop
    return b"".join([*parts, content[end:]]).decode("utf-8", "replace")


@cache
def _parser() -> tree_sitter.Parser:
    return tree_sitter.Parser(tree_sitter.Language(tree_sitter_python.language()))


@dataclass
class _Rewriting:
    """The edits that make an older text of a newer one, and the expressions that they drop."""

    #: First byte, byte after the last, replacement.
    edits: list[tuple[int, int, bytes]] = field(default_factory=list)
    expressions: list[str] = field(default_factory=list)

    def read(self, root: tree_sitter.Node) -> None:
        """Collect the edits of a whole tree; raises _Wrong."""
        waiting = [root]
        while waiting:
            node = waiting.pop()
            if node.is_error or node.is_missing:
                raise _Wrong
            waiting += self._of_node(node)

    def _of_node(self, node: tree_sitter.Node) -> list[tree_sitter.Node]:
        """Collect the edits of one node, and return its children that are still to be read."""
        if node.type == "type_conversion" and _text(node) not in _CONVERSIONS:
            raise _Wrong
        if node.type == "type_alias_statement":
            return self._alias(node)
        if node.type in _DEFINITIONS:
            return self._definition(node)
        if node.type == "string":
            return self._string(node)
        return node.children

    def _alias(self, node: tree_sitter.Node) -> list[tree_sitter.Node]:
        """Rewrite `type Name[T] = value` as `Name = value`."""
        keyword, name, *rest = node.children
        given = _text(name)
        plain, bracket, parameters = given.partition("[")
        if not plain.strip().isidentifier():
            raise _Wrong
        if bracket:
            _require_parameters(parameters.strip().removesuffix("]"))
        self.edits.append((keyword.start_byte, name.end_byte, plain.strip().encode()))
        return rest

    def _definition(self, node: tree_sitter.Node) -> list[tree_sitter.Node]:
        """Rewrite `def name[T](...)` and `class Name[T]` without their type parameters."""
        rest = []
        for child in node.children:
            if child.type != "type_parameter":
                rest.append(child)
                continue
            _require_parameters(_text(child)[1:-1])
            self.edits.append((child.start_byte, child.end_byte, b""))
        return rest

    def _string(self, node: tree_sitter.Node) -> list[tree_sitter.Node]:
        """Rewrite the prefix and the newer fields of a string."""
        start, *rest = node.children
        opening = _text(start)
        prefix = opening.rstrip("'\"")
        if "t" in prefix.lower():
            older = opening.translate(_OLDER_PREFIX).encode()
            self.edits.append((start.start_byte, start.end_byte, older))
        left: list[tree_sitter.Node] = []
        waiting = [child for child in rest if child.type in _FIELDS]
        while waiting:
            part = waiting.pop()
            if part.type in _FIELDS:
                expression, after = self._field(part, opening[len(prefix) :])
                left += expression
                waiting += after
            elif part.type == "format_specifier":
                waiting += part.children
            else:
                left.append(part)
        return left + [child for child in rest if child.type not in _FIELDS]

    def _field(
        self, node: tree_sitter.Node, quotes: str
    ) -> tuple[list[tree_sitter.Node], list[tree_sitter.Node]]:
        """Rewrite `{expression!r:format}` as `{_!r:format}`, if only a newer Python accepts the expression.

        Returns the nodes of the expression that are still to be read, and those after it.
        """
        brace, *inner = node.children
        ends = [n for n, child in enumerate(inner) if child.type in _AFTER_EXPRESSION]
        if not ends:
            raise _Wrong
        expression = inner[: ends[0]]
        after = inner[ends[0] :]
        start = brace.end_byte
        stop = after[0].start_byte
        first = node.start_byte
        content = (node.text or b"")[start - first : stop - first]
        text = content.decode("utf-8", "replace")
        signs = ("\\", "#", quotes, "\n" if len(quotes) == 1 else quotes)
        if not any(sign in text for sign in signs):
            return expression, after
        _require_bare(expression)
        self.expressions.append(text)
        self.edits.append((start, stop, b"_"))
        return [], after


def _require_bare(nodes: list[tree_sitter.Node]) -> None:
    """Raise _Wrong unless the nodes of an expression may be used in a field without parentheses."""
    waiting = list(nodes)
    while waiting:
        node = waiting.pop()
        if node.type in _NOT_BARE or node.has_error:
            raise _Wrong
        if node.type not in _BRACKETED:
            waiting += node.children


def _require_expressions(texts: list[str], levels: int) -> None:
    """Raise _Wrong unless some texts, with fields nested up to so many levels, are expressions."""
    if not texts:
        return
    alone = "".join(f"({text}\n)\n" for text in texts)
    older = _as_older(alone, levels - 1) if levels else None
    if older is None or expression_tree(older) is None:
        raise _Wrong


def _text(node: tree_sitter.Node) -> str:
    return (node.text or b"").decode("utf-8", "replace")


def _require_parameters(text: str) -> None:
    """Raise _Wrong unless a text is a list of type parameters: names with bounds and defaults, as a function has."""
    plain = _STARS.sub(r"\1", text)
    if expression_tree(f"def _({plain}): ...") is None or not text.strip():
        raise _Wrong

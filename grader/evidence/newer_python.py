"""Tell whether a Python text is correct, but only by the syntax of a newer Python, and of which.

Two parsers answer together. The grammar of tree-sitter finds the newer constructs. Each is then rewritten as an older
Python has it, and the interpreter's own parser must accept every part of it and all of the result. A text that no
Python accepts stays an error of its author.

====================================================  =====================
type aliases, type parameters (PEP 695)               Python 3.12
f-strings with freely written fields (PEP 701)        Python 3.12
defaults of type parameters (PEP 696)                 Python 3.13
several exceptions without parentheses (PEP 758)      Python 3.14
t-strings (PEP 750)                                   Python 3.14
====================================================  =====================
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, field
from functools import lru_cache

import tree_sitter

from grader.evidence.text.concrete_syntax import concrete_tree
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
#: Wrong parts of an `except` of several exceptions without parentheses.
_NOT_IN_EXCEPT = ("as_pattern", *_NOT_BARE)
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
#: Stars before type parameters, and before the default of one with a single star: `[*Ts = *tuple[int], **P]`.
_STARRED_DEFAULT = re.compile(r"(^|,)\s*\*\s*(\w+)\s*=\s*\*")
_STARS = re.compile(r"(^|,)\s*\*{1,2}")
#: A bound of a type parameter with stars: an error in every Python.
_BOUND_OF_STARRED = re.compile(r"(^|,)\s*\*{1,2}\s*\w+\s*:")
_DEFINITIONS = ("function_definition", "class_definition")
#: Minor versions of Python 3 with new syntax.
_FREE_FIELDS = _TYPE_PARAMETERS = 12
_DEFAULTS = 13
_BARE_EXCEPTIONS = _TEMPLATES = 14


@lru_cache(maxsize=16)
def python_needed(text: str) -> str:
    """Return the first Python by which a text is correct, such as "3.12"; empty if it needs no newer one, or is wrong."""
    older = _as_older(normalise(text), _MOST_NESTED)
    if older is None or not older.version:
        return ""
    if tree_of(older.text) is None:
        return ""
    return f"3.{older.version}"


class _Wrong(Exception):
    """Raised for a text that no Python accepts."""


@dataclass(frozen=True)
class _Older:
    """A text with its newer constructs rewritten."""

    text: str
    #: Minor version of Python 3 for all of the constructs; 0 without any.
    version: int


def _as_older(text: str, levels: int) -> _Older | None:
    """Return a text with its newer constructs rewritten; None where no Python accepts them."""
    content = text.encode("utf-8", "replace")
    rewriting = _Rewriting()
    try:
        rewriting.read(_root(content))
        inner = _version_of(rewriting.expressions, levels)
    except _Wrong:
        return None
    parts, end = [], 0
    for start, stop, replacement in sorted(rewriting.edits):
        parts += [content[end:start], replacement]
        end = stop
    older = b"".join([*parts, content[end:]]).decode("utf-8", "replace")
    return _Older(older, max(rewriting.version, inner))


def _root(content: bytes) -> tree_sitter.Node:
    """Return the root of a text's tree; raises _Wrong for a text that takes the parser too long for code."""
    tree = concrete_tree(content)
    if tree is None:
        raise _Wrong
    return tree.root_node


@dataclass
class _Rewriting:
    """The edits that make an older text of a newer one, and the expressions that they drop."""

    #: First byte, byte after the last, replacement.
    edits: list[tuple[int, int, bytes]] = field(default_factory=list)
    expressions: list[str] = field(default_factory=list)
    #: Minor version of Python 3 for all of the constructs so far; 0 without any.
    version: int = 0

    def _edit(self, start: int, stop: int, replacement: bytes, version: int) -> None:
        """Note an edit, and the version of its construct."""
        self.edits.append((start, stop, replacement))
        self.version = max(self.version, version)

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
        if node.type == "except_clause":
            return self._except(node)
        if node.type == "concatenated_string":
            _require_one_kind(node.children)
        return node.children

    def _except(self, node: tree_sitter.Node) -> list[tree_sitter.Node]:
        """Rewrite `except A, B:` as `except (A, B):`; the grammar of tree-sitter knows no comma at the end."""
        left = list(node.children)
        named: list[tree_sitter.Node] = []
        while left and left[0].type != ":":
            named.append(left.pop(0))
        while named and named[0].type in ("except", "*"):
            named.pop(0)
        kept = _without_commas(named)
        if len(kept) == len(named):
            return node.children
        if not left:
            raise _Wrong
        if not {child.type for child in kept}.isdisjoint(_NOT_IN_EXCEPT):
            raise _Wrong
        start = named[0].start_byte
        stop = left[0].start_byte
        self._edit(start, start, b"(", _BARE_EXCEPTIONS)
        self._edit(stop, stop, b")", _BARE_EXCEPTIONS)
        return kept + left

    def _alias(self, node: tree_sitter.Node) -> list[tree_sitter.Node]:
        """Rewrite `type Name[T] = value` as `Name = value`."""
        keyword, name, *rest = node.children
        given = _text(name)
        plain, bracket, parameters = given.partition("[")
        if not plain.strip().isidentifier():
            raise _Wrong
        version = _TYPE_PARAMETERS
        if bracket:
            version = _version_of_parameters(parameters.strip().removesuffix("]"))
        self._edit(keyword.start_byte, name.end_byte, plain.strip().encode(), version)
        return rest

    def _definition(self, node: tree_sitter.Node) -> list[tree_sitter.Node]:
        """Rewrite `def name[T](...)` and `class Name[T]` without their type parameters."""
        rest = []
        for child in node.children:
            if child.type != "type_parameter":
                rest.append(child)
                continue
            version = _version_of_parameters(_text(child)[1:-1])
            self._edit(child.start_byte, child.end_byte, b"", version)
        return rest

    def _string(self, node: tree_sitter.Node) -> list[tree_sitter.Node]:
        """Rewrite the prefix and the newer fields of a string."""
        start, *rest = node.children
        opening = _text(start)
        prefix = opening.rstrip("'\"")
        if "t" in prefix.lower():
            older = opening.translate(_OLDER_PREFIX).encode()
            self._edit(start.start_byte, start.end_byte, older, _TEMPLATES)
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
        signs = ["\\", "#", quotes]
        if len(quotes) == 1:
            signs.append("\n")
        if not any(sign in text for sign in signs):
            return expression, after
        _require_bare(expression)
        self.expressions.append(text)
        self._edit(start, stop, b"_", _FREE_FIELDS)
        return [], after


def _require_bare(nodes: list[tree_sitter.Node]) -> None:
    """Raise _Wrong unless the nodes of an expression may be used in a field without parentheses."""
    waiting = list(nodes)
    while waiting:
        node = waiting.pop()
        if node.type in _NOT_BARE or node.has_error:
            raise _Wrong
        if node.type == "expression_list":
            waiting += _without_stars(node.children)
        elif node.type not in _BRACKETED:
            waiting += node.children


def _without_stars(members: list[tree_sitter.Node]) -> list[tree_sitter.Node]:
    """Return the members of a tuple without parentheses, such as `*a, b`, without their stars."""
    plain = []
    for member in members:
        if member.type == "list_splat":
            plain += member.children
        else:
            plain.append(member)
    return plain


def _without_commas(exceptions: list[tree_sitter.Node]) -> list[tree_sitter.Node]:
    """Return the exceptions without commas, and without a missing name after the last comma."""
    kept = []
    for node in exceptions:
        if _text(node) != ",":
            kept.append(node)
    if len(kept) == len(exceptions):
        return kept
    if not kept:
        raise _Wrong
    if kept[-1].is_missing:
        kept.pop()
    return kept


def _require_one_kind(strings: list[tree_sitter.Node]) -> None:
    """Raise _Wrong if a t-string is joined with another string."""
    kinds = set()
    for string in strings:
        if string.type == "string":
            prefix = _text(string.children[0]).rstrip("'\"")
            kinds.add("t" in prefix.lower())
    if len(kinds) > 1:
        raise _Wrong


def _version_of(texts: list[str], levels: int) -> int:
    """Return the version that some expressions need, with fields nested so many levels deep; raises _Wrong."""
    if not texts:
        return 0
    alone = "".join(f"({text}\n)\n" for text in texts)
    older = _as_older(alone, levels - 1) if levels else None
    if older is None or expression_tree(older.text) is None:
        raise _Wrong
    return older.version


def _text(node: tree_sitter.Node) -> str:
    return (node.text or b"").decode("utf-8", "replace")


def _version_of_parameters(text: str) -> int:
    """Return the version that a list of type parameters needs: names with bounds and defaults, as a function has.

    Raises _Wrong for another text.
    """
    plain = _STARS.sub(r"\1", _STARRED_DEFAULT.sub(r"\1\2=", text))
    tree = expression_tree(f"def _({plain}): ...")
    if tree is None or not text.strip():
        raise _Wrong
    if _BOUND_OF_STARRED.search(text):
        raise _Wrong
    defined = tree.body[0]
    has_defaults = isinstance(defined, ast.FunctionDef) and bool(defined.args.defaults)
    if has_defaults:
        return _DEFAULTS
    return _TYPE_PARAMETERS

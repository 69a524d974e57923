"""Explanations in a student's C or C++ source, parsed by tree-sitter and never compiled."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import tree_sitter

from grader.evidence.text.comments import CodeFinder, is_licence
from grader.evidence.text.concrete_syntax import concrete_tree
from grader.evidence.text.source import Note, Reader, Rules, Scope, SourceFacts, Unit, file_unit
from grader.evidence.text.syntax import normalise

_CLASSES = frozenset({"class_specifier", "struct_specifier"})
_DEFINED = _CLASSES | {"function_definition"}
#: Beginnings of comments for Doxygen.
_DOCUMENTATION = ("/**", "/*!", "///", "//!")
#: Signs around the words of a comment, and the commands of Doxygen.
_FRAME = re.compile(r"^\s*(?:/{2,}!?<?|/\*+!?<?|\*+/?)|\*+/\s*$")
_COMMAND = re.compile(r"[@\\](?:brief|file|class|fn|param|t?param|returns?|details|author|date)\b")
#: Lines of a file that can hold a licence.
_LAST_LICENCE_LINE = 10


def read_c(path: str, text: str, rules: Rules, said: set[str]) -> SourceFacts:
    """Read a file in C or C++, as `source.read_python` reads one in Python. Never raises.

    A comment for Doxygen counts as a docstring.
    """
    whole = normalise(text)
    content = whole.encode("utf-8", "replace")
    tree = concrete_tree(content, "cpp")
    nodes: list[tree_sitter.Node] = []
    if tree is not None:
        nodes += _comment_nodes(tree.root_node)
    code = [*_without(content, nodes).split("\n"), ""]
    file = file_unit(path, "\n".join(code), rules)
    scopes: list[Scope] = []
    if tree is not None:
        scopes += _Definitions(tree.root_node, file, rules).scopes()
    notes = list(_notes(nodes, code))
    return Reader(path, file, code, scopes, rules).read(notes, tree is not None, said)


def _below(root: tree_sitter.Node) -> Iterator[tree_sitter.Node]:
    """Yield a node and all nodes in it, in their order; without recursion, because trees can be deep."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += reversed(node.children)


def _comment_nodes(root: tree_sitter.Node) -> list[tree_sitter.Node]:
    return [node for node in _below(root) if node.type == "comment"]


def _without(content: bytes, comments: Sequence[tree_sitter.Node]) -> str:
    """Return a text without its comments, line for line."""
    parts = []
    start = 0
    for node in comments:
        parts.append(content[start : node.start_byte])
        lines = node.end_point[0] - node.start_point[0]
        parts.append(b"\n" * lines)
        start = node.end_byte
    parts.append(content[start:])
    return b"".join(parts).decode("utf-8", "replace")


# -- comments ------------------------------------------------------------------------------------------


@dataclass
class _Block:
    """A comment, or comments on consecutive lines at one column."""

    text: str
    first: int
    last: int
    column: int
    is_inline: bool

    def continues(self, node: tree_sitter.Node) -> bool:
        """Return whether a comment belongs to the block."""
        line, column = node.start_point
        if self.is_inline:
            return False
        is_next = (line, column) == (self.last, self.column)
        return is_next and self.text.startswith("//")


def _notes(nodes: Sequence[tree_sitter.Node], code: Sequence[str]) -> Iterator[Note]:
    """Yield the comments; a block of commented-out code explains nothing."""
    finder = CodeFinder()
    for block in _blocks(nodes, code):
        bodies = [_body(line) for line in block.text.split("\n")]
        joined = "\n".join(bodies)
        if not any(map(str.isalnum, joined)):
            continue
        fault = ""
        is_first = block.first <= _LAST_LICENCE_LINE
        if is_first and is_licence(bodies):
            fault = "a licence"
        elif 2 * len(finder.lines_of_code(bodies)) > len(bodies):
            fault = "commented-out code"
        kind = "comment"
        if block.text.startswith(_DOCUMENTATION):
            kind = "docstring"
        yield Note(kind, joined, block.first, block.last, block.is_inline, fault, in_front=True)


def _blocks(nodes: Sequence[tree_sitter.Node], code: Sequence[str]) -> Iterator[_Block]:
    block: _Block | None = None
    for node in nodes:
        line, column = node.start_point
        text = _text(node)
        last = node.end_point[0] + 1
        is_inline = bool(code[line].strip())
        if block is not None and not is_inline and block.continues(node):
            block.text += f"\n{text}"
            block.last = last
            continue
        if block is not None:
            yield block
        block = _Block(text, line + 1, last, column, is_inline)
    if block is not None:
        yield block


def _body(line: str) -> str:
    """Return the words of a line of a comment.

    Examples
    --------
    >>> _body("/** @brief Sends a text. */")
    'Sends a text.'
    """
    bare = _FRAME.sub("", line.strip())
    return _COMMAND.sub("", _FRAME.sub("", bare)).strip()


# -- classes and functions -----------------------------------------------------------------------------


class _Definitions:
    """The classes and functions of a file."""

    def __init__(self, root: tree_sitter.Node, file: Unit, rules: Rules) -> None:
        self._file = file
        self._rules = rules
        #: Classes and functions with a body, in their order.
        self._nodes = [node for node in _below(root) if _is_definition(node)]
        self._alone = self._only_unit()

    def _only_unit(self) -> tree_sitter.Node | None:
        """Return the only class of a file, or the only function of a file without classes, `main` left out."""
        found = [node for node in self._nodes if node.type in _CLASSES]
        if not found:
            found = [node for node in self._nodes if _name(node) != "main"]
        if len(found) != 1:
            return None
        return found[0]

    def scopes(self) -> Iterator[Scope]:
        """Yield the scopes, the outer ones first; a member shares the notes of its class if it needs none of its own."""
        around: list[Scope] = []
        for node in self._nodes:
            last = node.end_point[0] + 1
            first = _first_line(node)
            around = [scope for scope in around if scope.last >= first]
            unit = self._file
            if around:
                unit = around[-1].unit
            is_class = node.type in _CLASSES
            is_class_of_file = is_class and unit is self._file
            if node != self._alone and not self._speaks_for_itself(node):
                name = _name(node)
                unit = Unit(name, node.start_point[0] + 1, needed=name != "main")
            scope = Scope(first, last, node.start_point[0] + 1, unit, is_class_of_file)
            around.append(scope)
            yield scope

    def _speaks_for_itself(self, node: tree_sitter.Node) -> bool:
        """Return whether a function is short, or a constructor, destructor or operator."""
        if node.type in _CLASSES:
            return False
        name = _name(node)
        if name == "main":
            return False
        lines = node.end_point[0] - node.start_point[0] - 1
        is_special = node.child_by_field_name("type") is None or name.startswith("operator")
        return is_special or lines < self._rules.function_lines


def _is_definition(node: tree_sitter.Node) -> bool:
    if node.type not in _DEFINED:
        return False
    return node.child_by_field_name("body") is not None


def _first_line(node: tree_sitter.Node) -> int:
    """Return the first line of a definition, with the line of its template."""
    parent = node.parent
    if parent is not None and parent.type == "template_declaration":
        node = parent
    return node.start_point[0] + 1


def _name(node: tree_sitter.Node) -> str:
    """Return the name of a class or function, without the class around it."""
    found = node.child_by_field_name("name")
    declarator = node.child_by_field_name("declarator")
    while declarator is not None:
        found = declarator
        declarator = declarator.child_by_field_name("declarator")
    if found is None:
        return "unnamed"
    return _text(found).rpartition("::")[2][:100]


def _text(node: tree_sitter.Node) -> str:
    if node.text is None:
        return ""
    return node.text.decode("utf-8", "replace")

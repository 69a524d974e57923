"""What a student's Python source says of itself: definitions, docstrings, comments.

Text is parsed, never imported or run. A text that Python refuses still yields its comments, and the
definitions that can be told from its lines, so that a typing error is not charged a
second time as missing documentation.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import PurePosixPath

from grader.evidence.comments import Comment, comments_of
from grader.evidence.syntax import Span, blank_out, normalise, spans, tree_of
from grader.evidence.words import is_placeholder, normal_form, substance, words

DOCSTRING_WORDS = 3
"""Distinct words from which a docstring says something."""

TRIVIAL_LINES = 3
"""A function this short, docstring aside, speaks for itself."""

_DEFINITION_LINE = re.compile(r"^([ \t]*)(?:async[ \t]+)?(def|class)[ \t]+([^\W\d]\w*)", re.MULTILINE)
_NAME_PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")
_NEEDED = {"module": Decimal(1), "class": Decimal(2), "function": Decimal(1), "method": Decimal(1)}
_BONUS = Decimal("0.5")
_HEADER_SPAN_LINES = 12


@dataclass(frozen=True)
class Definition:
    """A module, class, function or method.

    Attributes
    ----------
    kind : str
        "module", "class", "function" or "method".
    name : str
        Its bare name; a module's is the file's without `.py`.
    line : int
        Where it begins.
    docstring : str or None
        Its docstring without indentation.
    public : bool
        Whether neither its name nor that of what it stands in begins with an underscore, and it is not
        nested in a function.
    trivial : bool
        Whether it needs no explanation: `main`, special methods, bodies of a line or two.
    owner : str or None
        Name of the class or function that it stands in.
    """

    kind: str
    name: str
    line: int
    docstring: str | None
    public: bool
    trivial: bool = False
    owner: str | None = None

    @property
    def label(self) -> str:
        """How to name it to a reader, e.g. `method Arm.step`."""
        return f"{self.kind} {self.owner}.{self.name}" if self.owner else f"{self.kind} {self.name}"


@dataclass(frozen=True)
class SourceFacts:
    """What the text of one Python file says.

    Attributes
    ----------
    path : str
        As given to `parse`.
    definitions : tuple of Definition
        In the order of their lines, the module first.
    comments : tuple of Comment
        All comments, each with what it is worth.
    code_lines : int
        Lines with code on them; blank lines, comments and docstrings are none.
    """

    path: str
    definitions: tuple[Definition, ...]
    comments: tuple[Comment, ...]
    code_lines: int

    @property
    def explaining(self) -> tuple[Comment, ...]:
        """The comments that explain."""
        return tuple(comment for comment in self.comments if comment.kind == "explains")


def parse(path: str, text: str) -> SourceFacts:
    """Read the Python file `text`, which stands at `path` in the submission. Never raises."""
    whole = normalise(text)
    tree = tree_of(whole)
    found = spans(whole)
    blank = blank_out(whole, found)
    module = path.rsplit("/", 1)[-1].removesuffix(".py")
    if tree is None:
        definitions = _definitions_by_line(module, whole, blank, found)
        docstring_lines: set[int] = set()
    else:
        docstring_lines = _docstring_lines(tree)
        definitions = list(_definitions(module, tree))
    definitions = _with_header_comment(definitions, comments := comments_of(whole, found, blank), blank)
    code_lines = sum(
        1 for number, line in enumerate(blank.split("\n"), 1) if line.strip() and number not in docstring_lines
    )
    return SourceFacts(path, tuple(definitions), comments, code_lines)


def _definitions(module: str, tree: ast.Module) -> Iterator[Definition]:
    """Definitions of a tree in the order of their lines; without recursion, as trees may be deep."""
    yield Definition("module", module, 1, _docstring(tree), True, not tree.body)
    stack: list[tuple[ast.stmt, ast.AST | None, bool]] = [(node, None, True) for node in reversed(tree.body)]
    while stack:
        node, owner, public = stack.pop()
        inner_owner, inner_public = owner, public
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            inner_owner, inner_public = node, public and _inner_public(node)
            yield _definition(node, owner, public)
        inner = [child for child in ast.iter_child_nodes(node) if isinstance(child, ast.stmt)]
        for part in ast.iter_child_nodes(node):
            if isinstance(part, (ast.ExceptHandler, ast.match_case)):
                inner.extend(part.body)
        stack.extend((child, inner_owner, inner_public) for child in reversed(inner))


def _inner_public(node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> bool:
    return isinstance(node, ast.ClassDef) and not node.name.startswith("_")


def _definition(
    node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef, owner: ast.AST | None, public: bool
) -> Definition:
    body = node.body[1:] if _docstring(node) is not None else node.body
    last = body[-1].end_lineno or 0 if body else 0
    body_lines = last - body[0].lineno + 1 if body else 0
    if isinstance(node, ast.ClassDef):
        kind = "class"
        trivial = not body or all(isinstance(statement, ast.Pass) for statement in body)
    else:
        kind = "method" if isinstance(owner, ast.ClassDef) else "function"
        trivial = _is_self_evident(node.name) or body_lines < TRIVIAL_LINES
    name = getattr(owner, "name", None)
    return Definition(
        kind=kind,
        name=node.name,
        line=node.lineno,
        docstring=_docstring(node),
        public=public and (not node.name.startswith("_") or _is_self_evident(node.name)),
        trivial=trivial,
        owner=name if isinstance(name, str) else None,
    )


def _is_self_evident(name: str) -> bool:
    return name == "main" or (name.startswith("__") and name.endswith("__"))


def _docstring(node: ast.Module | ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> str | None:
    try:
        return ast.get_docstring(node)
    except (TypeError, ValueError):
        return None


def _docstring_lines(tree: ast.Module) -> set[int]:
    """Lines taken by strings that stand alone as statements: docstrings and strings used as comments."""
    found: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            found.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return found


def _definitions_by_line(module: str, text: str, blank: str, found: Sequence[Span]) -> list[Definition]:
    """Definitions of a text that Python refuses, told from its lines.

    A docstring is the first string literal below a definition's line that stands at a line's beginning, with
    nothing but the rest of the header between.
    """
    strings = {span.line: span for span in found if span.kind == "string"}
    lines = blank.split("\n")
    heads = [(text_line, match) for match, text_line in _numbered(blank, _DEFINITION_LINE)]
    first = next((number for number, line in enumerate(lines, 1) if line.strip()), 0)
    whole = _literal(text, strings.get(first)) if lines[first - 1].startswith("_") else None
    definitions = [Definition("module", module, 1, whole, True)]
    owners: list[tuple[int, str, str]] = []
    for place, (number, match) in enumerate(heads):
        indent, keyword, name = len(match[1].expandtabs(4)), match[2], match[3]
        while owners and owners[-1][0] >= indent:
            owners.pop()
        owner = owners[-1] if owners else None
        owners.append((indent, keyword, name))
        last = heads[place + 1][0] - 1 if place + 1 < len(heads) else len(lines)
        kind = "class" if keyword == "class" else "method" if owner and owner[1] == "class" else "function"
        public = not name.startswith("_") and (owner is None or owner[1] == "class")
        docstring = _docstring_below(text, lines, number, last, strings)
        trivial = kind != "class" and (_is_self_evident(name) or last - number <= TRIVIAL_LINES)
        definitions.append(Definition(kind, name, number, docstring, public, trivial, owner[2] if owner else None))
    return definitions


def _numbered(text: str, pattern: re.Pattern[str]) -> Iterator[tuple[re.Match[str], int]]:
    """Matches of `pattern` with the lines that they begin on."""
    line, position = 1, 0
    for match in pattern.finditer(text):
        line += text.count("\n", position, match.start())
        position = match.start()
        yield match, line


def _docstring_below(text: str, lines: Sequence[str], number: int, last: int, strings: dict[int, Span]) -> str | None:
    header_open = True
    for below in range(number, min(last, number + _HEADER_SPAN_LINES, len(lines)) + 1):
        line = lines[below - 1].strip()
        if not header_open and line:
            return _literal(text, strings.get(below)) if line.startswith("_") else None
        if line.endswith(":"):
            header_open = False
    return None


def _literal(text: str, span: Span | None) -> str | None:
    if span is None:
        return None
    return text[span.start : span.end].strip("\"'").strip()


def _with_header_comment(definitions: list[Definition], comments: Sequence[Comment], blank: str) -> list[Definition]:
    """Take an explaining comment above the first line of code for the docstring of a module that has none."""
    module = definitions[0]
    if module.docstring is not None:
        return definitions
    first_code = next((number for number, line in enumerate(blank.split("\n"), 1) if line.strip()), 0)
    header = [c.text for c in comments if c.line < first_code and c.kind == "explains"]
    if not header:
        return definitions
    described = Definition("module", module.name, 1, "\n".join(header), True, module.trivial)
    return [described, *definitions[1:]]


def spin_lines(text: str, others: Iterable[str]) -> tuple[int, ...] | None:
    """Return the lines in which a file names what spins a node; None where the file alone does not tell.

    Parameters
    ----------
    others : iterable of str
        Paths of the submission's files: one that this file imports may spin for it.
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    modules = {PurePosixPath(path).stem for path in others if path.endswith(".py")}
    lines = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
            parts = {part for alias in node.names for part in f"{module}.{alias.name}".split(".")}
            if parts & modules or (isinstance(node, ast.ImportFrom) and node.level):
                return None
        named = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
        if named.startswith("spin"):
            lines.add(node.lineno)  # type: ignore[attr-defined]
    return tuple(sorted(lines))


@dataclass(frozen=True)
class Undocumented:
    """A definition whose docstring is missing or says nothing, and why."""

    path: str
    definition: Definition
    reason: str


@dataclass(frozen=True)
class DocstringShare:
    """How much of a submission's definitions is documented.

    Attributes
    ----------
    share : Decimal
        Weight of what is documented over weight of what should be, from 0 to 1.
    documented, needed : int
        Definitions that should be documented: those that are, and all.
    undocumented : tuple of Undocumented
        Definitions that should be documented and are not.
    """

    share: Decimal
    documented: int
    needed: int
    undocumented: tuple[Undocumented, ...]


def docstring_share(sources: Iterable[SourceFacts]) -> DocstringShare:
    """Weigh the docstrings of several files together.

    Modules, classes and public functions of more than a few lines should be documented; a class weighs twice.
    What speaks for itself (`main`, special methods, private and short functions) costs nothing without a
    docstring, and makes up for half a missing one with it. A docstring counts if it has `DOCSTRING_WORDS`
    distinct words, says more than the name, holds no place for a later text, and is not used twice.
    """
    weight = documented_weight = Decimal(0)
    documented = needed = 0
    undocumented: list[Undocumented] = []
    seen: set[str] = set()
    for path, definition in ((s.path, d) for s in sources for d in s.definitions):
        reason = _fault(definition, seen)
        if not definition.public or definition.trivial:
            documented_weight += _BONUS if not reason else 0
            continue
        needed += 1
        weight += _NEEDED[definition.kind]
        if reason:
            undocumented.append(Undocumented(path, definition, reason))
        else:
            documented += 1
            documented_weight += _NEEDED[definition.kind]
    share = min(documented_weight / weight, Decimal(1)) if weight and documented else Decimal(0)
    return DocstringShare(share, documented, needed, tuple(undocumented))


def _fault(definition: Definition, seen: set[str]) -> str:
    """Why the docstring of `definition` does not count, empty if it does. Adds it to those `seen`."""
    docstring = definition.docstring
    if docstring is None:
        return "has no docstring"
    form = normal_form(docstring)
    if is_placeholder(docstring):
        return "has a placeholder for a docstring"
    name_parts = {part.lower() for part in _NAME_PARTS.findall(definition.name)} | {definition.name.lower()}
    if set(words(docstring)) <= name_parts | {"a", "an", "the", "class", "function", "method", "module"}:
        return "has a docstring that only repeats its name"
    if substance(docstring) < DOCSTRING_WORDS:
        return f"has a docstring of fewer than {DOCSTRING_WORDS} words"
    if form in seen:
        return "repeats the docstring of another"
    seen.add(form)
    return ""

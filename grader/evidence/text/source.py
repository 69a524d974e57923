"""What a student's Python source says of itself: definitions, docstrings, comments.

Text is parsed, never imported or run. A text that Python refuses still yields its comments, and is read without the
lines that it refuses, so that a typing error is not charged a second time as missing documentation.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import PurePosixPath

from grader.evidence.text.comments import Comment, comments_of
from grader.evidence.text.syntax import blank_out, normalise, tree_of
from grader.evidence.text.words import is_placeholder, normal_form, substance, words
from grader.submission.python_source import parse_python

DOCSTRING_WORDS = 3
"""Distinct words from which a docstring says something."""

TRIVIAL_LINES = 3
"""A function this short, docstring aside, speaks for itself."""

_DEFINITION_LINE = re.compile(r" *(?:async +)?(?:def|class) +[^\W\d]\w*")
_NAME_PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")
_NEEDED = {"module": Decimal(1), "class": Decimal(2), "function": Decimal(1), "method": Decimal(1)}
_BONUS = Decimal("0.5")
#: Lines of a file that are left out for being no Python, and characters that are parsed to find them.
_MOST_REPAIRS, _MOST_PARSED = 20, 400_000
_EMPTY_BLOCK = re.compile(r"expected an indented block after .* on line (\d+)")


@dataclass(frozen=True)
class Definition:
    """A module, class, function or method."""

    #: "module", "class", "function" or "method".
    kind: str
    #: Its bare name; a module's is the file's without `.py`.
    name: str
    #: Where it begins.
    line: int
    #: Its docstring without indentation.
    docstring: str | None
    #: Whether neither its name nor that of what it stands in begins with an underscore, and it is not nested in
    #: a function.
    public: bool
    #: Whether it needs no explanation: `main`, special methods, bodies of a line or two.
    trivial: bool = False
    #: Name of the class or function that it stands in.
    owner: str | None = None

    @property
    def label(self) -> str:
        """How to name it to a reader, e.g. `method Arm.step`."""
        return f"{self.kind} {self.owner}.{self.name}" if self.owner else f"{self.kind} {self.name}"


@dataclass(frozen=True)
class SourceFacts:
    """What the text of one Python file says."""

    #: As given to `parse`.
    path: str
    #: In the order of their lines, the module first.
    definitions: tuple[Definition, ...]
    #: All comments, each with what it is worth.
    comments: tuple[Comment, ...]
    #: Lines with code on them; blank lines, comments and docstrings are none.
    code_lines: int
    #: Whether the definitions are known: Python takes the file, or all of it but for a few lines.
    readable: bool = True

    @property
    def explaining(self) -> tuple[Comment, ...]:
        """The comments that explain."""
        return tuple(comment for comment in self.comments if comment.kind == "explains")


def parse(path: str, text: str) -> SourceFacts:
    """Read the Python file `text`, which stands at `path` in the submission. Never raises."""
    whole = normalise(text)
    blank = blank_out(whole)
    tree = tree_of(whole) or _repaired(whole, blank)
    module = path.rsplit("/", 1)[-1].removesuffix(".py")
    definitions = list(_definitions(module, tree or ast.Module([], [])))
    docstring_lines = _docstring_lines(tree) if tree is not None else set()
    comments = comments_of(whole, blank)
    first_code = next((number for number, line in enumerate(blank.split("\n"), 1) if line.strip()), 0)
    header = [c.text for c in comments if c.line < first_code and c.kind == "explains"]
    if header and definitions[0].docstring is None:
        definitions[0] = replace(definitions[0], docstring="\n".join(header))
    code_lines = sum(
        1 for number, line in enumerate(blank.split("\n"), 1) if line.strip() and number not in docstring_lines
    )
    return SourceFacts(path, tuple(definitions), comments, code_lines, tree is not None)


def _repaired(text: str, blank: str) -> ast.Module | None:
    """Tree of a text that Python refuses, without what it refuses; None where that is more than slips of typing."""
    lines, bare = text.replace("\0", " ").expandtabs(4).split("\n"), blank.split("\n")
    replaced: set[int] = set()
    for _ in range(min(_MOST_REPAIRS, 1 + _MOST_PARSED // (len(text) + 1))):
        try:
            return parse_python("\n".join(lines))
        except SyntaxError as problem:
            empty = _EMPTY_BLOCK.search(problem.msg)
            at = int(empty[1]) - 1 if empty else (problem.lineno or 0) - 1
        except (ValueError, RecursionError, MemoryError):
            return None
        if not 0 <= at < len(lines):
            return None
        head = _DEFINITION_LINE.match(lines[at])
        indent = _indent(lines[at])
        if empty:
            lines[at] = f"{bare[at]} pass"
        elif at in replaced:
            lines[at] = ""
        elif head is not None:
            lines[at] = f"{head[0]}():"
        else:
            below = next((line for line in lines[at + 1 :] if line.strip()), "")
            lines[at] = " " * indent + ("if 1:" if _indent(below) > indent else "pass")
        replaced.add(at)
    return None


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _definitions(module: str, tree: ast.Module) -> Iterator[Definition]:
    """Definitions of a tree in the order of their lines; without recursion, as trees may be deep."""
    yield Definition("module", module, 1, ast.get_docstring(tree), True, not tree.body)
    stack: list[tuple[ast.AST, ast.AST | None, bool]] = [(tree, None, True)]
    while stack:
        node, owner, public = stack.pop()
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield _definition(node, owner, public)
            owner, public = node, public and isinstance(node, ast.ClassDef) and not node.name.startswith("_")
        inner = [child for child in ast.iter_child_nodes(node) if not isinstance(child, ast.expr)]
        stack += [(child, owner, public) for child in reversed(inner)]


def _definition(
    node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef, owner: ast.AST | None, public: bool
) -> Definition:
    body = node.body[1:] if ast.get_docstring(node) is not None else node.body
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
        docstring=ast.get_docstring(node),
        public=public and (not node.name.startswith("_") or _is_self_evident(node.name)),
        trivial=trivial,
        owner=name if isinstance(name, str) else None,
    )


def _is_self_evident(name: str) -> bool:
    return name == "main" or (name.startswith("__") and name.endswith("__"))


def _docstring_lines(tree: ast.Module) -> set[int]:
    """Lines taken by strings that stand alone as statements: docstrings and strings used as comments."""
    return {
        line
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }


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
    """How much of a submission's definitions is documented."""

    #: Weight of what is documented over weight of what should be, from 0 to 1.
    share: Decimal
    #: Definitions that should be documented: those that are, and all.
    documented: int
    needed: int
    #: Definitions that should be documented and are not.
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

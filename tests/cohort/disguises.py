"""Twenty-two ways to disguise a copied program, each a rewriting of a submission's Python files.

The ways are named in the papers on JPlag (Prechelt, Malpohl, Philippsen 2002: lexical and structural changes that its
authors found in real copies, and attacks that they thought of) and on MOSS (Schleimer, Wilkerson, Aiken 2003: blanks,
names, moved and partial copies). Each is carried out as thoroughly as a program can: it changes every possible place.
The result is Python; its behaviour is not checked.
"""

from __future__ import annotations

import ast
import builtins
import copy
import io
import keyword
import tokenize
from collections.abc import Callable, Iterator
from itertools import count

Files = dict[str, str]
Disguise = Callable[[Files], Files]


def _each(change: Callable[[ast.Module], ast.AST]) -> Disguise:
    """Return the disguise that changes the syntax tree of each file."""

    def disguise(files: Files) -> Files:
        trees = {}
        for path, text in files.items():
            trees[path] = ast.fix_missing_locations(change(ast.parse(text)))
        return {path: ast.unparse(tree) + "\n" for path, tree in trees.items()}

    return disguise


def _transformed(transformer: Callable[[], ast.NodeTransformer]) -> Disguise:
    return _each(lambda tree: transformer().visit(tree))


def _in_bodies(change: Callable[[list[ast.stmt]], list[ast.stmt]]) -> Disguise:
    """Return the disguise that changes each list of statements, the innermost first."""

    def changed(tree: ast.Module) -> ast.AST:
        for node in reversed(list(ast.walk(tree))):
            for name in ("body", "orelse", "finalbody"):
                if isinstance(old := getattr(node, name, None), list) and old:
                    setattr(node, name, change(old))
        return tree

    return _each(changed)


def _is_docstring(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.Expr):
        return False
    return isinstance(statement.value, ast.Constant)


def _simple(statement: ast.stmt) -> bool:
    kinds = (ast.Assign, ast.AugAssign, ast.Expr, ast.AnnAssign)
    if not isinstance(statement, kinds):
        return False
    return not _is_docstring(statement)


def _statement(text: str) -> ast.stmt:
    return ast.parse(text).body[0]


# -- changes that keep the program's form ----------------------------------------------------------


def _reformatted(files: Files) -> Files:
    """Break lines behind each comma, indent by two, and leave a blank line behind each line."""

    def broken(text: str) -> Iterator[str]:
        depth = brackets = 0
        for token in tokenize.generate_tokens(io.StringIO(ast.unparse(ast.parse(text))).readline):
            brackets += (token.string in ("(", "[", "{")) - (token.string in (")", "]", "}"))
            if token.type in (tokenize.INDENT, tokenize.DEDENT):
                depth += 1 if token.type == tokenize.INDENT else -1
            elif token.type in (tokenize.NEWLINE, tokenize.NL):
                yield "\n\n"
            elif token.type != tokenize.ENDMARKER:
                yield ("  " * depth if token.start[1] == 4 * depth else " ") + token.string
                yield "\n" if token.string == "," and brackets else ""

    return {path: "".join(broken(text)) for path, text in files.items()}


def _uncommented(body: list[ast.stmt]) -> list[ast.stmt]:
    return [s for s in body if not _is_docstring(s)] or [ast.Pass()]


def _commented(files: Files) -> Files:
    """Write a comment above each logical line."""

    def lines(text: str) -> Iterator[str]:
        for number, line in enumerate(ast.unparse(ast.parse(text)).splitlines()):
            indent = line[: len(line) - len(line.lstrip())]
            yield f"{indent}# step {number}: now comes what is needed for this part of the lab"
            yield f"{line}  # see the sheet"

    # Texts of several lines would take the comments in.
    bare = _in_bodies(_uncommented)(files)
    return {path: "\n".join(lines(text)) + "\n" for path, text in bare.items()}


class _Texts(ast.NodeTransformer):
    """Writes other texts, as in another language; names of topics and nodes stay."""

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if isinstance(node.value, str) and (" " in node.value or "\n" in node.value):
            return ast.Constant(f"Hinweis {len(node.value)}: so geht es weiter")
        return node


class _Numbers(ast.NodeTransformer):
    """Changes each number a little."""

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        is_number = isinstance(node.value, (int, float)) and not isinstance(node.value, bool)
        return ast.Constant(node.value + 1) if is_number else node  # type: ignore[operator]


def _own_names(tree: ast.AST) -> dict[str, str]:
    """Return another name for each that the program itself binds."""
    bound = []
    for n in ast.walk(tree):
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store):
            bound.append(n.id)
    bound += [n.arg for n in ast.walk(tree) if isinstance(n, ast.arg) and n.arg != "self"]
    own = [n for n in dict.fromkeys(bound) if not hasattr(builtins, n) and not keyword.iskeyword(n)]
    return {name: f"{'abcdefghij'[k % 10]}{k}_wert" for k, name in enumerate(own)}


class _Variables(ast.NodeTransformer):
    """Renames all variables and parameters."""

    def __init__(self, names: dict[str, str]) -> None:
        self.names = names

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.Name(self.names.get(node.id, node.id), node.ctx)

    def visit_arg(self, node: ast.arg) -> ast.AST:
        self.generic_visit(node)
        return ast.arg(self.names.get(node.arg, node.arg), node.annotation)


def _definitions(tree: ast.AST) -> dict[str, str]:
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    own = [n.name for n in ast.walk(tree) if isinstance(n, kinds) and not n.name.startswith("__")]
    own += [
        n.attr
        for n in ast.walk(tree)
        if isinstance(n, ast.Attribute)
        and isinstance(n.ctx, ast.Store)
        and isinstance(n.value, ast.Name)
    ]
    return {name: f"Teil{k}" for k, name in enumerate(dict.fromkeys(own))}


class _Definitions(_Variables):
    """Renames all functions, classes and attributes."""

    def visit(self, node: ast.AST) -> ast.AST:
        for part in ("name", "attr"):
            if isinstance(old := getattr(node, part, None), str):
                setattr(node, part, self.names.get(old, old))
        return super().visit(node)  # type: ignore[no-any-return]


def _annotated(tree: ast.Module) -> ast.AST:
    """Annotate each parameter, result and plain assignment."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            node.returns = ast.Name("object")
            for each in node.args.args:
                each.annotation = each.annotation or ast.Name("object")

    class Annotate(ast.NodeTransformer):
        def visit_Assign(self, node: ast.Assign) -> ast.AST:
            if len(node.targets) == 1 and isinstance(node.targets[0], (ast.Name, ast.Attribute)):
                return ast.AnnAssign(node.targets[0], ast.Name("object"), node.value, 1)
            return node

    return Annotate().visit(tree)  # type: ignore[no-any-return]


# -- moved parts -----------------------------------------------------------------------------------


def _imports_changed(tree: ast.Module) -> ast.AST:
    """Turn the imports round, one line each, between others that nothing uses."""
    imports = [s for s in tree.body if isinstance(s, (ast.Import, ast.ImportFrom))]
    single = []
    for s in imports:
        for name in s.names:
            single.append(
                ast.ImportFrom(s.module, [name], s.level)
                if isinstance(s, ast.ImportFrom)
                else ast.Import([name])
            )
    extra = [
        _statement(f"import {name}")
        for name in ("os", "sys", "json", "random", "typing", "itertools")
    ]
    tree.body = [
        *extra[:3],
        *reversed(single),
        *extra[3:],
        *(s for s in tree.body if s not in imports),
    ]
    return tree


def _definitions_reordered(body: list[ast.stmt]) -> list[ast.stmt]:
    """Turn the order of the methods of a class, and of the definitions of a module, round."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    places = [n for n, s in enumerate(body) if isinstance(s, kinds)]
    found = list(body)
    for place, other in zip(places, reversed(places), strict=True):
        found[place] = body[other]
    return found


def _names_in(statement: ast.stmt) -> set[str]:
    names = {n.id for n in ast.walk(statement) if isinstance(n, ast.Name)} - {"self", "node"}
    return names | {n.attr for n in ast.walk(statement) if isinstance(n, ast.Attribute)}


def _statements_reordered(body: list[ast.stmt]) -> list[ast.stmt]:
    """Swap neighbours that share no name."""
    found, n = list(body), 0
    while n + 1 < len(found):
        one, other = found[n : n + 2]
        if _simple(one) and _simple(other) and not _names_in(one) & _names_in(other):
            found[n : n + 2] = other, one
            n += 1
        n += 1
    return found


def _split(files: Files) -> Files:
    """Move every second definition of each file into a file of its own."""
    found = {}
    for path, text in files.items():
        tree = ast.parse(text)
        moved = [s for s in tree.body if isinstance(s, (ast.FunctionDef, ast.ClassDef))][::2]
        rest = [s for s in tree.body if s not in moved]
        found[path] = ast.unparse(ast.Module([_statement("from . import part"), *rest], [])) + "\n"
        for n, part in enumerate(moved):
            found[path.replace(".py", f"_part{n}.py")] = ast.unparse(part) + "\n"
    return found


def _merged(files: Files) -> Files:
    """Put all files into one."""
    return {"all_in_one.py": "\n\n".join(text for _, text in sorted(files.items(), reverse=True))}


# -- additions -------------------------------------------------------------------------------------


def _between(texts: Callable[[int], str], each: int) -> Callable[[list[ast.stmt]], list[ast.stmt]]:
    """Return a transformer that inserts a statement after every few others."""

    def inserted(body: list[ast.stmt]) -> list[ast.stmt]:
        found: list[ast.stmt] = []
        for n, statement in enumerate(body, 1):
            found.append(statement)
            if (
                n % each == 0
                and n < len(body)
                and not isinstance(statement, (ast.Import, ast.ImportFrom))
            ):
                found.append(_statement(texts(n)))
        return found

    return inserted


_DEAD_FUNCTION = """
def unused_{n}(values, limit={n}):
    best = None
    for index, value in enumerate(values):
        if value > limit and (best is None or value < best):
            best = value - index
    return best
"""


def _dead_functions(body: list[ast.stmt]) -> list[ast.stmt]:
    """Put a function that nothing calls before each that there is."""
    numbers = count(1)
    found: list[ast.stmt] = []
    for statement in body:
        if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            found.append(_statement(_DEAD_FUNCTION.format(n=next(numbers))))
        found.append(statement)
    return found


# -- changes of structure --------------------------------------------------------------------------


def _outlined(body: list[ast.stmt]) -> list[ast.stmt]:
    """Put the second half of each longer body into a function that is called there."""
    if len(body) < 4:
        return body
    if not any(map(_simple, body)):
        return body
    if any(isinstance(s, ast.ClassDef) for s in body):
        return body
    if any(
        isinstance(s, (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.AsyncFunctionDef))
        for s in body
    ):
        return body
    half = len(body) // 2
    part = _statement("def carry_on():\n    pass")
    assert isinstance(part, ast.FunctionDef)
    part.body = body[half:]
    return [*body[:half], part, _statement("return carry_on()")]


class _Inlined(ast.NodeTransformer):
    """Replaces the calls of a function without parameters by its statements, and removes it."""

    def __init__(self, tree: ast.AST) -> None:
        calls = []
        for n in ast.walk(tree):
            if isinstance(n, ast.Expr) and isinstance(n.value, ast.Call):
                calls.append(n.value.func)
        called = [getattr(f, "attr", getattr(f, "id", "")) for f in calls]
        kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
        own = {n.name: n for n in ast.walk(tree) if isinstance(n, kinds)}
        self.own = {name: own[name] for name in called if name in own and called.count(name) == 1}

    def visit_Expr(self, node: ast.Expr) -> ast.AST | list[ast.stmt]:
        if isinstance(node.value, ast.Call):
            function = node.value.func
        else:
            function = None
        target = self.own.get(getattr(function, "attr", getattr(function, "id", "")))
        if target:
            return [copy.deepcopy(s) for s in target.body if not _is_docstring(s)]
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST | None:
        self.generic_visit(node)
        return None if self.own.get(node.name) is node else node


class _Loops(ast.NodeTransformer):
    """Writes `for` as `while`, and comprehensions as calls."""

    def visit_For(self, node: ast.For) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        steps = _statement(
            "while True:\n    try:\n        item = next(walk)\n    except StopIteration:\n        break"
        )
        assert isinstance(steps, ast.While)
        take = ast.Assign([node.target], ast.Name("item", ast.Load()))
        steps.body += [take, *node.body]
        start = ast.Assign(
            [ast.Name("walk", ast.Store())], ast.Call(ast.Name("iter", ast.Load()), [node.iter], [])
        )
        return [start, steps]

    def visit_ListComp(self, node: ast.ListComp) -> ast.AST:
        self.generic_visit(node)
        return ast.Call(
            ast.Name("list", ast.Load()), [ast.GeneratorExp(node.elt, node.generators)], []
        )


_TURNED = {
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.GtE,
    ast.GtE: ast.LtE,
    ast.Eq: ast.Eq,
    ast.NotEq: ast.NotEq,
}


class _Conditions(ast.NodeTransformer):
    """Turns each condition round, with its branches."""

    def visit_If(self, node: ast.If) -> ast.AST:
        self.generic_visit(node)
        return ast.If(ast.UnaryOp(ast.Not(), node.test), node.orelse or [ast.Pass()], node.body)

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        return ast.IfExp(ast.UnaryOp(ast.Not(), node.test), node.orelse, node.body)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        self.generic_visit(node)
        if len(node.ops) == 1 and type(node.ops[0]) in _TURNED:
            return ast.Compare(node.comparators[0], [_TURNED[type(node.ops[0])]()], [node.left])
        return node


class _Expressions(ast.NodeTransformer):
    """Writes `a += b` as `a = a + b`, turns sums and products round, and writes products with 1."""

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        self.generic_visit(node)
        value = copy.deepcopy(node.target)
        value.ctx = ast.Load()
        return ast.Assign([node.target], ast.BinOp(node.value, node.op, value))

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, (ast.Add, ast.Mult)):
            return ast.BinOp(node.right, node.op, node.left)
        return node


def _with_temporaries(body: list[ast.stmt]) -> list[ast.stmt]:
    """Compute the arguments of each call before it, in variables of their own."""
    found: list[ast.stmt] = []
    for statement in body:
        if isinstance(statement, (ast.Assign, ast.Expr)):
            value = statement.value
        else:
            value = None
        for n, argument in enumerate(value.args if isinstance(value, ast.Call) else ()):
            if isinstance(argument, (ast.Call, ast.BinOp, ast.List, ast.Attribute, ast.JoinedStr)):
                found.append(ast.Assign([ast.Name(f"tmp{n}", ast.Store())], argument))
                value.args[n] = ast.Name(f"tmp{n}", ast.Load())  # type: ignore[union-attr]
        found.append(statement)
    return found


def _partial(files: Files) -> Files:
    """Take over only the larger half of it: the larger definitions."""
    found = {}
    for path, text in files.items():
        tree = ast.parse(text)
        parts = [s for s in tree.body if isinstance(s, (ast.FunctionDef, ast.ClassDef))]
        parts.sort(key=lambda s: -len(ast.unparse(s)))
        found[path] = (
            ast.unparse(
                ast.Module([s for s in tree.body if s in parts[: (len(parts) + 1) // 2]], [])
            )
            + "\n"
        )
    return found


DISGUISES: dict[str, Disguise] = {
    "other layout": _reformatted,
    "comments and docstrings taken out": _in_bodies(_uncommented),
    "comments put in": _commented,
    "texts translated": _transformed(_Texts),
    "numbers changed": _transformed(_Numbers),
    "variables renamed": _each(lambda tree: _Variables(_own_names(tree)).visit(tree)),
    "functions and classes renamed": _each(
        lambda tree: _Definitions(_definitions(tree)).visit(tree)
    ),
    "types annotated": _each(_annotated),
    "imports changed": _each(_imports_changed),
    "definitions reordered": _in_bodies(_definitions_reordered),
    "statements reordered": _in_bodies(_statements_reordered),
    "files split": _split,
    "files merged": _merged,
    "output put in": _in_bodies(_between(lambda n: f"print('so far', {n})", 2)),
    "dead code put in": _in_bodies(_between(lambda n: f"if False:\n    spare_{n} = [{n}]", 2)),
    "dead functions put in": _in_bodies(_dead_functions),
    "functions outlined": _in_bodies(_outlined),
    "functions inlined": _each(lambda tree: _Inlined(tree).visit(tree)),
    "loops rewritten": _transformed(_Loops),
    "conditions turned": _transformed(_Conditions),
    "expressions rewritten": lambda files: _in_bodies(_with_temporaries)(
        _transformed(_Expressions)(files)
    ),
    "only half copied": _partial,
}

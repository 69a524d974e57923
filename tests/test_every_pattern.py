"""No regular expression of the grader takes time that grows faster than a text; they are found, not listed."""

from __future__ import annotations

import ast
import builtins
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import pytest

from grader.bounded import Bound, in_processes
from tests.hard_for_patterns import hard_texts
from tests.packages import modules

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
#: Function -> where its flags stand among the arguments.
FUNCTIONS = {
    **dict.fromkeys(("search", "match", "fullmatch", "findall", "finditer"), 2),
    **{"compile": 1, "split": 3, "sub": 4, "subn": 4},
}
CHARACTERS = 3000
#: Less is no wait, and too little to be compared: a pattern takes it for every fourth pair of characters.
SOON_S = 0.0025
#: Limit of the ratio of times for a fourfold text: 4 for linear time, 16 for quadratic.
MOST_TIMES = 9.0
#: In each, a part of them is tried.
PROCESSES = 12
BOUND = Bound("trying it", cpu_s=10.0, wall_s=120.0, memory_bytes=2**30)


@dataclass(frozen=True)
class Use:
    """A regular expression in the source, and how it is used."""

    place: str
    pattern: str
    flags: int
    how: frozenset[str]


class _Names(dict[str, Any]):
    """Names as far as they can be known without running anything.

    An unknown name may be any word.
    """

    def __init__(self, module: Mapping[str, Any]) -> None:
        super().__init__()
        self.module = module

    def __missing__(self, name: str) -> Any:
        return self.module.get(name, getattr(builtins, name, "x"))


def uses() -> Iterator[Use]:
    """Find all regular expressions in the source."""
    texts = {path: path.read_text(encoding="utf-8") for path in modules()}
    everything = "\n".join(texts.values())
    for path, text in texts.items():
        tree = ast.parse(text)
        calls = {
            node: name
            for node in _nodes(tree)
            if isinstance(node, ast.Call) and (name := _function(node))
        }
        module = _constants(tree) if calls else {}
        for call in calls:
            names = _names_at(call, tree, module)
            place = f"{path.relative_to(ROOT)}:{call.lineno}"
            position = FUNCTIONS[calls[call]]
            given = [k.value for k in call.keywords if k.arg == "flags"] + call.args[
                position : position + 1
            ]
            for node in _passed(call, tree):
                with suppress(
                    AttributeError, TypeError
                ):  # The pattern comes from elsewhere: from a file, or out of an object.
                    flags = int(_value(given[0], names)) if given else 0
                    pattern = _value(node, names)
                    if isinstance(pattern, bytes):
                        pattern = pattern.decode("latin-1")
                    yield Use(place, pattern, flags, _how(call, tree, everything))


@cache
def _nodes(tree: ast.Module) -> Sequence[ast.AST]:
    return list(ast.walk(tree))


def _around(call: ast.Call, tree: ast.Module) -> list[ast.FunctionDef]:
    """Return the functions that a call stands in."""
    functions = [node for node in _nodes(tree) if isinstance(node, ast.FunctionDef)]
    return [node for node in functions if node.lineno <= call.lineno <= (node.end_lineno or 0)]


def _passed(call: ast.Call, tree: ast.Module) -> list[ast.expr]:
    """Return the pattern of a call; for a parameter of the function, the arguments of its calls."""
    pattern = call.args[0]
    for node in _around(call, tree):
        names = [argument.arg for argument in node.args.args]
        if isinstance(pattern, ast.Name) and pattern.id in names:
            place, callers = (
                names.index(pattern.id),
                (n for n in _nodes(tree) if isinstance(n, ast.Call)),
            )
            inside = []
            for n in callers:
                if ast.unparse(n.func) == node.name and len(n.args) > place:
                    inside.append(n)
            return [n.args[place] for n in inside]
    return [pattern]


def _function(call: ast.Call) -> str:
    """Return the function of `re` that is called; nothing if it is another's."""
    module, _, name = ast.unparse(call.func).rpartition(".")
    return name if module == "re" and name in FUNCTIONS else ""


def _value(node: ast.expr, names: _Names) -> Any:
    return eval(compile(ast.Expression(node), "", "eval"), {}, names)


def _constants(tree: ast.Module) -> Mapping[str, Any]:
    """Return a module's imports, and its constants as far as they depend on nothing else in it."""
    module: dict[str, Any] = {}
    for node in tree.body:
        if isinstance(node, (ast.Import, ast.ImportFrom, ast.Assign, ast.AnnAssign)):
            with suppress(Exception):
                exec(compile(ast.Module([node], []), "", "exec"), module)
    return module


def _names_at(call: ast.Call, tree: ast.Module, module: Mapping[str, Any]) -> _Names:
    """Return the known names at a call: module constants, and earlier ones of its function."""
    names = _Names(module)
    for node in _around(call, tree):
        for inner in ast.walk(node):
            if isinstance(inner, ast.Assign) and inner.lineno < call.lineno:
                target = inner.targets[0]
                with suppress(Exception):
                    if isinstance(target, ast.Name):
                        names[target.id] = _value(inner.value, names)
    return names


def _how(call: ast.Call, tree: ast.Module, everything: str) -> frozenset[str]:
    """Return the functions that use a pattern; both matching functions if this cannot be told."""
    if (function := _function(call)) != "compile":
        return frozenset({function})
    named = []
    for n in tree.body:
        if isinstance(n, ast.Assign) and n.value is call:
            named.append(ast.unparse(n.targets[0]))
    if named and named[0].startswith("_"):
        where = ast.unparse(tree)
    else:
        where = everything
    if named:
        found = re.findall(rf"\b{named[0]}\.(\w+)\b", where)
    else:
        found = []
    return frozenset(FUNCTIONS.keys() & found) or frozenset({"match", "fullmatch"})


def slowness(use: Use) -> str:
    """Return a description of a text that makes a pattern too slow; empty if there is none."""
    compiled = re.compile(use.pattern, use.flags)
    for begin, again, end in hard_texts(use.pattern, use.flags):
        text, quarter = (
            begin + (again * size)[:size] + end for size in (CHARACTERS, CHARACTERS // 4)
        )
        for how in use.how:
            if _took_s(compiled, how, text) > SOON_S:
                short_s = min(_took_s(compiled, how, quarter) for _ in range(4))
                # The machine may be busy with something else, which takes longer, never less long.
                least_s = max(SOON_S, MOST_TIMES * short_s)
                long_s = next(
                    (s for _ in range(4) if (s := _took_s(compiled, how, text)) <= least_s), None
                )
                if long_s is None:
                    return f"{how}: {begin!r} {again!r} {end!r} takes over {least_s:.3f} s, a quarter {short_s:.4f} s"
    return ""


def slow_ones(uses: Sequence[Use]) -> list[str]:
    """Return a description of each slow pattern and its text."""
    return [_describe(use, told) for use in uses if (told := slowness(use))]


def _describe(use: Use, told: object) -> str:
    return f"{use.place} {use.pattern!r}\n  {told}"


def _took_s(compiled: re.Pattern[str], how: str, text: str) -> float:
    began_s = time.thread_time()
    if how in ("sub", "subn"):
        compiled.sub("", text)
    elif how == "finditer":
        list(compiled.finditer(text))
    else:
        getattr(compiled, how)(text)
    return time.thread_time() - began_s


def test_no_pattern_takes_longer_than_its_text_is_long() -> None:
    """The hardest text of 3,000 characters takes no longer than a few texts of 750."""
    found = list({(use.pattern, use.flags, use.how): use for use in uses()}.values())
    assert len(found) > 150
    slow, parts = [], [found[n::PROCESSES] for n in range(PROCESSES)]
    tried = {n: partial(slow_ones, some) for n, some in enumerate(parts)}
    for n, told in in_processes(tried, BOUND, at_a_time=2):
        if isinstance(told, Exception):  # One of them has no end.
            each = in_processes(
                {use: partial(slowness, use) for use in parts[n]}, BOUND, at_a_time=2
            )
            told = [_describe(use, problem) for use, problem in each if problem]
        slow += told
    assert not slow, "\n" + "\n".join(sorted(slow))


def test_slow_patterns_are_noticed() -> None:
    """Patterns known to be slow are found: quadratic ones and exponential ones."""
    for pattern, how in (
        (r"\s+$", "search"),
        (r"(\w*)*\d", "match"),
        (r"\w+\d+\w+x", "fullmatch"),
        (r"<[^>]*>", "sub"),
    ):
        ((_, told),) = in_processes(
            {0: partial(slowness, Use("", pattern, 0, frozenset({how})))}, replace(BOUND, cpu_s=1.0)
        )
        assert told, pattern

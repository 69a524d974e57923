"""Signal temporal logic: meaning of the operators, refused texts, and the largest property."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.recorded import Floats
from grader.evidence.temporal_logic import Property, TooShortError

SIGNALS = ("x", "y")


def value(text: str, x: Any, y: Any = (), step_s: float = 1.0) -> float:
    """Give the robustness of a property."""
    signals = {"x": np.array(x, dtype=float), "y": np.array(y if len(y) else x, dtype=float)}
    return Property.parse(text, SIGNALS).robustness(signals, step_s).value


@pytest.mark.parametrize(
    ("text", "robustness"),
    [
        ("x < 3", 2),
        ("x >= 3", -2),
        ("0 <= x <= 3", 1),
        ("not x > 3", 2),
        ("x > 0 and x < 3", 1),
        ("x > 4 or x < 3", 2),
        ("implies(x > 0, x < 3)", 2),
        ("always(x < 5)", 1),
        ("eventually(x > 3)", 1),
        ("always[0, 2](x < 5)", 2),
        ("eventually[1, 1](x > 0)", 2),
        ("until(x < 4, x > 3)", 1),
        ("until[1, 2](x < 4, x > 2.5)", 0.5),
        ("abs(x - 2) <= max(1, 0.5) * 2", 1),
        ("min(x, 3) > -1 / 2", 1.5),
    ],
)
def test_each_operator_means_what_is_written(text: str, robustness: float) -> None:
    """Over 1, 2, 3, 4, from the first step on."""
    assert value(text, [1, 2, 3, 4]) == pytest.approx(robustness)


def test_equal_numbers_are_told_apart_by_the_comparison() -> None:
    """1 >= 1 holds and 1 > 1 does not, so that a condition on a switch is one."""
    assert value("x >= 1", [1]) > 0
    assert value("x > 1", [1]) < 0
    assert value("always(implies(x >= 1, y > 5))", [0, 1], [0, 0]) < -1e-13


def test_the_moment_that_decides_is_found() -> None:
    """The worst step of an `always` is found through any formula around it."""
    x = np.array([0.0, 0.3, 0.9, 0.2])
    found = Property.parse("always(x < 0.5) and eventually(x > 0.1)", ["x"]).robustness(
        {"x": x}, 0.1
    )
    assert found.worst == 2
    assert found.value == pytest.approx(-0.4)


def test_a_condition_that_never_held_is_named() -> None:
    """An implication without its condition says nothing."""
    signals = {"x": np.array([0.0, 1.0]), "y": np.array([9.0, 9.0])}
    read = Property.parse(
        "always(implies(x > 2, y < 1)) and always(implies(x > 0.5, y > 1))", SIGNALS
    )
    assert read.robustness(signals, 1.0).never == ("x > 2",)


def test_what_lies_beyond_the_end_is_not_asked() -> None:
    """A condition in the last two seconds has no answer yet, and is not held against anybody."""
    text = "always(implies(x > 0.5, eventually[0, 2](y > 0.5)))"
    assert value(text, [0, 0, 0, 0, 1], [0, 0, 0, 0, 0]) > 0
    assert value(text, [0, 0, 1, 0, 0], [0, 0, 0, 0, 0]) < 0
    with pytest.raises(TooShortError):
        value("always[0, 9](x > 0)", [1, 1])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("always(z < 1)", "there is no signal 'z', only x, y"),
        ("alwys(x < 1)", "did you mean 'always'?"),
        ("always(x)", "neither true nor false"),
        ("x == 1", "write abs(a - b)"),
        ("always(x < 1", "not a property at character 7"),
        ("always[2, 1](x < 1)", "bounds must be finite, with 0 <= start <= end"),
        ("always[0](x < 1)", "bounds must be two numbers"),
        ("abs[0, 1](x) < 1", "abs takes no bounds"),
        ("until(x < 1)", "until takes 2 arguments (at character 1"),
        ("x < 'a'", "(at character 5: 'a')"),
        ("x < True", "a number is expected"),
        ("(lambda: x < 1)()", "this cannot be called"),
        ("x < x.real", "a number is expected"),
        ("__import__('os') < 1", "there is no numeric function"),
        ("(" * 300 + "x < 1" + ")" * 300, "not a property"),
        ("-" * 1990 + "x < 1", "not a property"),
        ("x < 1 and " * 300 + "x < 1", "at most 2000 characters"),
    ],
)
def test_what_is_no_property_is_refused_with_its_place(text: str, words: str) -> None:
    """Before anything runs."""
    with pytest.raises(ValueError) as caught:
        Property.parse(text, SIGNALS)
    assert words in str(caught.value)


# -- against the definition ------------------------------------------------------------------------

_ATOMS = st.sampled_from(["x <= {}", "y > {}", "x + y < {}", "abs(x) >= {}"])
_LEAVES = st.builds(str.format, _ATOMS, st.floats(-1, 1).map(lambda v: round(v, 1)))
_BOUNDS = st.tuples(st.integers(0, 2), st.integers(0, 2)).map(lambda b: f"[{b[0]}, {b[0] + b[1]}]")


def _grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    some_bounds = st.one_of(st.just(""), _BOUNDS)
    return st.one_of(
        st.builds("({} and {})".format, inner, inner),
        st.builds("({} or {})".format, inner, inner),
        st.builds("(not {})".format, inner),
        st.builds("implies({}, {})".format, inner, inner),
        st.builds("{}{}({})".format, st.sampled_from(["always", "eventually"]), some_bounds, inner),
        st.builds("until{}({}, {})".format, some_bounds, inner, inner),
    )


def defined(node: Any, x: Floats, y: Floats, t: int) -> float:
    """Return the robustness at a step by its definition, with as many later steps as are asked for."""

    def of(part: Any, at: int) -> float:
        return defined(part, x, y, at)

    if isinstance(node, ast.Compare):
        return _margin(node, float(x[t]), float(y[t]))
    if isinstance(node, ast.UnaryOp):
        return -of(node.operand, t)
    if isinstance(node, ast.BoolOp):
        values = [of(value, t) for value in node.values]
        return min(values) if isinstance(node.op, ast.And) else max(values)
    name = _name_called(node)
    if name == "implies":
        return max(-of(node.args[0], t), of(node.args[1], t))
    steps = _steps_within(node, t)
    if name == "until":
        return max(_until(node, of, t, step) for step in steps)
    values = [of(node.args[0], step) for step in steps]
    return min(values) if name == "always" else max(values)


def _margin(node: ast.Compare, x: float, y: float) -> float:
    """Return by how much a comparison holds."""
    sides = []
    for side in (node.left, *node.comparators):
        code = compile(ast.Expression(side), "", "eval")
        sides.append(float(eval(code, {"x": x, "y": y, "abs": abs})))
    left, right = sides
    is_less = isinstance(node.ops[0], (ast.Lt, ast.LtE))
    return right - left if is_less else left - right


def _name_called(node: Any) -> str:
    """Return the name of an operator, e.g. `until` of `until[0, 2](...)`."""
    called: Any = node.func.value if isinstance(node.func, ast.Subscript) else node.func
    return str(called.id)


def _steps_within(node: Any, t: int) -> range:
    """Return the steps within an operator's bounds, and all later ones without bounds."""
    low, high = 0, _AT_REST - t
    if isinstance(node.func, ast.Subscript):
        low, high = ast.literal_eval(node.func.slice)
    return range(t + low, max(t + low, t + high) + 1)


def _until(node: Any, of: Callable[[Any, int], float], t: int, step: int) -> float:
    """Return the robustness of `until` if its second part counts at one step."""
    before = [of(node.args[0], each) for each in range(t, step)]
    return min([of(node.args[1], step), *before])


#: From this step on the signals rest, so that it is all the same how far one looks.
_AT_REST = 4


@given(
    st.recursive(_LEAVES, _grown, max_leaves=4), st.lists(st.floats(-2, 2), min_size=8, max_size=8)
)
def test_the_robustness_is_that_of_the_definition(text: str, drawn: list[float]) -> None:
    """Windows and rewriting give the robustness of the definition, for any nesting."""
    x, y = np.zeros(40), np.zeros(40)
    x[:_AT_REST], y[:_AT_REST] = drawn[:_AT_REST], drawn[_AT_REST:]
    right = defined(ast.parse(text, mode="eval").body, x, y, 0)
    assert value(text, x, y) == pytest.approx(right, abs=1e-9)


@given(st.text(max_size=40))
def test_any_text_is_a_property_or_refused(text: str) -> None:
    """By ValueError alone."""
    try:
        Property.parse(text, SIGNALS)
    except ValueError as refused:
        assert str(refused)  # noqa: PT017


def test_long_signals_take_no_long_time() -> None:
    """A hundred thousand samples with wide windows are a matter of a second, not of their product."""
    x = np.sin(np.arange(100_000) / 1000)
    text = "always[0, 300](eventually[0, 300](x > 0.9)) and until[100, 200](x < 2, x > 0.99)"
    found = Property.parse(text, ["x"]).robustness({"x": x}, 0.01)
    assert math.isfinite(found.value)

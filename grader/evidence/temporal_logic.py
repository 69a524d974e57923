"""Signal temporal logic over sampled signals: whether a property holds, and by how much (its robustness).

Properties are written as expressions of Python, which is what reads them:

    always(implies(distance < 0.5, eventually[0, 2](abs(speed) <= 0.05)))

- numbers: names of signals, + - * /, abs(x), min(x, y), max(x, y);
- comparisons: < <= > >=, also chained: -1 <= turn <= 1;
- not a, a and b, a or b, implies(a, b);
- always(a), eventually(a), until(a, b): b comes, and until then a holds; with bounds in s where these are written.

Time is discrete: signals are sampled at even steps, to which bounds are rounded. What an operator with bounds would
have to know of the time after the last sample is not asked; one without bounds looks as far as the last sample.

The robustness of a comparison is the difference of its sides, in their unit; positive where it holds. Of `not` it is
the negative, of `and` and `always` the least, of `or` and `eventually` the greatest.

The library rtamt is not used: its parser needs a Python before 3.13, and it does not tell which moment decides.

References
----------
A. Donzé and O. Maler: Robust satisfaction of temporal logic over real-valued signals, FORMATS 2010. The rewriting of a
bounded `until` is of A. Donzé, T. Ferrère and O. Maler: Efficient robust monitoring for STL, CAV 2013.
"""

from __future__ import annotations

import ast
import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from grader.evidence.recorded import Floats, Integers

#: Beyond this a property is no property, and might be nested too deeply.
_LONGEST = 2000
_BINARY: Mapping[type[ast.operator], np.ufunc] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
}
_FUNCTIONS: Mapping[str, np.ufunc] = {"abs": np.abs, "min": np.minimum, "max": np.maximum}
_TEMPORAL = ("always", "eventually", "until")
_OPERATORS = dict.fromkeys(("implies", *_TEMPORAL))
_OF_ONE = ("abs", "always", "eventually")
#: Robustness of a comparison of equal numbers, so that its sign tells whether it holds: 1 >= 1 does, 1 > 1 does not.
_LEAST = 1e-12


class TooShortError(ValueError):
    """The signals end before anything can be said of a property."""


@dataclass(frozen=True)
class Truth:
    """How far a formula holds from each step on, and at which step lies what decides that."""

    values: Floats
    where: Integers

    def __len__(self) -> int:
        return len(self.values)

    def cut(self, start: int, length: int) -> Truth:
        """Return a part of it."""
        return Truth(self.values[start : start + length], self.where[start : start + length])


@dataclass(frozen=True)
class Robustness:
    """How far a property holds from the first step on; positive where it does."""

    value: float
    #: The step at which that is decided.
    worst: int
    #: Conditions of implications, as they are written, that held at no step.
    never: tuple[str, ...]


@dataclass(frozen=True)
class Property:
    """A property that has been read."""

    text: str
    root: ast.expr

    @classmethod
    def parse(cls, text: str, signals: Iterable[str]) -> Property:
        """Read a property of some signals; raises ValueError, with the place in the text, if it is none."""
        if len(text) > _LONGEST:
            raise ValueError(f"a property has at most {_LONGEST} characters")
        try:
            root = ast.parse(text.strip(), mode="eval").body
            # Over one value of each, with steps so long that all bounds are 0: that refuses what is no property.
            _Evaluation({name: np.zeros(1) for name in signals}, np.inf, 1).truth(root)
        except (SyntaxError, RecursionError, MemoryError) as problem:
            place = f" at character {problem.offset}" if isinstance(problem, SyntaxError) else ""
            raise ValueError(
                f"not a property{place}: {getattr(problem, 'msg', problem)}"
            ) from problem
        return cls(text.strip(), root)

    def robustness(self, signals: Mapping[str, Floats], step_s: float) -> Robustness:
        """Evaluate it over signals, float64[n] each, at even steps; raises TooShortError where they end too early."""
        evaluation = _Evaluation(signals, step_s, len(next(iter(signals.values()))))
        truth = evaluation.truth(self.root)
        return Robustness(
            float(truth.values[0]), int(truth.where[0]), tuple(dict.fromkeys(evaluation.never))
        )


# -- reading ---------------------------------------------------------------------------------------


def _refuse(node: ast.AST, why: str) -> NoReturn:
    raise ValueError(
        f"{why} (at character {getattr(node, 'col_offset', 0) + 1}: {ast.unparse(node)[:60]})"
    )


def _known(node: ast.AST, name: str, known: Iterable[str], what: str) -> None:
    if name not in known:
        near = difflib.get_close_matches(name, list(known), n=1)
        _refuse(
            node, f"there is no {what} {name!r}" + (f"; did you mean {near[0]!r}?" if near else "")
        )


def _called(
    node: ast.Call, known: Mapping[str, Any], what: str
) -> tuple[str, tuple[float, float] | None]:
    """Return the name of what is called, one of those known, and its bounds in s."""
    function, bounds = node.func, None
    if isinstance(function, ast.Subscript):
        bounds, function = _bounds(function), function.value
    if not isinstance(function, ast.Name) or node.keywords:
        _refuse(node, "this cannot be called")
    name, count = function.id, 1 if function.id in _OF_ONE else 2
    _known(node, name, known, what)
    if bounds is not None and name not in _TEMPORAL:
        _refuse(node, f"{name} has no bounds")
    if len(node.args) != count:
        _refuse(node, f"{name} takes {count} argument{'s' * (count > 1)}")
    return name, bounds


def _bounds(node: ast.Subscript) -> tuple[float, float]:
    try:
        low, high = (float(value) for value in ast.literal_eval(node.slice))
    except (TypeError, ValueError, SyntaxError):
        _refuse(node, "bounds are two numbers in s, as in eventually[0, 2](...)")
    if not 0 <= low <= high < np.inf:
        _refuse(node, "bounds begin at 0 or later, and end no earlier")
    return low, high


# -- evaluating ------------------------------------------------------------------------------------


@dataclass
class _Evaluation:
    """One evaluation of a property; raises ValueError at what is none."""

    signals: Mapping[str, Floats]
    step_s: float
    count: int
    never: list[str] = field(default_factory=list)

    def number(self, node: ast.expr) -> Floats:
        if isinstance(node, ast.Name):
            _known(node, node.id, self.signals, "signal")
            return self.signals[node.id]
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            return np.full(self.count, float(node.value))  # type: ignore[arg-type]
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return -self.number(node.operand)
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            function, arguments = _BINARY[type(node.op)], [node.left, node.right]
        elif isinstance(node, ast.Call):
            name, _ = _called(node, _FUNCTIONS, "function of numbers")
            function, arguments = _FUNCTIONS[name], node.args
        else:
            _refuse(node, "a number is expected")
        with np.errstate(divide="ignore", invalid="ignore"):
            values: Floats = function(*map(self.number, arguments))
        return values

    def truth(self, node: ast.expr) -> Truth:
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return _negated(self.truth(node.operand))
        if isinstance(node, ast.BoolOp):
            return _pick(
                map(self.truth, node.values),
                np.less if isinstance(node.op, ast.And) else np.greater,
            )
        if isinstance(node, ast.Compare):
            return self._compared(node)
        if not isinstance(node, ast.Call):
            _refuse(node, "this is neither true nor false; compare it with something")
        name, bounds = _called(node, _OPERATORS, "operator")
        parts = [self.truth(argument) for argument in node.args]
        if name == "implies":
            self.never += [ast.unparse(node.args[0])] * (not (parts[0].values > 0).any())
            return _pick((_negated(parts[0]), parts[1]), np.greater)
        steps = (
            tuple(round(bound / self.step_s) for bound in bounds) if bounds is not None else None
        )
        if name == "until":
            return _until(parts[0], parts[1], steps)
        return _window(parts[0], steps, np.less if name == "always" else np.greater)

    def _compared(self, node: ast.Compare) -> Truth:
        sides = [self.number(side) for side in (node.left, *node.comparators)]
        parts = []
        for left, right, op in zip(sides, sides[1:], node.ops, strict=False):
            if not isinstance(op, (ast.Lt, ast.LtE, ast.Gt, ast.GtE)):
                _refuse(
                    node,
                    "numbers are compared by < <= > >=; for equal ones, write abs(a - b) <= 0.01",
                )
            values = right - left if isinstance(op, (ast.Lt, ast.LtE)) else left - right
            equal = _LEAST if isinstance(op, (ast.LtE, ast.GtE)) else -_LEAST
            # What is no number, as nought by nought, says nothing, and holds by no more than what is equal.
            values = np.where((values == 0) | np.isnan(values), equal, values)
            parts.append(Truth(values, np.arange(self.count)))
        return _pick(parts, np.less)


_Better = Callable[[Floats, Floats], np.typing.NDArray[np.bool_]]


def _negated(truth: Truth) -> Truth:
    return Truth(-truth.values, truth.where)


def _pick(parts: Iterable[Truth], better: _Better) -> Truth:
    """Return at each step the part that is better, the first of equal ones."""
    first, *others = parts
    for other in others:
        length = min(len(first), len(other))
        first, other = first.cut(0, length), other.cut(0, length)
        other_counts = better(other.values, first.values)
        first = Truth(
            *(
                np.where(other_counts, b, a)
                for a, b in zip(vars(first).values(), vars(other).values(), strict=True)
            )
        )
    return first


def _window(truth: Truth, steps: tuple[int, ...] | None, better: _Better) -> Truth:
    """Return the best within bounds after each step; without bounds, within all that follows."""
    if steps is None:
        padding = Truth(
            np.repeat(truth.values[-1:], len(truth) - 1),
            np.repeat(truth.where[-1:], len(truth) - 1),
        )
        truth = Truth(
            *(
                np.concatenate(pair)
                for pair in zip(vars(truth).values(), vars(padding).values(), strict=True)
            )
        )
        steps = (0, len(padding))
    start, width = steps[0], steps[1] - steps[0] + 1
    length = len(truth) - steps[1]
    if length <= 0:
        raise TooShortError
    covered, best = 1, truth
    while covered < width:  # Windows of twice the width from two that overlap.
        shift = min(covered, width - covered)
        best = _pick((best.cut(0, len(best) - shift), best.cut(shift, len(best))), better)
        covered += shift
    return best.cut(start, length)


def _until(holds: Truth, comes: Truth, steps: tuple[int, ...] | None) -> Truth:
    """Return how far one holds until the other comes, within bounds."""
    if steps is None:
        return _unbounded_until(holds, comes)
    parts = [_window(comes, steps, np.greater)]
    after = _unbounded_until(holds, comes)
    if steps[0] >= len(after):
        raise TooShortError
    parts.append(after.cut(steps[0], len(after)))
    if steps[0]:
        parts.append(_window(holds, (0, steps[0] - 1), np.less))
    return _pick(parts, np.less)


def _unbounded_until(holds: Truth, comes: Truth) -> Truth:
    length = min(len(holds), len(comes))
    values, where = comes.values[:length].copy(), comes.where[:length].copy()
    for n in range(length - 2, -1, -1):
        later, at = values[n + 1], where[n + 1]
        if holds.values[n] < later:
            later, at = holds.values[n], holds.where[n]
        if later > values[n]:
            values[n], where[n] = later, at
    return Truth(values, where)

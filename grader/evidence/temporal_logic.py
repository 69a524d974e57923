"""Signal temporal logic over sampled signals: truth of a property, and its margin (robustness).

Properties are written as expressions of Python, and parsed by it:

    always(implies(distance < 0.5, eventually[0, 2](abs(speed) <= 0.05)))

- numbers: names of signals, + - * /, abs(x), min(x, y), max(x, y);
- comparisons: < <= > >=, also chained: -1 <= turn <= 1;
- not a, a and b, a or b, implies(a, b);
- always(a), eventually(a), until(a, b): b comes, and until then a holds; with optional bounds in s.

Time is discrete: signals are sampled at even steps, and bounds are rounded to these. An operator with bounds is
evaluated only at steps for which its bounds lie within the samples; an operator without bounds ends at the last sample.

The robustness of a comparison is the difference of its sides, in their unit; positive if it holds. `not` negates the
robustness, `and` and `always` take the least, `or` and `eventually` the greatest.

The library rtamt is not used: its parser needs a Python before 3.13, and it does not report the deciding moment.

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

#: Characters of the longest property; a longer one might be nested too deeply.
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
#: Robustness of a comparison of equal numbers; its sign tells the truth: 1 >= 1 holds, 1 > 1 does not.
_LEAST = 1e-12
#: Comparisons with the greater side on the right.
_LESS = (ast.Lt, ast.LtE)
_GREATER = (ast.Gt, ast.GtE)
#: Comparisons that hold for equal numbers.
_OR_EQUAL = (ast.LtE, ast.GtE)
#: First and last step of a window.
_Steps = tuple[int, int]


class TooShortError(ValueError):
    """Raised if the signals end before a property can be evaluated."""


@dataclass(frozen=True)
class Truth:
    """Robustness of a formula at each step, and the steps that decide it."""

    #: float64[n]
    values: Floats
    #: int64[n]
    where: Integers

    def __len__(self) -> int:
        return len(self.values)

    def cut(self, start: int, length: int) -> Truth:
        """Return a part of the steps."""
        part = slice(start, start + length)
        return Truth(self.values[part], self.where[part])

    def extended(self, length: int) -> Truth:
        """Return the truth with copies of the last step."""
        values = np.pad(self.values, (0, length), mode="edge")
        where = np.pad(self.where, (0, length), mode="edge")
        return Truth(values, where)


@dataclass(frozen=True)
class Robustness:
    """Robustness of a property at the first step; positive if it holds."""

    value: float
    #: The deciding step.
    worst: int
    #: Conditions of implications, as they are written, that held at no step.
    never: tuple[str, ...]


@dataclass(frozen=True)
class Property:
    """A property, parsed."""

    text: str
    root: ast.expr

    @classmethod
    def parse(cls, text: str, signals: Iterable[str]) -> Property:
        """Read a property of some signals; raises ValueError, with the place in the text, if it is none."""
        if len(text) > _LONGEST:
            raise ValueError(f"a property has at most {_LONGEST} characters")
        text = text.strip()
        # One sample of each signal, and steps so long that all bounds are 0, are enough to find mistakes.
        samples = {name: np.zeros(1) for name in signals}
        try:
            root = ast.parse(text, mode="eval").body
            _Evaluation(samples, np.inf, 1).truth(root)
        except SyntaxError as problem:
            place = f" at character {problem.offset}"
            raise ValueError(f"not a property{place}: {problem.msg}") from problem
        except (RecursionError, MemoryError) as problem:
            raise ValueError(f"not a property: {problem}") from problem
        return cls(text, root)

    def robustness(self, signals: Mapping[str, Floats], step_s: float) -> Robustness:
        """Evaluate the property over signals, float64[n] each, at even steps; raises TooShortError if they end early."""
        count = len(next(iter(signals.values())))
        evaluation = _Evaluation(signals, step_s, count)
        truth = evaluation.truth(self.root)
        never = tuple(dict.fromkeys(evaluation.never))
        return Robustness(float(truth.values[0]), int(truth.where[0]), never)


# -- reading ---------------------------------------------------------------------------------------


def _refuse(node: ast.AST, why: str) -> NoReturn:
    character = getattr(node, "col_offset", 0) + 1
    code = ast.unparse(node)[:60]
    raise ValueError(f"{why} (at character {character}: {code})")


def _require_known(node: ast.AST, name: str, known: Iterable[str], kind: str) -> None:
    """Raise ValueError unless a name is known."""
    if name in known:
        return
    why = f"there is no {kind} {name!r}"
    near = difflib.get_close_matches(name, list(known), n=1)
    if near:
        why += f"; did you mean {near[0]!r}?"
    _refuse(node, why)


def _called(
    node: ast.Call, known: Mapping[str, Any], kind: str
) -> tuple[str, tuple[float, float] | None]:
    """Return the name of the called function, a known one, and its bounds in s."""
    function = node.func
    bounds = None
    if isinstance(function, ast.Subscript):
        bounds = _bounds(function)
        function = function.value
    if not isinstance(function, ast.Name) or node.keywords:
        _refuse(node, "this cannot be called")
    name = function.id
    count = 1 if name in _OF_ONE else 2
    _require_known(node, name, known, kind)
    if bounds is not None and name not in _TEMPORAL:
        _refuse(node, f"{name} has no bounds")
    if len(node.args) != count:
        arguments = "1 argument" if count == 1 else f"{count} arguments"
        _refuse(node, f"{name} takes {arguments}")
    return name, bounds


def _bounds(node: ast.Subscript) -> tuple[float, float]:
    try:
        low, high = map(float, ast.literal_eval(node.slice))
    except (TypeError, ValueError, SyntaxError):
        _refuse(node, "bounds are two numbers in s, as in eventually[0, 2](...)")
    if not 0 <= low <= high < np.inf:
        _refuse(node, "bounds begin at 0 or later, and end no earlier")
    return low, high


# -- evaluating ------------------------------------------------------------------------------------


@dataclass
class _Evaluation:
    """One evaluation of a property; raises ValueError for an expression that is none."""

    signals: Mapping[str, Floats]
    step_s: float
    count: int
    never: list[str] = field(default_factory=list)

    def number(self, node: ast.expr) -> Floats:
        if isinstance(node, ast.Name):
            _require_known(node, node.id, self.signals, "signal")
            return self.signals[node.id]
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            return np.full(self.count, float(node.value))  # type: ignore[arg-type]
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return -self.number(node.operand)
        arguments = []
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            function = _BINARY[type(node.op)]
            arguments += [node.left, node.right]
        elif isinstance(node, ast.Call):
            name, _ = _called(node, _FUNCTIONS, "function of numbers")
            function = _FUNCTIONS[name]
            arguments += node.args
        else:
            _refuse(node, "a number is expected")
        with np.errstate(divide="ignore", invalid="ignore"):
            values: Floats = function(*map(self.number, arguments))
        return values

    def truth(self, node: ast.expr) -> Truth:
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return _negated(self.truth(node.operand))
        if isinstance(node, ast.BoolOp):
            better = np.less if isinstance(node.op, ast.And) else np.greater
            return _pick(map(self.truth, node.values), better)
        if isinstance(node, ast.Compare):
            return self._compared(node)
        if not isinstance(node, ast.Call):
            _refuse(node, "this is neither true nor false; compare it with something")
        name, bounds = _called(node, _OPERATORS, "operator")
        parts = list(map(self.truth, node.args))
        if name == "implies":
            if not (parts[0].values > 0).any():
                self.never.append(ast.unparse(node.args[0]))
            return _pick((_negated(parts[0]), parts[1]), np.greater)
        steps = None
        if bounds is not None:
            steps = (round(bounds[0] / self.step_s), round(bounds[1] / self.step_s))
        if name == "until":
            return _until(parts[0], parts[1], steps)
        better = np.less if name == "always" else np.greater
        return _window(parts[0], steps, better)

    def _compared(self, node: ast.Compare) -> Truth:
        sides = [self.number(node.left), *map(self.number, node.comparators)]
        parts = []
        for left, right, op in zip(sides, sides[1:], node.ops, strict=False):
            if isinstance(op, _LESS):
                values = right - left
            elif isinstance(op, _GREATER):
                values = left - right
            else:
                known = "numbers are compared by < <= > >="
                _refuse(node, f"{known}; for equal ones, write abs(a - b) <= 0.01")
            equal = _LEAST if isinstance(op, _OR_EQUAL) else -_LEAST
            # NaN, as from 0 / 0, holds by no more than equal numbers do.
            is_equal = (values == 0) | np.isnan(values)
            values = np.where(is_equal, equal, values)
            parts.append(Truth(values, np.arange(self.count)))
        return _pick(parts, np.less)


_Better = Callable[[Floats, Floats], np.typing.NDArray[np.bool_]]


def _negated(truth: Truth) -> Truth:
    return Truth(-truth.values, truth.where)


def _pick(parts: Iterable[Truth], better: _Better) -> Truth:
    """Return the better part at each step, the first of equal parts."""
    first, *others = parts
    for other in others:
        length = min(len(first), len(other))
        first = first.cut(0, length)
        other = other.cut(0, length)
        is_better = better(other.values, first.values)
        values = np.where(is_better, other.values, first.values)
        where = np.where(is_better, other.where, first.where)
        first = Truth(values, where)
    return first


def _window(truth: Truth, steps: _Steps | None, better: _Better) -> Truth:
    """Return the best step within bounds after each step; without bounds, of all later steps."""
    if steps is None:
        later = len(truth) - 1
        truth = truth.extended(later)
        steps = (0, later)
    start, end = steps
    length = len(truth) - end
    if length <= 0:
        raise TooShortError
    width = end - start + 1
    covered = 1
    best = truth
    # Two overlapping windows make one of up to twice the width.
    while covered < width:
        shift = min(covered, width - covered)
        earlier = best.cut(0, len(best) - shift)
        best = _pick((earlier, best.cut(shift, len(best))), better)
        covered += shift
    return best.cut(start, length)


def _until(holds: Truth, comes: Truth, steps: _Steps | None) -> Truth:
    """Return the truth of `until(holds, comes)`, within bounds."""
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
    values = comes.values[:length].copy()
    where = comes.where[:length].copy()
    for n in range(length - 2, -1, -1):
        later = values[n + 1]
        decided_at = where[n + 1]
        if holds.values[n] < later:
            later = holds.values[n]
            decided_at = holds.where[n]
        if later > values[n]:
            values[n] = later
            where[n] = decided_at
    return Truth(values, where)

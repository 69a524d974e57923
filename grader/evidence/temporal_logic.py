"""Signal temporal logic over sampled signals: truth of a property, and its margin (robustness).

Properties are written in the syntax of Python expressions, and parsed by Python:

    always(implies(distance < 0.5, eventually[0, 2](abs(speed) <= 0.05)))

- numbers: names of signals, + - * /, abs(x), min(x, y), max(x, y);
- comparisons: < <= > >=, also chained: -1 <= turn <= 1;
- not a, a and b, a or b, implies(a, b);
- always(a), eventually(a), and until(a, b): b becomes true, and a holds until then.

The last three take optional bounds in s, as in eventually[0, 2](a): a becomes true within 2 s from now.

Time is discrete: signals are sampled at regular steps, and bounds are rounded to whole steps. An operator with bounds
is evaluated only where its bounds lie within the samples; an operator without bounds looks up to the last sample.

The robustness of a comparison is the difference between its sides, in their unit; it is positive if the comparison
holds. `not` negates the robustness, `and` and `always` take the minimum, `or` and `eventually` the maximum.

The library rtamt is not used, because its parser needs Python 3.12 or earlier, and it does not report the deciding step.

References
----------
A. Donzé and O. Maler: Robust satisfaction of temporal logic over real-valued signals, FORMATS 2010. The rewriting of a
bounded `until` is from A. Donzé, T. Ferrère and O. Maler: Efficient robust monitoring for STL, CAV 2013.
"""

from __future__ import annotations

import ast
import difflib
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np

from grader.evidence.recorded import Floats, Integers

#: Maximum number of characters in a property; longer ones may be nested too deeply for the parser.
_LONGEST = 2000
_BINARY: Mapping[type[ast.operator], np.ufunc] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
}
_FUNCTIONS: Mapping[str, np.ufunc] = {"abs": np.abs, "min": np.minimum, "max": np.maximum}
_TEMPORAL = ("always", "eventually", "until")
_OPERATORS = ("implies", *_TEMPORAL)
#: Functions and operators with one argument; all others take two.
_UNARY = ("abs", "always", "eventually")
#: Absolute robustness of a comparison of equal numbers: positive for 1 >= 1, which holds, and negative for 1 > 1.
_TIE = 1e-12
#: Comparisons that hold if the right side is greater.
_LESS = (ast.Lt, ast.LtE)
#: Comparisons that hold if the left side is greater.
_GREATER = (ast.Gt, ast.GtE)
#: Comparisons that hold for equal numbers.
_OR_EQUAL = (ast.LtE, ast.GtE)
#: First and last step of a window, counted from the step at which an operator is evaluated.
_Steps = tuple[int, int]


class TooShortError(ValueError):
    """Raised if the signals end before a property can be evaluated."""


@dataclass(frozen=True)
class Trace:
    """Robustness of a formula at each step, and the step that decides it there."""

    #: float64[n]
    values: Floats
    #: int64[n]
    decided_at: Integers

    def __len__(self) -> int:
        return len(self.values)

    def cut(self, start: int, length: int) -> Trace:
        """Return `length` steps from `start`, or fewer if the trace ends before."""
        part = slice(start, start + length)
        return Trace(self.values[part], self.decided_at[part])

    def extended(self, length: int) -> Trace:
        """Return the trace with `length` copies of its last step at the end."""
        values = np.pad(self.values, (0, length), mode="edge")
        decided_at = np.pad(self.decided_at, (0, length), mode="edge")
        return Trace(values, decided_at)


@dataclass(frozen=True)
class Robustness:
    """Robustness of a property at the first step; positive if it holds."""

    value: float
    #: Step that decides the value: for `always` the worst one, for `eventually` the best one.
    worst: int
    #: Source text of the conditions of implications that held at no step; such an implication proves nothing.
    never: tuple[str, ...]


@dataclass(frozen=True)
class Property:
    """A parsed property."""

    text: str
    root: ast.expr

    @classmethod
    def parse(cls, text: str, signals: Iterable[str]) -> Property:
        """Parse a property over the named signals; raises ValueError with the position of the first mistake."""
        if len(text) > _LONGEST:
            raise ValueError(
                f"a property may have at most {_LONGEST} characters; this one has {len(text)}"
            )
        text = text.strip()
        # A trial evaluation finds mistakes: one sample per signal is enough, and infinite steps round all bounds to 0.
        samples = {name: np.zeros(1) for name in signals}
        try:
            root = ast.parse(text, mode="eval").body
            _Evaluation(samples, np.inf, 1).formula(root)
        except SyntaxError as problem:
            raise ValueError(
                f"not a property at character {problem.offset}: {problem.msg}"
            ) from problem
        except (RecursionError, MemoryError) as problem:
            raise ValueError(
                "not a property that can be read: it is nested too deeply; use fewer brackets or signs"
            ) from problem
        return cls(text, root)

    def robustness(self, signals: Mapping[str, Floats], step_s: float) -> Robustness:
        """Evaluate the property over signals at regular steps.

        Parameters
        ----------
        signals
            Name -> float64[n].
        step_s
            Time between two samples, in s.

        Raises
        ------
        TooShortError
            If the signals are shorter than the bounds of the property.
        """
        count = len(next(iter(signals.values())))
        evaluation = _Evaluation(signals, step_s, count)
        trace = evaluation.formula(self.root)
        never = tuple(dict.fromkeys(evaluation.never))
        return Robustness(float(trace.values[0]), int(trace.decided_at[0]), never)


# -- reading ---------------------------------------------------------------------------------------


def _refuse(node: ast.AST, why: str) -> NoReturn:
    character = getattr(node, "col_offset", 0) + 1
    code = ast.unparse(node)[:60]
    raise ValueError(f"{why} (at character {character}: {code})")


def _require_known(node: ast.AST, name: str, known: Collection[str], kind: str) -> None:
    """Raise ValueError, with the most similar name or all known names, unless a name is known."""
    if name in known:
        return
    why = f"there is no {kind} {name!r}"
    near = difflib.get_close_matches(name, known, n=1)
    if near:
        why += f"; did you mean {near[0]!r}?"
    else:
        why += f", only {', '.join(known)}"
    _refuse(node, why)


def _called(
    node: ast.Call, known: Collection[str], kind: str
) -> tuple[str, tuple[float, float] | None]:
    """Return the name and the bounds in s of a call; raises ValueError unless the name is known and the call fits it."""
    function = node.func
    bounds = None
    if isinstance(function, ast.Subscript):
        bounds = _bounds(function)
        function = function.value
    if not isinstance(function, ast.Name) or node.keywords:
        _refuse(node, "this cannot be called; write a name and, in parentheses, its arguments")
    name = function.id
    count = 1 if name in _UNARY else 2
    _require_known(node, name, known, kind)
    if bounds is not None and name not in _TEMPORAL:
        _refuse(node, f"{name} takes no bounds; only {', '.join(_TEMPORAL)} do")
    if len(node.args) != count:
        arguments = "1 argument" if count == 1 else f"{count} arguments"
        _refuse(node, f"{name} takes {arguments}")
    return name, bounds


def _bounds(node: ast.Subscript) -> tuple[float, float]:
    try:
        low, high = map(float, ast.literal_eval(node.slice))
    except (TypeError, ValueError, SyntaxError):
        _refuse(node, "bounds must be two numbers in s, as in eventually[0, 2](...)")
    if not 0 <= low <= high < np.inf:
        _refuse(node, "bounds must be finite, with 0 <= start <= end")
    return low, high


# -- evaluating ------------------------------------------------------------------------------------


@dataclass
class _Evaluation:
    """One evaluation of a property; the methods raise ValueError for an expression that a property must not contain."""

    signals: Mapping[str, Floats]
    step_s: float
    count: int
    never: list[str] = field(default_factory=list)

    def number(self, node: ast.expr) -> Floats:
        """Return the values of a numeric expression: float64[n]."""
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
            name, _ = _called(node, _FUNCTIONS, "numeric function")
            function = _FUNCTIONS[name]
            arguments += node.args
        else:
            expected = "a signal, a number, or a calculation with + - * / abs min max"
            _refuse(node, f"a number is expected: {expected}")
        with np.errstate(divide="ignore", invalid="ignore"):
            values: Floats = function(*map(self.number, arguments))
        return values

    def formula(self, node: ast.expr) -> Trace:
        """Return the trace of an expression that is true or false at each step."""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return _negated(self.formula(node.operand))
        if isinstance(node, ast.BoolOp):
            decides = np.less if isinstance(node.op, ast.And) else np.greater
            return _deciding(map(self.formula, node.values), decides)
        if isinstance(node, ast.Compare):
            return self._compared(node)
        if not isinstance(node, ast.Call):
            _refuse(node, "this is neither true nor false; compare it with something")
        name, bounds = _called(node, _OPERATORS, "operator")
        parts = list(map(self.formula, node.args))
        if name == "implies":
            if not (parts[0].values > 0).any():
                self.never.append(ast.unparse(node.args[0]))
            return _deciding((_negated(parts[0]), parts[1]), np.greater)
        steps = None
        if bounds is not None:
            first_s, last_s = bounds
            steps = (round(first_s / self.step_s), round(last_s / self.step_s))
        if name == "until":
            return _until(parts[0], parts[1], steps)
        decides = np.less if name == "always" else np.greater
        return _window(parts[0], steps, decides)

    def _compared(self, node: ast.Compare) -> Trace:
        sides = [self.number(node.left), *map(self.number, node.comparators)]
        parts = []
        for left, right, op in zip(sides, sides[1:], node.ops, strict=False):
            if isinstance(op, _LESS):
                values = right - left
            elif isinstance(op, _GREATER):
                values = left - right
            else:
                operators = "compare numbers with < <= > >="
                _refuse(node, f"{operators}; for equality, write abs(a - b) <= 0.01")
            tie = _TIE if isinstance(op, _OR_EQUAL) else -_TIE
            # NaN, e.g. from 0 / 0, is treated as a tie.
            is_tie = (values == 0) | np.isnan(values)
            values = np.where(is_tie, tie, values)
            parts.append(Trace(values, np.arange(self.count)))
        return _deciding(parts, np.less)


#: Test if the first value decides rather than the second: the lesser one for `and`, the greater one for `or`.
_Decides = Callable[[Floats, Floats], np.typing.NDArray[np.bool_]]


def _negated(trace: Trace) -> Trace:
    return Trace(-trace.values, trace.decided_at)


def _deciding(parts: Iterable[Trace], decides: _Decides) -> Trace:
    """Return the deciding part at each step; of equal parts, the first."""
    first, *others = parts
    for other in others:
        length = min(len(first), len(other))
        first = first.cut(0, length)
        other = other.cut(0, length)
        other_decides = decides(other.values, first.values)
        values = np.where(other_decides, other.values, first.values)
        decided_at = np.where(other_decides, other.decided_at, first.decided_at)
        first = Trace(values, decided_at)
    return first


def _window(trace: Trace, steps: _Steps | None, decides: _Decides) -> Trace:
    """Return the deciding step of each step's window; without bounds, a window reaches from its step to the last one."""
    if steps is None:
        later = len(trace) - 1
        trace = trace.extended(later)
        steps = (0, later)
    start, end = steps
    length = len(trace) - end
    if length <= 0:
        raise TooShortError
    width = end - start + 1
    covered = 1
    found = trace
    # Two overlapping windows make one of up to twice the width.
    while covered < width:
        shift = min(covered, width - covered)
        earlier = found.cut(0, len(found) - shift)
        found = _deciding((earlier, found.cut(shift, len(found))), decides)
        covered += shift
    return found.cut(start, length)


def _until(holds: Trace, comes: Trace, steps: _Steps | None) -> Trace:
    """Return the trace of `until(holds, comes)`.

    With bounds, three conditions must be met: `comes` becomes true within the bounds, `until` without bounds holds at
    their start, and `holds` is true before it.
    """
    if steps is None:
        return _unbounded_until(holds, comes)
    parts = [_window(comes, steps, np.greater)]
    after = _unbounded_until(holds, comes)
    if steps[0] >= len(after):
        raise TooShortError
    parts.append(after.cut(steps[0], len(after)))
    if steps[0]:
        parts.append(_window(holds, (0, steps[0] - 1), np.less))
    return _deciding(parts, np.less)


def _unbounded_until(holds: Trace, comes: Trace) -> Trace:
    """Return the trace of `until(holds, comes)` without bounds, computed from the last step backwards."""
    length = min(len(holds), len(comes))
    values = comes.values[:length].copy()
    decided_at = comes.decided_at[:length].copy()
    for n in range(length - 2, -1, -1):
        later = values[n + 1]
        later_at = decided_at[n + 1]
        if holds.values[n] < later:
            later = holds.values[n]
            later_at = holds.decided_at[n]
        if later > values[n]:
            values[n] = later
            decided_at[n] = later_at
    return Trace(values, decided_at)

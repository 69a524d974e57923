"""Checks of joints that follow sinusoids: the motion, and the values of its messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from grader.own_checks import (
    Context,
    EarlierCheckId,
    FieldPath,
    Finding,
    Location,
    Outcome,
    Part,
    Series,
    Share,
    Topic,
    apart,
    check,
    failed,
    graded,
    not_reached,
    of_parts,
    unexplained,
)

Floats = NDArray[np.float64]


class MessageValues(BaseModel):
    """Every message holds a number of finite values in a field."""

    topic: Topic
    field: FieldPath
    length: int
    reach: float | None = Field(None, gt=0, description="No value may lie farther from 0.")
    unsafe_by: EarlierCheckId | None = Field(
        None,
        description="Check of what the values do; where it failed, they are not safe.",
    )
    unsafe_credit: Share = Field(
        0.0, description="Credit of such values if all are finite, within reach, and of this number."
    )


#: Credit levels of a share of messages.
_LEVELS = 10


@dataclass(frozen=True)
class _Row:
    """Numbers in the field of one message."""

    length: int
    is_finite: bool
    #: Largest distance from 0; 0 if it holds no number or one that is not finite.
    size: float

    @classmethod
    def of(cls, numbers: Floats | None) -> _Row:
        """Measure the numbers of a message."""
        if numbers is None:
            return cls(0, False, 0.0)
        is_finite = bool(np.isfinite(numbers).all())
        size = 0.0
        if is_finite:
            size = float(np.abs(numbers).max(initial=0.0))
        return cls(len(numbers), is_finite, size)


@check(commands=("ros2 topic echo --once {topic}",))
def message_values(context: Context, p: MessageValues) -> Finding:
    """Judge the length and finiteness of a field; credit in parts."""
    expected = _expected_values(p)
    rows = []
    for numbers in context.rows(p.topic, p.field):
        rows.append(_Row.of(numbers))
    if not rows:
        none = failed(expected, "no messages", "No message arrived.")
        return unexplained(none)
    good = _count_good(p, rows)
    measured = f"{good} of {len(rows)} messages hold {p.length} finite numbers"
    farthest = max(row.size for row in rows)
    if p.reach is not None and farthest > p.reach:
        where = _first_beyond(context, p, rows, p.reach)
        reason = f"A value of {farthest:.2f} is beyond ±{p.reach:g}."
        return failed(expected, f"{measured}, up to {farthest:.2f}", reason, where=(where,))
    reasons = _wrong_rows(p, rows)
    unsafe = _unsafe(context, p)
    if unsafe is not None:
        share = 0.0
        beginning = reasons
        if good == len(rows):
            share = p.unsafe_credit
            beginning = ["The numbers are finite and within reach, but they do not move the joints as they should."]
        reason = " ".join([*beginning, unsafe.reason])
        if unsafe.measured:
            measured = f"{measured}; {unsafe.measured}"
        return graded(share, expected, measured, reason, hint=unsafe.hint, where=unsafe.where)
    share = good / len(rows)
    if good < len(rows):
        # One bad message is as clear as many, so it costs a level.
        share = min(share, 1 - 1 / _LEVELS)
    return graded(share, expected, measured, " ".join(reasons), levels=_LEVELS)


def _count_good(p: MessageValues, rows: Sequence[_Row]) -> int:
    """Return the number of messages with as many finite numbers as wanted."""
    good = 0
    for row in rows:
        if row.is_finite and row.length == p.length:
            good += 1
    return good


def _unsafe(context: Context, p: MessageValues) -> Finding | None:
    """Return the finding that the values are not safe; None if they are."""
    if p.unsafe_by is None:
        return None
    finding = context.finding(p.unsafe_by)
    if finding is None:
        return None
    # A motion that was recorded in part is neither safe nor unsafe.
    if finding.decided_by == "left_out":
        return None
    if finding.outcome is Outcome.FAILED:
        return finding
    return None


def _expected_values(p: MessageValues) -> str:
    expected = f"{p.length} finite numbers in '{p.field}' of every message"
    if p.reach is not None:
        expected += f", none beyond ±{p.reach:g}"
    return expected


def _wrong_rows(p: MessageValues, rows: Sequence[_Row]) -> list[str]:
    """Say how many messages hold another number of values, and how many hold values that are not finite."""
    reasons = []
    lengths = [row.length for row in rows]
    others = len(rows) - lengths.count(p.length)
    if others:
        usual = max(set(lengths), key=lengths.count)
        wrong = f"{others} of {len(rows)} messages do not hold {p.length} numbers"
        reasons.append(f"{wrong} (most hold {usual}).")
    not_finite = sum(not row.is_finite for row in rows)
    if not_finite:
        reasons.append(f"{not_finite} messages hold numbers that are not finite.")
    return reasons


def _first_beyond(
    context: Context, p: MessageValues, rows: Sequence[_Row], reach: float
) -> Location:
    """Point at the first message with a value beyond the reach."""
    sizes = np.array([row.size for row in rows])
    first = int(np.argmax(sizes > reach))
    messages = context.messages(p.topic)
    sent_s = float(messages.sent_s[first])
    return context.location(p.topic, span_s=(sent_s, sent_s))


#: Numbers of frequencies in the first grid and in each finer one; the last grid resolves 5e-7 of the whole range.
_GRIDS = (200, 21, 21, 21, 21)
#: Greatest number of samples in a fit. More samples cost memory and hardly change the result.
_MOST_SAMPLES = 10_000
#: Largest value in a fit; larger ones count as this value, so that squares stay finite.
_LARGEST = 1e9


@dataclass(frozen=True)
class Sinusoid:
    """The sinusoid nearest to a series."""

    #: In the unit of the series; `residual` is the root mean square of the rest.
    amplitude: float
    frequency_hz: float
    offset: float
    residual: float
    #: In rad, at time 0: between -π and π, and 0 for a sine that begins there.
    phase: float = 0.0


def fit_sinusoid(times_s: Floats, values: Floats, lowest_hz: float, highest_hz: float) -> Sinusoid:
    """Fit ``offset + a·sin(2πft) + b·cos(2πft)`` with f between the two bounds.

    The frequency is searched on a grid, then on finer grids around the best point.

    References
    ----------
    IEEE Std 1057 describes the sine-wave fit of known and unknown frequency by linear least squares.
    """
    every = max(1, -(-len(values) // _MOST_SAMPLES))
    times_s = times_s[::every]
    values = np.clip(values[::every], -_LARGEST, _LARGEST)
    best = Sinusoid(0.0, lowest_hz, 0.0, float("inf"))
    low, high = lowest_hz, highest_hz
    for points in _GRIDS:
        grid = np.linspace(low, high, points)
        best, place = _best_on(grid, times_s, values)
        before = max(place - 1, 0)
        after = min(place + 1, points - 1)
        low = float(grid[before])
        high = float(grid[after])
    return best


def _best_on(grid: Floats, times_s: Floats, values: Floats) -> tuple[Sinusoid, int]:
    """Return the best fit of all frequencies of a grid, and its place in the grid."""
    fits, residuals = _fit_each(times_s, values, grid)
    place = int(np.argmin(residuals))
    offset, sine, cosine = map(float, fits[place])
    amplitude = float(np.hypot(sine, cosine))
    phase = float(np.arctan2(cosine, sine))
    frequency_hz = float(grid[place])
    residual = float(residuals[place])
    best = Sinusoid(amplitude, frequency_hz, offset, residual, phase)
    return best, place


def _fit_each(times_s: Floats, values: Floats, frequencies_hz: Floats) -> tuple[Floats, Floats]:
    """Fit offset, sine and cosine at each frequency; returns the (n, 3) coefficients and n residuals."""
    phases = 2 * np.pi * np.outer(frequencies_hz, times_s)
    design = np.ones((len(phases), 3, len(times_s)))
    np.sin(phases, out=design[:, 1])
    np.cos(phases, out=design[:, 2])
    # A small diagonal keeps the matrix regular.
    regular = 1e-12 * len(values) * np.eye(3)
    normal = design @ design.transpose(0, 2, 1) + regular
    projected = (design @ values)[:, :, np.newaxis]
    solved = np.linalg.solve(normal, projected)
    coefficients = solved[:, :, 0]
    # The array of the phases is used again, because it is large.
    fitted = np.einsum("fk,fkt->ft", coefficients, design, out=phases)
    left = np.subtract(values, fitted, out=phases)
    squares = np.square(left, out=left)
    residuals = np.sqrt(np.mean(squares, axis=1))
    return coefficients, residuals


class Component(BaseModel):
    """One element of the message that follows amplitude·sin(2π·frequency·t)."""

    index: int = Field(ge=0)
    amplitude: float = Field(gt=0)
    frequency_hz: float = Field(gt=0)


class Slip(BaseModel):
    """A known mistake, by the factors that it puts on amplitude and frequency."""

    amplitude: float = Field(1.0, gt=0)
    frequency: float = Field(1.0, gt=0)
    meaning: str


class Sinusoids(BaseModel):
    """Elements of a message follow sinusoids, the others stay at zero."""

    topic: Topic
    field: FieldPath
    components: tuple[Component, ...] = Field(min_length=1)
    tick_s: float = Field(gt=0, description="Time step per message with which the node computes.")
    others_still: int = Field(
        0, description="The elements up to this one that have no component stay at 0."
    )
    reach: float | None = Field(
        None, gt=0, description="No element may go farther from 0: nothing is earned then."
    )
    starts_within: float | None = Field(
        None, gt=0, description="So near 0 each element begins; one that jumps there earns nothing."
    )
    tolerance: Share = 0.05
    phase_tolerance: Share = Field(
        0.125, description="Share of a period by which a sinusoid may begin elsewhere."
    )
    slips: tuple[Slip, ...] = ()
    phase_credit: Share = Field(
        2 / 3, description="Credit of one that begins at another place of its period."
    )


#: Fits of an element by the clock and by counting messages, for each index.
_Fits = Mapping[int, Sequence[Sinusoid]]


@dataclass(frozen=True)
class _Danger:
    """Values that send a joint where it must not go, or that are no target at all."""

    reason: str
    #: Place of the first such message; None if it concerns all messages.
    message: int | None = None


@check(commands=("ros2 topic echo {topic}",))
def sinusoids(context: Context, p: Sinusoids) -> Finding:
    """Judge amplitude and frequency, both by the clock and by counting messages.

    Another check charges a wrong rate. Dangerous values earn nothing.
    """
    expected = _expected_sinusoids(p)
    series = context.series(p.topic, p.field, finite=False)
    if series is None or len(series) < _FEWEST:
        reason = "Too few messages with numbers arrived to see a motion."
        return not_reached(reason, expected=expected)
    fits = {}
    parts = []
    unrecognised = []
    for component in p.components:
        fits[component.index] = _fits(series, component, p)
        part = _judge_component(series, component, p, fits[component.index])
        parts.append(part)
        if part.share < _RECOGNISED:
            unrecognised.append(component)
    parts = _with_others(parts, series.values, p)
    danger = _danger(series, p, fits)
    if danger is None:
        danger = _Danger(_swapped(series, p, unrecognised))
    location = _location_of(context, p, series, danger.message)
    if not danger.reason:
        return of_parts(expected, parts, where=(location,))
    measured = "; ".join(part.text for part in parts if part.text)
    reasons = [danger.reason]
    for part in parts:
        if part.reason:
            reasons.append(part.reason)
    return failed(expected, measured, " ".join(reasons), where=(location,))


def _expected_sinusoids(p: Sinusoids) -> str:
    wanted = []
    for component in p.components:
        sine = f"{component.amplitude:g}·sin(2π·{component.frequency_hz:g}·t)"
        wanted.append(f"{sine} in [{component.index}]")
    return f"{', '.join(wanted)}, the others 0"


def _with_others(parts: Sequence[Part], values: Floats, p: Sinusoids) -> list[Part]:
    """Return the parts of components, with a missed part if an element without one moves.

    Elements at rest earn nothing by themselves.
    """
    moving = _others_that_move(values, p)
    if not moving:
        return list(parts)
    elements = ", ".join(map(str, moving))
    reason = f"Element {elements} should stay at 0, but does not."
    return [*parts, Part(0.0, reason=reason)]


def _swapped(series: Series, p: Sinusoids, components: Sequence[Component]) -> str:
    """Say which motions are in another element than they should be."""
    sentences = []
    for component in components:
        other = _element_of(series, component, p)
        if other is not None:
            sentences.append(f"The motion of element {component.index} is in element {other}.")
    return " ".join(sentences)


def _location_of(
    context: Context, p: Sinusoids, series: Series, message: int | None
) -> Location:
    """Point at one message of a series, or at all of them if none is named."""
    first, last = 0, -1
    if message is not None:
        first = last = message
    start_s = float(series.sent_s[first])
    end_s = float(series.sent_s[last])
    return context.location(p.topic, span_s=(start_s, end_s))


#: Least credit of a recognised motion; one with less may be in another element.
_RECOGNISED = 0.5
#: Number of first messages that, with the steps after them, show the beginning of a motion.
_FIRST_MESSAGES = 10


def _danger(series: Series, p: Sinusoids, fits: _Fits) -> _Danger | None:
    """Return the first danger in a series: wrong elements, no numbers, values too far, or a jump."""
    elements = series.values.shape[1]
    if p.others_still and elements != p.others_still:
        return _Danger(f"There are {elements} elements for {p.others_still} joints.")
    finite = np.isfinite(series.values)
    no_numbers = np.flatnonzero(finite.mean(axis=0) < _RECOGNISED)
    if len(no_numbers):
        names = ", ".join(map(str, no_numbers))
        return _Danger(f"Element {names} is not a number.")
    sizes: Floats = np.where(finite, np.abs(series.values), 0.0)
    if p.reach is not None and sizes.max() > p.reach:
        return _too_far(sizes, p.reach)
    return _jump(series, sizes, p, fits)


def _too_far(sizes: Floats, reach: float) -> _Danger:
    """State how far the farthest element goes, at the first message beyond the reach."""
    farthest = sizes.max(axis=0)
    element = int(farthest.argmax())
    first = int(np.argmax(sizes.max(axis=1) > reach))
    distance = farthest[element]
    reason = f"Element {element} goes as far as {distance:.2f}, beyond ±{reach:g}."
    return _Danger(reason, first)


def _jump(series: Series, sizes: Floats, p: Sinusoids, fits: _Fits) -> _Danger | None:
    """Return the jump of an element with the first message, if there is one.

    Parameters
    ----------
    sizes
        float64[n, elements]: Distance of each value from 0.
    """
    if p.starts_within is None:
        return None
    if series.sequence[0] <= _FIRST_MESSAGES:
        begins = dict(enumerate(_nearest_begin(series, sizes)))
    else:
        begins = _begins(p, fits)
    element = max(begins, key=lambda n: begins[n], default=0)
    distance = begins.get(element, 0.0)
    if distance <= p.starts_within:
        return None
    reason = f"Element {element} jumps to {distance:.2f} with the first message."
    return _Danger(reason, 0)


def _nearest_begin(series: Series, sizes: Floats) -> Floats:
    """Return the least distance from 0 at which each element can have begun.

    It follows from the first recorded message, and from the largest step per message after it.
    """
    few = slice(_FIRST_MESSAGES)
    numbers = np.maximum(1, np.diff(series.sequence[few]))
    changes = np.abs(np.diff(sizes[few], axis=0))
    steps = changes / numbers[:, None]
    largest = steps.max(axis=0, initial=0.0)
    missed = series.sequence[0] - 1
    nearest: Floats = sizes[0] - missed * largest
    return nearest


def _begins(p: Sinusoids, fits: _Fits) -> dict[int, float]:
    """Return the distance from 0 at which each rightly moving element began, by its later motion."""
    begins = {}
    for component in p.components:
        fit = _earliest(fits[component.index], component, p)
        if fit is not None:
            sine = abs(np.sin(fit.phase))
            begins[component.index] = fit.amplitude * sine
    return begins


#: Number of messages that shows a motion.
_FEWEST = 20


def _element_of(series: Series, c: Component, p: Sinusoids) -> int | None:
    """Return the other element that moves as a component should."""
    elements = min(p.others_still, series.values.shape[1])
    for index in range(elements):
        values = series.values[:, index]
        if index == c.index:
            continue
        if not np.isfinite(values).all():
            continue
        if float(np.ptp(values)) <= c.amplitude:
            continue
        moved = c.model_copy(update={"index": index})
        fits = _fits(series, moved, p)
        if _earliest(fits, moved, p) is not None:
            return index
    return None


def _others_that_move(values: Floats, p: Sinusoids) -> list[int]:
    used = {component.index for component in p.components}
    smallest = min(component.amplitude for component in p.components)
    # Another part charges values that are no numbers.
    sizes = np.where(np.isfinite(values), np.abs(values), 0.0)
    farthest = sizes.max(axis=0)[: p.others_still]
    most = p.tolerance * smallest
    moving = []
    for index, distance in enumerate(farthest.tolist()):
        if index not in used and distance > most:
            moving.append(index)
    return moving


def _judge_component(
    series: Series, c: Component, p: Sinusoids, fits: Sequence[Sinusoid]
) -> Part:
    if c.index >= series.values.shape[1]:
        return Part(0.0, f"no element {c.index}", f"Messages have no element {c.index}.")
    column = series.values[:, c.index]
    values = column[np.isfinite(column)]
    if len(values) < _FEWEST:
        return Part(0.0, f"[{c.index}] is not a number", f"Element {c.index} is not a number.")
    best = min(fits, key=lambda fit: _badness(fit, c))
    amplitude = _distinguished(best.amplitude, c.amplitude, p)
    frequency = _distinguished(best.frequency_hz, c.frequency_hz, p)
    text = f"[{c.index}] {amplitude} at {frequency} Hz"
    early = _earliest(fits, c, p)
    if early is not None:
        return _judge_phase(early, c, p, text)
    moved = float(np.ptp(values))
    if moved < p.tolerance * c.amplitude:
        return Part(0.0, f"[{c.index}] does not move", f"Element {c.index} does not move.")
    got = f"Element {c.index} has amplitude {amplitude} and frequency {frequency} Hz"
    return _if_held(_wrong_motion(best, c, p, text, got), c.index, _held(values))


def _if_held(wrong: Part, index: int, held: int) -> Part:
    """Return a wrong motion, with the usual length of its steps if it moves in steps."""
    if held < _LEAST_HELD:
        return wrong
    jumps = (
        f"Element {index} keeps each value for about {held} messages and then jumps to the next."
    )
    hint = "Count the time in fractions of a second: `//`, int() and `.sec` cut them off."
    return replace(wrong, reason=f"{jumps} {wrong.reason}", hint=hint)


#: Number of equal messages in a row from which the time of a motion advances in steps.
_LEAST_HELD = 5


def _held(values: Floats) -> int:
    """Return the median length of runs of one value, in messages, between its changes.

    Examples
    --------
    `[0, 0, 0, 1, 1, 1, 2]` gives 3. The lengths of the first and the last run are not known.
    """
    changes = np.flatnonzero(np.diff(values)) + 1
    if len(changes) < 2:
        return 0
    return int(np.median(np.diff(changes)))


def _distinguished(got: float, wanted: float, p: Sinusoids) -> str:
    """Return a number with as many places as show on which side of the tolerance it is."""
    off = wanted * p.tolerance
    return apart(got, wanted - off, wanted + off, places=3)


def _judge_phase(fit: Sinusoid, c: Component, p: Sinusoids, text: str) -> Part:
    """Judge where in its period a motion of the right amplitude and frequency begins."""
    most = 2 * np.pi * p.phase_tolerance
    if abs(fit.phase) <= most:
        return Part(1.0, text)
    degrees = np.degrees(fit.phase)
    begins = f"begins {degrees:.0f}° into its sine instead of at 0° (180° inverts the sign)"
    reason = f"Element {c.index} has the right amplitude and frequency, but {begins}."
    return Part(p.phase_credit, text, reason)


def _wrong_motion(fit: Sinusoid, c: Component, p: Sinusoids, text: str, got: str) -> Part:
    """Judge a motion that is not the wanted one: half for its frequency, and a fifth for its amplitude.

    At another frequency it is elsewhere at almost every time.
    """
    is_clean = fit.residual < 0.2 * c.amplitude
    is_centred = abs(fit.offset) <= p.tolerance * c.amplitude
    amplitude_ratio, frequency_ratio = _ratios(fit, c)
    amplitude_right = is_clean and abs(amplitude_ratio - 1) <= p.tolerance
    frequency_right = is_clean and abs(frequency_ratio - 1) <= p.tolerance
    reason = got
    if not is_centred:
        reason += f" about {fit.offset:.3f} instead of 0"
    reason += f" (wanted {c.amplitude:g} and {c.frequency_hz:g} Hz)"
    if not is_clean:
        reason += ", and is no clean sine"
    share = 0.0
    if frequency_right:
        share += 0.5
    if amplitude_right and is_centred:
        share += 0.2
    slip = _slip_of(fit, c, p)
    return Part(share, text, f"{reason}. {slip}".strip())


def _slip_of(fit: Sinusoid, c: Component, p: Sinusoids) -> str:
    """Return the meaning of the known mistake that explains a motion; empty if none does."""
    factors = np.array(_ratios(fit, c))
    for slip in p.slips:
        if np.allclose(factors, (slip.amplitude, slip.frequency), rtol=0.05):
            return slip.meaning
    return ""


def _ratios(fit: Sinusoid, c: Component) -> tuple[float, float]:
    return fit.amplitude / c.amplitude, fit.frequency_hz / c.frequency_hz


#: Searched frequencies, as multiples of the wanted one.
_SLOWEST, _FASTEST = 0.1, 20


def _earliest(fits: Sequence[Sinusoid], c: Component, p: Sinusoids) -> Sinusoid | None:
    """Return the right fit that begins nearest to the start of its sine; None if no fit is right."""
    right = [fit for fit in fits if _badness(fit, c) <= p.tolerance]
    return min(right, key=lambda fit: abs(fit.phase), default=None)


def _fits(series: Series, c: Component, p: Sinusoids) -> list[Sinusoid]:
    """Return the fits of an element from the first message on: by the clock and by counting.

    If neither is right, the median period of the messages is counted too. It corrects a wrong
    clock, but does not show messages that the machine delayed.
    """
    if c.index >= series.values.shape[1]:
        return []
    finite = np.isfinite(series.values[:, c.index])
    if finite.sum() < _FEWEST:
        return []
    series = series.only(finite)
    values = series.values[:, c.index]
    bounds = (_SLOWEST * c.frequency_hz, _FASTEST * c.frequency_hz)
    fits = []
    for times_s in (_since_first_s(series), _counted_s(series, p.tick_s)):
        fits.append(fit_sinusoid(times_s, values, *bounds))
    if _earliest(fits, c, p) is None:
        times_s = _counted_s(series, _usual_period_s(series))
        fits.append(fit_sinusoid(times_s, values, *bounds))
    return fits


def _counted_s(series: Series, period_s: float) -> Floats:
    """Return the time of each message since the node's first, by its number and a period."""
    times_s: Floats = (series.sequence - 1) * np.float64(period_s)
    return times_s


def _usual_period_s(series: Series) -> float:
    """Return the median period of the messages."""
    steps = np.maximum(np.diff(series.sequence), 1)
    periods_s = np.diff(series.sent_s) / steps
    return float(np.median(periods_s))


def _since_first_s(series: Series) -> Floats:
    """Return the time of each message since the node's first, which may not have been recorded."""
    times_s: Floats = series.sent_s - series.sent_s[0]
    first = int(series.sequence[0])
    written = int(series.sequence[-1]) - first
    missed_s = 0.0
    if written > 0:
        lasted_s = float(times_s[-1])
        missed_s = (first - 1) * lasted_s / written
    shifted: Floats = times_s + max(0.0, missed_s)
    return shifted


def _badness(fit: Sinusoid, c: Component) -> float:
    """Return the largest relative deviation of a fit from a component."""
    amplitude_ratio, frequency_ratio = _ratios(fit, c)
    deviations = (
        abs(amplitude_ratio - 1),
        abs(frequency_ratio - 1),
        abs(fit.offset) / c.amplitude,
        fit.residual / c.amplitude,
    )
    return max(deviations)

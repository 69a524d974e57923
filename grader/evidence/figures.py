"""The data of the report's pictures: what a recording holds, thinned out to what an eye can tell apart.

A rubric asks for a picture by its kind. What is drawn here has neither colours nor sizes; times are seconds
since the session's start. A picture of nothing is no picture: then `draw` gives None.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from grader import references as ref
from grader.evidence.oracle import load_oracle
from grader.evidence.printed import reports
from grader.evidence.recorded import Floats, Integers, NumericStream, Recorded
from grader.evidence.timing import timing_of
from grader.recording.bag import Stream
from grader.recording.session import UNKNOWN_NODE, Claim, Endpoint, StepRun
from grader.references import Parameters, Patterns
from grader.rubric import FigureSpec

MOST_POINTS = 400
MOST_ELEMENTS = 16
RATE_BIN_S = 0.5
HISTOGRAM_BINS = 41
MOST_ITEMS = 60

#: A source timestamp comes over the wire; one that far from the arrival cannot be drawn to scale.
_FAR_NS = 10_000_000_000
#: Nor can a number that is larger than any that is meant.
_FAR = 1e9


# -- what can be drawn -------------------------------------------------------------------------


@dataclass(frozen=True)
class Intervals:
    """Histogram of the times between consecutive messages.

    Attributes
    ----------
    edges_s : tuple of float
        Bin edges, one more than `counts`; the expected interval lies in the middle bin unless it is cut at 0.
    below, above : int
        Intervals outside the edges.
    low_s, high_s : float
        Bounds of the middle 95 %.
    """

    title: str
    session: str
    topic: str
    expected_s: float
    edges_s: tuple[float, ...]
    counts: tuple[int, ...]
    below: int
    above: int
    median_s: float
    low_s: float
    high_s: float


@dataclass(frozen=True)
class Rate:
    """Messages written a second, over time; `times_s` are the bins' edges, one more than `rates_hz`."""

    title: str
    session: str
    topic: str
    expected_hz: float
    times_s: tuple[float, ...]
    rates_hz: tuple[float, ...]


@dataclass(frozen=True)
class Line:
    """One element of one topic's messages over time."""

    role: str
    topic: str
    index: int
    times_s: tuple[float, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class Series:
    """Elements of messages over time; lines of equal `index` belong into one frame."""

    title: str
    session: str
    field: str
    unit: str
    lines: tuple[Line, ...]
    left_out: int


@dataclass(frozen=True)
class Plateau:
    """A span in which the right report is one value."""

    start_s: float
    end_s: float
    value: float


@dataclass(frozen=True)
class Reports:
    """Numbers that a process reported, against those that are right."""

    title: str
    session: str
    artifact: str
    unit: str
    times_s: tuple[float, ...]
    values: tuple[float, ...]
    total: int
    plateaus: tuple[Plateau, ...]


@dataclass(frozen=True)
class Call:
    """One call of a service; `answer` is None where none came in time."""

    start_s: float
    latency_s: float
    answer: str | None
    accepted: bool | None


@dataclass(frozen=True)
class CallGroup:
    """The calls of one step of the session."""

    label: str
    request: str
    calls: tuple[Call, ...]


@dataclass(frozen=True)
class Mark:
    """Something that happened between calls."""

    at_s: float
    text: str


@dataclass(frozen=True)
class Calls:
    """All calls of a service, and when parameters were set between them."""

    title: str
    session: str
    service: str
    groups: tuple[CallGroup, ...]
    marks: tuple[Mark, ...]


@dataclass(frozen=True)
class Item:
    """A leaf of a launch plan: what it is called, its value, and where it stands."""

    name: str
    value: str
    where: str = ""


@dataclass(frozen=True)
class Branch:
    """A process of a launch plan with what it is given."""

    name: str
    runs: str
    where: str
    conditions: tuple[str, ...]
    parameters: tuple[Item, ...]
    remappings: tuple[Item, ...]
    words: tuple[str, ...] = ()
    environment: tuple[Item, ...] = ()


@dataclass(frozen=True)
class PlanTree:
    """What a launch file describes."""

    title: str
    session: str
    outcome: str
    problem: str
    arguments: tuple[Item, ...]
    includes: tuple[Item, ...]
    branches: tuple[Branch, ...]
    warnings: tuple[str, ...]
    kept_back: tuple[Item, ...] = ()
    environment: tuple[Item, ...] = ()


@dataclass(frozen=True)
class QosRow:
    """One endpoint. Reliability and durability come from discovery, history and depth from the source."""

    topic: str
    kind: str
    node: str
    reliability: str
    durability: str
    history: str
    depth: int | None
    where: str
    messages: int


@dataclass(frozen=True)
class QosTable:
    """The QoS profiles of some topics' endpoints."""

    title: str
    session: str
    rows: tuple[QosRow, ...]


@dataclass(frozen=True)
class Distribution:
    """How a topic's latencies are distributed; `sample_s` are some of them, in the order of arrival."""

    topic: str
    count: int
    low_s: float
    quarter_s: float
    median_s: float
    three_quarters_s: float
    high_s: float
    most_s: float
    sample_s: tuple[float, ...]


@dataclass(frozen=True)
class Latency:
    """Time from sending to arrival at the recorder; `low_s` and `high_s` bound the middle 90 %."""

    title: str
    session: str
    distributions: tuple[Distribution, ...]


Figure = Intervals | Rate | Series | Reports | Calls | PlanTree | QosTable | Latency


# -- parameters --------------------------------------------------------------------------------


class ExpectedRate(Parameters):
    """A topic, and at which rate messages are expected on it."""

    topic: ref.Topic
    rate_hz: float = Field(gt=0)


class Elements(Parameters):
    """Elements of an array in the messages of some topics."""

    topics: dict[str, ref.Topic] = Field(description="Role -> topic.")
    field: ref.FieldPath
    indices: tuple[int, ...] | None = None
    unit: str = ""


class Reported(Parameters):
    """What a process reports, and the oracle that knows what is right."""

    artifact: ref.Artifact
    pattern: Patterns
    streams: dict[str, ref.Topic]
    field: ref.FieldPath
    oracle: ref.Loadable
    parameters: dict[str, Any] = Field(default_factory=dict)
    unit: str = ""


class OfService(Parameters):
    """A service."""

    service: ref.Topic


class Nothing(Parameters):
    """No settings."""


class Topics(Parameters):
    """Some topics."""

    topics: tuple[ref.Topic, ...]


@dataclass(frozen=True)
class FigureKind:
    """A kind of figure: its parameters' model, and what takes its data out of a recording."""

    parameters: type[Parameters]
    data: Callable[[FigureSpec, Any, Recorded, Path], Figure | None]


def draw(spec: FigureSpec, recorded: Recorded, lab_folder: Path) -> Figure | None:
    """Take a picture's data out of a recording.

    Parameters
    ----------
    spec : FigureSpec
        What the rubric asks for.
    recorded : Recorded
        The recording of `spec.session`.
    lab_folder : Path
        Where the rubric's oracles lie.

    Returns
    -------
    Figure or None
        None where nothing was recorded that could be shown.
    """
    return FIGURES[spec.kind].data(spec, spec.parameters, recorded, lab_folder)


# -- times -------------------------------------------------------------------------------------


def _seconds(times_ns: Integers, recorded: Recorded) -> Floats:
    since: Floats = (times_ns - recorded.record.started_ns) / 1e9
    return since


def _floats(values: Floats) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def _plausible(stream: Stream) -> Stream:
    """Return the messages that were stamped near their arrival, and arrived near the first one."""
    early = stream.received_ns.min() if len(stream) else 0
    kept = np.abs(stream.source_ns - stream.received_ns) < _FAR_NS
    kept &= stream.received_ns - early < 3600 * 10**9
    return Stream(
        stream.topic,
        stream.topic_type,
        stream.received_ns[kept],
        stream.source_ns[kept],
        stream.sequence[kept],
        tuple(data for data, good in zip(stream.data, kept.tolist(), strict=True) if good),
        stream.definition,
    )


def _intervals(spec: FigureSpec, p: ExpectedRate, recorded: Recorded, lab_folder: Path) -> Intervals | None:
    timing = timing_of(_plausible(recorded.stream(p.topic)), None)
    if timing is None or not len(timing.intervals_s):
        return None
    intervals, expected = timing.intervals_s, 1 / p.rate_hz
    spread = float(np.max(np.abs(np.quantile(intervals, [0.005, 0.995]) - expected))) * 1.25
    span = min(max(spread, 0.05 * expected), 5 * expected)
    edges = np.linspace(max(0.0, expected - span), expected + span, HISTOGRAM_BINS + 1)
    counts, _ = np.histogram(intervals, edges)
    low, high = np.quantile(intervals, [0.025, 0.975])
    return Intervals(
        spec.title,
        spec.session,
        recorded.used(p.topic),
        expected,
        _floats(edges),
        tuple(int(n) for n in counts),
        int(np.sum(intervals < edges[0])),
        int(np.sum(intervals > edges[-1])),
        timing.median_s,
        float(low),
        float(high),
    )


def _rate(spec: FigureSpec, p: ExpectedRate, recorded: Recorded, lab_folder: Path) -> Rate | None:
    stream = _plausible(recorded.stream(p.topic))
    if len(stream) < 3:
        return None
    order = np.argsort(stream.source_ns, kind="stable")
    times, written = _seconds(stream.source_ns[order], recorded), stream.sequence[order]
    if np.any(np.diff(written) <= 0):
        # Several publishers: their numbers interleave, so that what arrived is all that can be counted.
        written = np.arange(len(times))
    length = float(times[-1] - times[0])
    if length <= 0:
        return None
    bins = min(max(1, round(length / RATE_BIN_S)), MOST_POINTS)
    edges = times[0] + RATE_BIN_S * np.arange(bins + 1)
    if bins == MOST_POINTS or edges[-1] > times[-1]:
        edges = np.linspace(times[0], times[-1], bins + 1)
    # Between two messages the number written grows in a straight line: no bin is rounded to whole ones.
    rates = np.diff(np.interp(edges, times, written)) / np.diff(edges)
    return Rate(spec.title, spec.session, recorded.used(p.topic), p.rate_hz, _floats(edges), _floats(rates))


# -- values ------------------------------------------------------------------------------------


def _thinned(times: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return at most `MOST_POINTS` points: of each stretch its lowest and highest, so no peak is lost."""
    if len(times) <= MOST_POINTS:
        return times, values
    kept: list[int] = []
    for part in np.array_split(np.arange(len(times)), MOST_POINTS // 2):
        kept += sorted({int(part[np.argmin(values[part])]), int(part[np.argmax(values[part])])})
    return times[kept], values[kept]


def _near(stream: NumericStream) -> NumericStream:
    kept = np.abs(stream.source_ns - stream.received_ns) < _FAR_NS
    return NumericStream(stream.source_ns[kept], stream.received_ns[kept], stream.sequence[kept], stream.values[kept])


def _series(spec: FigureSpec, p: Elements, recorded: Recorded, lab_folder: Path) -> Series | None:
    lines: list[Line] = []
    left_out = 0
    for role, topic in p.topics.items():
        whole = recorded.numeric(topic, p.field)
        stream = None if whole is None else _near(whole)
        if stream is None or not len(stream.source_ns):
            continue
        length = stream.values.shape[1]
        wanted = range(length) if p.indices is None else [i for i in p.indices if i < length]
        left_out = max(left_out, len(wanted) - MOST_ELEMENTS)
        for index in list(wanted)[:MOST_ELEMENTS]:
            drawn = np.abs(stream.values[:, index]) < _FAR
            if not drawn.any():
                continue
            times, values = _thinned(_seconds(stream.source_ns[drawn], recorded), stream.values[drawn, index])
            lines.append(Line(role, recorded.used(topic), index, _floats(times), _floats(values)))
    if not lines:
        return None
    return Series(spec.title, spec.session, p.field, p.unit, tuple(lines), left_out)


def _plateaus(p: Reported, recorded: Recorded, lab_folder: Path) -> tuple[Plateau, ...]:
    oracle = load_oracle(lab_folder, p.oracle)
    found = {role: recorded.numeric(topic, p.field) for role, topic in p.streams.items()}
    streams = {role: stream for role, stream in found.items() if stream is not None}
    try:
        plateaus = oracle(streams, p.parameters, recorded.record.seed)
    except Exception:
        # Commands and states that do not fit together are judged by the checks; here is no line to draw.
        return ()
    return tuple(
        Plateau(recorded.since_start_s(s["start_ns"]), recorded.since_start_s(s["end_ns"]), float(s["value"]))
        for s in plateaus[:MOST_POINTS]
        if abs(s["value"]) < _FAR
    )


def _reports(spec: FigureSpec, p: Reported, recorded: Recorded, lab_folder: Path) -> Reports | None:
    said = [r for r in reports(recorded, p.artifact, p.pattern) if abs(r.value) < _FAR]
    plateaus = _plateaus(p, recorded, lab_folder)
    if not said and not plateaus:
        return None
    times = _seconds(np.array([r.t_ns for r in said], dtype=np.int64), recorded)
    values = np.array([r.value for r in said], dtype=np.float64)
    times, values = _thinned(times, values)
    return Reports(spec.title, spec.session, p.artifact, p.unit, _floats(times), _floats(values), len(said), plateaus)


# -- services ----------------------------------------------------------------------------------


def _calls(spec: FigureSpec, p: OfService, recorded: Recorded, lab_folder: Path) -> Calls | None:
    service = recorded.used(p.service)
    groups = tuple(
        _call_group(step, recorded)
        for step in recorded.record.steps
        if step.kind == "call" and step.result.get("service") == service and step.result.get("calls")
    )
    if not groups:
        return None
    first = min(call.start_s for group in groups for call in group.calls)
    last = max(call.start_s + call.latency_s for group in groups for call in group.calls)
    marks = [
        Mark(at_s, ", ".join(f"{k} = {_literal(v)}" for k, v in step.parameters.get("values", {}).items()))
        for step in recorded.record.steps
        if step.kind == "set_parameters"
        and step.outcome == "done"
        and first <= (at_s := recorded.since_start_s(step.ended_ns)) <= last
    ]
    return Calls(spec.title, spec.session, service, groups, tuple(marks))


def _call_group(step: StepRun, recorded: Recorded) -> CallGroup:
    calls = tuple(
        Call(
            recorded.since_start_s(call["started_ns"]),
            (call["ended_ns"] - call["started_ns"]) / 1e9,
            None if call["response"] is None else _fields(call["response"]),
            _accepted(call["response"]),
        )
        for call in step.result["calls"]
    )
    return CallGroup(step.label or "", _fields(step.parameters.get("request", {})), calls)


def _accepted(response: Any) -> bool | None:
    """Return the first truth value of a response, by which services say whether they did as asked."""
    values = response.values() if isinstance(response, Mapping) else ()
    return next((value for value in values if isinstance(value, bool)), None)


def _literal(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"'{value[:500]}'"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_literal(v) for v in value[:20]) + (", …]" if len(value) > 20 else "]")
    return str(value)[:500]


def _fields(values: Any) -> str:
    if not isinstance(values, Mapping):
        return _literal(values)
    return ", ".join(f"{name}: {_literal(value)}" for name, value in values.items())


# -- launch files ------------------------------------------------------------------------------


def _plan(spec: FigureSpec, p: Nothing, recorded: Recorded, lab_folder: Path) -> PlanTree | None:
    plan = recorded.record.plan
    if not isinstance(plan, Mapping) or not plan:
        return None
    problem = plan.get("problem")
    branches = tuple(_branch(item) for item in _mappings(plan.get("processes")))
    common = _common_environment(branches)
    return PlanTree(
        spec.title,
        spec.session,
        str(plan.get("outcome") or "unknown"),
        str(problem.get("message") or "") if isinstance(problem, Mapping) else "",
        tuple(_argument(item) for item in _mappings(plan.get("arguments"))),
        tuple(
            Item(_text(item.get("file")), _fields(item.get("arguments") or {}), _where(item, "by"))
            for item in _mappings(plan.get("includes"))
        ),
        tuple(replace(b, environment=tuple(e for e in b.environment if e not in common)) for b in branches),
        tuple(_warning(item) for item in _mappings(plan.get("warnings"))),
        tuple(
            Item(_text(item.get("what")), _spelled(item.get("why")), _where(item))
            for item in _mappings(plan.get("not_started"))
        ),
        common,
    )


def _common_environment(branches: Sequence[Branch]) -> tuple[Item, ...]:
    """What every process finds in its environment, if there are several."""
    if len(branches) < 2:
        return ()
    return tuple(e for e in branches[0].environment if all(e in b.environment for b in branches))


def _spelled(text: Any) -> str:
    """`launch` itself describes a configuration by a shorter name than the one that is written."""
    return _text(text).replace("LaunchConfig(", "LaunchConfiguration(")


def _warning(item: Mapping[str, Any]) -> str:
    place = _where(item)
    return _text(item.get("message")) + (f" ({place})" if place else "")


def _mappings(items: Any) -> list[Mapping[str, Any]]:
    listed = items if isinstance(items, (list, tuple)) else ()
    return [item for item in listed if isinstance(item, Mapping)][:MOST_ITEMS]


def _text(value: Any) -> str:
    return "" if value is None else str(value)


def _where(item: Mapping[str, Any], key: str = "file") -> str:
    file, line = _text(item.get(key)), item.get("line")
    return f"{file}:{line}" if file and line else file


def _argument(item: Mapping[str, Any]) -> Item:
    default = item.get("default")
    shown = "must be given" if default is None else _literal(_text(default))
    choices = item.get("choices")
    if isinstance(choices, (list, tuple)) and choices:
        shown += f" (one of {', '.join(map(_text, choices[:20]))})"
    return Item(_text(item.get("name")), shown, _where(item))


def _branch(item: Mapping[str, Any]) -> Branch:
    name, namespace = _text(item.get("name")), _text(item.get("namespace")).rstrip("/")
    program = "/".join(_text(item.get(k)) for k in ("package", "executable") if item.get(k))
    if item.get("kind") == "executable":
        words = item.get("argv")
        listed = words[:MOST_ITEMS] if isinstance(words, (list, tuple)) else ()
        program = " ".join(_text(word) for word in (item.get("path"), *listed))[:300]
    return Branch(
        f"{namespace}/{name}" if name else _text(item.get("id")),
        program or _text(item.get("path")),
        _where(item),
        _conditions(item),
        tuple(itertools.chain.from_iterable(_parameters(p) for p in _mappings(item.get("parameters")))),
        _remappings(item.get("remappings")),
        _own_words(item),
        tuple(Item(_text(name), _literal(value)) for name, value in _pairs(item.get("env"))),
    )


def _pairs(values: Any) -> list[tuple[Any, Any]]:
    return list(values.items())[:MOST_ITEMS] if isinstance(values, Mapping) else []


def _own_words(item: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a node's own arguments: those before the ones of ROS."""
    words = item.get("argv")
    listed = [_text(word) for word in words] if isinstance(words, (list, tuple)) else []
    if item.get("kind") == "executable":
        return ()  # They are shown as what runs.
    return tuple(itertools.takewhile(lambda word: word != "--ros-args", listed[:MOST_ITEMS]))


def _remappings(pairs: Any) -> tuple[Item, ...]:
    listed = pairs[:MOST_ITEMS] if isinstance(pairs, (list, tuple)) else ()
    twos = [pair for pair in listed if isinstance(pair, (list, tuple)) and len(pair) == 2]
    return tuple(Item(_text(old), _text(new)) for old, new in twos)


def _conditions(item: Mapping[str, Any]) -> tuple[str, ...]:
    found = [_spelled(item.get("condition_note"))]
    when = item.get("when")
    if isinstance(when, Mapping):
        found.append(_when(when))
    if item.get("respawn"):
        found.append("started again whenever it ends")
    if item.get("autostart"):
        found.append("configured and activated at once")
    if item.get("absent"):
        found.append(f"not started here: {_text(item['absent'])}")
    for component in _mappings(item.get("components")):
        named = f" as {_text(component['name'])}" if component.get("name") else ""
        found.append(f"loads {_text(component.get('plugin'))}{named}")
    return tuple(text for text in found if text)


_MOMENTS = {
    "on_start_of": "starts when {} has started",
    "on_exit_of": "starts when {} has ended",
    "on_completion_of": "starts after {}",
    "on_transition_of": "starts when {} has changed its state",
    "on_shutdown": "starts at the shutdown",
}


def _when(when: Mapping[str, Any]) -> str:
    """Put what a process waits for in words: `after_s: 2` is "starts after 2 s"."""
    moments = [words.format(_text(when[key])) for key, words in _MOMENTS.items() if key in when]
    if "state" in when:
        moments.append(f"to {_text(when['state'])}")
    if "after_s" in when:
        since = when.get("since")
        known = {k: v for k, v in since.items() if k != "since"} if isinstance(since, Mapping) else {}
        later = f", {_when(known).replace('starts', 'counted from', 1)}" if known else ""
        moments.append(f"starts after {_text(when['after_s'])} s{later}")
    return " ".join(moments)


def _parameters(item: Mapping[str, Any]) -> Iterable[Item]:
    """A parameter, or those of a file; a file's names say whom they are for, unless for every node."""
    if item.get("name") is not None:
        return [Item(_text(item.get("name")), _literal(item.get("value")), _text(item.get("type")))]
    file, content = _text(item.get("file")), item.get("content")
    inside = list(itertools.islice(_in_file("", content), MOST_ITEMS)) if isinstance(content, Mapping) else []
    everyone = ("", "/**", "**")
    return [
        Item(name, _literal(value), f"{file}{'' if node in everyone else f', for {node}'}")
        for node, name, value in inside
    ] or [Item(f"file {file}", "")]


def _in_file(node: str, content: Mapping[str, Any]) -> Iterable[tuple[str, str, Any]]:
    for key, value in content.items():
        if key == "ros__parameters" and isinstance(value, Mapping):
            yield from ((node, name, inner) for name, inner in _dotted("", value))
        elif isinstance(value, Mapping):
            yield from _in_file(f"{node}/{key}".replace("//", "/") if node else _text(key), value)


def _dotted(prefix: str, values: Mapping[str, Any]) -> Iterable[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _dotted(f"{prefix}{key}.", value)
        else:
            yield f"{prefix}{key}", value


# -- QoS ---------------------------------------------------------------------------------------


def _qos_table(spec: FigureSpec, p: Topics, recorded: Recorded, lab_folder: Path) -> QosTable | None:
    rows = [
        _qos_row(endpoint, recorded)
        for topic in p.topics
        for kind in ("publisher", "subscription")
        for endpoint in _named(recorded.endpoints_on(topic, kind))[:MOST_ELEMENTS]
    ]
    return QosTable(spec.title, spec.session, tuple(rows)) if rows else None


def _named(endpoints: Sequence[Endpoint]) -> Sequence[Endpoint]:
    """Leave out endpoints whose node was never known, unless there are no others."""
    return [e for e in endpoints if UNKNOWN_NODE not in e.node] or endpoints


def _qos_row(endpoint: Endpoint, recorded: Recorded) -> QosRow:
    claim = _claim(endpoint, recorded.record.claims)
    qos = endpoint.qos
    said = claim.qos if claim is not None and claim.qos is not None else None
    history = said.history if said is not None and qos.history == "unknown" else qos.history
    depth = said.depth if said is not None and not qos.depth else qos.depth
    inside = claim is not None and claim.file and not claim.file.startswith("/")
    return QosRow(
        endpoint.topic,
        endpoint.kind,
        endpoint.node,
        qos.reliability,
        qos.durability,
        history,
        depth or None,
        f"{claim.file}:{claim.line}" if claim is not None and inside else "",
        len(recorded.bag.stream(endpoint.topic)),
    )


def _claim(endpoint: Endpoint, claims: Sequence[Claim]) -> Claim | None:
    """Return what the node's source asked for: the claim of the same node if there are several."""
    plain, node = endpoint.topic.rsplit("/", 1)[-1], endpoint.node.rsplit("/", 1)[-1]
    fitting = [c for c in claims if c.kind == endpoint.kind and c.name.rsplit("/", 1)[-1] == plain]
    of_node = [c for c in fitting if c.node.rsplit("/", 1)[-1] == node]
    return next(iter(of_node or fitting), None)


def _latency(spec: FigureSpec, p: Topics, recorded: Recorded, lab_folder: Path) -> Latency | None:
    found = [_distribution(recorded, topic) for topic in p.topics]
    there = tuple(d for d in found if d is not None)
    return Latency(spec.title, spec.session, there) if there else None


def _distribution(recorded: Recorded, topic: str) -> Distribution | None:
    stream = _plausible(recorded.stream(topic))
    if not len(stream):
        return None
    delays = (stream.received_ns - stream.source_ns) / 1e9
    low, quarter, median, three_quarters, high = np.quantile(delays, [0.05, 0.25, 0.5, 0.75, 0.95])
    kept = np.unique(np.linspace(0, len(delays) - 1, min(len(delays), MOST_POINTS // 2)).astype(int))
    return Distribution(
        recorded.used(topic),
        len(delays),
        float(low),
        float(quarter),
        float(median),
        float(three_quarters),
        float(high),
        float(delays.max()),
        _floats(delays[kept]),
    )


FIGURES: dict[str, FigureKind] = {
    "intervals": FigureKind(ExpectedRate, _intervals),
    "rate": FigureKind(ExpectedRate, _rate),
    "series": FigureKind(Elements, _series),
    "reports": FigureKind(Reported, _reports),
    "calls": FigureKind(OfService, _calls),
    "plan": FigureKind(Nothing, _plan),
    "qos_table": FigureKind(Topics, _qos_table),
    "latency": FigureKind(Topics, _latency),
}

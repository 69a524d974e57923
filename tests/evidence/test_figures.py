"""The data of pictures, taken from small bags written here."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grader.evidence.figures import (
    FIGURES,
    MOST_POINTS,
    Calls,
    Figure,
    Intervals,
    Latency,
    PlanTree,
    QosTable,
    Rate,
    Reports,
    Series,
    draw,
)
from grader.evidence.recorded import Recorded
from grader.recording.bag import Bag, BagWriter
from grader.recording.definitions import definition_of
from grader.recording.session import (
    Claim,
    Endpoint,
    GraphSnapshot,
    OutputLine,
    ProcessRun,
    Qos,
    SessionRecord,
    StepRun,
)
from grader.rubric import FigureSpec

FLOATS = "std_msgs/msg/Float64MultiArray"
START_NS = 1_800_000_000_000_000_000
ORACLE = """
def spans(streams, parameters, seed):
    state = streams["state"]
    return [{"start_ns": int(state.source_ns[0]), "end_ns": int(state.source_ns[-1]), "value": 0.25}]


def broken(streams, parameters, seed):
    raise KeyError("state")
"""

Row = tuple[int, int, list[float]]


def floats(values: list[float]) -> bytes:
    """CDR of a Float64MultiArray without a layout."""
    body = struct.pack(f"<4x{len(values)}d", *values) if values else b""
    return struct.pack("<BBHIII", 0, 1, 0, 0, 0, len(values)) + body


def recorded(folder: Path, topics: dict[str, list[Row]], **more: Any) -> Recorded:
    """Write a bag of (sequence, source time in ns since the start, values), received 0.2 ms later."""
    writer = BagWriter(folder, "bag")
    for topic, rows in topics.items():
        channel = writer.add_channel(topic, FLOATS, "", definition_of(FLOATS), [Qos()])
        for sequence, at_ns, values in rows:
            source_ns = START_NS + at_ns
            writer.write(
                channel,
                floats(values),
                received_ns=source_ns + 200_000,
                source_ns=source_ns,
                sequence=sequence,
            )
    writer.close()
    return Recorded(SessionRecord("alone", started_ns=START_NS, **more), Bag.open(folder))


def ticking(count: int, period_ns: int, *values: float) -> list[Row]:
    """Return messages one period apart, the first of them 1 s after the start."""
    return [(n + 1, 10**9 + n * period_ns, list(values)) for n in range(count)]


def drawn(kind: str, data: Recorded, lab: Path = Path(), **settings_: Any) -> Figure | None:
    """Draw a figure of a kind."""
    parameters = FIGURES[kind].parameters(**settings_)
    return draw(FigureSpec(kind=kind, title="Title", session="alone", **{"with": parameters}), data, lab)


@pytest.mark.parametrize(
    ("kind", "settings_"),
    [
        ("intervals", {"topic": "/a", "rate_hz": 100}),
        ("rate", {"topic": "/a", "rate_hz": 100}),
        ("series", {"topics": {"command": "/a"}, "field": "data"}),
        ("calls", {"service": "/s"}),
        ("plan", {}),
        ("qos_table", {"topics": ["/a"]}),
        ("latency", {"topics": ["/a"]}),
    ],
)
def test_nothing_recorded_is_no_figure(tmp_path: Path, kind: str, settings_: dict[str, Any]) -> None:
    """Without data there is no picture of any kind."""
    assert drawn(kind, recorded(tmp_path, {}), **settings_) is None


def test_intervals_lie_around_the_expected_one(tmp_path: Path) -> None:
    """A regular 100 Hz gives one filled bin, the middle one; a pause is counted outside."""
    rows = ticking(500, 10_000_000)
    rows += [(501 + n, rows[-1][1] + 10**9 + n * 10_000_000, []) for n in range(500)]
    figure = drawn("intervals", recorded(tmp_path, {"/a": rows}), topic="/a", rate_hz=100)
    assert isinstance(figure, Intervals)
    assert figure.expected_s == pytest.approx(0.01)
    assert len(figure.edges_s) == len(figure.counts) + 1
    assert [n for n, count in enumerate(figure.counts) if count] == [len(figure.counts) // 2]
    assert (figure.below, sum(figure.counts), figure.above) == (0, 998, 1)
    assert figure.median_s == pytest.approx(0.01)


def test_rate_needs_no_whole_number_of_messages_in_a_bin(tmp_path: Path) -> None:
    """83.3 Hz is shown as such in every half second, although bins hold 41 or 42 messages."""
    figure = drawn("rate", recorded(tmp_path, {"/a": ticking(300, 12_000_000)}), topic="/a", rate_hz=100)
    assert isinstance(figure, Rate)
    assert len(figure.times_s) == len(figure.rates_hz) + 1
    assert figure.rates_hz == pytest.approx([1e9 / 12_000_000] * len(figure.rates_hz))
    assert figure.times_s[0] == pytest.approx(1.0)


def test_rate_counts_what_the_recorder_lost(tmp_path: Path) -> None:
    """Sequence numbers tell the rate at which was written, even where every second message is missing."""
    rows = ticking(400, 10_000_000)[::2]
    figure = drawn("rate", recorded(tmp_path, {"/a": rows}), topic="/a", rate_hz=100)
    assert isinstance(figure, Rate)
    assert figure.rates_hz == pytest.approx([100.0] * len(figure.rates_hz))


def test_absurd_timestamps_neither_raise_nor_fill_memory(tmp_path: Path) -> None:
    """Messages stamped centuries ahead are left out of pictures over time."""
    rows = [*ticking(50, 10_000_000, 1.0), (51, 6 * 10**18, [1.0])]
    data = recorded(tmp_path, {"/a": rows})
    stream = data.stream("/a")
    stream.received_ns[-1] = START_NS + 2 * 10**9
    rate = drawn("rate", data, topic="/a", rate_hz=100)
    assert isinstance(rate, Rate)
    assert rate.times_s[-1] < 2
    assert isinstance(drawn("intervals", data, topic="/a", rate_hz=100), Intervals)


def test_series_keep_peaks_when_thinned(tmp_path: Path) -> None:
    """Of many points at most 400 are left, and a single outlier is among them."""
    rows = ticking(3000, 1_000_000, 0.0, 1.0)
    rows[1234][2][0] = 9.0
    data = recorded(tmp_path, {"/a": rows, "/b": ticking(10, 1_000_000, 0.5)})
    figure = drawn("series", data, topics={"command": "/a", "state": "/b"}, field="data", unit="rad")
    assert isinstance(figure, Series)
    assert [(line.role, line.index) for line in figure.lines] == [
        ("command", 0),
        ("command", 1),
        ("state", 0),
    ]
    assert all(len(line.times_s) == len(line.values) <= MOST_POINTS for line in figure.lines)
    assert max(figure.lines[0].values) == 9.0
    assert list(figure.lines[0].times_s) == sorted(figure.lines[0].times_s)


def test_series_show_the_chosen_elements(tmp_path: Path) -> None:
    """Indices pick elements; those that the messages do not have are left out."""
    data = recorded(tmp_path, {"/a": ticking(10, 1_000_000, 1.0, 2.0)})
    figure = drawn("series", data, topics={"command": "/a"}, field="data", indices=[1, 6])
    assert isinstance(figure, Series)
    assert [line.index for line in figure.lines] == [1]


def output(*texts: str) -> list[OutputLine]:
    """Return lines of output 10 ms apart from 1 s after the start."""
    return [OutputLine(START_NS + 10**9 + n * 10**7, "stdout", text) for n, text in enumerate(texts)]


@pytest.mark.parametrize(("oracle", "spans"), [("spans", 1), ("broken", 0)])
def test_reports_stand_against_the_oracle(tmp_path: Path, oracle: str, spans: int) -> None:
    """Printed numbers and right values are both there; a failing oracle takes only its own line away."""
    (tmp_path / "oracle.py").write_text(ORACLE)
    run = ProcessRun("node", "student", [], "node", output=output("error: 0.5", "hello", "error: 0.25"))
    data = recorded(tmp_path / "bag", {"/s": ticking(5, 10**8, 1.0)}, processes=[run])
    figure = drawn(
        "reports",
        data,
        tmp_path,
        artifact="node",
        pattern=r"error: (\S+)",
        streams={"state": "/s"},
        field="data",
        oracle=f"oracle.py:{oracle}",
    )
    assert isinstance(figure, Reports)
    assert figure.values == (0.5, 0.25)
    assert figure.times_s == pytest.approx((1.0, 1.02))
    assert len(figure.plateaus) == spans
    assert all((p.start_s, p.end_s, p.value) == pytest.approx((1.0, 1.4, 0.25)) for p in figure.plateaus)


def call_step(label: str, service: str, *responses: dict[str, Any] | None) -> StepRun:
    """Return a step of calls, each answered after 2 ms."""
    calls = [
        {"started_ns": START_NS + 10**9, "ended_ns": START_NS + 10**9 + 2_000_000, "response": response}
        for response in responses
    ]
    parameters = {"request": {"data": True}}
    return StepRun("call", parameters, label, result={"service": service, "calls": calls})


def test_calls_are_those_of_the_service(tmp_path: Path) -> None:
    """Answers, refusals and silence are told apart; calls of other services are not shown."""
    steps = [
        call_step("on", "/robot/enabel", {"success": True, "message": "it's on"}),
        call_step("other", "/else", {"success": True}),
        call_step("many", "/robot/enabel", {"success": False}, None, {"sum": 3}),
    ]
    data = recorded(tmp_path, {}, steps=steps, names={"/robot/enable": "/robot/enabel"})
    figure = drawn("calls", data, service="/robot/enable")
    assert isinstance(figure, Calls)
    assert [(g.label, g.request) for g in figure.groups] == [("on", "data: true"), ("many", "data: true")]
    first = figure.groups[0].calls[0]
    assert first.answer == "success: true, message: 'it's on'"
    assert first.latency_s == pytest.approx(0.002)
    assert [(c.answer is None, c.accepted) for c in figure.groups[1].calls] == [
        (False, False),
        (True, None),
        (False, None),
    ]


def test_plan_is_a_tree(tmp_path: Path) -> None:
    """Arguments, processes, parameters, remappings, includes and conditions of a plan are there."""
    plan = {
        "outcome": "ok",
        "arguments": [{"name": "rate", "default": "5", "file": "l.py", "line": 3}, {"name": "must"}],
        "includes": [{"file": "other.py", "arguments": {"a": "1"}, "by": "l.py", "line": 9}],
        "processes": [
            {
                "id": "talker-1",
                "path": "/ws/talker",
                "package": "pkg",
                "executable": "talker",
                "name": "talker",
                "namespace": "/ns",
                "file": "l.py",
                "line": 12,
                "parameters": [
                    {"name": "use_sim_time", "value": True, "type": "bool"},
                    {"file": "p.yaml", "content": {"/**": {"x": 1}}},
                ],
                "remappings": [["/a", "/b"]],
                "argv": ["--fast", "--ros-args", "-r", "__node:=talker"],
                "env": {"A_B": "c"},
                "when": {"after_s": 2.0},
            }
        ],
        "not_started": [{"what": "Node", "why": "its condition does not hold", "file": "l.py", "line": 20}],
        "warnings": [{"message": "odd", "file": "l.py", "line": 2}],
    }
    figure = drawn("plan", recorded(tmp_path, {}, plan=plan))
    assert isinstance(figure, PlanTree)
    assert [(a.name, a.value, a.where) for a in figure.arguments] == [
        ("rate", "'5'", "l.py:3"),
        ("must", "must be given", ""),
    ]
    assert (figure.includes[0].name, figure.includes[0].where) == ("other.py", "l.py:9")
    branch = figure.branches[0]
    assert (branch.name, branch.runs, branch.where) == ("/ns/talker", "pkg/talker", "l.py:12")
    assert branch.conditions == ("starts after 2.0 s",)
    assert branch.words == ("--fast",)
    assert [(e.name, e.value) for e in branch.environment] == [("A_B", "'c'")]
    kept = [(k.name, k.value, k.where) for k in figure.kept_back]
    assert kept == [("Node", "its condition does not hold", "l.py:20")]
    assert figure.warnings == ("odd (l.py:2)",)
    assert (branch.parameters[0].name, branch.parameters[0].value) == ("use_sim_time", "true")
    assert [(r.name, r.value) for r in branch.remappings] == [("/a", "/b")]


def test_a_parameter_file_shows_what_it_sets_and_for_whom(tmp_path: Path) -> None:
    """The parameters of a file stand one by one, with the node they are for, unless they are for every node."""
    content = {
        "/**": {"ros__parameters": {"rate": 2.5, "gains": {"p": 1}}},
        "ns": {"other": {"ros__parameters": {"mode": "a"}}},
    }
    files = [{"file": "p.yaml", "content": content}, {"file": "gone.yaml", "content": None}]
    plan = {"outcome": "ok", "processes": [{"name": "n", "parameters": files}]}
    figure = drawn("plan", recorded(tmp_path, {}, plan=plan))
    assert isinstance(figure, PlanTree)
    assert [(p.name, p.value, p.where) for p in figure.branches[0].parameters] == [
        ("rate", "2.5", "p.yaml"),
        ("gains.p", "1", "p.yaml"),
        ("mode", "'a'", "p.yaml, for ns/other"),
        ("file gone.yaml", "", ""),
    ]


def test_what_all_processes_find_in_their_environment_stands_once(tmp_path: Path) -> None:
    """A variable that is set for all is named above them, and not again for each."""
    processes = [{"name": "a", "env": {"ALL": "1", "ONE": "2"}}, {"name": "b", "env": {"ALL": "1"}}]
    figure = drawn("plan", recorded(tmp_path, {}, plan={"outcome": "ok", "processes": processes}))
    assert isinstance(figure, PlanTree)
    assert [e.name for e in figure.environment] == ["ALL"]
    assert [[e.name for e in b.environment] for b in figure.branches] == [["ONE"], []]
    alone = drawn("plan", recorded(tmp_path / "x", {}, plan={"outcome": "ok", "processes": processes[:1]}))
    assert isinstance(alone, PlanTree)
    assert not alone.environment


@pytest.mark.parametrize(
    ("when", "words"),
    [
        ({"on_exit_of": "a-1"}, "starts when a-1 has ended"),
        ({"after_s": 2, "since": {"on_start_of": "a-1"}}, "starts after 2 s, counted from when a-1 has started"),
        ({"on_transition_of": "a-1", "state": "active"}, "starts when a-1 has changed its state to active"),
        ({"on_shutdown": True}, "starts at the shutdown"),
    ],
)
def test_what_a_process_waits_for_is_told_in_words(tmp_path: Path, when: dict[str, Any], words: str) -> None:
    """Starts, ends and times of other processes are put into words."""
    plan = {"outcome": "ok", "processes": [{"id": "b-2", "path": "/b", "when": when}]}
    figure = drawn("plan", recorded(tmp_path, {}, plan=plan))
    assert isinstance(figure, PlanTree)
    assert figure.branches[0].conditions == (words,)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
plan_keys = st.sampled_from(
    [
        "outcome",
        "problem",
        "arguments",
        "processes",
        "includes",
        "warnings",
        "parameters",
        "remappings",
        "when",
    ]
)


@given(plan=st.dictionaries(plan_keys, json_values | st.lists(st.dictionaries(plan_keys, json_values))))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_plan_can_be_drawn(tmp_path: Path, plan: dict[str, Any]) -> None:
    """A plan comes from a process that ran a student's code: whatever it holds, drawing does not raise."""
    figure = drawn("plan", recorded(tmp_path, {}, plan=plan))
    assert figure is None or isinstance(figure, PlanTree)


def test_qos_comes_from_discovery_and_source(tmp_path: Path) -> None:
    """Reliability is the one seen, depth the one asked for; nodes without a name do not double the rows."""
    seen = Qos(reliability="best_effort", durability="volatile")
    asked = Qos(reliability="reliable", history="keep_last", depth=7)
    graph = GraphSnapshot(
        START_NS,
        endpoints=[
            Endpoint("publisher", "/a", FLOATS, "", "/node", "01", seen),
            Endpoint("publisher", "/a", FLOATS, "", "_NODE_NAME_UNKNOWN_", "02", seen),
            Endpoint("subscription", "/a", FLOATS, "", "/node", "03", seen),
        ],
    )
    claim = Claim("node", "publisher", "a", "/node", FLOATS, "node.py", 31, asked)
    data = recorded(tmp_path, {"/a": ticking(4, 10**7)}, graph=[graph], claims=[claim])
    figure = drawn("qos_table", data, topics=["/a", "/b"])
    assert isinstance(figure, QosTable)
    publisher, subscription = figure.rows
    assert (publisher.reliability, publisher.history, publisher.depth) == ("best_effort", "keep_last", 7)
    assert (publisher.where, publisher.messages) == ("node.py:31", 4)
    assert (subscription.history, subscription.depth, subscription.where) == ("unknown", None, "")


def test_latency_is_arrival_minus_sending(tmp_path: Path) -> None:
    """The distribution is of received minus source times; topics without messages are left out."""
    data = recorded(tmp_path, {"/a": ticking(1000, 10**6)})
    figure = drawn("latency", data, topics=["/a", "/b"])
    assert isinstance(figure, Latency)
    (only,) = figure.distributions
    assert (only.topic, only.count) == ("/a", 1000)
    assert [only.low_s, only.median_s, only.most_s] == pytest.approx([0.0002] * 3)
    assert len(only.sample_s) <= MOST_POINTS


def test_numbers_are_plain(tmp_path: Path) -> None:
    """Figures hold no numpy values, so that equal recordings give equal text."""
    figure = drawn("intervals", recorded(tmp_path, {"/a": ticking(50, 10**7)}), topic="/a", rate_hz=100)
    assert isinstance(figure, Intervals)
    assert not any(isinstance(v, np.generic) for v in (*figure.edges_s, *figure.counts, figure.median_s))


def test_numbers_that_nobody_means_are_not_drawn(tmp_path: Path) -> None:
    """Next to the largest number that there is, all others would lie on one line, and so would nothing."""
    rows: list[Row] = [(n + 1, 10**9 + n * 10**7, [1e308 if n % 2 else -1e308, float(n)]) for n in range(50)]
    figure = drawn("series", recorded(tmp_path, {"/a": rows}), topics={"command": "/a"}, field="data")
    assert isinstance(figure, Series)
    assert [(line.index, len(line.values)) for line in figure.lines] == [(1, 50)]
    alone = recorded(tmp_path / "alone", {"/a": [(number, time_ns, row[:1]) for number, time_ns, row in rows]})
    assert drawn("series", alone, topics={"command": "/a"}, field="data") is None

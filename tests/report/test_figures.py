"""Figures of small bags from these tests: their contents, form, descriptions and harmlessness."""

from __future__ import annotations

import re
import struct
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grader.evidence.recorded import Recorded
from grader.lab.rubric import FigureSpec
from grader.recording.session import (
    Claim,
    Endpoint,
    GraphSnapshot,
    OutputLine,
    ProcessRun,
    SessionRecord,
    StepRun,
)
from grader.report.figures import draw
from grader.report.figures.kinds import FIGURES
from grader.report.figures.plan import Tree
from grader.report.figures.svg import HALF, MOST_POINTS, NARROW, WIDE, Figure, duration
from launch_plan.format import SCHEMA
from ros_bag.definitions import definition_of
from ros_bag.qos import Qos
from ros_bag.reading import Bag
from ros_bag.writing import BagWriter
from tests.thorough import examples

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
    if values:
        body = struct.pack(f"<4x{len(values)}d", *values)
    else:
        body = b""
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
    parameters = FIGURES[kind](**settings_)
    spec = FigureSpec.model_validate(
        {"kind": kind, "title": "Title", "session": "alone", "with": parameters}
    )
    return draw(spec, data, lab)


def shown(kind: str, data: Recorded, lab: Path = Path(), **settings_: Any) -> Figure:
    """Draw a figure of a kind that is there."""
    figure = drawn(kind, data, lab, **settings_)
    assert figure is not None
    return figure


def picture(figure: Figure) -> ET.Element:
    """Return a figure's wide form, taken apart."""
    return ET.fromstring(str(figure.svg("f", HALF if figure.half else WIDE)))


def marks(figure: Figure, style: str) -> list[ET.Element]:
    """Return the marks of a style class."""
    return [element for element in picture(figure) if style in (element.get("class") or "").split()]


def dots(figure: Figure) -> int:
    """Return the number of dots."""
    return sum((path.get("d") or "").count("h0") for path in marks(figure, "dots"))


def lines(figure: Figure) -> list[list[tuple[float, float]]]:
    """Return the points of each line."""
    paths = [element.get("d") or "" for element in picture(figure).iter("path")]
    return [points_of(path) for path in paths if "l" in path]


def points_of(path: str) -> list[tuple[float, float]]:
    """Return the points of a line, which a path gives relative to each other."""
    found: list[tuple[float, float]] = []
    x = y = 0.0
    for right, down in re.findall(r"[Ml](-?[\d.]+) ?(-?[\d.]+)", path):
        x += float(right)
        y += float(down)
        found.append((round(x, 1), round(y, 1)))
    return found


def labels(figure: Figure) -> list[str]:
    """Return all that is written in a picture."""
    return [element.text or "" for element in picture(figure).iter("text")]


@pytest.mark.parametrize(
    ("kind", "settings_"),
    [
        ("intervals", {"topic": "/a", "rate_hz": 100}),
        ("rate", {"topic": "/a", "rate_hz": 100}),
        ("series", {"topics": {"command": "/a"}, "field": "data"}),
        ("field", {"lines": {"command": {"topic": "/a", "field": "data"}}}),
        ("calls", {"service": "/s"}),
        ("plan", {}),
        ("qos_table", {"topics": ["/a"]}),
        ("latency", {"topics": ["/a"]}),
    ],
)
def test_nothing_recorded_is_no_figure(
    tmp_path: Path, kind: str, settings_: dict[str, Any]
) -> None:
    """Without data there is no picture of any kind."""
    assert drawn(kind, recorded(tmp_path, {}), **settings_) is None


def test_intervals_lie_around_the_expected_one(tmp_path: Path) -> None:
    """A regular 100 Hz gives one filled bin, the middle one; a pause is counted outside."""
    rows = ticking(500, 10_000_000)
    rows += [(501 + n, rows[-1][1] + 10**9 + n * 10_000_000, []) for n in range(500)]
    figure = shown("intervals", recorded(tmp_path, {"/a": rows}), topic="/a", rate_hz=100)
    assert figure.caption.startswith(
        "999 intervals, median 10 ms; 95 % lie between 10 ms and 10 ms. Expected: 10 ms"
    )
    (bar,), (expected,) = marks(figure, "bar"), marks(figure, "expected")
    left = float(bar.get("x") or 0)
    assert left < float(expected.get("x1") or 0) < left + float(bar.get("width") or 0)
    assert "1 longer" in labels(figure)


def test_rate_needs_no_whole_number_of_messages_in_a_bin(tmp_path: Path) -> None:
    """83.3 Hz is shown as such in every half second, although bins hold 41 or 42 messages."""
    figure = shown(
        "rate", recorded(tmp_path, {"/a": ticking(300, 12_000_000)}), topic="/a", rate_hz=100
    )
    assert figure.caption.startswith(
        "Between 83.3 and 83.3 messages a second on /a, each step over 500 ms"
    )
    assert len({y for _, y in lines(figure)[0]}) == 1


def test_rate_counts_what_the_recorder_lost(tmp_path: Path) -> None:
    """Sequence numbers tell the rate at which was written, even where every second message is missing."""
    rows = ticking(400, 10_000_000)[::2]
    figure = shown("rate", recorded(tmp_path, {"/a": rows}), topic="/a", rate_hz=100)
    assert "Between 100 and 100" in figure.caption


def test_absurd_timestamps_neither_raise_nor_fill_memory(tmp_path: Path) -> None:
    """Messages stamped centuries ahead are left out of pictures over time."""
    rows = [*ticking(50, 10_000_000, 1.0), (51, 6 * 10**18, [1.0])]
    data = recorded(tmp_path, {"/a": rows})
    data.stream("/a").received_ns[-1] = START_NS + 2 * 10**9
    assert "Between 100 and 100" in shown("rate", data, topic="/a", rate_hz=100).caption
    assert "49 intervals" in shown("intervals", data, topic="/a", rate_hz=100).caption


def test_series_keep_peaks_when_thinned(tmp_path: Path) -> None:
    """At most 400 of many points are left, in order, and a single outlier is among them."""
    rows = ticking(3000, 1_000_000, 0.0, 1.0)
    rows[1234][2][0] = 9.0
    data = recorded(tmp_path, {"/a": rows, "/b": ticking(10, 1_000_000, 0.5)})
    figure = shown(
        "series", data, topics={"command": "/a", "state": "/b"}, field="data", unit="rad"
    )
    assert figure.key == (("line-0", "command: /a"), ("line-1", "state: /b"))
    assert figure.caption == "Range in rad: command data[0] 0 to 9. 2 of 3 lines do not move."
    first, state, second = lines(figure)
    for points in (first, second):
        assert len(points) <= MOST_POINTS
    assert len(state) == 2  # the ends of a level line
    assert first == sorted(first, key=lambda point: point[0])
    assert len({y for _, y in first}) == 2


def test_a_field_is_shown_with_its_limits(tmp_path: Path) -> None:
    """A line an element, in the colour of its name, and a dashed one a limit, within the picture."""
    rows = [(n + 1, 10**9 + n * 10_000_000, [0.1 * n, 1.0]) for n in range(20)]
    data = recorded(tmp_path, {"/a": rows, "/b": ticking(20, 10_000_000, 0.5)})
    named = {"robot": {"topic": "/a", "field": "data"}, "goal": {"topic": "/b", "field": "data[0]"}}
    figure = shown("field", data, lines=named, limits=(2.5,), unit="m")
    assert (
        figure.caption == "Range in m: robot 0 to 1.9; robot 1 to 1; goal 0.5 to 0.5. Dashed: 2.5."
    )
    assert [len(marks(figure, f"line-{n}")) for n in range(2)] == [2, 1]
    (limit,) = marks(figure, "expected")
    assert 30 < float(limit.get("y1") or 0) < min(y for line in lines(figure) for _, y in line)


def test_series_show_the_chosen_elements(tmp_path: Path) -> None:
    """Indices pick elements; those that the messages do not have are left out."""
    data = recorded(tmp_path, {"/a": ticking(10, 1_000_000, 1.0, 2.0)})
    figure = shown("series", data, topics={"command": "/a"}, field="data", indices=[1, 6])
    assert "data[1]" in labels(figure)
    assert len(lines(figure)) == 1


def output(*texts: str) -> list[OutputLine]:
    """Return lines of output 10 ms apart from 1 s after the start."""
    found = []
    for n, text in enumerate(texts):
        found.append(OutputLine(START_NS + 10**9 + n * 10**7, "stdout", text))
    return found


def reporting(folder: Path, oracle: str, *texts: str) -> Figure:
    """Draw a node's printed numbers against an oracle's."""
    (folder / "oracle.py").write_text(ORACLE)
    run = ProcessRun("node", "student", [], "node", output=output(*texts))
    data = recorded(folder / "bag", {"/s": ticking(5, 10**8, 1.0)}, processes=[run])
    with_ = {
        "pattern": r"error: (\S+)",
        "streams": {"state": "/s"},
        "field": "data",
        "oracle": f"oracle.py:{oracle}",
    }
    return shown("reports", data, folder, artifact="node", **with_)


@pytest.mark.parametrize(("oracle", "spans"), [("spans", 1), ("broken", 0)])
def test_reports_stand_against_the_oracle(tmp_path: Path, oracle: str, spans: int) -> None:
    """Printed numbers and right values are both there; a failing oracle takes only its own line away."""
    figure = reporting(tmp_path, oracle, "error: 0.5", "hello", "error: 0.25")
    assert figure.caption.startswith("2 reported numbers")
    assert dots(figure) == 2
    assert len(marks(figure, "plateau")) == spans


def test_outliers_do_not_flatten_the_rest(tmp_path: Path) -> None:
    """A report of a hundred million is left out of the picture, and the caption says so."""
    figure = reporting(tmp_path, "spans", "error: 0.25", "error: 100000000")
    assert "1 lie far outside" in figure.caption
    assert dots(figure) == 1


def call_step(label: str, service: str, *responses: dict[str, Any] | None) -> StepRun:
    """Return a step of calls, each answered after 2 ms."""
    calls = []
    for response in responses:
        calls.append(
            {
                "started_ns": START_NS + 10**9,
                "ended_ns": START_NS + 10**9 + 2_000_000,
                "response": response,
            }
        )
    parameters = {"request": {"data": True}}
    return StepRun("call", parameters, label, result={"service": service, "calls": calls})


def test_calls_are_those_of_the_service(tmp_path: Path) -> None:
    """Answers, refusals and silence have marks of their own; calls of other services are not shown."""
    steps = [
        call_step("on", "/robot/enabel", {"success": True, "message": "it's on"}),
        call_step("other", "/else", {"success": True}),
        call_step("many", "/robot/enabel", {"success": False}, None, {"sum": 3}),
    ]
    data = recorded(tmp_path, {}, steps=steps, names={"/robot/enable": "/robot/enabel"})
    figure = shown("calls", data, service="/robot/enable")
    assert [(label, request, len(calls)) for label, request, calls in figure.content] == [
        ("on", "data: true", 1),
        ("many", "data: true", 3),
    ]
    assert set(figure.key) == {
        ("call-accepted", "answered: true"),
        ("call-accepted", "answered"),
        ("call-refused", "answered: false"),
        ("call-silent", "no answer in time"),
    }
    assert dots(figure) == 2
    for style in ("call-refused", "call-silent"):
        assert len(marks(figure, style)) == 1
    assert (
        figure.caption
        == "4 calls of /robot/enabel; the slowest answer took 2 ms. 1 got no answer in time."
    )


def planned(folder: Path, *processes: dict[str, Any], **plan: Any) -> Tree:
    """Return the tree in the figure of a plan."""
    listed = [{"id": f"p-{n}", "path": "/p", **process} for n, process in enumerate(processes)]
    whole = {"schema": SCHEMA, "outcome": "ok", "processes": listed, **plan}
    tree = shown("plan", recorded(folder, {}, plan=whole)).content
    assert isinstance(tree, Tree)
    return tree


def test_plan_is_a_tree(tmp_path: Path) -> None:
    """Arguments, processes, parameters, remappings, includes and conditions of a plan are there."""
    talker = {
        "package": "pkg",
        "executable": "talker",
        "kind": "node",
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
    content = planned(
        tmp_path,
        talker,
        arguments=[{"name": "rate", "default": "5", "file": "l.py", "line": 3}, {"name": "must"}],
        includes=[{"file": "other.py", "arguments": {"a": "1"}, "by": "l.py", "line": 9}],
        not_started=[
            {"what": "Node", "why": "its condition does not hold", "file": "l.py", "line": 20}
        ],
        warnings=[{"message": "odd", "file": "l.py", "line": 2}],
    )
    assert content.arguments == [("rate", "'5'", "l.py:3"), ("must", "must be given", "")]
    assert content.includes == [("other.py", "a: '1'", "l.py:9")]
    (process,) = content.processes
    assert (process.name, process.runs, process.where) == (
        "/ns/talker",
        "pkg/talker",
        "l.py:12",
    )
    assert process.conditions == ["starts after 2.0 s"]
    assert process.words == ["--fast"]
    assert process.environment == [("A_B", "'c'", "")]
    assert content.not_started == [("Node", "its condition does not hold", "l.py:20")]
    assert content.warnings == [("odd", "l.py:2")]
    assert process.parameters[0] == ("use_sim_time", "true", "bool")
    assert process.remappings == (("/a", "/b"),)


def test_a_parameter_file_shows_what_it_sets_and_for_whom(tmp_path: Path) -> None:
    """The parameters of a file stand one by one, with the node they are for, unless they are for every node."""
    content = {
        "/**": {"ros__parameters": {"rate": 2.5, "gains": {"p": 1}}},
        "ns": {"other": {"ros__parameters": {"mode": "a"}}},
    }
    files = [{"file": "p.yaml", "content": content}, {"file": "gone.yaml", "content": None}]
    assert planned(tmp_path, {"name": "n", "parameters": files}).processes[0].parameters == [
        ("rate", "2.5", "p.yaml"),
        ("gains.p", "1", "p.yaml"),
        ("mode", "'a'", "p.yaml, for ns/other"),
        ("file gone.yaml", "", ""),
    ]


def test_what_all_processes_find_in_their_environment_stands_once(tmp_path: Path) -> None:
    """A variable that is set for all is named above them, and not again for each."""
    processes: list[dict[str, Any]] = [
        {"name": "a", "env": {"ALL": "1", "ONE": "2"}},
        {"name": "b", "env": {"ALL": "1"}},
    ]
    content = planned(tmp_path, *processes)
    assert content.environment == [("ALL", "'1'", "")]
    assert [p.environment for p in content.processes] == [[("ONE", "'2'", "")], []]
    assert not planned(tmp_path / "x", processes[0]).environment


@pytest.mark.parametrize(
    ("when", "words"),
    [
        ({"on_exit_of": "a-1"}, "starts when a-1 has ended"),
        (
            {"after_s": 2, "since": {"on_start_of": "a-1"}},
            "starts after 2 s, counted from when a-1 has started",
        ),
        (
            {"on_transition_of": "a-1", "state": "active"},
            "starts when a-1 has changed its state to active",
        ),
        ({"on_shutdown": True}, "starts at the shutdown"),
    ],
)
def test_what_a_process_waits_for_is_reported_in_words(
    tmp_path: Path, when: dict[str, Any], words: str
) -> None:
    """Starts, ends and times of other processes are put into words."""
    assert planned(tmp_path, {"when": when}).processes[0].conditions == [words]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
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


@given(
    plan=st.dictionaries(plan_keys, json_values | st.lists(st.dictionaries(plan_keys, json_values)))
)
@settings(
    max_examples=examples(60),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_any_plan_can_be_drawn(tmp_path: Path, plan: dict[str, Any]) -> None:
    """A plan comes from a process that ran a student's code: whatever it holds, drawing does not raise."""
    drawn("plan", recorded(tmp_path, {}, plan={"schema": SCHEMA, "outcome": "ok", **plan}))


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
    publisher, subscription = shown("qos_table", data, topics=["/a", "/b"]).content
    assert publisher.qos == Qos(
        reliability="best_effort", durability="volatile", history="keep_last", depth=7
    )
    assert (publisher.where, publisher.messages) == ("node.py:31", 4)
    assert (subscription.qos, subscription.where) == (seen, "")


def test_latency_is_arrival_minus_sending(tmp_path: Path) -> None:
    """The distribution is of received minus source times; topics without messages are left out."""
    data = recorded(tmp_path, {"/a": ticking(1000, 10**6)})
    figure = shown("latency", data, topics=["/a", "/b"])
    assert figure.caption == "/a: half within 200 µs, 95 % within 200 µs, longest 200 µs."
    assert "/a (1000)" in labels(figure)
    assert dots(figure) <= MOST_POINTS


def test_numbers_that_nobody_means_are_not_drawn(tmp_path: Path) -> None:
    """Next to the largest number that there is, all others would lie on one line, and so would nothing."""
    rows: list[Row] = []
    for n in range(50):
        rows.append((n + 1, 10**9 + n * 10**7, [1e308 if n % 2 else -1e308, float(n)]))
    figure = shown(
        "series", recorded(tmp_path, {"/a": rows}), topics={"command": "/a"}, field="data"
    )
    assert "data[1]" in labels(figure)
    (rising,) = lines(figure)
    assert rising == sorted(rising, key=lambda point: (point[0], -point[1]))
    alone = recorded(
        tmp_path / "alone", {"/a": [(number, time_ns, row[:1]) for number, time_ns, row in rows]}
    )
    assert drawn("series", alone, topics={"command": "/a"}, field="data") is None


EVIL = "/a<script>alert('x')</script>\x1b[31m\u202e"


@pytest.fixture
def hostile(tmp_path: Path) -> list[Figure]:
    """Give a picture of each kind, of topics and answers that a student chose."""
    steps = [call_step("a", EVIL, {"success": True}, {"success": False}, None, {"text": EVIL})]
    steps.append(
        StepRun(
            "set_parameters",
            {"values": {EVIL: EVIL}},
            started_ns=0,
            ended_ns=START_NS + 10**9 + 10**6,
            outcome="done",
        )
    )
    rows = [(n + 1, 10**9 + n * 10**7 + 10**5 * (n % 3), [n / 10, 1.0, -n / 7]) for n in range(300)]
    names = {"/a": EVIL, "/s": EVIL}
    data = recorded(tmp_path / "evil", {EVIL: rows, "/b": rows[5:9]}, steps=steps, names=names)
    (tmp_path / "reports").mkdir()
    return [
        shown("intervals", data, topic="/a", rate_hz=100),
        shown("rate", data, topic="/a", rate_hz=100),
        shown("series", data, topics={"command": "/a", "state": "/b"}, field="data"),
        shown("calls", data, service="/s"),
        shown("latency", data, topics=["/a", "/b"]),
        reporting(tmp_path / "reports", "spans", "error: 0.3", "error: 100000000"),
    ]


def test_each_form_is_a_described_image_within_its_frame(hostile: list[Figure]) -> None:
    """Both forms parse, are labelled by title and description, and no mark lies beyond them or is no number."""
    for figure in hostile:
        for width in (HALF,) if figure.half else (WIDE, NARROW):
            form = str(figure.svg("fig-1", width))
            require_described(ET.fromstring(form), figure.caption)
            require_within_frame(form)


def require_described(root: ET.Element, caption: str) -> None:
    """Fail unless an image is labelled by its title and its description."""
    title, description = root[:2]
    assert root.get("role") == "img"
    assert (title.tag, description.tag) == ("title", "desc")
    assert (title.text, description.text) == ("Title", caption)
    labels_of_root = (root.get("aria-labelledby") or "").split()
    assert labels_of_root == [title.get("id"), description.get("id")]


def require_within_frame(form: str) -> None:
    """Fail unless each mark's place is a number within the frame."""
    assert "nan" not in form
    assert "inf" not in form
    size = map(float, re.findall(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', form)[0])
    for axis, limit in zip("xy", size, strict=True):
        numbers = re.findall(rf'(?<![a-z]){axis}[12]?="(-?[\d.]+)"', form)
        for n in numbers:
            assert -1 <= float(n) <= limit + 1


def test_names_of_students_stay_text(hostile: list[Figure]) -> None:
    """Topic names and answers can neither become elements nor carry control characters."""
    for figure in hostile:
        form = figure.svg("fig-1", WIDE)
        assert "<script" not in form
        assert "\x1b" not in form
        assert "\u202e" not in form


def test_equal_recordings_give_equal_text(tmp_path: Path) -> None:
    """A picture is drawn twice with the same bytes."""
    forms = []
    for name in ("one", "two"):
        forms.append(
            shown(
                "intervals",
                recorded(tmp_path / name, {"/a": ticking(50, 10**7)}),
                topic="/a",
                rate_hz=100,
            ).svg("f", HALF)
        )
    assert forms[0] == forms[1]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.01, "10 ms"), (0.0001234, "123 µs"), (1.5, "1.5 s"), (0.0, "0 s"), (12.3456, "12.3 s")],
)
def test_durations_have_the_unit_that_suits(seconds: float, text: str) -> None:
    """Short times are written in ms or µs, with three digits."""
    assert duration(seconds) == text

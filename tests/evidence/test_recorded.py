"""A recorded session as the checks see it: names that students used, windows, numbers, endpoints, processes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grader.evidence.cpu_delay import Span
from grader.evidence.recorded import Recorded
from grader.recording.session import (
    UNKNOWN_NODE,
    Endpoint,
    GraphSnapshot,
    MachineSample,
    ProcessRun,
    Trusted,
    Usage,
)
from tests.synthetic import FLOATS, START_NS, Session, at


def test_a_folder_without_a_recording_is_no_recording(tmp_path: Path) -> None:
    """Without a record or a bag there is nothing to open."""
    with pytest.raises(FileNotFoundError):
        Recorded.open(tmp_path)
    session = Session(tmp_path)
    session.recorded()
    next(session.folder.glob("*.mcap")).unlink()
    with pytest.raises(FileNotFoundError):
        Recorded.open(session.folder)


def test_the_students_names_are_followed(tmp_path: Path) -> None:
    """A topic of the rubric is read under the name that the student used."""
    session = (
        Session(tmp_path).messages("/command", [[1.0]], [1.0]).endpoint("publisher", "/command")
    )
    recorded = session.called("/commands=/command").recorded()
    assert recorded.used("/commands") == "/command"
    assert len(recorded.stream("/commands")) == 1
    assert [e.topic for e in recorded.endpoints_on("/commands", "publisher")] == ["/command"]


def test_times_are_since_the_sessions_start(tmp_path: Path) -> None:
    """The session's start is zero."""
    recorded = Session(tmp_path).recorded()
    assert recorded.since_start_s(at(2.5)) == 2.5
    assert Span(at(1.0), at(3.5)).duration_s == 2.5


def test_a_window_is_there_if_it_opened(tmp_path: Path) -> None:
    """A step that observed has a span; one that timed out, or is not there, has none."""
    recorded = Session(tmp_path).window(1.0, 2.0).step("observe", "late", "timeout").recorded()
    assert recorded.window("window") == Span(at(1.0), at(2.0))
    assert recorded.window("late") is None
    assert recorded.window("other") is None


def test_a_step_that_publishes_is_a_window(tmp_path: Path) -> None:
    """The window of a `publish` step lasts from its start to its end."""
    recorded = Session(tmp_path).step("publish", "commands", topic="/commands").recorded()
    step = recorded.step("commands")
    assert step is not None
    assert recorded.window("commands") == Span(step.started_ns, step.ended_ns)


@pytest.mark.parametrize(
    ("first_s", "begin_s"),
    [(1.2, 1.2), (0.4, 1.3), (1.7, 1.3)],
    ids=["came while the step waited", "came before the step", "came after the window opened"],
)
def test_a_window_holds_the_message_that_opened_it(
    tmp_path: Path, first_s: float, begin_s: float
) -> None:
    """The director opens a window some milliseconds after the awaited message."""
    session = Session(tmp_path).messages("/a", [[1.0]] * 3, [first_s, first_s + 0.1, 2.5])
    session.window(1.3, 2.0)
    session.record.steps[-1].parameters = {"first_message_on": "/a"}
    assert session.recorded().window("window") == Span(at(begin_s), at(2.0))


# -- numbers ---------------------------------------------------------------------------------------


def test_rows_of_the_most_frequent_length_are_the_series(tmp_path: Path) -> None:
    """Odd messages are left out, those that are not finite too, and order is by source time."""
    rows = [[1.0, 1.0], [2.0], [float("nan"), 0.0], [3.0, 3.0], []]
    recorded = Session(tmp_path).messages("/a", rows, [5.0, 1.0, 2.0, 3.0, 4.0]).recorded()
    series = recorded.numeric("/a", "data")
    assert series is not None
    assert series.values.tolist() == [[3.0, 3.0], [1.0, 1.0]]
    assert series.sequence.tolist() == [4, 1]
    with_nan = recorded.numeric("/a", "data", finite=False)
    assert with_nan is not None
    assert len(with_nan.values) == 3


def test_the_greatest_of_equally_frequent_lengths_counts(tmp_path: Path) -> None:
    """Messages that are not finite do not count for the length of theirs."""
    nan = float("nan")
    rows = [[1.0], [2.0, 2.0], [3.0], [4.0, 4.0], [nan, nan, nan], [nan, 0.0, 0.0], [0.0, 0.0, nan]]
    recorded = Session(tmp_path).messages("/a", rows, list(range(1, 8))).recorded()
    series = recorded.numeric("/a", "data")
    assert series is not None
    assert series.values.tolist() == [[2.0, 2.0], [4.0, 4.0]]


def test_a_topic_without_numbers_has_no_series(tmp_path: Path) -> None:
    """Text, empty messages and a topic that is not there have none."""
    session = Session(tmp_path).texts("/text", ["hello"], [1.0]).messages("/empty", [[]], [1.0])
    recorded = session.recorded()
    assert [recorded.numeric(name, "data") for name in ("/text", "/empty", "/none")] == [
        None,
        None,
        None,
    ]
    assert recorded.rows("/text", "data") == (None,)


def test_another_field_of_numbers_stands_in(tmp_path: Path) -> None:
    """Without the field, the first numeric field is read, because the type is charged elsewhere."""
    recorded = Session(tmp_path).messages("/a", [[1.0, 2.0]], [1.0]).recorded()
    series = recorded.numeric("/a", "position")
    assert series is not None
    assert series.values.tolist() == [[1.0, 2.0]]


# -- the graph -------------------------------------------------------------------------------------


def endpoint(gid: str, node: str, topic: str = "/a") -> Endpoint:
    """Give a publisher."""
    return Endpoint("publisher", topic, FLOATS, "", node, gid)


def test_an_endpoint_whose_node_was_unknown_belongs_to_its_participant(tmp_path: Path) -> None:
    """The node is learned from later discovery or from another endpoint of the process.

    An endpoint that stays unknown is left out.
    """
    session = Session(tmp_path)
    session.record.graph = [
        GraphSnapshot(
            at(1.0),
            endpoints=[
                endpoint("a" * 24 + "01", UNKNOWN_NODE),
                endpoint("b" * 24 + "01", UNKNOWN_NODE),
            ],
        ),
        GraphSnapshot(
            at(2.0),
            endpoints=[endpoint("a" * 24 + "01", "/late"), endpoint("c" * 24 + "01", UNKNOWN_NODE)],
        ),
        GraphSnapshot(at(3.0), endpoints=[endpoint("c" * 24 + "02", "/same", "/b")]),
    ]
    recorded = session.recorded()
    assert sorted((e.gid[0], e.node) for e in recorded.endpoints) == [
        ("a", "/late"),
        ("c", "/same"),
        ("c", "/same"),
    ]
    assert [e.node for e in recorded.endpoints_on("/a", "publisher", without=["/late"])] == [
        "/same"
    ]


def test_an_endpoint_of_the_graders_is_no_students_under_any_name(tmp_path: Path) -> None:
    """Anybody can tell the graph which node an endpoint belongs to; the gid that came through the pipe counts."""
    session = Session(tmp_path)
    renamed, own = endpoint("a" * 24 + "01", "/student"), endpoint("b" * 24 + "01", "/arm")
    session.record.graph = [
        GraphSnapshot(at(1.0), endpoints=[renamed, own, endpoint("a" * 24 + "02", "/arm", "/b")]),
    ]
    session.record.trusted = [Trusted("arm", "a" * 24)]
    recorded = session.recorded()
    assert [e.gid for e in recorded.endpoints_on("/a", "publisher", without=["/arm"])] == [own.gid]
    assert [e.gid for e in recorded.endpoints_on("/a", "publisher")] == [renamed.gid, own.gid]


def test_nodes_of_all_times_are_listed_once(tmp_path: Path) -> None:
    """A node that left is still known."""
    session = Session(tmp_path).node("/a")
    session.record.graph.append(GraphSnapshot(at(2.0), nodes=["/b", "/a"]))
    assert session.recorded().nodes == ("/a", "/b")


# -- processes -------------------------------------------------------------------------------------


def test_processes_are_found_by_artifact_and_by_name(tmp_path: Path) -> None:
    """An artifact's own runs are in order; one under another name is not among them."""
    session = Session(tmp_path).process("it", ["first"]).process("it", ["second"])
    session.process("twin", ["third"], artifact="it")
    recorded = session.recorded()
    assert [p.output[0].text for p in recorded.processes_of("it")] == ["first", "second"]
    assert [line.text for line in recorded.output_of("it")] == ["second"]
    assert recorded.output_of("none") == []
    twin = recorded.process("twin")
    assert twin is not None
    assert twin.artifact == "it"
    assert recorded.process("none") is None


def run(*samples: tuple[float, float, float]) -> ProcessRun:
    """Give a process by samples of time, CPU time and run-queue delay, all in s."""
    usage = [Usage(at(t), round(cpu * 1e9), round(delay * 1e9)) for t, cpu, delay in samples]
    return ProcessRun("it", "student", [], usage=usage)


def machine_delay_s_of(
    folder: Path, process: ProcessRun, span: Span, stolen_s: float = 0.0
) -> float:
    """Return the delay of a process on a machine from which its host took some time, evenly over 10 s."""
    recorded = Session(folder / "session").recorded()
    recorded.record.machine = [
        MachineSample(at(0), 0, 0),
        MachineSample(at(10), 0, round(stolen_s * 1e9)),
    ]
    return recorded.machine_delay_s(process, span)


def test_time_that_the_host_took_counts_as_the_machines(tmp_path: Path) -> None:
    """Half of a span with 4 s taken by a virtual machine's host had 2 s of them."""
    process = run((0, 0, 0), (5, 1, 1), (10, 1, 1))
    assert machine_delay_s_of(tmp_path, process, Span(at(0), at(5)), stolen_s=4.0) == pytest.approx(
        3.0
    )


def test_delay_between_two_samples_may_all_lie_in_a_part(tmp_path: Path) -> None:
    """Two samples give only the sum between them; a span may contain as much of it as fits."""
    process = run((0, 0, 0), (1, 0, 0.4), (2, 0, 0.4), (3, 0, 1.4))
    assert machine_delay_s_of(tmp_path, process, Span(at(0.5), at(2.0))) == pytest.approx(0.4)
    assert machine_delay_s_of(tmp_path, process, Span(at(0.9), at(2.2))) == pytest.approx(0.1 + 0.2)


def test_delay_before_the_first_sample_counts(tmp_path: Path) -> None:
    """A process that began before its first sample was delayed since its start."""
    process = run((1.0, 0.2, 0.5), (2.0, 0.2, 0.5))
    process.started_ns = at(0.2)
    assert machine_delay_s_of(tmp_path, process, Span(at(0.8), at(2.0))) == pytest.approx(0.2)


def test_what_follows_the_last_sample_of_a_process_was_delayed_as_usual(tmp_path: Path) -> None:
    """Nobody can ask a process that has ended; its delay is noted then as it was last seen."""
    process = run((0.0, 0, 0), (1.0, 0, 0.4), (1.5, 0.1, 0.4))
    process.exited_ns = at(1.5)
    assert machine_delay_s_of(tmp_path, process, Span(at(0), at(1.5))) == pytest.approx(0.6)
    process.ended_by = "interrupt"
    assert machine_delay_s_of(tmp_path, process, Span(at(0), at(1.5))) == pytest.approx(0.4)


def test_a_machine_that_stalled_delayed_all_its_processes(tmp_path: Path) -> None:
    """Late samples of the grader reveal a frozen machine; frozen processes wait in no queue."""
    recorded = Session(tmp_path).recorded()
    process = run((0, 0, 0), (10, 1, 0.0))
    recorded.record.machine = [MachineSample(at(t), 0) for t in (0.5, 1.0, 1.5, 2.0, 4.0, 4.5, 5.0)]
    assert recorded.machine_delay_s(process, Span(at(1), at(5))) == pytest.approx(1.5)
    assert recorded.machine_delay_s(process, Span(at(3.5), at(5))) == pytest.approx(0.5)
    assert recorded.machine_delay_s(process, Span(at(4), at(5))) == 0.0
    even = Session(tmp_path / "even").recorded()
    even.record.machine = [MachineSample(at(t / 2), 0) for t in range(10)]
    assert even.machine_delay_s(process, Span(at(1), at(5))) == 0.0


def test_delay_is_never_more_than_the_time_in_which_the_process_did_not_run(tmp_path: Path) -> None:
    """A process that is busy all the time was kept from nothing by the machine."""
    assert machine_delay_s_of(
        tmp_path, run((0, 0, 0), (10, 10, 8)), Span(at(0), at(10))
    ) == pytest.approx(0.0)
    assert machine_delay_s_of(
        tmp_path, run((0, 0, 0), (10, 7, 8)), Span(at(0), at(10))
    ) == pytest.approx(3.0)


def test_without_samples_the_machine_is_not_blamed(tmp_path: Path) -> None:
    """One sample says nothing, and beyond the last there is no delay."""
    assert machine_delay_s_of(tmp_path, run((0, 0, 5)), Span(START_NS, at(10))) == 0.0
    assert machine_delay_s_of(
        tmp_path, run((0, 0, 0), (1, 0, 1)), Span(at(5), at(10))
    ) == pytest.approx(0.0)
    assert np.isfinite(machine_delay_s_of(tmp_path, run(), Span(at(5), at(5))))


def test_of_a_process_that_was_not_watched_samples_tell_what_may_have_waited_for_it(
    tmp_path: Path,
) -> None:
    """Between samples only sums are known: two delays may have followed each other without a pause."""
    process = run((0, 0, 0), (1, 0, 0.05), (2, 0, 0.10), (3, 0, 0.10), (4, 0, 0.14), (5, 0, 0.14))
    recorded = Session(tmp_path).recorded()
    span = Span(at(0), at(5))
    assert recorded.backlog(process, span, 0.0).lost_s == pytest.approx(0.14)
    assert recorded.backlog(process, span, 0.08).lost_s == pytest.approx(0.02)
    assert recorded.backlog(process, span, 0.10).lost_s == 0.0
    assert recorded.backlog(process, Span(at(2), at(5)), 0.03).lost_s == pytest.approx(0.01)


@pytest.mark.parametrize(("cpu_s", "lost_s"), [(7.0, 3.0), (3.0, 0.0)])
def test_who_had_no_time_left_would_have_done_more(
    tmp_path: Path, cpu_s: float, lost_s: float
) -> None:
    """A process that always computes or waits lost all its waiting time.

    With idle time, nothing.
    """
    session = Session(tmp_path).process("it").delayed("it", 0.0, 10.0, cpu_s)
    session.disturbed("it", *((n / 10, 0.03) for n in range(100)))
    recorded = session.recorded()
    (process,) = recorded.processes_of("it")
    assert recorded.backlog(process, Span(at(0), at(10)), 0.2).lost_s == pytest.approx(
        lost_s, abs=0.1
    )


def test_the_delays_of_a_process_that_was_watched_count_where_they_are(tmp_path: Path) -> None:
    """Samples do not count then; of a delay that reaches over a span, as much as the span has room for."""
    recorded = Session(tmp_path).recorded()
    process = run((0, 0, 0), (10, 1, 9))
    process.disturbed = [[at(1), 20_000_000, 5_000_000], [at(4), 200_000_000, 100_000_000]]
    assert recorded.machine_delay_s(process, Span(at(0), at(10))) == pytest.approx(0.105)
    assert recorded.machine_delay_s(process, Span(at(2), at(4.05))) == pytest.approx(0.05)
    assert recorded.machine_delay_s(replace(process, disturbed=[]), Span(at(0), at(10))) == 0.0


def test_what_the_students_unseen_processes_used_was_not_with_others(tmp_path: Path) -> None:
    """A program that keeps itself from its core by processes that come and go has itself to blame."""
    recorded = Session(tmp_path).recorded()
    recorded.record.machine = [
        MachineSample(at(t), 0, students_ns=round(0.3 * t * 1e9)) for t in (0, 10)
    ]
    process = run((0, 0, 0), (10, 1, 9))
    process.disturbed = [[at(1), 5_000_000_000, 3_000_000_000]]
    recorded.record.processes = [process]
    assert recorded.machine_delay_s(process, Span(at(0), at(10))) == pytest.approx(
        3.0 - (3.0 - 1.0)
    )


@pytest.mark.parametrize(("stalled_ns", "delay_s"), [(0, 0.0), (30_000_000, 3.0)])
def test_a_core_that_stands_still_counts_as_idle_and_delays_all_the_same(
    tmp_path: Path, stalled_ns: int, delay_s: float
) -> None:
    """A host that stops a mostly idle machine leaves its idle time growing; nobody else had the core then."""
    recorded = Session(tmp_path).recorded()
    recorded.record.machine = [
        MachineSample(at(t), 0, idle_ns={"1": round(0.95e9 * t)}) for t in range(11)
    ]
    process = run(*((t, 0.05 * t, 0.0) for t in range(11)))
    process.core, process.held_ns = 1, at(0)
    process.disturbed = [[at(n / 10), 40_000_000, 30_000_000, stalled_ns] for n in range(100)]
    recorded.record.processes = [process]
    span = Span(at(0), at(10))
    assert recorded.machine_delay_s(process, span) == pytest.approx(delay_s, abs=0.1)
    together_s = sum(delay.delay_ns for delay in recorded.delays(process)) / 1e9
    assert together_s == pytest.approx(delay_s, abs=0.3)


@pytest.mark.parametrize(("cpu_s", "delay_s"), [(9.7, 0.3), (5.0, 4.0), (2.0, 4.0)])
def test_children_that_share_a_programs_core_are_no_delay_by_the_machine(
    tmp_path: Path, cpu_s: float, delay_s: float
) -> None:
    """Forty busy children make their parent wait; only the time that others had the core counts, however it was noted."""
    recorded = Session(tmp_path).recorded()
    recorded.record.machine = [
        MachineSample(at(t), 0, idle_ns={"0": round(t * 1e9), "1": 0}) for t in range(11)
    ]
    process = run(*((t, cpu_s * t / 10, 39.0 * t) for t in range(11)))
    process.core, process.held_ns = 1, at(0)
    process.disturbed = [[at(n / 10), 95_000_000, 40_000_000] for n in range(100)]
    recorded.record.processes = [process]
    whole = Span(at(0), at(10))
    assert recorded.machine_delay_s(process, whole) == pytest.approx(delay_s, abs=0.03)
    # The noted delays add up to the same, or to a little more at the uncertain ends of spans.
    assert sum(d.delay_ns for d in recorded.delays(process)) / 1e9 == pytest.approx(
        delay_s, abs=0.15
    )


def test_the_longest_delay_is_of_a_process_that_is_not_the_recorder(tmp_path: Path) -> None:
    """Students' and reference processes count; the grader's own may be late."""
    session = (
        Session(tmp_path).process("a").process("b").delayed("a", 1.0, 10.0).delayed("b", 3.0, 10.0)
    )
    span = Span(at(0), at(10))
    assert session.recorded().longest_delay_s(span) == pytest.approx(3.0)
    session.record.processes[1].role = "grader"
    assert session.recorded().longest_delay_s(span) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("idle_share", "own_s", "fellow_s", "waited_s", "delay_s"),
    [
        (0.0, 2.0, 0.0, 7.5, 7.5),
        (0.5, 2.0, 0.0, 7.5, 3.0),
        (0.0, 2.0, 6.0, 7.5, 2.0),
        (0.0, 2.0, 9.0, 7.5, 0.0),
        (0.0, 5.0, 0.0, 40.0, 2.5),
    ],
)
def test_a_wait_for_ones_own_is_not_the_machines(
    tmp_path: Path,
    idle_share: float,
    own_s: float,
    fellow_s: float,
    waited_s: float,
    delay_s: float,
) -> None:
    """A delay counts up to the time that others used the core.

    Simultaneous waits count by their share.
    """
    recorded = Session(tmp_path).recorded()
    samples = []
    for t in (0, 10):
        samples.append(MachineSample(at(t), 0, idle_ns={"0": 0, "1": round(idle_share * t * 1e9)}))
    recorded.record.machine = samples
    process, fellow = run((0, 0, 0), (10, own_s, waited_s)), run((0, 0, 0), (10, fellow_s, 0))
    for each in (process, fellow):
        each.core, each.held_ns = 1, at(0)
    recorded.record.processes = [process, fellow]
    assert recorded.machine_delay_s(process, Span(at(0), at(10))) == pytest.approx(
        delay_s, abs=0.03
    )


@pytest.mark.parametrize(("together_s", "delay_s"), [(None, 7.5), (2.0, 7.5), (9.0, 1.0)])
def test_processes_that_nobody_saw_or_waited_for_are_the_students(
    tmp_path: Path, together_s: float | None, delay_s: float
) -> None:
    """CPU time counted by the kernel, and used by no known process, was the students'."""
    recorded = Session(tmp_path).recorded()
    used = [None if together_s is None else round(together_s * share * 1e9) for share in (0, 1)]
    samples = []
    for t, ns in zip((0, 10), used, strict=True):
        samples.append(MachineSample(at(t), 0, idle_ns={"1": 0}, students_ns=ns))
    recorded.record.machine = samples
    process = run((0, 0, 0), (10, 2.0, 7.5))
    process.core, process.held_ns = 1, at(0)
    recorded.record.processes = [process]
    assert recorded.machine_delay_s(process, Span(at(0), at(10))) == pytest.approx(
        delay_s, abs=0.03
    )

"""Processes in the timeline: nodes in the graph, logs, exceptions, ends and delays."""

from __future__ import annotations

import re
from collections.abc import Iterator

from grader.evidence.crash.tracebacks import tracebacks
from grader.evidence.recorded import Recorded
from grader.recording.session import ProcessRun
from grader.report.figures.svg import duration
from grader.report.timeline.moments import Lane, LogLine, Moment, delay_moments
from grader.report.views import end_of, heading_of

#: Shortest delay by the machine that is shown, in ns.
_SHOWN_DELAY_NS = 50_000_000
#: Beginning of a warning or error in the log of rclpy or Python, also after the prefix of a launch: `[WARN] ...`,
#: `[talker-1] [ERROR] ...`, `talker.py:3: DeprecationWarning: ...`.
_WARNS = re.compile(
    r"(?:\[[\w.-]{1,100}-\d{1,4}\] ?)?(?:\[(?:WARN|(ERROR|FATAL))\]|\S{1,300}:\d{1,9}: [A-Za-z]{0,60}Warning: )"
)


def lane_of_process(recorded: Recorded, place: int) -> Lane:
    """Return the moments of a process; `place` is its index in the record."""
    run = recorded.record.processes[place]
    heading = heading_of(recorded.record, place)
    remark = "the lab's" if run.role == "reference" else ""
    end_ns = run.exited_ns or recorded.record.ended_ns
    moments = [
        *_running(recorded, run, end_ns),
        *_found(recorded, run, end_ns),
        *_ending(recorded, run),
        *_raised(recorded, place),
        *_logged(recorded, place),
        *_delayed(recorded, run),
    ]
    return Lane(heading, remark, moments)


def _running(recorded: Recorded, run: ProcessRun, end_ns: int) -> Iterator[Moment]:
    """Yield the time while a process runs."""
    start_s = recorded.since_start_s(run.started_ns)
    end_s = recorded.since_start_s(end_ns)
    yield Moment("run", start_s, f"{run.name} runs", end_of(run), end_s)


def _found(recorded: Recorded, run: ProcessRun, end_ns: int) -> Iterator[Moment]:
    """Yield the first time in the graph of each node that is known to be in a process."""
    trusted = [each for each in recorded.record.trusted if each.process == run.name]
    prefixes = tuple(each.gid_prefix for each in trusted)
    nodes = {claim.node for claim in recorded.record.claims if claim.process == run.name}
    first_ns: dict[str, int] = {}
    for sighting in recorded.sightings:
        node, gid = sighting.endpoint.node, sighting.endpoint.gid
        own = node in nodes or gid.startswith(prefixes)
        if own and run.started_ns <= sighting.start_ns <= end_ns:
            first_ns.setdefault(node, sighting.start_ns)
    for node, seen_ns in first_ns.items():
        note = f"{duration((seen_ns - run.started_ns) / 1e9)} after the start"
        yield Moment("found", recorded.since_start_s(seen_ns), f"node {node} is in the graph", note)


def _ending(recorded: Recorded, run: ProcessRun) -> Iterator[Moment]:
    """Yield the interrupt and the exit of a process."""
    if run.interrupted_ns is not None:
        yield Moment("interrupt", recorded.since_start_s(run.interrupted_ns), "Ctrl-C (SIGINT)")
    if run.exited_ns is not None:
        odd = _ended_oddly(run)
        style = "bad-exit" if odd else "exit"
        yield Moment(style, recorded.since_start_s(run.exited_ns), end_of(run), trouble=odd)


def _ended_oddly(run: ProcessRun) -> bool:
    """Return whether a student's process was killed or failed."""
    if run.role != "student":
        return False
    return run.ended_by in ("kill", "terminate", "limit") or bool(run.exit_status)


def _raised(recorded: Recorded, place: int) -> Iterator[Moment]:
    """Yield the exceptions of a process at the last lines of their tracebacks."""
    run = recorded.record.processes[place]
    lines = recorded.lines_of(run)
    numbers = {}
    for number, line in enumerate(lines):
        name, _, _ = line.text.partition(":")
        numbers[line.t_ns, name.strip()] = number
    for raised in tracebacks(run.output):
        number = numbers.get((raised.t_ns, raised.type), len(lines) - 1)
        text, _, _ = f"{raised.name}: {raised.message}".partition("\n")
        time_s = recorded.since_start_s(raised.t_ns)
        yield Moment("raised", time_s, text, trouble=True, line=LogLine(place, number))


def _logged(recorded: Recorded, place: int) -> Iterator[Moment]:
    """Yield the warnings and errors that a process logged."""
    run = recorded.record.processes[place]
    for number, line in enumerate(recorded.lines_of(run)):
        begin = _WARNS.match(line.text)
        if begin is not None:
            style = "logged-error" if begin[1] else "warning"
            _, _, message = line.text.partition("]: ")
            time_s = recorded.since_start_s(line.t_ns)
            text = message or line.text
            yield Moment(style, time_s, text, trouble=True, line=LogLine(place, number))


def _delayed(recorded: Recorded, run: ProcessRun) -> Iterator[Moment]:
    """Yield the longer delays of a process by the machine."""
    long = [delay for delay in recorded.delays(run) if delay.delay_ns >= _SHOWN_DELAY_NS]
    words = f"the grading computer was busy: {run.name} waited for a core,"
    yield from delay_moments(recorded, words, long, "delay")

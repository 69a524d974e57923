"""Moments, their lanes, and the timeline that the template draws."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from grader.evidence.cpu_delay import Delay
from grader.evidence.recorded import Recorded
from grader.report.figures.svg import duration, short, ticks
from grader.report.views import anchor, heading_of

#: Maximum number of lanes of the same sort, e.g. of topics or of processes.
MOST_LANES = 12
#: Maximum number of moments in a lane.
_MOST_MOMENTS = 60
#: Approximate maximum number of ticks on the time axis.
_MOST_TICKS = 8
#: Longest time in s from a moment to the line of output that is shown with it.
_SOON_S = 1.0
#: Minimum length of a timeline in s, because times are divided by it.
_SHORTEST_S = 1e-3


class LogLine(NamedTuple):
    """A line of output, by the index of its process in the record and its own index in the output, both from 0."""

    process: int
    number: int


@dataclass(frozen=True)
class Moment:
    """An event, or an interval if it has an end; times are in s since the session's start."""

    #: Style of its mark or bar in the picture.
    style: str
    start_s: float
    text: str
    #: Result or details of the event, e.g. `no answer` or `3 times`.
    note: str = ""
    end_s: float | None = None
    #: True if something went wrong.
    trouble: bool = False
    line: LogLine | None = None
    #: Link to the part of the report that explains the moment.
    href: str = ""


@dataclass(frozen=True)
class Lane:
    """Moments of one thing, such as a process or a topic."""

    name: str
    #: Remark beside the name, e.g. `goals` or `60 of 75 moments`; may be empty.
    remark: str
    moments: Sequence[Moment]


def stacked(name: str, remark: str, moments: Iterable[Moment]) -> list[Lane]:
    """Return moments in as few lanes as possible without overlapping bars; at most `MOST_LANES` lanes."""
    lanes: list[list[Moment]] = []
    for moment in sorted(moments, key=lambda moment: moment.start_s):
        for lane in lanes:
            last = lane[-1]
            if (last.end_s or last.start_s) <= moment.start_s:
                lane.append(moment)
                break
        else:
            lanes.append([moment])
    return [Lane(name, remark, lane) for lane in lanes[:MOST_LANES]]


def delay_moments(
    recorded: Recorded, words: str, delays: Iterable[Delay], style: str
) -> Iterator[Moment]:
    """Yield a moment for each delay by the machine; its text is `words`, followed by the duration."""
    for delay in delays:
        start_s = recorded.since_start_s(delay.start_ns)
        end_s = recorded.since_start_s(delay.end_ns)
        length = duration(delay.delay_ns / 1e9)
        yield Moment(style, start_s, f"{words} {length}", end_s=end_s)


class Row(NamedTuple):
    """A moment in the list of all moments."""

    id: str
    #: Index of the moment's lane in `Timeline.lanes`.
    lane: int
    moment: Moment


class Timeline:
    """The lanes of a session that have moments, and a list of all moments in chronological order."""

    def __init__(self, recorded: Recorded, lanes: Iterable[Lane]) -> None:
        record = recorded.record
        self.session = record.session
        self.started_ns = record.started_ns
        #: Headings of the processes, in the order of the record.
        self.processes = [heading_of(record, place) for place in range(len(record.processes))]
        self.length_s = _length_s(recorded)
        #: Ticks of the time axis: a round time in s, and its label.
        self.ticks: list[tuple[float, str]] = []
        for time_s in ticks(0.0, self.length_s, _MOST_TICKS):
            self.ticks.append((time_s, short(time_s)))
        log = _student_log(recorded)
        self.lanes = [_shown(lane, log, self.length_s) for lane in lanes if lane.moments]
        self.rows = self._rows()

    def _rows(self) -> list[Row]:
        """Return the moments of all lanes in chronological order."""
        placed = []
        for place, lane in enumerate(self.lanes):
            for moment in lane.moments:
                placed.append((place, moment))
        placed.sort(key=lambda pair: pair[1].start_s)
        prefix = anchor("moment", self.session)
        rows = []
        for number, (place, moment) in enumerate(placed):
            rows.append(Row(f"{prefix}-{number}", place, moment))
        return rows

    def percentage(self, time_s: float) -> str:
        """Return a time or a duration as a percentage of the timeline's length, e.g. `12.5%`."""
        percent = f"{100 * time_s / self.length_s:.2f}"
        return percent.rstrip("0").rstrip(".") + "%"

    def linked_lines(self, process: int) -> set[int]:
        """Return the indexes of the lines of output to which moments link, for the process with an index in the record."""
        numbers = set()
        for row in self.rows:
            line = row.moment.line
            if line is not None and line.process == process:
                numbers.add(line.number)
        return numbers

    @property
    def styles(self) -> set[str]:
        """Styles that the key of the picture must explain."""
        return {row.moment.style for row in self.rows}


def _length_s(recorded: Recorded) -> float:
    """Return the time from the session's start until the session, all steps and all processes have ended, in s."""
    record = recorded.record
    ends_ns = [record.ended_ns]
    for step in record.steps:
        ends_ns.append(step.ended_ns)
    for run in record.processes:
        ends_ns.append(run.exited_ns or 0)
    return max(_SHORTEST_S, recorded.since_start_s(max(ends_ns)))


# -- moments as they are shown -----------------------------------------------------------------


class _TimedLine(NamedTuple):
    """A line of a student's output, with its time since the session's start."""

    time_s: float
    line: LogLine


def _student_log(recorded: Recorded) -> list[_TimedLine]:
    """Return the lines of output of all student processes in chronological order."""
    log = []
    for place, run in enumerate(recorded.record.processes):
        if run.role == "student":
            for number, line in enumerate(run.output):
                time_s = recorded.since_start_s(line.t_ns)
                log.append(_TimedLine(time_s, LogLine(place, number)))
    return sorted(log)


def _shown(lane: Lane, log: Sequence[_TimedLine], length_s: float) -> Lane:
    """Return a lane with runs of equal moments merged, cut after the maximum number of moments."""
    shown = []
    for _, alike in itertools.groupby(lane.moments, key=_merge_key):
        first, *others = alike
        shown.append(_completed(first, log, length_s, len(others) + 1))
    remark = lane.remark
    if len(shown) > _MOST_MOMENTS:
        remark = f"{_MOST_MOMENTS} of {len(shown)} moments"
    return Lane(lane.name, remark, shown[:_MOST_MOMENTS])


def _merge_key(moment: Moment) -> tuple[str, str, str, float | None]:
    """Return the attributes that consecutive moments must share to be merged."""
    return moment.style, moment.text, moment.note, moment.end_s


def _completed(moment: Moment, log: Sequence[_TimedLine], length_s: float, times: int) -> Moment:
    """Return a moment clamped to the session, with the number of merged moments and a line of output."""
    note = moment.note
    if times > 1:
        note += f" {times} times"
    line = moment.line
    if line is None:
        line = _soon_after(moment.start_s, log)
    end_s = moment.end_s
    if end_s is not None:
        end_s = min(max(end_s, 0.0), length_s)
    start_s = min(max(moment.start_s, 0.0), length_s)
    return replace(moment, start_s=start_s, end_s=end_s, note=note.strip(), line=line)


def _soon_after(time_s: float, log: Sequence[_TimedLine]) -> LogLine | None:
    """Return the first line written at a time or soon after it; None if there is no such line."""
    place = bisect.bisect_left(log, time_s, key=lambda line: line.time_s)
    if place == len(log):
        return None
    line = log[place]
    if line.time_s - time_s > _SOON_S:
        return None
    return line.line

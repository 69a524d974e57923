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

#: Lanes of a kind, and moments of a lane, that are shown.
MOST_LANES = 12
_MOST_MOMENTS = 60
_MOST_TICKS = 8
#: Time in s after a moment within which a written line is shown with it.
_SOON_S = 1.0
#: Shortest length of a timeline in s.
_SHORTEST_S = 1e-3


class LogLine(NamedTuple):
    """A line of a process's output: place of the process in the record, and number of the line, both from 0."""

    process: int
    number: int


@dataclass(frozen=True)
class Moment:
    """Something that happened at a time, or lasted from that time on; times are in s since the session's start."""

    #: Style of its mark or bar in the picture.
    style: str
    start_s: float
    text: str
    #: Outcome of the moment.
    note: str = ""
    end_s: float | None = None
    #: True if something went wrong.
    trouble: bool = False
    line: LogLine | None = None
    #: Link to the part of the report with more about it.
    href: str = ""


@dataclass(frozen=True)
class Lane:
    """Moments of one thing, such as a process or a topic."""

    name: str
    kind: str
    moments: Sequence[Moment]


def stacked(name: str, kind: str, moments: Iterable[Moment]) -> list[Lane]:
    """Return lanes of one name, as few as possible without overlapping bars."""
    lanes: list[list[Moment]] = []
    for moment in sorted(moments, key=lambda moment: moment.start_s):
        for lane in lanes:
            last = lane[-1]
            if (last.end_s or last.start_s) <= moment.start_s:
                lane.append(moment)
                break
        else:
            lanes.append([moment])
    return [Lane(name, kind, lane) for lane in lanes[:MOST_LANES]]


def delay_moments(
    recorded: Recorded, words: str, delays: Iterable[Delay], style: str
) -> Iterator[Moment]:
    """Yield delays by the machine; `words` stand before their durations."""
    for delay in delays:
        start_s = recorded.since_start_s(delay.start_ns)
        end_s = recorded.since_start_s(delay.end_ns)
        length = duration(delay.delay_ns / 1e9)
        yield Moment(style, start_s, f"{words} {length}", end_s=end_s)


class Row(NamedTuple):
    """A moment in the list of all moments."""

    id: str
    #: Place of its lane.
    lane: int
    moment: Moment


class Timeline:
    """All lanes of a session with moments, and all moments in the order of time."""

    def __init__(self, recorded: Recorded, lanes: Iterable[Lane]) -> None:
        record = recorded.record
        self.session = record.session
        self.started_ns = record.started_ns
        #: Headings of the processes, by their places in the record.
        self.processes = [heading_of(record, place) for place in range(len(record.processes))]
        self.length_s = _length_s(recorded)
        #: Round times in s with their texts.
        self.ticks: list[tuple[float, str]] = []
        for time_s in ticks(0.0, self.length_s, _MOST_TICKS):
            self.ticks.append((time_s, short(time_s)))
        log = _log(recorded)
        self.lanes = [_shown(lane, log, self.length_s) for lane in lanes if lane.moments]
        self.rows = self._rows()

    def _rows(self) -> list[Row]:
        """Return all moments in the order of time."""
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

    def at(self, time_s: float) -> str:
        """Return a time, or the length of a span, as a share of the picture's width: `12.5%`."""
        percent = f"{100 * time_s / self.length_s:.2f}"
        return percent.rstrip("0").rstrip(".") + "%"

    def lines_of(self, place: int) -> set[int]:
        """Return the numbers of a process's lines with links from moments."""
        numbers = set()
        for row in self.rows:
            line = row.moment.line
            if line is not None and line.process == place:
                numbers.add(line.number)
        return numbers

    @property
    def styles(self) -> set[str]:
        """Styles of all moments."""
        return {row.moment.style for row in self.rows}


def _length_s(recorded: Recorded) -> float:
    """Return the time from the session's start to the last end of anything, in s."""
    record = recorded.record
    ends_ns = [record.ended_ns]
    for step in record.steps:
        ends_ns.append(step.ended_ns)
    for run in record.processes:
        ends_ns.append(run.exited_ns or 0)
    return max(_SHORTEST_S, recorded.since_start_s(max(ends_ns)))


# -- moments as they are shown -----------------------------------------------------------------


class _Written(NamedTuple):
    """A line in a student's output, with its time since the session's start."""

    time_s: float
    line: LogLine


def _log(recorded: Recorded) -> list[_Written]:
    """Return the lines of all student processes in the order of time."""
    log = []
    for place, run in enumerate(recorded.record.processes):
        if run.role == "student":
            for number, line in enumerate(run.output):
                time_s = recorded.since_start_s(line.t_ns)
                log.append(_Written(time_s, LogLine(place, number)))
    return sorted(log)


def _shown(lane: Lane, log: Sequence[_Written], length_s: float) -> Lane:
    """Return a lane with one moment for consecutive equal ones, and with the first few of these."""
    shown = []
    for _, alike in itertools.groupby(lane.moments, key=_likeness):
        first, *others = alike
        shown.append(_within(first, log, length_s, len(others) + 1))
    kind = lane.kind
    if len(shown) > _MOST_MOMENTS:
        kind = f"{_MOST_MOMENTS} of {len(shown)} moments"
    return Lane(lane.name, kind, shown[:_MOST_MOMENTS])


def _likeness(moment: Moment) -> tuple[str, str, str, float | None]:
    """Return the common facts of equal moments."""
    return moment.style, moment.text, moment.note, moment.end_s


def _within(moment: Moment, log: Sequence[_Written], length_s: float, times: int) -> Moment:
    """Return a moment within the session, with its number of times and a line written soon after it."""
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


def _soon_after(time_s: float, log: Sequence[_Written]) -> LogLine | None:
    """Return the first line written at a time or soon after it."""
    place = bisect.bisect_left(log, time_s, key=lambda written: written.time_s)
    if place == len(log) or log[place].time_s - time_s > _SOON_S:
        return None
    return log[place].line

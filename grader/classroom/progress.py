"""The terminal's view of a class while it is graded, and the table at its end."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from grader.classroom.job import Row
from grader.errors import GraderError
from grader.live.session.runner import Progress
from grader.report.escape import terminal_text
from grader.report.views import points
from grader.result import Result

_NAME_WIDTH = 40
_PROBLEM_WIDTH = 200
_BAR_WIDTH = 40
#: Least time for a speed, in s.
_LEAST_S = 1e-3


class RunProgress(Live):
    """Progress of a run: finished, running (with its phase) and waiting submissions, and the estimated time left.

    Each ending prints a line; below these lines, a terminal shows the others, updated in place. The first estimate
    uses the number of sessions at a time.
    """

    def __init__(self, console: Console, at_a_time: int, noun: str = "submissions") -> None:
        self._console = console
        self._noun = noun
        self._began_s = time.monotonic()
        self._speed = float(at_a_time)
        self._work_s: dict[str, float] = {}
        self._done_s = 0.0
        self._phases: dict[str, dict[str, str]] = {}
        self._since_s: dict[str, float] = {}
        self._done = 0
        self._remarks: Counter[str] = Counter()
        super().__init__(console=console, get_renderable=self.view, transient=True)

    def expect(self, name: str, work_s: float) -> None:
        """Add a submission that will be graded, with the time of its sessions."""
        self._work_s[name] = work_s

    def phase(self, name: str, progress: Progress) -> None:
        """Note the phase of a submission."""
        self._since_s.setdefault(name, time.monotonic())
        phases = self._phases.setdefault(name, {})
        if progress.session:
            phases.pop("", None)  # The grader's own work comes before or after all sessions.
        if progress.ended:
            phases.pop(progress.session, None)
        else:
            step = ""
            if progress.steps:
                step = f" ({progress.step} of {progress.steps})"
            phases[progress.session] = progress.text[:200] + step

    def took_s(self, name: str) -> float:
        """Return the time since the first phase of a submission in s; 0 before it."""
        now_s = time.monotonic()
        return now_s - self._since_s.get(name, now_s)

    def done(self, name: str, line: Text | None, remark: str = "") -> None:
        """Note the end of a submission; remarks of a kind are counted."""
        self._phases.pop(name, None)
        self._done_s += self._work_s.pop(name, 0.0)
        self._done += 1
        self._remarks.update([remark] if remark else [])
        if line is not None:
            count = Text(f"[{self._done}/{self._total}] ")
            self._console.print(count.append(line), soft_wrap=True, highlight=False)

    @property
    def _total(self) -> int:
        """Number of submissions, done or not."""
        return self._done + len(self._work_s)

    def ended(self, row: Row) -> None:
        """Note the ending of a submission of a class."""
        failed = isinstance(row.ending, GraderError)
        if row.reused:
            remark = "as before"
        else:
            remark = "not graded" if failed else ""
        self.done(row.source.name, None if row.reused else _line(row), remark)

    def note(self, text: str) -> None:
        """Report something about the run as a whole."""
        self._console.print(Text(terminal_text(text), "yellow"), soft_wrap=True)

    # -- what is shown ------------------------------------------------------------------------

    def view(self) -> RenderableType:
        """Return the view of the terminal."""
        table = Table.grid(padding=(0, 2))
        table.add_column(no_wrap=True, max_width=_NAME_WIDTH)
        table.add_column(no_wrap=True, overflow="ellipsis")
        for name, phases in self._phases.items():
            named = []
            for session, text in phases.items():
                named.append(f"{session}: {text}" if session else text)
            shown = terminal_text(name, _NAME_WIDTH)
            doing = terminal_text(" · ".join(named), 300)
            table.add_row(Text(shown), Text(doing, "dim"))
        # The library does not end the line.
        bar = Table.grid()
        total = max(1, self._total)
        bar.add_row(ProgressBar(total=total, completed=self._done, width=_BAR_WIDTH))
        return Group(Text(""), self._headline(), bar, table)

    def _headline(self) -> Text:
        waiting = len(self._work_s) - len(self._phases)
        parts = [f"{self._done} of {self._total} {self._noun} done"]
        for remark, count in self._remarks.items():
            parts.append(f"{count} {remark}")
        parts.append(f"{len(self._phases)} under way")
        parts.append(f"{waiting} in the queue")
        parts.append(f"about {self._time_left()} left")
        return Text(" · ".join(parts), "bold")

    def _time_left(self) -> str:
        """Estimate the time left: by the speed so far, as soon as there is one."""
        elapsed_s = time.monotonic() - self._began_s
        if self._done_s:
            speed = self._done_s / max(elapsed_s, _LEAST_S)
        else:
            speed = self._speed
        left_s = sum(self._work_s.values()) / speed
        if left_s >= 90:
            return f"{left_s / 60:.0f} min"
        return f"{left_s:.0f} s"


def _line(row: Row) -> Text:
    name = terminal_text(row.source.name, _NAME_WIDTH)
    if isinstance(row.ending, GraderError):
        return Text(f"✗ {_not_graded(row.source.name, row.ending)}", "red")
    score = row.ending.score
    undecided = ""
    if score.undecided:
        undecided = f", {points(score.undecided)} undecided"
    return Text(f"✓ {name}: {_points(row.ending)}{undecided} ({row.took_s:.0f} s)")


def _not_graded(name: str, ending: GraderError) -> str:
    shown = terminal_text(name, _NAME_WIDTH)
    return f"{shown}: not graded: {_problem(ending, name)}"


def _points(result: Result) -> str:
    return f"{points(result.final)} / {points(result.score.possible)}"


def _problem(ending: GraderError, name: str) -> str:
    location = ""
    if ending.location and Path(ending.location).name != name:
        location = f"{ending.location}: "
    return terminal_text(f"{location}{ending.problem}", _PROBLEM_WIDTH)


def print_class(console: Console, rows: Sequence[Row]) -> None:
    """Print the points of a class, a line for each submission, and below them the questions for a person."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("submission", overflow="fold")
    table.add_column("points", justify="right", no_wrap=True)
    table.add_column("undecided", justify="right", no_wrap=True)
    for row in rows:
        name = Text(terminal_text(row.source.name, _NAME_WIDTH))
        if isinstance(row.ending, Result):
            undecided = row.ending.score.undecided
            open_points = points(undecided) if undecided else ""
            table.add_row(name, _points(row.ending), Text(open_points, "magenta"))
        else:
            table.add_row(name, Text("not graded", "red"), "")
    console.print(table)
    for row in rows:
        if isinstance(row.ending, GraderError):
            words = _not_graded(row.source.name, row.ending)
            console.print(Text(words, "red"), soft_wrap=True)
            if row.ending.remedy:
                remedy = terminal_text(row.ending.remedy)
                console.print(Text(f"  → {remedy}", "cyan"), soft_wrap=True)


def summary(rows: Sequence[Row]) -> str:
    """Return a sentence on the rows."""
    graded = [row.ending for row in rows if isinstance(row.ending, Result)]
    parts = [f"{len(graded)} graded"]
    reused = sum(row.reused for row in rows)
    if reused:
        parts.append(f"{reused} of them as before")
    undecided = sum(bool(result.score.undecided) for result in graded)
    if undecided:
        parts.append(f"{undecided} with undecided points")
    missing = len(rows) - len(graded)
    if missing:
        parts.append(f"{missing} not graded")
    if graded:
        mean = sum((g.final for g in graded), Decimal(0)) / len(graded)
        parts.append(f"mean {mean:.1f} points")
    return ", ".join(parts)

"""Prints the wall time and CPU time of a grading's stages and sessions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from grader.report.escape import terminal_text

if TYPE_CHECKING:
    from grader.timings import Stopwatch

#: Roles of processes that have a column each, besides the grader.
_ROLES = ("student", "reference")


def print_timings(
    console: Console, watch: Stopwatch, provenance: Mapping[str, Any], children_cpu_s: float
) -> None:
    """Print the times of stages and sessions; `children_cpu_s` is the CPU time of all awaited child processes."""
    sessions = provenance.get("sessions", {})
    console.print(_stages_table(watch))
    table = _sessions_table(watch, sessions)
    console.print(table, cpu_summary(watch, sessions, children_cpu_s), sep="\n", highlight=False)


def _stages_table(watch: Stopwatch) -> Table:
    table = _table("Where the time went", "stage", "from", "wall", "CPU of grade itself")
    for stage in sorted(watch.stages, key=lambda stage: stage.began_s):
        since_s = stage.began_s - watch.started_s
        table.add_row(Text(stage.what), *map(_seconds, (since_s, stage.took_s, stage.cpu_s)))
    all_s = max(stage.ended_s for stage in watch.stages) - watch.started_s
    table.add_row("all", "", _seconds(all_s), _seconds(own_cpu_s(watch)), style="bold")
    return table


def _sessions_table(watch: Stopwatch, sessions: Mapping[str, Any]) -> Table:
    """Return the table of all attempts; only the kept attempt of a session, its last, has CPU times by role."""
    table = _table("", "session", "attempt", "waited", "ran", *_ROLES, "grader (CPU)")
    attempts: Counter[str] = Counter()
    last = {run.session: run for run in watch.session_runs}
    for run in watch.session_runs:
        attempts[run.session] += 1
        cells = [str(attempts[run.session]), _seconds(run.waited_s), _seconds(run.ran_s)]
        cpu_s = {}
        if run is last[run.session]:
            cpu_s = sessions.get(run.session, {}).get("cpu_s", {})
        for role in (*_ROLES, "grader"):
            used = ""
            if role in cpu_s:
                used = _seconds(cpu_s[role])
            cells.append(used)
        table.add_row(Text(terminal_text(run.session)), *map(Text, cells))
    return table


def _seconds(value_s: float) -> str:
    return f"{value_s:.2f} s"


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if number == 0 else "right")
    return table


def own_cpu_s(watch: Stopwatch) -> float:
    """Return the CPU time of the grading process itself in all stages."""
    return sum(stage.cpu_s for stage in watch.stages)


def cpu_summary(watch: Stopwatch, sessions: Mapping[str, Any], children_cpu_s: float) -> str:
    """Write the CPU time of the student's processes and that of the grader."""
    students_s = 0.0
    for session in sessions.values():
        students_s += float(session.get("cpu_s", {}).get("student", 0))
    ours_s = own_cpu_s(watch) + children_cpu_s - students_s
    text = f"CPU time: the student's processes {students_s:.2f} s, the grader's {ours_s:.2f} s"
    names = {run.session for run in watch.session_runs}
    if len(watch.session_runs) > len(names):
        return f"{text} (with all of what was recorded again)."
    return f"{text}."

"""Tells on the terminal where a grading's wall time and CPU time went."""

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


def print_timings(
    console: Console, watch: Stopwatch, provenance: Mapping[str, Any], children_cpu_s: float
) -> None:
    """Print where the time went; `children_cpu_s` is the CPU time of all processes that the grader waited for."""
    sessions = provenance.get("sessions", {})
    table = _table("Where the time went", "stage", "from", "wall", "CPU of grade itself")
    for stage in sorted(watch.stages, key=lambda stage: stage.began_s):
        since_s = stage.began_s - watch.started_s
        table.add_row(
            Text(stage.what), f"{since_s:.2f} s", f"{stage.took_s:.2f} s", f"{stage.cpu_s:.2f} s"
        )
    all_s = max(stage.ended_s for stage in watch.stages) - watch.started_s
    table.add_row("all", "", f"{all_s:.2f} s", f"{own_cpu_s(watch):.2f} s", style="bold")
    console.print(table)
    table = _table(
        "", "session", "attempt", "waited", "ran", "student", "reference", "grader (CPU)"
    )
    attempts: Counter[str] = Counter()
    last = {run.session: run for run in watch.session_runs}
    for run in watch.session_runs:
        attempts[run.session] += 1
        # Only the last attempt's recording is kept, so only its CPU time is known by role.
        cpu_s = sessions.get(run.session, {}).get("cpu_s", {}) if run is last[run.session] else {}
        used = [
            f"{cpu_s[role]:.2f} s" if role in cpu_s else ""
            for role in ("student", "reference", "grader")
        ]
        name, waited, ran = (
            terminal_text(run.session),
            f"{run.waited_s:.2f} s",
            f"{run.ran_s:.2f} s",
        )
        table.add_row(*map(Text, (name, str(attempts[run.session]), waited, ran, *used)))
    console.print(table, cpu_summary(watch, sessions, children_cpu_s), sep="\n", highlight=False)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if number == 0 else "right")
    return table


def own_cpu_s(watch: Stopwatch) -> float:
    """Return the CPU time of the grading process itself in all stages."""
    return sum(stage.cpu_s for stage in watch.stages)


def cpu_summary(watch: Stopwatch, sessions: Mapping[str, Any], children_cpu_s: float) -> str:
    """Say how much CPU time was the student's, and how much the grader's."""
    students_s = sum(
        float(session.get("cpu_s", {}).get("student", 0)) for session in sessions.values()
    )
    ours_s = own_cpu_s(watch) + children_cpu_s - students_s
    text = f"CPU time: the student's processes {students_s:.2f} s, the grader's {ours_s:.2f} s"
    if len(watch.session_runs) > len({run.session for run in watch.session_runs}):
        return f"{text} (with all of what was recorded again)."
    return f"{text}."

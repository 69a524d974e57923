"""The stopwatch of a grading, and its printed times."""

from __future__ import annotations

import io
from dataclasses import dataclass

from rich.console import Console

from grader.report.timings import cpu_summary, own_cpu_s, print_timings
from grader.timings import SessionRun, Stage, Stopwatch


@dataclass(frozen=True)
class Told:
    """A piece of progress, as sessions tell it."""

    session: str
    ended: bool = False


def test_sessions_are_measured_by_their_progress() -> None:
    """A session counts from its first word to its end; each attempt by itself, and all is passed on."""
    watch, heard = Stopwatch(), list[Told]()
    listen = watch.follow(heard.append)
    told = [
        Told("a"),
        Told("b"),
        Told("a"),
        Told("a", ended=True),
        Told("a"),
        Told("a", ended=True),
        Told("c", True),
    ]
    with watch.stage("sessions"):
        for progress in told:
            listen(progress)
    assert heard == told
    assert [cell.session for cell in watch.session_runs] == ["a", "a"]
    assert all(cell.waited_s >= 0 and 0 <= cell.ran_s < 60 for cell in watch.session_runs)
    assert [stage.what for stage in watch.stages] == ["starting the program", "sessions"]


def test_a_stage_that_fails_is_measured_too() -> None:
    """A failing stage took time too."""
    watch = Stopwatch()
    try:
        with watch.stage("judging"):
            raise LookupError
    except LookupError:
        pass
    assert watch.stages[-1].what == "judging"
    assert watch.stages[-1].took_s >= 0


def _watch() -> Stopwatch:
    watch = Stopwatch()
    watch.stages[:] = [Stage("staging", 1.0, 3.0, 1.0), Stage("judging", 3.0, 4.0, 0.5)]
    watch.session_runs = [SessionRun("publisher", 0.0, 7.0), SessionRun("publisher", 0.5, 8.0)]
    return watch


def test_the_students_cpu_time_is_not_the_graders() -> None:
    """The stages and the processes that were waited for make up the grader's time, but for the student's own."""
    sessions = {"publisher": {"cpu_s": {"student": 2.0, "reference": 0.25, "grader": 0.5}}}
    assert own_cpu_s(_watch()) == 1.5
    assert "the student's processes 2.00 s, the grader's 3.50 s (with" in cpu_summary(
        _watch(), sessions, 4.0
    )


def test_the_table_shows_each_attempt_with_the_cpu_time_of_the_last() -> None:
    """Names come from a rubric, and are shown as they are, not as markup."""
    watch, out = _watch(), io.StringIO()
    watch.session_runs.append(SessionRun("[bold]x[/bold]", 0.0, 1.0))
    provenance = {
        "sessions": {"publisher": {"cpu_s": {"student": 2.0, "reference": 0.25, "grader": 0.5}}}
    }
    print_timings(Console(file=out, width=120), watch, provenance, 4.0)
    lines = out.getvalue().splitlines()
    first, second = (line for line in lines if line.startswith("publisher"))
    assert "7.00 s" in first
    assert "2.00 s" not in first
    assert "8.00 s" in second
    assert "2.00 s" in second
    assert any("[bold]x[/bold]" in line for line in lines)

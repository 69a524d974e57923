"""Display of a class: while it is graded, and at its end."""

from __future__ import annotations

import io
import re
from decimal import Decimal
from pathlib import Path

import pytest
from rich.console import Console

from grader.classroom.job import Ending, Row
from grader.classroom.progress import RunProgress, print_class, summary
from grader.errors import GraderError
from grader.live.session.runner import Progress
from grader.result import Result, Score
from grader.submission.extraction import Piece, SubmissionSource


def row(name: str, ending: Ending, *, reused: bool = False) -> Row:
    """Make the row of an ended submission."""
    return Row(SubmissionSource(name, (Piece(Path(name)),)), ending, reused, 12.4)


def points(earned: str, undecided: str = "0") -> Result:
    """Make points of 100."""
    return Result("ann", "Lab 1", Score(Decimal(earned), Decimal(100), Decimal(undecided)), ())


def console(*, terminal: bool = False) -> tuple[Console, io.StringIO]:
    """Make a console with readable output."""
    stream = io.StringIO()
    return Console(
        file=stream, force_terminal=terminal, width=100, highlight=False, _environ={}
    ), stream


def shown(progress: RunProgress) -> str:
    """Return the terminal's content, without colours."""
    screen, stream = console(terminal=True)
    screen.print(progress.view())
    return re.sub(r"\x1b\[[0-9;]*m", "", stream.getvalue())


def test_in_a_ci_job_each_submission_is_a_line() -> None:
    """Without a terminal, one line reports the outcome of each ended submission.

    Nothing else is written.
    """
    screen, stream = console()
    with RunProgress(screen, 4) as progress:
        for name in ("ann", "bob", "cem"):
            progress.expect(name, 40.0)
        progress.ended(row("dan", points("77"), reused=True))
        progress.phase("ann", Progress("qos", "starting"))
        progress.ended(row("ann", points("84.6")))
        progress.ended(row("bob", points("50", "2.5")))
        progress.ended(
            row(
                "cem",
                GraderError("the submission is empty", location="class/cem", remedy="fill it"),
            )
        )
    assert stream.getvalue().splitlines() == [
        "[2/4] ✓ ann: 84.6 / 100 (12 s)",
        "[3/4] ✓ bob: 50 / 100, 2.5 undecided (12 s)",
        "[4/4] ✗ cem: not graded: the submission is empty",
    ]


def test_on_a_terminal_all_that_runs_is_shown() -> None:
    """The display shows finished, running and waiting submissions, the phase, and the time left."""
    screen, stream = console(terminal=True)
    progress = RunProgress(screen, 4)
    for name in ("ann", "bob", "cem", "dan"):
        progress.expect(name, 40.0)
    assert "0 of 4 submissions done · 0 under way · 4 in the queue · about 40 s left" in shown(
        progress
    )
    progress.phase("ann", Progress("", "reading"))
    progress.phase("ann", Progress("qos", "waits for the exit of qos", 7, 8))
    progress.phase("ann", Progress("publisher", "waits"))
    progress.phase("ann", Progress("publisher", "recorded", ended=True))
    progress.phase("bob", Progress("", "reading"))
    text = shown(progress)
    assert "2 under way · 2 in the queue" in text
    assert re.search(r"^ann +qos: waits for the exit of qos \(7 of 8\) *$", text, re.MULTILINE)
    assert re.search(r"^bob +reading *$", text, re.MULTILINE)
    progress.ended(row("ann", points("84.6")))
    text = shown(progress)
    assert "1 of 4 submissions done · 1 under way · 2 in the queue" in text
    assert "qos" not in text
    assert "[1/4] ✓ ann: 84.6 / 100 (12 s)" in stream.getvalue()


def test_the_view_stays_small_in_a_large_class() -> None:
    """Two hundred ended submissions leave a line each, above a view of a few lines."""
    screen, stream = console(terminal=True)
    progress = RunProgress(screen, 4)
    for number in range(200):
        progress.expect(f"s{number}", 40.0)
    for number in range(199):
        progress.ended(row(f"s{number}", points("50")))
    text = shown(progress)
    assert "199 of 200" in text
    assert "s198" not in text
    assert len(re.findall(r"✓ s[0-9]+: 50 / 100", stream.getvalue())) == 199
    assert len(text.splitlines()) < 15


def test_the_table_at_the_end() -> None:
    """Each submission has its points; cases for a person stand below, with the remedy."""
    screen, stream = console()
    rows = [
        row("ann", points("84.6")),
        row("bob", points("50", "2.5")),
        row(
            "cem",
            GraderError(
                "the submission is empty",
                location="class/cem",
                remedy="Put the lab's files into it.",
            ),
        ),
        row(
            "dan",
            GraderError(
                "No space left on device",
                location="/results/dan/report.html",
                remedy="Check the disk.",
            ),
        ),
    ]
    print_class(screen, rows)
    lines = [line.strip() for line in stream.getvalue().splitlines()]
    assert re.fullmatch(r"ann +84\.6 / 100", lines[1])
    assert re.fullmatch(r"bob +50 / 100 +2\.5", lines[2])
    assert re.fullmatch(r"cem +not graded", lines[3])
    assert lines[-4:] == [
        "cem: not graded: the submission is empty",
        "→ Put the lab's files into it.",
        "dan: not graded: /results/dan/report.html: No space left on device",
        "→ Check the disk.",
    ]


def test_the_summary() -> None:
    """One sentence counts all kinds, and the mean is of those that were graded."""
    rows = [
        row("a", points("80"), reused=True),
        row("b", points("90", "1")),
        row("c", GraderError("empty")),
    ]
    assert (
        summary(rows)
        == "2 graded, 1 of them as before, 1 with undecided points, 1 not graded, mean 85.0 points"
    )
    assert summary([row("c", GraderError("empty"))]) == "0 graded, 1 not graded"


@pytest.mark.parametrize(
    "name", ["\x1b[2Jann", "::error::ann", "ann\nbob", "[red]ann[/red]", "a" * 5000]
)
def test_names_cannot_steer_terminal_or_log(name: str) -> None:
    """Escapes, markup, line breaks and commands of a CI job in a name are shown, and a long one is cut."""
    screen, stream = console(terminal=False)
    with RunProgress(screen, 4) as progress:
        progress.expect(name, 1.0)
        progress.phase(name, Progress(name, name))
        text = shown(progress)
        progress.ended(row(name, GraderError(name, location=name, remedy=name)))
    print_class(screen, [row(name, GraderError(name, location=name, remedy=name))])
    text += stream.getvalue()
    assert "\x1b" not in text
    for line in text.splitlines():
        assert not line.strip().startswith(("::", "bob"))
    assert len(text) < 10_000
    if "red" in name:
        assert "[red]ann[/red]" in text

"""Grading of fixtures, several at a time, and comparison with their expectations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from grader.classroom.expectations import Fixture, compare
from grader.classroom.job import Job, problem_of
from grader.classroom.progress import RunProgress
from grader.classroom.worker import Here
from grader.errors import GraderError
from grader.lab.rubric import Rubric
from grader.live.process.waiting import side_by_side
from grader.pipeline import Options
from grader.report.escape import terminal_text
from grader.report.views import points
from grader.submission.extraction import SubmissionSource

_STYLES = {"✓": "green", "?": "magenta"}
_LONGEST = 600


@dataclass(frozen=True)
class FixtureRun:
    """The outcome of a fixture."""

    name: str
    #: "✓" as expected, "✗" not, "?" undecided, "!" not graded.
    sign: str
    #: Differences from the expectation, or the reason why it was not graded.
    differences: tuple[str, ...] = ()
    #: Points of all judged checks.
    earned: Decimal = Decimal(0)
    possible: Decimal = Decimal(0)
    took_s: float = 0.0

    @property
    def points(self) -> str:
        """The points in words."""
        if not self.possible:
            return "not graded" if self.sign in "!✗" else ""
        return f"{points(self.earned)} / {points(self.possible)}"


async def run_fixtures(
    fixtures: Sequence[Fixture],
    rubric: Rubric,
    options: Options,
    here: Here,
    folder: Path,
    display: RunProgress,
) -> list[FixtureRun]:
    """Grade fixtures on this machine; a failure of one does not affect the others.

    Submissions are laid out in the folder, and results go there.
    """

    async def one(fixture: Fixture) -> FixtureRun:
        unfit = tuple(words for _, words in fixture.expectation.unfit(rubric))
        found = FixtureRun(fixture.name, "✗", unfit)
        if not unfit:
            found = await _graded(fixture, rubric, options, here, folder, display)
        found = replace(found, took_s=display.took_s(fixture.name))
        line = Text(f"{found.sign} ", _STYLES.get(found.sign, "red"))
        line.append(terminal_text(found.name, 40), "default")
        line.append(f": {found.points} ({found.took_s:.0f} s)", "dim")
        display.done(found.name, line, "" if found.sign == "✓" else "not as expected")
        return found

    for fixture in fixtures:
        typical_s = 0.0
        for session in fixture.expectation.sessions:
            if session in rubric.sessions:
                typical_s += rubric.sessions[session].typical_s
        display.expect(fixture.name, typical_s)
    return await side_by_side(one(fixture) for fixture in fixtures)


async def _graded(
    fixture: Fixture,
    rubric: Rubric,
    options: Options,
    here: Here,
    folder: Path,
    display: RunProgress,
) -> FixtureRun:
    name = fixture.name
    try:
        source = SubmissionSource.of(fixture.lay_out(folder / "submissions"))
        options = replace(options, sessions=list(fixture.expectation.sessions))
        job = Job(source, folder / name, rubric, options)
        ending, _ = await here.grade(job, partial(display.phase, name))
    except OSError as error:
        ending = problem_of(error)
    if isinstance(ending, GraderError):
        location = f"{ending.location}: " if ending.location else ""
        return FixtureRun(name, "!", (f"not graded: {location}{ending.problem}",))
    verdict = compare(fixture.expectation, ending, rubric)
    if not verdict.differences:
        sign = "✓"
    else:
        sign = "?" if verdict.undecided else "✗"
    return FixtureRun(name, sign, verdict.differences, ending.final, ending.score.possible)


def print_fixtures(console: Console, found: Sequence[FixtureRun]) -> None:
    """Print a table of all fixtures, and below it the differences from their expectations."""
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    table.add_column(justify="right", no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    for each in found:
        name = Text(terminal_text(each.name, 40))
        sign = Text(each.sign, _STYLES.get(each.sign, "red"))
        table.add_row(sign, name, each.points, f"{each.took_s:.1f} s")
    console.print(table)
    for each in found:
        if each.differences:
            console.print(Text(f"\n{terminal_text(each.name, 40)}", "bold"))
            for difference in each.differences:
                console.print(Text(f"  • {terminal_text(difference, _LONGEST)}"))


def quick(fixtures: Sequence[Fixture], rubric: Rubric) -> list[Fixture]:
    """Choose fixtures that test much in little time.

    These are all fixtures that state their total or need no session, and for each criterion the first fixture with
    one session that loses points in it.
    """
    chosen = []
    for fixture in fixtures:
        expectation = fixture.expectation
        if not expectation.sessions or expectation.total is not None:
            chosen.append(fixture)
    of_one_session = [each for each in fixtures if len(each.expectation.sessions) == 1]
    for criterion in rubric.criteria:
        losing = (each for each in of_one_session if each.expectation.loses_in(criterion.id))
        first = next(losing, None)
        if first is not None and first not in chosen:
            chosen.append(first)
    return sorted(chosen, key=list(fixtures).index)

"""`grade selftest`: compare verdicts of known submissions on this machine and by this rubric."""

from __future__ import annotations

import argparse
import asyncio
import tempfile
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from grader.commands.arguments import (
    BELOW,
    add_flag,
    add_jobs,
    add_lab,
    add_path,
    parser_of,
    print_note,
    students_side,
)
from grader.errors import TEMPORARY, SubmissionError
from grader.lab.shipped_labs import require_extras
from grader.report.escape import terminal_text

if TYPE_CHECKING:
    from grader.classroom.expectations import Fixture
    from grader.classroom.selftest import FixtureRun
    from grader.lab.rubric import Rubric

_DESCRIPTION = """\
Grade submissions with known verdicts, and compare: the lab's solution earns all points, an empty starter none, and each
fixture gets exactly the verdict in its expected.yaml. Run this after each change of the rubric.
"""

_EPILOG = """\
exit status:
  0 all as expected    1 a fixture is undecided or differs from its verdict
  3 no fixtures        4 rubric or an expected.yaml not usable    5 platform not supported
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade selftest", _DESCRIPTION, _EPILOG)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="fixtures to grade; 'solution' means the lab's solution (default: all)",
    )
    add_lab(parser, "default: the lab shipped with grade")
    add_path(
        parser, "--fixtures", "folder of fixtures (default: fixtures/ beside the rubric)", "DIR"
    )
    add_flag(parser, "--quick", "grade only a few, in about a minute")
    add_jobs(parser, "number of sessions side by side (default: depends on the number of cores)")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="folder in which submissions and results are kept",
    )
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Grade the fixtures and compare; returns the exit status."""
    parser = make_parser()
    options = parser.parse_args(arguments)
    from grader.classroom.selftest import print_fixtures
    from grader.judging import rubrics
    from grader.lab.similar_words import meant
    from grader.live.sandbox import environment

    rubric = rubrics.read_rubric(options.rubric)
    fixtures = _fixtures(options, rubric, console)
    unknown = [name for name in options.names if name not in {fixture.name for fixture in fixtures}]
    if unknown:
        near = meant(unknown[0], [fixture.name for fixture in fixtures])
        parser.error(f"there is no fixture {terminal_text(unknown[0], 80)!r}{near}")
    if options.names:
        fixtures = [fixture for fixture in fixtures if fixture.name in options.names]
    environment.require_platform()
    require_extras(rubric)
    began_s = time.monotonic()
    found = _run(fixtures, rubric, options, console)
    took_s = time.monotonic() - began_s
    print_fixtures(console, found)
    console.print()
    marks = [each.sign for each in found]
    console.print(
        Text(f"{marks.count('✓')} of {len(marks)} as expected, in {took_s:.0f} s.", "bold")
    )
    if undecided := marks.count("?"):
        console.print(
            f"{undecided} undecided: their reports say why. If the machine was busy, name them to grade these alone."
        )
    return 0 if set(marks) <= {"✓"} else BELOW


def _fixtures(options: argparse.Namespace, rubric: Rubric, console: Console) -> list[Fixture]:
    """Return the lab's solution and the fixtures, as far as there are any."""
    from grader.classroom.expectations import EXPECTED_FILE, fixtures_in, solution
    from grader.classroom.selftest import quick

    found = []
    if rubric.lab.solution is not None and (rubric.folder / rubric.lab.solution).is_dir():
        found.append(solution(rubric.folder / rubric.lab.solution, rubric))
    else:
        console.print("The solution is missing here, or the rubric names none (lab.solution).")
    folder: Path = options.fixtures or rubric.folder / "fixtures"
    if options.fixtures is not None or any(folder.glob(f"*/{EXPECTED_FILE}")):
        found += fixtures_in(folder)
    else:
        print_note(
            console,
            f"Lab {rubric.lab.id} has no fixtures here; name a folder of fixtures with --fixtures.",
            "",
        )
    if not found:
        remedy = "Name a folder of fixtures, or a solution in the rubric."
        raise SubmissionError("there is nothing to grade", remedy=remedy)
    return quick(found, rubric) if options.quick else found


def _run(
    fixtures: Sequence[Fixture], rubric: Rubric, options: argparse.Namespace, console: Console
) -> list[FixtureRun]:
    from grader import pipeline
    from grader.classroom.journal import Journal
    from grader.classroom.progress import RunProgress
    from grader.classroom.scheduler import Machine
    from grader.classroom.selftest import run_fixtures
    from grader.classroom.worker import Here
    from grader.live.sandbox.probing import probe_isolation

    interpreter, ros = students_side(None, rubric)
    isolation = probe_isolation(interpreter)
    machine = Machine.of(isolation, options.jobs)
    # The submissions are known, so any level of confinement is enough.
    live = pipeline.Options(interpreter, ros=ros, least_isolation="none")
    if options.output is None:
        folder: AbstractContextManager[str] = tempfile.TemporaryDirectory(prefix=TEMPORARY)
    else:
        folder = nullcontext(str(options.output))
    display = RunProgress(console, machine.slots, "fixtures")
    with (
        folder as path,
        Journal.open(Path(path)) as alone,
        Here(isolation, machine) as here,
        display,
    ):
        return asyncio.run(run_fixtures(fixtures, rubric, live, here, alone.results, display))

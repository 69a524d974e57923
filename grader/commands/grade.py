"""`grade PATH...`: grade submissions on a live ROS graph."""

from __future__ import annotations

import argparse
import difflib
import os
import resource
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from grader import __version__
from grader.commands import COMMANDS
from grader.commands.arguments import (
    BELOW,
    add_fail_under,
    add_flag,
    add_isolation,
    add_jobs,
    add_lab,
    add_path,
    each,
    interpreter_of,
    least_isolation,
    parser_of,
    print_error,
    print_note,
)
from grader.commands.export import add_exports
from grader.commands.usage import WrongUsage
from grader.errors import GraderError, UsageError
from grader.recording.submission import SUBMISSION_FILE
from grader.result_folder import EXPORTED, HISTORY, RECORDINGS
from grader.submission.file_names import is_packed
from grader.submission.separation import (
    require_no_links,
    require_same_source,
    uncounted_overrides,
    with_earlier,
)

if TYPE_CHECKING:
    from decimal import Decimal

    from grader.classroom.job import Row
    from grader.classroom.scheduler import Machine
    from grader.lab.rubric import Rubric
    from grader.live.sandbox.isolation import Isolation
    from grader.live.session.runner import Progress
    from grader.pipeline import Options
    from grader.submission.discovery import Discovery
    from grader.submission.extraction import SubmissionSource

_INTERRUPTED = 130
#: Files that belong to no submission are listed up to so many.
_MOST_LISTED = 10

_DESCRIPTION = """\
Grade ROS 2 lab submissions on a live ROS graph.

PATH is a submission (a folder or an archive), a folder of submissions, or a learning-management system's download.
Several submissions are graded side by side. What has been graded is kept: give the same command again after an
interruption, and it goes on; unchanged submissions are not graded a second time.
"""


def _parser(epilog: str) -> argparse.ArgumentParser:
    parser = parser_of("grade", _DESCRIPTION, epilog)
    parser.add_argument(
        "submissions",
        nargs="+",
        type=Path,
        metavar="PATH",
        help="a submission, or a folder of them",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default="results",
        metavar="DIR",
        help="where results go (default: results)",
    )
    add_lab(parser, "default: the lab which travels with grade")
    overrides = (
        "decisions of people, see `grade regrade --help` (default: overrides.yaml where results go)"
    )
    add_path(parser, "--overrides", overrides)
    parser.add_argument(
        "--sessions", type=_names, metavar="A,B", help="run only these sessions of the rubric"
    )
    add_path(parser, "--python", "interpreter for students' code (default: grade's own)")
    parser.add_argument("--seed", type=int, help="seed of the stimuli (default: drawn anew)")
    add_jobs(parser, "sessions side by side (default: as the cores allow)")
    parser.add_argument(
        "--launch",
        choices=("standin", "native", "auto"),
        default="standin",
        help="what evaluates launch files: grade's own stand-in (default), the real launch of a sourced ROS "
        "installation, or the real one where there is one",
    )
    _add_class(parser)
    add_isolation(parser)
    add_exports(parser, "--export")
    add_fail_under(parser)
    add_flag(parser, "--timings", "also print where the time went (for a single submission)")
    parser.add_argument("--version", action="version", version=f"grade {__version__}")
    return parser


def _names(text: str) -> list[str]:
    return [name for part in text.split(",") if (name := part.strip())]


def _add_class(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("several submissions")
    shape = group.add_mutually_exclusive_group()
    add_flag(shape, "--one", "each PATH is one submission, whatever it looks like")
    add_flag(shape, "--each", "each folder and archive in PATH is a submission")
    listed = "who is in the class: columns name, student_id, submitted_at and others, or a grade book's own export"
    add_path(group, "--class-list", listed, "CSV")
    again = group.add_mutually_exclusive_group()
    add_flag(
        again,
        "--resume",
        "keep what has been graded from the same files, rubric and options (the default)",
    )
    add_flag(again, "--afresh", "grade all again")
    undecided = "of what has been graded, run again only the sessions that left something undecided"
    add_flag(again, "--undecided", undecided)
    replace = (
        "let results take the place of those that were made from another path under the same name"
    )
    add_flag(group, "--replace", replace)
    pseudonyms = (
        "also write index-anonymous.html and grades-anonymous.csv, with pseudonyms instead of names"
    )
    add_flag(group, "--anonymous", pseudonyms)
    workers = "grade on the workers of this Dask scheduler (an address, or the file that it wrote)"
    group.add_argument("--scheduler", metavar="ADDRESS", help=workers)


def takes(arguments: Sequence[str]) -> bool:
    """Return whether these are arguments for grading, and all paths among them exist."""
    if {"-h", "--help", "--version"}.intersection(arguments):
        return False
    try:
        options = _parser("").parse_args(arguments)
    except WrongUsage:
        return False
    return all(path.exists() for path in options.submissions)


def run(arguments: Sequence[str], console: Console, epilog: str = "") -> int:
    """Grade the submissions; returns the exit status."""
    parser = _parser(epilog)
    options = parser.parse_args(arguments)
    if options.scheduler is not None:
        return _run(parser, options, console)
    _note_limits(console)
    from grader.live.sandbox.environment import require_platform
    from grader.live.session.scheduler import LocalScheduler

    require_platform(interpreter := interpreter_of(options.python))
    with LocalScheduler(interpreter, options.jobs) as options.local:
        return _run(parser, options, console)


def _note_limits(console: Console) -> None:
    """Say which limits give students' programs less than elsewhere; raises PlatformError if one prevents grading."""
    # First: under a limit on memory, not even the modules of the grader can be imported.
    from grader.live.sandbox.enough import present_shortages, require_limits

    require_limits()
    for shortage in present_shortages():
        print_note(console, f"Note: {shortage}.")


def _run(parser: argparse.ArgumentParser, options: argparse.Namespace, console: Console) -> int:
    from grader import pipeline
    from grader.classroom.regrade import recorded_in
    from grader.judging import rubrics
    from grader.live.sandbox.scratch import remove_stale

    rubric = rubrics.read_rubric(options.rubric)
    pipeline.require_sessions(options.sessions or (), rubric)
    require_submissions(options.submissions, rubric)
    found = _found(options, rubric)
    if options.undecided and options.scheduler is not None:
        parser.error("--undecided is for this machine; leave --scheduler out")
    several = len(found.submissions) > 1 or options.scheduler is not None or options.undecided
    origins = [source.origin for source in found.submissions]
    require_no_links(options.output, origins)
    for folder in recorded_in(options.output):
        rubrics.require_lab(folder, rubric, "Give another folder for these results by -o.")
    for target in options.exports:
        require_no_links(target.path(options.output).parent, origins, inside=False)
    if (
        options.overrides is None
        and (ignored := uncounted_overrides(options.output, origins)) is not None
    ):
        print_note(console, f"Note: {ignored}")
    if several and options.timings:
        parser.error("--timings is for one submission")
    if several and options.exports:
        parser.error(
            "--export is for one submission; for several use `grade export` on their results"
        )
    live = pipeline.Options(
        interpreter_of(options.python),
        options.sessions,
        pipeline.Scope.UNDECIDED if options.undecided else pipeline.Scope.ALL,
        options.seed,
        options.jobs,
        options.launch,
        least_isolation(options, several=several),
        rubrics.read_overrides(options.overrides, options.output, rubric, origins),
        options.exports,
        options.path_prefix,
    )
    _note_single_files(options.submissions, rubric, console)
    remove_stale()
    _print_discovery(found, console, several=several)
    allowed, status = [], 0
    for source in found.submissions:
        try:
            if not options.replace:
                require_same_source(options.output / source.name, source.origin)
            allowed.append(source)
        except UsageError as error:
            print_error(error)
            status = error.exit_status
    if several and allowed:
        found = replace(found, submissions=tuple(allowed))
        status = max(status, _grade_class(found, rubric, live, options, console))
    elif allowed:
        status = each(
            allowed, lambda one: _grade_one(one, rubric, live, options, console), options.fail_under
        )
    return status


def _found(options: argparse.Namespace, rubric: Rubric) -> Discovery:
    from grader.errors import SubmissionError
    from grader.submission.discovery import Shape, find_submissions

    shape = Shape.ONE if options.one else Shape.EACH if options.each else Shape.AUTO
    found = find_submissions(
        options.submissions, rubric, shape=shape, class_list=options.class_list
    )
    if not found.submissions:
        location, remedy = (
            ", ".join(map(str, options.submissions)),
            "Give a submission, or the folder that holds them.",
        )
        raise SubmissionError("there are no submissions in it", location=location, remedy=remedy)
    if options.class_list is not None:
        return found
    return replace(
        found, submissions=tuple(with_earlier(one, options.output) for one in found.submissions)
    )


def _note_single_files(paths: Sequence[Path], rubric: Rubric, console: Console) -> None:
    """Say so where one of the lab's files is given, and its folder holds more of them."""
    names = {artifact.file for artifact in rubric.artifacts.values()}
    for path in paths:
        if (
            path.name in names
            and path.is_file()
            and any((path.parent / n).is_file() for n in names - {path.name})
        ):
            print_note(
                console,
                f"Of the lab's files only {path.name} is graded; for all of them: grade {path.parent}",
            )


# -- one submission -------------------------------------------------------------------------------


def _grade_one(
    source: SubmissionSource,
    rubric: Rubric,
    live: Options,
    options: argparse.Namespace,
    console: Console,
) -> Decimal:
    from grader import pipeline, result_folder
    from grader.classroom import audit
    from grader.files import text_of
    from grader.report.terminal import ProgressDisplay, print_result
    from grader.report.timings import print_timings
    from grader.timings import Stopwatch

    output, watch = options.output, Stopwatch()
    results = output / source.name
    before = text_of(results / result_folder.RESULT_FILE)
    sessions = live.sessions
    if not sessions:
        counted = list(rubric.sessions)
        for name in rubric.bonus_sessions:
            counted.remove(name)
        sessions = counted
    with ProgressDisplay(console, source.name, sessions) as display:

        def show(p: Progress) -> None:
            display.note(p.session, p.text, p.step, p.steps, p.ended)

        result = pipeline.grade(source, rubric, results, live, show, options.local, watch)
    if (
        live.overrides.sha256
    ):  # Else nobody decides anything here, and a student's tries need no trail.
        audit.note_replaced(
            output, source.name, before, "grade", overrides_sha256=live.overrides.sha256
        )
    print_result(console, result)
    if live.sessions is not None:
        only = ", ".join(live.sessions)
        print_note(
            console, f"Of the sessions only {only}; what others show is not part of this score."
        )
    if options.timings:
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        print_timings(console, watch, result.provenance, children.ru_utime + children.ru_stime)
    console.print(f"Report: {results / result_folder.REPORT_FILE}", soft_wrap=True, markup=False)
    return result.final


# -- a class --------------------------------------------------------------------------------------


def _grade_class(
    found: Discovery, rubric: Rubric, live: Options, options: argparse.Namespace, console: Console
) -> int:
    from grader.classroom.class_run import ClassRun
    from grader.classroom.journal import Journal
    from grader.classroom.progress import RunProgress, print_class, summary

    began_s = time.monotonic()
    location, machine = _grading_location(options, live)
    with Journal.open(options.output, afresh=options.afresh) as journal:
        with RunProgress(console, machine.slots) as display:
            run = ClassRun(rubric, live, journal, machine, display)
            try:
                run.grade(found.submissions, location)
            except (KeyboardInterrupt, SystemExit) as end:
                kept = sum(not isinstance(row.ending, GraderError) for row in run.rows)
                text = f"grade: interrupted; {kept} of {len(found.submissions)} submissions are graded and kept."
                print(f"{text}\n  Run the same command again to grade the others.", file=sys.stderr)
                return int(end.code or 0) if isinstance(end, SystemExit) else _INTERRUPTED
        rows = sorted(run.rows, key=lambda row: (row.source.name.casefold(), row.source.name))
        print_class(console, rows)
        took_s = time.monotonic() - began_s
        took = f"{took_s / 60:.1f} min" if took_s >= 120 else f"{took_s:.0f} s"
        console.print(Text(f"{summary(rows)}; {took}."))
        names = [*(row.source.name for row in rows), *found.missing]
        for remark in live.overrides.remarks(names, times_matter=rubric.policy.late is not None):
            print_note(console, f"Note: {remark}")
        if below := [row.source.name for row in rows if _status(row, options.fail_under) == BELOW]:
            print_note(console, f"Below {options.fail_under} points: {', '.join(below)}")
        _report_class(rows, rubric, options, console)
    return max((_status(row, options.fail_under) for row in rows), default=0)


def _grading_location(
    options: argparse.Namespace, live: Options
) -> tuple[Isolation | str, Machine]:
    """Return where to grade (how code is confined here, or a scheduler), and this machine's slots."""
    from grader.classroom.scheduler import Machine
    from grader.live.sandbox.isolation import Isolation, Level
    from grader.live.sandbox.probing import require

    if options.scheduler is not None:
        return str(options.scheduler), Machine.of(Isolation(Level.FULL))
    with options.local as local:  # All of a class are forks of another process.
        isolation: Isolation = local.isolation
    require(isolation, Level.of(live.least_isolation))
    return isolation, Machine.of(isolation, live.jobs)


def _print_discovery(found: Discovery, console: Console, *, several: bool) -> None:
    """Print how the paths were understood, unless they hold a single submission without further facts."""
    for doubt in found.doubts:
        print_note(console, f"Note: {doubt}")
    if not (several or _has_more_to_say(found)):
        return
    for line in found.understood:
        print_note(console, line, "")
    _print_not_understood(found.not_understood, console)
    late = _late_without_time(found.submissions)
    if late:
        text = "Marked as late, but the download does not say when they were handed in; --class-list can"
        print_note(console, f"{text}: {', '.join(late)}")
    if found.missing:
        print_note(console, f"Nothing handed in: {', '.join(found.missing)}")


def _has_more_to_say(found: Discovery) -> bool:
    """Tell whether the paths hold more than submissions without a name or a mark of their own."""
    if found.not_understood or found.missing:
        return True
    return any(source.late or source.student for source in found.submissions)


def _print_not_understood(lines: Sequence[str], console: Console) -> None:
    """Print the first files and folders that belong to no submission, and the number of the others."""
    for line in lines[:_MOST_LISTED]:
        print_note(console, f"Belongs to no submission: {line}")
    more = len(lines) - _MOST_LISTED
    if more > 0:
        print_note(console, f"and {more} more.")


def _late_without_time(submissions: Iterable[SubmissionSource]) -> list[str]:
    """Return the names of submissions that a download marks as late without their time."""
    found = []
    for source in submissions:
        if source.late and source.submitted_at is None:
            found.append(source.name)
    return found


def _report_class(
    rows: Sequence[Row], rubric: Rubric, options: argparse.Namespace, console: Console
) -> None:
    """Write the class page and the table of grades, over all results that lie in the folder."""
    from grader.classroom.class_run import entries_of
    from grader.commands.report import report_class

    entries = entries_of(options.output, rows)
    known = {row.source.name for row in rows}
    if earlier := [entry.name for entry in entries if entry.name not in known]:
        print_note(console, f"Results of earlier runs, on the page too: {', '.join(earlier)}.")
    for anonymous in (False, True)[: 1 + options.anonymous]:
        report_class(
            options.output, entries, rubric, console, options.class_list, anonymous=anonymous
        )


def _status(row: Row, least: Decimal | None) -> int:
    if isinstance(row.ending, GraderError):
        return row.ending.exit_status
    return BELOW if least is not None and row.ending.final < least else 0


# -- what else than submissions may be meant ------------------------------------------------------


def require_submissions(paths: Sequence[Path], rubric: Rubric) -> None:
    """Raise UsageError if a path is no submission, but a word like a command, or a folder of results."""
    for path in paths:
        near = difflib.get_close_matches(str(path), COMMANDS, n=1, cutoff=0.75)
        if near and not path.exists():
            remedy = f"If you mean the command, write it first: grade {near[0]} ..."
            raise UsageError(
                f"there is neither a submission nor a command {str(path)!r}", remedy=remedy
            )
        if is_results(path, rubric):
            remedy = f"`grade regrade {path}` judges them again, without ROS."
            if not _is_recorded(path):
                remedy += f" `grade report {path}` writes the class page again."
            raise UsageError(
                "these are results, not submissions", location=str(path), remedy=remedy
            )


def is_results(path: Path, rubric: Rubric) -> bool:
    """Whether a folder holds results of a submission, or of a class, and nothing that a student hands in."""
    if not path.is_dir():
        return False
    inner = [
        entry
        for entry in path.iterdir()
        if not entry.name.startswith(".") and entry.name not in (HISTORY, EXPORTED)
    ]
    folders = [path] if _is_recorded(path) else [entry for entry in inner if entry.is_dir()]
    if (
        not folders
        or not all(map(_is_recorded, folders))
        or any(is_packed(entry.name) for entry in inner)
    ):
        return False
    wanted = {artifact.file for artifact in rubric.artifacts.values()}
    return not any(
        wanted.intersection(files) for folder in folders for _, _, files in os.walk(folder)
    )


def _is_recorded(folder: Path) -> bool:
    return (folder / RECORDINGS / SUBMISSION_FILE).is_file()

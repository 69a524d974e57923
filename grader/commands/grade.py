"""`grade PATH...`: grade submissions on a live ROS graph."""

from __future__ import annotations

import argparse
import difflib
import importlib
import os
import resource
import sys
import time
from collections.abc import Iterable, Sequence, Set
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from grader import __version__
from grader.commands import COMMANDS, GROUPS
from grader.commands.arguments import (
    BELOW,
    add_fail_under,
    add_flag,
    add_isolation,
    add_jobs,
    add_lab,
    add_path,
    add_ros,
    each,
    interpreter_of,
    least_isolation,
    likely_interpreter,
    parser_of,
    print_error,
    print_note,
    students_side,
)
from grader.commands.export_options import add_exports
from grader.commands.usage import WrongUsage
from grader.errors import GraderError, UsageError
from grader.lab.shipped_labs import require_extras
from grader.recording.submission import SUBMISSION_FILE
from grader.report.escape import terminal_text
from grader.result_folder import EXPORTED, HISTORY, RECORDINGS
from grader.submission.file_names import is_packed
from grader.submission.separation import (
    require_no_links,
    require_same_source,
    uncounted_overrides,
    with_earlier,
)

if TYPE_CHECKING:
    from argparse import _ActionsContainer
    from decimal import Decimal

    from confine.isolation import Isolation
    from grader.classroom.job import Row
    from grader.classroom.scheduler import Machine
    from grader.lab.rubric import Rubric
    from grader.live.session.runner import Progress
    from grader.pipeline import Options
    from grader.submission.discovery import Discovery
    from grader.submission.extraction import SubmissionSource

#: Exit status after Ctrl-C, as shells report it.
_INTERRUPTED = 130
#: Maximum number of files that are listed because they belong to no submission.
_MOST_LISTED = 10

EXIT_STATUS = """\
exit status:
  0  graded, whatever the score    1  below --fail-under         2  wrong usage
  3  no usable submission          4  rubric or overrides wrong  5  platform not supported
  6  recording not readable        7  code cannot be confined    70 other trouble
  130 interrupted                  of several submissions: the highest
"""
EXAMPLES = """\
  grade submissions/alice        grade a submission; its report: results/alice/report.html
  grade submissions/             grade a class; again: continue, and grade changed submissions
  grade --lab NAME submissions/  grade by another lab; `grade lab list` names them
"""
_DESCRIPTION = """\
Grade ROS 2 lab submissions on a live ROS graph.

PATH is a submission (a folder or an archive), a folder of submissions, or a download from a learning-management
system. Several submissions are graded side by side. After an interruption, run the same command again: it keeps the
results of unchanged submissions.
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of a grading."""
    epilog = f"{_list_of_commands()}\n{EXIT_STATUS}"
    parser = parser_of("grade", _DESCRIPTION, epilog, EXAMPLES)
    parser.add_argument(
        "submissions",
        nargs="+",
        type=Path,
        metavar="PATH",
        help="a submission, or a folder of submissions",
    )
    parser.add_argument("--version", action="version", version=f"grade {__version__}")
    _add_grading(parser.add_argument_group("grading"))
    _add_results(parser.add_argument_group("results"))
    _add_class(parser)
    _add_students_code(parser.add_argument_group("students' code"))
    return parser


def _list_of_commands() -> str:
    """List the other commands by group, a line each."""
    width = max(map(len, COMMANDS))
    lines = []
    for title, commands in GROUPS.items():
        lines.append(f"commands for {title} (each with --help):")
        lines += [f"  grade {name:<{width}}  {text}" for name, text in commands.items()]
        lines.append("")
    return "\n".join(lines)


def _add_grading(group: _ActionsContainer) -> None:
    add_lab(group, "default: the lab shipped with grade")
    group.add_argument(
        "--sessions",
        type=_names,
        metavar="A,B",
        help="sessions of the rubric to run (default: all)",
    )
    overrides = "file of manual decisions, see `grade regrade --help` (default: overrides.yaml in the results folder)"
    add_path(group, "--overrides", overrides)
    group.add_argument("--seed", type=int, help="seed of the random stimuli (default: a new one)")
    add_jobs(group, "number of sessions side by side (default: depends on the number of cores)")


def _add_results(group: _ActionsContainer) -> None:
    group.add_argument(
        "-o",
        "--output",
        type=Path,
        default="results",
        metavar="DIR",
        help="folder for the results (default: results)",
    )
    add_exports(group, "--export")
    add_fail_under(group)
    add_flag(group, "--timings", "also print the time of each stage (for a single submission)")


def _add_students_code(group: _ActionsContainer) -> None:
    add_path(
        group,
        "--python",
        "interpreter for students' code, or `lab`: an environment with the libraries of ROS 2 Jazzy and of the lab alone, "
        "made when it is first needed (default: grade's own)",
    )
    add_ros(group)
    group.add_argument(
        "--launch",
        choices=("standin", "native", "auto"),
        help="evaluation of launch files: by grade's own stand-in (default), by the native launch of --ros or of a sourced "
        "ROS installation, or auto: native if available (default with --ros)",
    )
    add_isolation(group)


def _names(text: str) -> list[str]:
    return [name for part in text.split(",") if (name := part.strip())]


def _add_class(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("several submissions")
    shape = group.add_mutually_exclusive_group()
    add_flag(shape, "--one", "treat each PATH as one submission")
    add_flag(shape, "--each", "treat each folder and archive in PATH as a submission")
    listed = "class list with the columns name, student_id, submitted_at and others, or a grade book export"
    add_path(group, "--class-list", listed, "CSV")
    again = group.add_mutually_exclusive_group()
    add_flag(
        again,
        "--resume",
        "keep results whose files, rubric and options are unchanged (the default)",
    )
    add_flag(again, "--afresh", "grade everything again")
    undecided = "run only the sessions with undecided checks again"
    add_flag(again, "--undecided", undecided)
    replacing = "replace earlier results of a submission with the same name from another path"
    add_flag(group, "--replace", replacing)
    pseudonyms = "also write index-anonymous.html and grades-anonymous.csv with pseudonyms"
    add_flag(group, "--anonymous", pseudonyms)
    workers = "grade on the workers of this Dask scheduler (its address or its scheduler file)"
    group.add_argument("--scheduler", metavar="ADDRESS", help=workers)


def takes(arguments: Sequence[str]) -> bool:
    """Return whether these arguments start a grading and all of their paths exist."""
    if {"-h", "--help", "--version"}.intersection(arguments):
        return False
    try:
        options = make_parser().parse_args(arguments)
    except WrongUsage:
        return False
    return all(path.exists() for path in options.submissions)


def run(arguments: Sequence[str], console: Console) -> int:
    """Grade the submissions; returns the exit status."""
    parser = make_parser()
    options = parser.parse_args(arguments)
    if options.scheduler is not None:
        return _run(parser, options, _read_lab(options), console)
    _note_limits(console)
    from grader.live.sandbox.environment import require_platform
    from grader.live.session.scheduler import LocalScheduler

    require_platform()
    # The sandbox test and the fork server load a second core while this process imports more, and reads the rubric.
    with LocalScheduler(likely_interpreter(options.python), options.jobs) as local:
        importlib.import_module("grader.pipeline")
        local.load()
        rubric = _read_lab(options)
        if options.ros is None:
            require_platform(options.python)
        options.local = local.for_interpreter(options.python)
        return _run(parser, options, rubric, console)


def _read_lab(options: argparse.Namespace) -> Rubric:
    """Read the rubric, which says where students' code runs unless options do."""
    from grader.judging import rubrics

    rubric = rubrics.read_rubric(options.rubric)
    options.python, options.ros = students_side(options.python, rubric, options.ros)
    return rubric


def _note_limits(console: Console) -> None:
    """Print a note for each resource limit too low for students' programs; raises PlatformError if one prevents grading."""
    # This check comes before other imports, because a memory limit can prevent even them.
    from grader.live.sandbox.enough import present_shortages, require_limits

    require_limits()
    for shortage in present_shortages():
        print_note(console, f"Note: {shortage}.")


def _run(
    parser: argparse.ArgumentParser, options: argparse.Namespace, rubric: Rubric, console: Console
) -> int:
    from confine.scratch import remove_stale
    from grader import pipeline

    pipeline.require_sessions(options.sessions or (), rubric)
    if options.scheduler is None:
        require_extras(rubric)
    require_submissions(options.submissions, rubric)
    found = _found(options, rubric)
    is_for_classes = options.scheduler is not None or options.undecided
    is_class = len(found.submissions) > 1 or is_for_classes
    _require_compatible_options(parser, options, is_class=is_class)
    origins = [source.origin for source in found.submissions]
    _require_safe_output(options, rubric, origins)
    _note_uncounted_overrides(options, origins, console)
    live = _live_options(options, rubric, origins, is_class=is_class)
    _note_single_files(options.submissions, rubric, console)
    remove_stale()
    _print_discovery(found, console, is_class=is_class)
    allowed, status = _without_other_sources(found.submissions, options)
    if not allowed:
        return status
    if is_class:
        found = replace(found, submissions=tuple(allowed))
        graded = _grade_class(found, rubric, live, options, console)
    else:
        graded = each(
            allowed, lambda one: _grade_one(one, rubric, live, options, console), options.fail_under
        )
    return max(status, graded)


def _require_compatible_options(
    parser: argparse.ArgumentParser, options: argparse.Namespace, *, is_class: bool
) -> None:
    """End with a usage error if options exclude each other, or do not work for a class."""
    if options.undecided:
        if options.scheduler is not None:
            parser.error("--undecided runs on this machine only; leave out --scheduler")
    if is_class and options.timings:
        parser.error(
            "--timings is for one submission, without --scheduler and --undecided; leave out --timings"
        )
    if is_class and options.exports:
        parser.error(
            "--export is for one submission, without --scheduler and --undecided; "
            "otherwise run `grade export` on the results"
        )


def _require_safe_output(
    options: argparse.Namespace, rubric: Rubric, origins: Sequence[str]
) -> None:
    """Raise UsageError if output would go through a submission's link, or to a folder with another lab's results."""
    from grader.classroom.regrade import recorded_in
    from grader.judging import rubrics

    require_no_links(options.output, origins)
    for folder in recorded_in(options.output):
        rubrics.require_lab(folder, rubric, "Name another folder for these results with -o.")
    for target in options.exports:
        require_no_links(target.path(options.output).parent, origins, inside=False)


def _note_uncounted_overrides(
    options: argparse.Namespace, origins: Sequence[str], console: Console
) -> None:
    """Print a note if the overrides file in the results folder is ignored because it is in a submission."""
    if options.overrides is not None:
        return
    ignored = uncounted_overrides(options.output, origins)
    if ignored is not None:
        print_note(console, f"Note: {ignored}")


def _live_options(
    options: argparse.Namespace, rubric: Rubric, origins: Sequence[str], *, is_class: bool
) -> Options:
    """Return the options for `grader.pipeline`."""
    from grader import pipeline
    from grader.judging import rubrics

    scope = pipeline.Scope.ALL
    if options.undecided:
        scope = pipeline.Scope.UNDECIDED
    interpreter = interpreter_of(options.python)
    isolation = least_isolation(options, several=is_class)
    overrides = rubrics.read_overrides(options.overrides, options.output, rubric, origins)
    return pipeline.Options(
        interpreter,
        options.sessions,
        scope,
        options.seed,
        options.jobs,
        options.launch,
        options.ros,
        isolation,
        overrides,
        options.exports,
        options.path_prefix,
    )


def _without_other_sources(
    submissions: Iterable[SubmissionSource], options: argparse.Namespace
) -> tuple[list[SubmissionSource], int]:
    """Return the submissions to grade, and the exit status for the refused ones.

    A submission is refused, with an error on the terminal, if its results were made from another path. `--replace` allows
    all.
    """
    allowed = []
    status = 0
    for source in submissions:
        try:
            if not options.replace:
                require_same_source(options.output / source.name, source.origin)
        except UsageError as error:
            print_error(error)
            status = error.exit_status
        else:
            allowed.append(source)
    return allowed, status


def _found(options: argparse.Namespace, rubric: Rubric) -> Discovery:
    from grader.errors import SubmissionError
    from grader.submission.discovery import Shape, find_submissions

    shape = Shape.AUTO
    if options.one:
        shape = Shape.ONE
    elif options.each:
        shape = Shape.EACH
    found = find_submissions(
        options.submissions, rubric, shape=shape, class_list=options.class_list
    )
    if not found.submissions:
        raise SubmissionError(
            "no submissions were found",
            location=", ".join(map(str, options.submissions)),
            remedy="Name a submission, or a folder of submissions.",
        )
    if options.class_list is not None:
        return found
    return replace(
        found, submissions=tuple(with_earlier(one, options.output) for one in found.submissions)
    )


def _note_single_files(paths: Sequence[Path], rubric: Rubric, console: Console) -> None:
    """Print a note for each path that leads to one file of the lab although its folder holds others."""
    names = {artifact.file for artifact in rubric.artifacts.values()}
    for path in paths:
        if path.name not in names or not path.is_file():
            continue
        others = names - {path.name}
        if any((path.parent / other).is_file() for other in others):
            print_note(
                console,
                f"Only {path.name} is graded; for all files of the lab: grade {path.parent}",
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

    results = options.output / source.name
    watch = Stopwatch()
    before = text_of(results / result_folder.RESULT_FILE)
    sessions = live.sessions
    if not sessions:
        sessions = [name for name in rubric.sessions if name not in rubric.bonus_sessions]
    with ProgressDisplay(console, source.name, sessions) as display:

        def show(p: Progress) -> None:
            display.note(p.session, p.text, p.step, p.steps, p.ended)

        result = pipeline.grade(source, rubric, results, live, show, options.local, watch)
    # Without overrides, this is probably a student's own attempt, which needs no audit trail.
    if live.overrides.sha256:
        audit.note_replaced(
            options.output, source.name, before, "grade", overrides_sha256=live.overrides.sha256
        )
    print_result(console, result)
    if live.sessions is not None:
        graded = ", ".join(live.sessions)
        print_note(console, f"Sessions graded: {graded}. The score leaves out the others.")
    if options.timings:
        # The CPU time of sandboxes counts when the fork server, their parent, has ended.
        options.local.close()
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
                return _interrupted(run.rows, len(found.submissions), end)
        rows = sorted(run.rows, key=_by_name)
        print_class(console, rows)
        took = _duration(time.monotonic() - began_s)
        console.print(Text(f"{summary(rows)}; {took}."))
        names = [*(row.source.name for row in rows), *found.missing]
        for remark in live.overrides.remarks(names, times_matter=rubric.policy.late is not None):
            print_note(console, f"Note: {remark}")
        statuses = {row.source.name: _status(row, options.fail_under) for row in rows}
        below = [name for name, status in statuses.items() if status == BELOW]
        if below:
            print_note(console, f"Below {options.fail_under} points: {', '.join(below)}")
        _report_class(rows, rubric, options, console)
    return max(statuses.values(), default=0)


def _interrupted(rows: Sequence[Row], count: int, end: KeyboardInterrupt | SystemExit) -> int:
    """Print the progress of an interrupted class run; returns the exit status."""
    kept = sum(not isinstance(row.ending, GraderError) for row in rows)
    text = f"grade: interrupted; {kept} of {count} submissions are graded and kept."
    print(f"{text}\n  Run the same command again to grade the others.", file=sys.stderr)
    if isinstance(end, SystemExit):
        return int(end.code or 0)
    return _INTERRUPTED


def _duration(duration_s: float) -> str:
    """Write a duration: below two minutes in seconds, otherwise in minutes, e.g. `95 s` or `2.5 min`."""
    if duration_s >= 120:
        return f"{duration_s / 60:.1f} min"
    return f"{duration_s:.0f} s"


def _grading_location(
    options: argparse.Namespace, live: Options
) -> tuple[Isolation | str, Machine]:
    """Return where to grade (with this machine's isolation, or at a scheduler's address), and this machine's slots."""
    from confine.isolation import Isolation, Level
    from grader.classroom.scheduler import Machine
    from grader.live.sandbox.probing import require

    if options.scheduler is not None:
        return str(options.scheduler), Machine.of(Isolation(Level.FULL))
    with options.local as local:  # A class has its own fork server; this one ends here.
        isolation: Isolation = local.isolation
    require(isolation, Level.of(live.least_isolation))
    return isolation, Machine.of(isolation, live.jobs)


def _print_discovery(found: Discovery, console: Console, *, is_class: bool) -> None:
    """Print how the paths were understood; for a single plain submission, only doubts."""
    for doubt in found.doubts:
        print_note(console, f"Note: {doubt}")
    if not (is_class or _is_worth_printing(found)):
        return
    for line in found.understood:
        print_note(console, line, "")
    _print_not_understood(found.not_understood, console)
    late = _late_without_time(found.submissions)
    if late:
        text = "Marked late in the download, without a submission time; add it with --class-list"
        print_note(console, f"{text}: {', '.join(late)}")
    if found.missing:
        print_note(console, f"Nothing handed in: {', '.join(found.missing)}")


def _is_worth_printing(found: Discovery) -> bool:
    """Return whether more was found than plain submissions, such as students' names or missing submissions."""
    if found.not_understood or found.missing:
        return True
    return any(source.marked_late_by or source.student for source in found.submissions)


def _print_not_understood(lines: Sequence[str], console: Console) -> None:
    """Print the first files and folders that belong to no submission, and the number of the others."""
    for line in lines[:_MOST_LISTED]:
        print_note(console, f"Belongs to no submission: {line}")
    more = len(lines) - _MOST_LISTED
    if more > 0:
        print_note(console, f"and {more} more.")


def _late_without_time(submissions: Iterable[SubmissionSource]) -> list[str]:
    """Return the names of submissions that a download marks as late without a submission time."""
    found = []
    for source in submissions:
        if source.marked_late_by and source.submitted_at is None:
            found.append(source.name)
    return found


def _report_class(
    rows: Sequence[Row], rubric: Rubric, options: argparse.Namespace, console: Console
) -> None:
    """Write the class page and the table of grades from all results in the folder, and print the next steps."""
    from grader.classroom.class_run import entries_of
    from grader.cohort.next_steps import next_steps
    from grader.commands.report import report_class
    from grader.report.exports import CLASS_EXPORTS

    entries = entries_of(options.output, rows)
    known = {row.source.name for row in rows}
    earlier = [entry.name for entry in entries if entry.name not in known]
    if earlier:
        print_note(
            console, f"The class page also has results of earlier runs: {', '.join(earlier)}."
        )
    listed = options.class_list
    if options.anonymous:
        report_class(options.output, entries, rubric, console, listed, anonymous=True)
    summary = report_class(options.output, entries, rubric, console, listed)
    console.print("Next:")
    for step in next_steps(summary, options.output, CLASS_EXPORTS):
        console.print(Text(f"  {terminal_text(str(step))}"), soft_wrap=True)


def _status(row: Row, least: Decimal | None) -> int:
    if isinstance(row.ending, GraderError):
        return row.ending.exit_status
    if least is not None and row.ending.final < least:
        return BELOW
    return 0


# -- paths that are not submissions -----------------------------------------------------------------


def require_submissions(paths: Sequence[Path], rubric: Rubric) -> None:
    """Raise UsageError if a path is a misspelt command or a folder of results."""
    for path in paths:
        near = difflib.get_close_matches(str(path), COMMANDS, n=1, cutoff=0.75)
        if near and not path.exists():
            remedy = f"If you mean the command, put it first: grade {near[0]} ..."
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
    """Return whether a folder holds the results of a submission or of a class, and nothing that could be graded."""
    if not path.is_dir():
        return False
    inner = [entry for entry in path.iterdir() if not _is_auxiliary(entry)]
    folders = [path]
    if not _is_recorded(path):
        folders = [entry for entry in inner if entry.is_dir()]
    if not folders or not all(map(_is_recorded, folders)):
        return False
    if any(is_packed(entry.name) for entry in inner):
        return False
    wanted = {artifact.file for artifact in rubric.artifacts.values()}
    return not any(_holds(folder, wanted) for folder in folders)


def _is_auxiliary(path: Path) -> bool:
    """Return whether an entry of a results folder is hidden, or is the folder of the audit trail or of exports."""
    return path.name.startswith(".") or path.name in (HISTORY, EXPORTED)


def _by_name(row: Row) -> tuple[str, str]:
    """Return the place of a row in the table of a class."""
    name = row.source.name
    return name.casefold(), name


def _holds(folder: Path, names: Set[str]) -> bool:
    """Return whether a folder holds a file with one of the names, at any depth."""
    for _, _, files in os.walk(folder):
        if not names.isdisjoint(files):
            return True
    return False


def _is_recorded(folder: Path) -> bool:
    return (folder / RECORDINGS / SUBMISSION_FILE).is_file()

"""`grade regrade RESULTS_DIR...`: judge recordings again, without ROS."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grader.commands.arguments import (
    BELOW,
    add_fail_under,
    add_flag,
    add_jobs,
    add_lab,
    add_path,
    each,
    parser_of,
    print_error,
    print_note,
)
from grader.files import replace_file

if TYPE_CHECKING:
    from grader.classroom.regrade import LoadedRubrics, Regrade
    from grader.cohort.changes import Changes

_DESCRIPTION = """\
Judge recordings again; needs no ROS.

A submission (results/alice) is judged and written at once. For a class (results/), the command prints all changes, and
writes them to changes.csv there; --apply also writes the results and the class page, and --ask does so after a question.

Decisions by people in overrides.yaml, beside the submissions' folders, are applied each time. Replaced results are kept
in history/, with a line in audit.jsonl, both beside the submissions' folders.
"""

_EPILOG = """\
overrides.yaml:
  overrides:
    - submission: alice               # the name of a submission, a list of names, or "*" for all
      check: node.rate                # an id of the rubric; or criterion: node
      set: 6                          # or add: -1.5, or excused: true (full points)
      reason: The timer was right; the lab's machine was not.
      who: J. Smith
      when: 2026-11-21
    - {submission: bob, extension: 2 days, reason: ill, who: J. Smith, when: 2026-11-19}
    - {submission: eve, bonus: 3, reason: an action server, who: J. Smith, when: 2026-11-21}
  Instead of extension: also due: or submitted:, each a time with offset (2026-11-22T23:59:00+01:00).

exit status:
  0 judged; class: nothing would change, or all results are written
  1 below --fail-under; class without --apply: something would change
  4 rubric or overrides not usable    6 recording not readable
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade regrade", _DESCRIPTION, _EPILOG)
    results = "results of a submission, e.g. results/alice, or of a class, e.g. results/"
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULTS_DIR", help=results)
    add_lab(parser, "default: the last rubric of each result")
    add_path(
        parser, "--overrides", "decisions by people (default: overrides.yaml beside the results)"
    )
    add_flag(
        parser,
        "--trust-lab",
        "execute unknown files of a lab that came with the recordings, because I trust their source",
    )
    writing = parser.add_mutually_exclusive_group()
    add_flag(writing, "--apply", "write the new results of a class, and its page")
    add_flag(writing, "--ask", "show the changes of a class, and ask whether to write them")
    add_flag(parser, "--mail", "also write mails with the changed reports, for a mail program")
    add_jobs(parser, "number of processes side by side for a class (default: one per core)")
    add_fail_under(parser)
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Judge the results again; returns the exit status."""
    parser = make_parser()
    options = parser.parse_args(arguments)
    from grader.classroom.regrade import is_class

    classes = [folder for folder in options.results if is_class(folder)]
    if not classes and any((options.apply, options.ask, options.jobs, options.mail)):
        parser.error(
            "--apply, --ask, --mail and --jobs are for a class; a single submission is written at once"
        )
    if options.mail and not _may_write(options):
        parser.error("--mail needs --apply or --ask")
    singles = [folder for folder in options.results if folder not in classes]
    statuses = [_regrade_class(folder, options, console) for folder in classes]
    if singles:
        # A preparation for others is of no use to a single submission.
        loaded: LoadedRubrics | None = None
        if len(singles) > 1:
            loaded = {}

        def regrade_one(folder: Path) -> Decimal:
            return _regrade_one(folder, options, console, loaded)

        statuses.append(each(singles, regrade_one, options.fail_under))
    return max(statuses)


def _may_write(options: argparse.Namespace) -> bool:
    """Return whether the results of a class are written, perhaps after a question."""
    return bool(options.apply or options.ask)


def _regrade_one(
    folder: Path, options: argparse.Namespace, console: Console, loaded: LoadedRubrics | None
) -> Decimal:
    from grader.classroom.regrade import regrade
    from grader.report.terminal import print_result

    found = regrade(
        [folder],
        options.rubric,
        options.overrides,
        pages=True,
        trusted=options.trust_lab,
        loaded=loaded,
    )
    for error in found.failed.values():
        raise error
    found.apply()
    ((name, judged),) = found.judged.items()
    print_result(console, judged.result)
    for remark in found.remarks(whole_class=False):
        print_note(console, f"Note: {remark}")
    if judged.changes.before is not None and judged.changes.matters:
        _print_changes(console, name, judged.changes)
    return judged.result.final


def _print_changes(console: Console, name: str, changes: Changes) -> None:
    """Print the changes of a submission as a table."""
    # Imported late: without a change, the tables of a class are not needed.
    from grader.report.changes import changes_table

    console.print()
    console.print(changes_table({name: changes}))


def _regrade_class(folder: Path, options: argparse.Namespace, console: Console) -> int:
    from rich.progress import Progress

    from grader.classroom.regrade import recorded_in, regrade
    from grader.report.changes import changes_csv, print_changes
    from grader.result_folder import CHANGES_FILE

    began_s = time.monotonic()
    folders = recorded_in(folder)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("Judging", total=len(folders))
        found = regrade(
            folders,
            options.rubric,
            options.overrides,
            pages=_may_write(options),
            trusted=options.trust_lab,
            jobs=options.jobs,
            on_judged=lambda name: progress.advance(task),
        )
    took_s = time.monotonic() - began_s
    if found.failed:
        console.print(
            f"{len(found.failed)} of {len(folders)} could not be judged, for the reasons below."
        )
    if not found.judged:
        return _status(found, [], options)
    print_changes(console, found.changes)
    matter = [changes for changes in found.changes.values() if changes.matters]
    replace_file(folder / CHANGES_FILE, changes_csv(matter))
    if options.ask and matter:
        options.apply = _is_confirmed(console)
    if options.apply:
        found.apply()
    for remark in found.remarks():
        print_note(console, f"Note: {remark}")
    console.print(f"Judged in {took_s:.1f} s. {_outlook(options, matter)}".rstrip())
    console.print(f"Table: {folder / CHANGES_FILE}", soft_wrap=True, markup=False)
    if options.apply and matter:
        changed = [name for name, changes in found.changes.items() if changes.matters]
        _report(folder, changed, options, console)
    return _status(found, matter, options)


def _is_confirmed(console: Console) -> bool:
    """Ask whether to write the results; without an answer, they are not written."""
    try:
        answer = console.input("Write these results? [y/N] ", markup=False)
    except EOFError:
        return False
    return answer.strip().lower() in ("y", "yes")


def _outlook(options: argparse.Namespace, matter: Sequence[Changes]) -> str:
    """Say whether the results of a class are written; empty if nothing would change."""
    if options.apply:
        return "The results are written."
    if matter:
        return "No result is written yet; --apply writes them."
    return ""


def _report(
    folder: Path, changed: Sequence[str], options: argparse.Namespace, console: Console
) -> None:
    """Renew the class page, if there is one, and write mails for the changed submissions if these are wanted."""
    from grader import result_folder
    from grader.commands import report
    from grader.commands.export import write_mails

    if (folder / result_folder.CLASS_PAGE).exists():
        report.run([str(folder)], console)
    if options.mail:
        write_mails(folder, changed, folder, console)


def _status(found: Regrade, matter: Sequence[Changes], options: argparse.Namespace) -> int:
    """Print the failures, one message for each cause; returns the exit status."""
    least: Decimal | None = options.fail_under
    statuses = [0]
    if matter and not options.apply:
        statuses.append(BELOW)
    if least is not None and any(changes.after < least for changes in found.changes.values()):
        statuses.append(BELOW)
    causes: dict[tuple[str, ...], list[str]] = {}
    for name, failed in found.failed.items():
        cause = (failed.problem, failed.remedy, *getattr(failed, "mistakes", ()))
        causes.setdefault(cause, []).append(name)
        statuses.append(failed.exit_status)
    for names in causes.values():
        failed = found.failed[names[0]]
        if len(names) > 1:
            failed.location = _listed(names)
        failed.location = failed.location or names[0]
        print_error(failed)
    return max(statuses)


def _listed(names: Sequence[str]) -> str:
    """List the first three names, e.g. `ann, bob, cleo and 2 more`."""
    listed = ", ".join(names[:3])
    if len(names) > 3:
        listed += f" and {len(names) - 3} more"
    return listed

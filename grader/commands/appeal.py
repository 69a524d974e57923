"""`grade appeal RESULTS_DIR CHECK`: judge a check again, write its evidence, note question and answer."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grader.commands.arguments import add_flag, add_lab, add_path, parser_of, points, print_note
from grader.commands.review import desk_of, login

if TYPE_CHECKING:
    from decimal import Decimal

    from grader.classroom.regrade import Judged
    from grader.desk.decisions import Desk
    from grader.result import CheckResult, Result

_DESCRIPTION = """\
Examine an appeal: write a page with all evidence of a check, judge the recording again, and print the difference.
Question and answer go to overrides.yaml, and appear at the check in the student's next report. A question without an
answer waits at the desk of `grade review`.
"""

_EPILOG = """\
examples:
  grade appeal results/alice publisher.rate                                   # evidence only
  grade appeal results/alice publisher.rate --question "My timer is 0.01 s."  # noted for the desk
  grade appeal results/alice publisher.rate --answer "You are right." --set 5 --reason "the timer is right"
  grade appeal results/alice publisher.rate --answer "The recording shows 94 Hz; see the figure." --mail
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = parser_of("grade appeal", _DESCRIPTION, _EPILOG)
    parser.add_argument(
        "results",
        type=Path,
        metavar="RESULTS_DIR",
        help="results of a submission, e.g. results/alice",
    )
    parser.add_argument("check", metavar="CHECK", help="id of a check, as shown in the report")
    parser.add_argument("--question", metavar="TEXT", help="question of the student")
    parser.add_argument(
        "--answer",
        metavar="TEXT",
        help="answer to the student; keeps the points unless they are set",
    )
    parser.add_argument("--set", type=points, metavar="N", help="new points of the check")
    add_flag(parser, "--excused", "give full points for the check")
    parser.add_argument(
        "--reason",
        metavar="TEXT",
        default="appeal",
        help="reason for changed points (default: %(default)s)",
    )
    parser.add_argument(
        "--who",
        metavar="NAME",
        default=login(),
        help="your name, for the decisions (default: %(default)s)",
    )
    add_flag(parser, "--mail", "also write a mail with the new report, for a mail program")
    add_path(
        parser, "--overrides", "decisions by people (default: overrides.yaml beside the results)"
    )
    add_lab(parser, "default: the last rubric of the result")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Judge again, write the evidence, note question and answer; returns the exit status."""
    options = make_parser().parse_args(arguments)
    from grader.commands.export import write_mails
    from grader.files import replace_file
    from grader.judging.judgement import evidence_of
    from grader.report.views import anchor
    from grader.result_folder import RECORDINGS

    folder = options.results.resolve()
    desk = desk_of(folder.parent, options.rubric, options.overrides, options.who, "appeal")
    before = _check_of(desk, folder, options.check)
    if options.set is not None:
        _require_within(options.set, before)
    judged = _judged_again(desk, folder, options.rubric)
    page = folder / f"{anchor('appeal', before.id)}.html"
    replace_file(page, evidence_of(judged.result, folder / RECORDINGS, judged.rubric, before.id))
    _print_difference(before, judged.result, console)
    console.print(f"Evidence: {page}", soft_wrap=True, markup=False)
    if _note(desk, folder.name, options):
        for name in desk.close():
            print_note(
                console, f"{name} could not be written; `grade regrade {folder}` shows the reason."
            )
        console.print(
            f"Noted in {desk.overrides_file}; the report shows it.", soft_wrap=True, markup=False
        )
    if options.mail:
        write_mails(folder.parent, {folder.name}, folder, console)
    return 0


def _check_of(desk: Desk, folder: Path, id_: str) -> CheckResult:
    """Return a check of a submission's result; raises UsageError if there is no such result or check."""
    from grader.errors import UsageError
    from grader.lab.similar_words import meant

    result = desk.judged().get(folder.name)
    if result is None:
        raise UsageError(
            "there is no result of this submission", location=str(folder), remedy="Grade it first."
        )
    checks = {check.id: check for check in result.checks}
    if id_ not in checks:
        raise UsageError(
            f"there is no check {id_!r}{meant(id_, list(checks))}",
            remedy="The report shows the id of each check.",
        )
    return checks[id_]


def _judged_again(desk: Desk, folder: Path, rubric: Path | None) -> Judged:
    """Judge a submission's recording again, with the overrides; raises GraderError if that fails."""
    from grader.classroom.regrade import regrade

    overrides = desk.overrides_file if desk.overrides_file.exists() else None
    found = regrade([folder], rubric, overrides, pages=False)
    for error in found.failed.values():
        raise error
    return found.judged[folder.name]


def _print_difference(before: CheckResult, result: Result, console: Console) -> None:
    """Print the new points of a check, e.g. `failed, 0 of 2, as before`, and the rule that decided."""
    from grader.judging.rules import sentence_of
    from grader.report.views import points as points_text
    from grader.report.views import rule_text, signed

    again = next(check for check in result.checks if check.id == before.id)
    difference = again.earned - before.earned
    words = f"{signed(difference)} points" if difference else "as before"
    outcome = again.outcome.value.replace("_", " ")
    earned = f"{points_text(again.earned)} of {points_text(again.possible)}"
    console.print(f"Judged again: {outcome}, {earned}, {words}.")
    console.print(f"Decided by {rule_text(again)}: {sentence_of(again.decided_by)}")


def _require_within(given: Decimal, check: CheckResult) -> None:
    """Raise UsageError if the points are outside the check's range."""
    from grader.errors import UsageError
    from grader.report.views import points as points_text

    if not 0 <= given <= check.possible:
        range_ = f"0 to {points_text(check.possible)} points"
        remedy = "For more points, add a bonus in overrides.yaml."
        problem = f"{check.id} has {range_}, not {points_text(given)}"
        raise UsageError(problem, location="--set", remedy=remedy)


def _note(desk: Desk, name: str, options: argparse.Namespace) -> bool:
    """Write question and answer to the overrides; returns True if there was any."""
    from dataclasses import replace

    from grader.desk.decisions import Decision

    about = {"names": (name,), "level": "check", "id": options.check}
    if options.question:
        student = desk.judged()[name].submission
        appeal = Decision(**about, change="appeal", comment=options.question)
        replace(desk, who=student).decide(appeal)
    if options.set is not None:
        change = "set"
    elif options.excused:
        change = "excused"
    else:
        change = "reviewed"
    is_answered = bool(options.answer) or change != "reviewed"
    if is_answered:
        comment = options.answer or ""
        reason = options.reason if change != "reviewed" else ""
        desk.decide(
            Decision(**about, change=change, points=options.set, comment=comment, reason=reason)
        )
    return bool(options.question) or is_answered

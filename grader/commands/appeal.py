"""`grade appeal RESULTS_DIR CHECK`: all evidence about a check in a page, judged again, with question and answer."""

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

    from grader.desk.decisions import Desk
    from grader.result import CheckResult

_DESCRIPTION = """\
Look into an appeal: write the page of all evidence about a check, judge the recording again, and say whether that
changes anything. What the student asks and what is answered is written to overrides.yaml, and stands in the student's
next report, at the check. An appeal that is noted without an answer waits at the desk of `grade review`.
"""

_EPILOG = """\
examples:
  grade appeal results/alice publisher.rate                                   # the evidence, and nothing else
  grade appeal results/alice publisher.rate --question "My timer is 0.01 s."  # noted; it waits at the desk
  grade appeal results/alice publisher.rate --answer "You are right." --set 5 --reason "the timer is right"
  grade appeal results/alice publisher.rate --answer "The recording shows 94 Hz; see the figure."
"""


def _parser() -> argparse.ArgumentParser:
    parser = parser_of("grade appeal", _DESCRIPTION, _EPILOG)
    parser.add_argument(
        "results",
        type=Path,
        metavar="RESULTS_DIR",
        help="results of a submission, e.g. results/alice",
    )
    parser.add_argument("check", metavar="CHECK", help="id of a check, as the report shows it")
    parser.add_argument("--question", metavar="TEXT", help="what the student asks")
    parser.add_argument(
        "--answer", metavar="TEXT", help="what the student is told; without points, they stay"
    )
    parser.add_argument("--set", type=points, metavar="N", help="points that the check gets")
    add_flag(parser, "--excused", "nothing is lost at the check")
    parser.add_argument(
        "--reason",
        metavar="TEXT",
        default="appeal",
        help="why points change (default: %(default)s)",
    )
    parser.add_argument(
        "--who", metavar="NAME", default=login(), help="who decides (default: %(default)s)"
    )
    add_path(
        parser, "--overrides", "decisions of people (default: overrides.yaml beside the results)"
    )
    add_lab(parser, "default: the one that it was judged by last")
    return parser


def run(arguments: Sequence[str], console: Console) -> int:
    """Show the evidence, judge again, and note what is asked and answered; returns the exit status."""
    from grader.classroom.regrade import regrade
    from grader.errors import UsageError
    from grader.files import replace_file
    from grader.judging.judgement import evidence_of
    from grader.judging.rules import sentence_of
    from grader.lab.yaml_with_lines import meant
    from grader.report.views import anchor, rule_text, signed
    from grader.report.views import points as points_text
    from grader.result_folder import RECORDINGS

    options = _parser().parse_args(arguments)
    folder, id_ = options.results.resolve(), options.check
    desk = desk_of(folder.parent, options.rubric, options.overrides, options.who, "appeal")
    result = desk.judged().get(folder.name)
    if result is None:
        raise UsageError(
            "there is no result of this submission", location=str(folder), remedy="Grade it first."
        )
    ids = [check.id for check in result.checks]
    if id_ not in ids:
        raise UsageError(
            f"there is no check {id_!r}{meant(id_, ids)}",
            remedy="The report names the id at each check.",
        )
    before = next(check for check in result.checks if check.id == id_)
    if options.set is not None:
        _require_within(options.set, before)
    found = regrade(
        [folder],
        options.rubric,
        desk.overrides_file if desk.overrides_file.exists() else None,
        pages=False,
    )
    for error in found.failed.values():
        raise error
    ((_, judged),) = found.judged.items()
    page = folder / f"{anchor('appeal', id_)}.html"
    replace_file(page, evidence_of(judged.result, folder / RECORDINGS, judged.rubric, id_))
    again = next(check for check in judged.result.checks if check.id == id_)
    same = (
        "as before"
        if again.earned == before.earned
        else f"{signed(again.earned - before.earned)} points"
    )
    outcome, earned = again.outcome.value.replace("_", " "), points_text(again.earned)
    console.print(f"Judged again: {outcome}, {earned} of {points_text(again.possible)}, {same}.")
    console.print(f"Decided by {rule_text(again)}: {sentence_of(again.decided_by)}")
    console.print(f"Evidence: {page}", soft_wrap=True, markup=False)
    if _note(desk, folder.name, options):
        for name in desk.close():
            print_note(console, f"{name} could not be written; `grade regrade {folder}` says why.")
        console.print(
            f"Noted in {desk.overrides_file}; the report shows it.", soft_wrap=True, markup=False
        )
    return 0


def _require_within(given: Decimal, check: CheckResult) -> None:
    """Raise UsageError if a check does not have so many points."""
    from grader.errors import UsageError
    from grader.report.views import points as points_text

    if not 0 <= given <= check.possible:
        raise UsageError(
            f"{check.id} has 0 to {points_text(check.possible)} points, not {points_text(given)}",
            location="--set",
            remedy="A bonus in overrides.yaml gives more.",
        )


def _note(desk: Desk, name: str, options: argparse.Namespace) -> bool:
    """Write question and answer; returns whether there was one."""
    from dataclasses import replace

    from grader.desk.decisions import Decision

    about = {"names": (name,), "level": "check", "id": options.check}
    if options.question:
        student = desk.judged()[name].submission
        replace(desk, who=student).decide(
            Decision(**about, change="appeal", comment=options.question)
        )
    change = "set" if options.set is not None else "excused" if options.excused else "reviewed"
    is_answered = bool(options.answer) or change != "reviewed"
    if is_answered:
        answer = {
            "change": change,
            "points": options.set,
            "comment": options.answer or "",
            "reason": options.reason,
        }
        desk.decide(
            Decision(**about, **(answer if change != "reviewed" else {**answer, "reason": ""}))
        )
    return bool(options.question) or is_answered

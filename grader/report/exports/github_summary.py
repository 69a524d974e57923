"""Markdown for GitHub's job summary: the score, the lost points with their reasons, and all checks.

GitHub shows nothing of a step that writes more than 1 MiB. Parts beyond it are left out whole, with a line that says
that they are missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from grader.report.escape import markdown_text
from grader.report.exports.graded import (
    MOST_REMARKS,
    Graded,
    GradedCheck,
    points_of,
    proof_lines,
    violation_texts,
)
from grader.report.views import (
    BONUS,
    EXPLANATION,
    HEADING,
    adjustments_of,
    badge_of,
    bonus_lines,
    points,
)
from grader.result import EVIDENCE_LINE, Outcome

LONGEST_BYTES = 1024 * 1024
_LEFT_OUT = "*More did not fit here; the report has all.*\n"


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the summary."""
    return fitting(_parts(graded), LONGEST_BYTES)


def fitting(parts: Iterable[str], longest_bytes: int) -> str:
    """Return the first parts that fit, with a last line if some do not."""
    fit: list[str] = []
    size = len(_LEFT_OUT.encode())
    for part in parts:
        size += len(part.encode()) + 1
        if size > longest_bytes:
            return "\n".join([*fit, _LEFT_OUT])
        fit.append(part)
    return "\n".join(fit)


def _parts(graded: Graded) -> Iterable[str]:
    yield _head(graded)
    yield _criteria(graded)
    yield from _listed(BONUS, bonus_lines(graded))
    adjustments = [view.text for view in adjustments_of(graded)]
    judged = points(graded.score.earned)
    total = f"As judged: {judged}. With all adjustments: **{points(graded.final)}**."
    yield from _listed("Adjustments", adjustments, total)
    yield from _listed(HEADING, violation_texts(graded), EXPLANATION)
    yield from _losses(graded)
    undecided = []
    for check in graded.checks:
        if check.open:
            undecided.append(_because(check, f"{points(check.undecided)} points"))
    yield from _items("Undecided, not earned", undecided)
    yield from _listed("Costs nothing, but worth knowing", graded.advisories[:MOST_REMARKS])
    yield from _listed("On the grader's side", graded.problems[:MOST_REMARKS])
    yield _all_checks(graded)
    yield _foot(graded)


def _losses(graded: Graded) -> Iterable[str]:
    """Yield a part for each check that lost points by itself, and one for the blocked checks."""
    lossy = []
    missed = []
    for check in graded.lossy:
        if check.outcome is Outcome.NOT_REACHED:
            missed.append(_because(check, f"−{points(check.lost)} points"))
        else:
            lossy.append(_lost(check))
    if lossy:
        yield "## What cost points\n"
    yield from lossy
    yield from _items("Not tested, because of the above", missed)


def _head(graded: Graded) -> str:
    total = f"{points(graded.final)} of {points(graded.score.possible)} points"
    lines = [
        f"# {markdown_text(graded.lab, 200)}: {total}",
        "",
        f"Submission {markdown_text(graded.submission, 200)}",
    ]
    if graded.still_undecided:
        lines += [
            "",
            f"> **{points(graded.still_undecided)} points are undecided**, and not earned before they are: "
            "the next run may decide them, or the instructor.",
        ]
    if "none" in graded.isolations:
        lines += [
            "",
            "> **The submission's code ran unconfined.** The report says what would confine it.",
        ]
    return "\n".join(lines) + "\n"


def _criteria(graded: Graded) -> str:
    rows = ["| | Criterion | Points |", "|:-:|---|--:|"]
    for criterion in graded.criteria:
        share = f"{points(criterion.earned)} / {points(criterion.possible)}"
        if criterion.undecided:
            share += f" (+ {points(criterion.undecided)} undecided)"
        sign = badge_of(criterion.outcome).sign
        rows.append(f"| {sign} | {markdown_text(criterion.title)} | {share} |")
    return "\n".join(rows) + "\n"


def _lost(check: GradedCheck) -> str:
    badge = badge_of(check.outcome)
    title = markdown_text(check.title)
    reason = markdown_text(check.reason) or badge.word
    heading = f"### {badge.sign} {title}: −{points(check.lost)} points"
    lines = [heading, "", reason, ""]
    lines += [f"- {name}: {markdown_text(text)}" for name, text in proof_lines(check)]
    return "\n".join(lines) + "\n"


def _because(check: GradedCheck, cost: str) -> str:
    return f"{markdown_text(check.title)} ({cost}): {markdown_text(check.reason)}"


def _listed(title: str, texts: Iterable[str], last: str = "") -> Iterable[str]:
    """Yield a part with a title and untrusted texts as its items; nothing if there are no texts."""
    yield from _items(title, map(markdown_text, texts), last)


def _items(title: str, lines: Iterable[str], last: str = "") -> Iterable[str]:
    """Yield a part with a title, lines of Markdown as its items, and a last item; nothing if there are no lines."""
    items = [f"- {line}" for line in lines]
    if not items:
        return
    if last:
        items.append(f"- {last}")
    yield "\n".join([f"## {title}", "", *items]) + "\n"


def _all_checks(graded: Graded) -> str:
    rows = ["| | Check | Points |", "|---|---|--:|"]
    without_loss = 0
    for check in graded.checks:
        badge = badge_of(check.outcome)
        title = markdown_text(check.title)
        rows.append(f"| {badge.sign} {badge.word} | {title} | {points_of(check)} |")
        without_loss += not check.lost and not check.open
    count = f"{len(graded.checks)} checks, {without_loss} without loss"
    table = "\n".join(rows)
    return f"<details><summary>All {count}</summary>\n\n{table}\n\n</details>\n"


def _foot(graded: Graded) -> str:
    facts = []
    if graded.isolations:
        facts.append(f"isolation: {markdown_text(', '.join(graded.isolations))}")
    if graded.rubric_sha256:
        facts.append(f"rubric {markdown_text(graded.rubric_sha256[:12])}")
    listed = f" ({'; '.join(facts)})" if facts else ""
    return f"{EVIDENCE_LINE}, among the files of this job{listed}.\n"

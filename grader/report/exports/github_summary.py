"""Markdown for GitHub's job summary: the score, what cost points and why, and all checks.

GitHub shows nothing of more than 1 MiB from a step: what does not fit is left out whole, with a line that says so.
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
from grader.result import Outcome

LONGEST_BYTES = 1024 * 1024
_LEFT_OUT = "*More did not fit here; the report has all.*\n"


def render(graded: Graded, environment: Mapping[str, str]) -> str:
    """Return the summary."""
    return fitting(_parts(graded), LONGEST_BYTES)


def fitting(parts: Iterable[str], longest_bytes: int) -> str:
    """Return as many of the parts, in their order, as fit; with a last line if some do not."""
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
    yield from _listed(BONUS, map(markdown_text, bonus_lines(graded)))
    judged = f"As judged: {points(graded.score.earned)}. With all adjustments: **{points(graded.final)}**."
    yield from _listed(
        "Adjustments", (markdown_text(view.text) for view in adjustments_of(graded)), judged
    )
    yield from _listed(HEADING, map(markdown_text, violation_texts(graded)), EXPLANATION)
    lossy = [check for check in graded.lossy if check.outcome is not Outcome.NOT_REACHED]
    if lossy:
        yield "## What cost points\n"
        yield from (_lost(check) for check in lossy)
    missed = [_because(c, f"−{points(c.lost)} points") for c in graded.lossy if c not in lossy]
    yield from _listed("Not tested, because of the above", missed)
    undecided = [_because(c, f"{points(c.undecided)} points") for c in graded.checks if c.open]
    yield from _listed("Undecided, not earned", undecided)
    yield from _listed(
        "Costs nothing, but worth knowing", map(markdown_text, graded.advisories[:MOST_REMARKS])
    )
    yield from _listed("On the grader's side", map(markdown_text, graded.problems[:MOST_REMARKS]))
    yield _all_checks(graded)
    yield _foot(graded)


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
    if any(session["isolation"] == "none" for session in graded.sessions.values()):
        lines += [
            "",
            "> **The submission's code ran unconfined.** The report says what would confine it.",
        ]
    return "\n".join(lines) + "\n"


def _criteria(graded: Graded) -> str:
    rows = []
    for criterion in graded.criteria:
        undecided = f" (+ {points(criterion.undecided)} undecided)" if criterion.undecided else ""
        share = f"{points(criterion.earned)} / {points(criterion.possible)}{undecided}"
        rows.append(
            f"| {badge_of(criterion.outcome).sign} | {markdown_text(criterion.title)} | {share} |"
        )
    return "\n".join(["| | Criterion | Points |", "|:-:|---|--:|", *rows]) + "\n"


def _lost(check: GradedCheck) -> str:
    lines = [
        f"### {badge_of(check.outcome).sign} {markdown_text(check.title)}: −{points(check.lost)} points",
        "",
        markdown_text(check.reason) or badge_of(check.outcome).word,
        "",
        *(f"- {name}: {markdown_text(text)}" for name, text in proof_lines(check)),
    ]
    return "\n".join(lines) + "\n"


def _because(check: GradedCheck, cost: str) -> str:
    return f"{markdown_text(check.title)} ({cost}): {markdown_text(check.reason)}"


def _listed(title: str, lines: Iterable[str], last: str = "") -> Iterable[str]:
    """Give a part of lines with a title, and a last one below them; nothing without lines."""
    items = [f"- {line}" for line in lines]
    if items:
        yield "\n".join([f"## {title}", "", *items, *([f"- {last}"] if last else [])]) + "\n"


def _all_checks(graded: Graded) -> str:
    rows = [
        f"| {badge.sign} {badge.word} | {markdown_text(check.title)} | {points_of(check)} |"
        for check, badge in ((check, badge_of(check.outcome)) for check in graded.checks)
    ]
    count = f"{len(rows)} checks, {sum(1 for c in graded.checks if not c.lost and not c.open)} without loss"
    table = "\n".join(["| | Check | Points |", "|---|---|--:|", *rows])
    return f"<details><summary>All {count}</summary>\n\n{table}\n\n</details>\n"


def _foot(graded: Graded) -> str:
    levels = dict.fromkeys(session["isolation"] for session in graded.sessions.values())
    facts = [f"isolation: {markdown_text(', '.join(levels))}"] if levels else []
    if graded.rubric_sha256:
        facts.append(f"rubric {markdown_text(graded.rubric_sha256[:12])}")
    listed = f" ({'; '.join(facts)})" if facts else ""
    return (
        f"The evidence for each point is in `report.html`, among the files of this job{listed}.\n"
    )

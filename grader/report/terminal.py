"""The terminal's view of a grading: progress while it runs, then a table with the reason for each lost point."""

from __future__ import annotations

import time
from collections.abc import Sequence
from decimal import Decimal

from rich.console import Console, Group
from rich.live import Live
from rich.padding import Padding
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from grader.report.escape import terminal_text
from grader.report.views import (
    BONUS,
    SEVERAL_FILES,
    adjustments_of,
    badge_of,
    chosen_words,
    earned_text,
    note_of,
    points,
    titles_of,
)
from grader.result import CheckResult, CriterionResult, Outcome, Result, Violation

#: What took less was not run at all.
_NOTABLE_S = 0.05


class ProgressDisplay(Live):
    """Shows each session, in order, and what it waits for; on a terminal in place, else a line when a session ends."""

    def __init__(self, console: Console, submission: str, sessions: Sequence[str]) -> None:
        self._console = console
        self._submission = terminal_text(submission, 80)
        self._states: dict[str, tuple[str, int, int, bool]] = dict.fromkeys(
            sessions, ("in the queue", 0, 0, False)
        )
        self._started_s = time.monotonic()
        self._began: dict[str, float] = {}
        self._took: dict[str, float] = {}
        super().__init__(
            console=console, get_renderable=self._table, refresh_per_second=8, transient=True
        )

    def note(self, session: str, text: str, step: int, steps: int, ended: bool) -> None:
        """Take note of what a session does now."""
        now = time.monotonic()
        self._began.setdefault(session, now)
        if ended:
            self._took[session] = now - self._began.pop(session)
            if not self._console.is_terminal:
                took = (
                    f" ({self._took[session]:.1f} s)" if self._took[session] >= _NOTABLE_S else ""
                )
                self._console.print(
                    f"  {session}: {terminal_text(text)}{took}", highlight=False, markup=False
                )
        self._states[session] = (text, step, steps, ended)

    def _table(self) -> Group:
        now = time.monotonic()
        table = Table.grid(padding=(0, 2))
        for name, (text, step, steps, ended) in self._states.items():
            if ended:
                table.add_row("  [green]✓[/]", name, text, f"{self._took.get(name, 0.0):.1f} s")
            elif name in self._began:
                count = f" ({step} of {steps})" if steps else ""
                line = Text(f"{terminal_text(text, 60)}{count}")
                table.add_row(Spinner("dots"), name, line, f"{now - self._began[name]:.1f} s")
            else:
                table.add_row("  ·", name, "in the queue", "")
        return Group(Text(f"Grading {self._submission} … {now - self._started_s:.0f} s"), table)


def print_result(console: Console, result: Result) -> None:
    """Print the score: each criterion, and under it each check that lost or withheld points, with reason and hint."""
    _print_chosen(console, result)
    table = Table(box=None, padding=(0, 1), show_header=False, expand=False)
    table.add_column(width=1)
    table.add_column(overflow="fold")
    table.add_column(justify="right", no_wrap=True)
    for criterion in result.criteria:
        _add_criterion(table, criterion)
    score = result.score
    table.add_row("", "", "")
    total = Text(f"{points(score.earned)} / {points(score.possible)}", "bold")
    table.add_row("", Text(f"{terminal_text(result.submission, 80)}: {result.lab}", "bold"), total)
    if result.bonus:
        table.add_row("", Text(BONUS, "bold"), "")
    for criterion in result.bonus:
        _add_criterion(table, criterion)
    if result.still_undecided:
        most = points(result.final + result.still_undecided)
        note = f"{points(result.final)} now, up to {most}: {points(result.still_undecided)} points are undecided."
        table.add_row("?", Text(note, "magenta"), "")
    if result.adjustments:
        _add_adjustments(table, result)
    console.print(table)
    levels = {s.get("isolation") for s in result.provenance.get("sessions", {}).values()}
    if "none" in levels:
        note = "The submission's code ran unconfined. `grade doctor` says what would fix that."
        console.print(Text(note, "bold red"))
    elif "reduced" in levels:
        note = "The submission's code was confined in part only; the report says what that does not cover."
        console.print(Text(note, "yellow"))
    for violation in result.violations:
        _print_violation(console, violation, result)
    for problem in result.problems:
        console.print(Text(f"Grader: {terminal_text(problem)}", "magenta"))
    if result.advisories:
        console.print(Text("Costs nothing, but worth knowing:", "dim"))
        for advisory in result.advisories:
            console.print(Padding(Text(f"• {terminal_text(advisory)}", "dim"), (0, 0, 0, 2)))


def _print_chosen(console: Console, result: Result) -> None:
    for chosen in result.chosen:
        words = terminal_text(chosen_words(chosen), 900)
        console.print(Text(f"{SEVERAL_FILES}: {words}", "yellow"))


def _add_adjustments(table: Table, result: Result) -> None:
    for adjustment in adjustments_of(result):
        body = Text(terminal_text(adjustment.title, 160))
        body.append(
            f"\n{terminal_text(adjustment.reason)} ({terminal_text(adjustment.decided, 160)})",
            "dim",
        )
        style = {"gain": "green", "loss": "red"}.get(adjustment.style, "")
        table.add_row("", body, Text(adjustment.points, style))
    total = Text(f"{points(result.final)} / {points(result.score.possible)}", "bold")
    table.add_row("", Text("With all adjustments", "bold"), total)


def _print_violation(console: Console, violation: Violation, result: Result) -> None:
    text = " ".join(
        part
        for part in (violation.text, note_of(violation), f"(session {violation.session})")
        if part
    )
    console.print(Text(f"For the instructor: {terminal_text(text)}", "red"))
    for evidence in violation.evidence:
        console.print(Text(f"  • {terminal_text(evidence, 300)}", "dim"))
    titles = [title for _, title in titles_of(violation, result)]
    if titles:
        console.print(Text(f"  Fails because of it: {terminal_text(', '.join(titles))}", "dim"))


def _add_criterion(table: Table, criterion: CriterionResult) -> None:
    style = "bold green" if criterion.earned == criterion.possible else "bold"
    earned = Text(f"{points(criterion.earned)} / {points(criterion.possible)}", style)
    table.add_row("", Text(criterion.title, style), earned)
    rows: dict[tuple[Outcome, str], list[CheckResult]] = {}
    for check in criterion.checks:
        if check.outcome is not Outcome.PASSED:
            # What one failure kept from being looked at is one row.
            key = check.reason if check.outcome is Outcome.NOT_REACHED else check.id
            rows.setdefault((check.outcome, key), []).append(check)
    for checks in rows.values():
        _add_checks(table, checks)


def _add_checks(table: Table, checks: Sequence[CheckResult]) -> None:
    first = checks[0]
    badge = badge_of(first.outcome)
    sign = Text(badge.sign, badge.colour)
    body = Text(", ".join(check.title for check in checks))
    body.append(f"  {', '.join(check.id for check in checks)}", "dim")
    if first.reason:
        body.append(f"\n{terminal_text(first.reason)}", "default")
    if first.hint:
        body.append(f"\n→ {terminal_text(first.hint)}", "cyan")
    locations = [str(w) for w in first.where if w.file]
    if locations:
        body.append(f"\n  {terminal_text(', '.join(locations[:3]))}", "dim")
    for command in first.commands:
        body.append(f"\n  see it yourself: {terminal_text(command, 400)}", "dim")
    if first.outcome in (Outcome.FAILED, Outcome.PARTIAL):
        body.append(f"\n  try again: {terminal_text(first.try_again)}", "dim")
    earned = (
        points(sum((check.earned for check in checks), Decimal(0)))
        if checks[1:]
        else earned_text(first)
    )
    possible = points(sum((check.possible for check in checks), Decimal(0)))
    table.add_row(sign, body, Text(f"{earned} / {possible}", sign.style))

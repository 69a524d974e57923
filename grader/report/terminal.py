"""A grading on the terminal: its progress, and then a table with the reason for each lost point."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
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

#: Shortest time that is shown, in s. A session below it was not run at all.
_NOTABLE_S = 0.05
_MOST_LOCATIONS = 3


# -- progress ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Progress:
    """The state of a session."""

    text: str = "in the queue"
    step: int = 0
    steps: int = 0
    ended: bool = False


class ProgressDisplay(Live):
    """Shows the progress of each session: in place on a terminal, or as one line when a session ends."""

    def __init__(self, console: Console, submission: str, sessions: Sequence[str]) -> None:
        self._console = console
        self._submission = terminal_text(submission, 80)
        self._states = dict.fromkeys(sessions, _Progress())
        self._started_s = time.monotonic()
        self._began_s: dict[str, float] = {}
        self._took_s: dict[str, float] = {}
        super().__init__(
            console=console,
            get_renderable=self._table,
            auto_refresh=console.is_terminal,
            transient=True,
        )

    def note(self, session: str, text: str, step: int, steps: int, ended: bool) -> None:
        """Take note of a session's current activity."""
        now_s = time.monotonic()
        self._began_s.setdefault(session, now_s)
        if ended:
            self._took_s[session] = now_s - self._began_s.pop(session)
            if not self._console.is_terminal:
                self._print_ended(session, text)
        self._states[session] = _Progress(text, step, steps, ended)

    def _print_ended(self, session: str, text: str) -> None:
        """Print a line about a session that ended."""
        line = f"  {session}: {terminal_text(text)}"
        took_s = self._took_s[session]
        if took_s >= _NOTABLE_S:
            line += f" ({took_s:.1f} s)"
        self._console.print(line, highlight=False, markup=False)

    def _table(self) -> Group:
        """Return the display."""
        table = Table.grid(padding=(0, 2))
        for name, state in self._states.items():
            self._add_state(table, name, state)
        running_s = time.monotonic() - self._started_s
        return Group(Text(f"Grading {self._submission} … {running_s:.0f} s"), table)

    def _add_state(self, table: Table, name: str, state: _Progress) -> None:
        """Add a session to the display."""
        if state.ended:
            took_s = self._took_s.get(name, 0.0)
            table.add_row("  [green]✓[/]", name, state.text, f"{took_s:.1f} s")
        elif name in self._began_s:
            line = terminal_text(state.text, 60)
            if state.steps:
                line += f" ({state.step} of {state.steps})"
            running_s = time.monotonic() - self._began_s[name]
            table.add_row(Spinner("dots"), name, Text(line), f"{running_s:.1f} s")
        else:
            table.add_row("  ·", name, "in the queue", "")


# -- result ------------------------------------------------------------------------------------


def print_result(console: Console, result: Result) -> None:
    """Print the points of each criterion, with reason and hint of each check that lost or withheld points."""
    _print_chosen(console, result)
    console.print(_result_table(result))
    _print_isolation(console, result)
    for violation in result.violations:
        _print_violation(console, violation, result)
    for problem in result.problems:
        console.print(Text(f"Grader: {terminal_text(problem)}", "magenta"))
    if result.advisories:
        console.print(Text("Costs nothing, but worth knowing:", "dim"))
    for advisory in result.advisories:
        text = Text(f"• {terminal_text(advisory)}", "dim")
        console.print(Padding(text, (0, 0, 0, 2)))


def _result_table(result: Result) -> Table:
    table = Table(box=None, padding=(0, 1), show_header=False, expand=False)
    table.add_column(width=1)
    table.add_column(overflow="fold")
    table.add_column(justify="right", no_wrap=True)
    for criterion in result.criteria:
        _add_criterion(table, criterion)
    table.add_row("", "", "")
    heading = Text(f"{terminal_text(result.submission, 80)}: {result.lab}", "bold")
    total = _out_of(result.score.earned, result.score.possible)
    table.add_row("", heading, Text(total, "bold"))
    if result.bonus:
        table.add_row("", Text(BONUS, "bold"), "")
    for criterion in result.bonus:
        _add_criterion(table, criterion)
    if result.still_undecided:
        _add_undecided(table, result)
    if result.adjustments:
        _add_adjustments(table, result)
    return table


def _out_of(earned: Decimal, possible: Decimal) -> str:
    """Write points: `83.5 / 100`."""
    return f"{points(earned)} / {points(possible)}"


def _add_undecided(table: Table, result: Result) -> None:
    now = points(result.final)
    most = points(result.final + result.still_undecided)
    undecided = points(result.still_undecided)
    note = f"{now} now, up to {most}: {undecided} points are undecided."
    table.add_row("?", Text(note, "magenta"), "")


def _print_chosen(console: Console, result: Result) -> None:
    for chosen in result.chosen:
        words = terminal_text(chosen_words(chosen), 900)
        console.print(Text(f"{SEVERAL_FILES}: {words}", "yellow"))


def _add_adjustments(table: Table, result: Result) -> None:
    styles = {"gain": "green", "loss": "red"}
    for adjustment in adjustments_of(result):
        body = Text(terminal_text(adjustment.title, 160))
        reason = terminal_text(adjustment.reason)
        decided = terminal_text(adjustment.decided, 160)
        body.append(f"\n{reason} ({decided})", "dim")
        style = styles.get(adjustment.style, "")
        table.add_row("", body, Text(adjustment.points, style))
    total = Text(_out_of(result.final, result.score.possible), "bold")
    table.add_row("", Text("With all adjustments", "bold"), total)


def _print_isolation(console: Console, result: Result) -> None:
    """Print a warning if the submission's code was not fully confined."""
    sessions = result.provenance.get("sessions", {})
    levels = {session.get("isolation") for session in sessions.values()}
    if "none" in levels:
        note = "The submission's code ran unconfined. `grade doctor` says what would fix that."
        console.print(Text(note, "bold red"))
    elif "reduced" in levels:
        note = "The submission's code was confined in part only; the report says what that does not cover."
        console.print(Text(note, "yellow"))


def _print_violation(console: Console, violation: Violation, result: Result) -> None:
    parts = [violation.text, note_of(violation), f"(session {violation.session})"]
    text = " ".join(filter(None, parts))
    console.print(Text(f"For the instructor: {terminal_text(text)}", "red"))
    for evidence in violation.evidence:
        console.print(Text(f"  • {terminal_text(evidence, 300)}", "dim"))
    titles = [title for _, title in titles_of(violation, result)]
    if titles:
        console.print(Text(f"  Fails because of it: {terminal_text(', '.join(titles))}", "dim"))


def _add_criterion(table: Table, criterion: CriterionResult) -> None:
    """Add a criterion, and below it its checks that did not pass."""
    full = criterion.earned == criterion.possible
    style = "bold green" if full else "bold"
    earned = _out_of(criterion.earned, criterion.possible)
    table.add_row("", Text(criterion.title, style), Text(earned, style))
    rows: dict[tuple[Outcome, str], list[CheckResult]] = {}
    for check in criterion.checks:
        if check.outcome is Outcome.PASSED:
            continue
        key = check.id
        if check.outcome is Outcome.NOT_REACHED:
            # All checks that one failure blocked are one row.
            key = check.reason
        rows.setdefault((check.outcome, key), []).append(check)
    for checks in rows.values():
        _add_checks(table, checks)


def _add_checks(table: Table, checks: Sequence[CheckResult]) -> None:
    """Add one row for checks with the same outcome and reason."""
    first = checks[0]
    badge = badge_of(first.outcome)
    body = Text(", ".join(check.title for check in checks))
    ids = ", ".join(check.id for check in checks)
    body.append(f"  {ids}", "dim")
    _append_details(body, first)
    sign = Text(badge.sign, badge.colour)
    amount = Text(_points_of(checks), badge.colour)
    table.add_row(sign, body, amount)


def _append_details(body: Text, check: CheckResult) -> None:
    """Append reason, hint, locations and commands of a check."""
    if check.reason:
        body.append(f"\n{terminal_text(check.reason)}", "default")
    if check.hint:
        body.append(f"\n→ {terminal_text(check.hint)}", "cyan")
    locations = [str(location) for location in check.where if location.file]
    if locations:
        shown = ", ".join(locations[:_MOST_LOCATIONS])
        body.append(f"\n  {terminal_text(shown)}", "dim")
    for command in check.commands:
        body.append(f"\n  see it yourself: {terminal_text(command, 400)}", "dim")
    if check.outcome in (Outcome.FAILED, Outcome.PARTIAL):
        body.append(f"\n  try again: {terminal_text(check.try_again)}", "dim")


def _points_of(checks: Sequence[CheckResult]) -> str:
    """Write the points of checks: `3.5 / 8`, or `? / 8` as `earned_text` does."""
    possible = points(sum((check.possible for check in checks), Decimal(0)))
    if len(checks) == 1:
        return f"{earned_text(checks[0])} / {possible}"
    earned = points(sum((check.earned for check in checks), Decimal(0)))
    return f"{earned} / {possible}"

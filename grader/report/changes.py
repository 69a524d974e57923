"""Changes by judging a class again, as tables: for the terminal, and as `changes.csv`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal

from rich.console import Console
from rich.table import Table
from rich.text import Text

from grader.cohort.changes import Change, Changes, by_check
from grader.report.escape import terminal_text
from grader.report.grades_csv import csv_text
from grader.report.views import points, signed
from grader.result import Outcome

_COLUMNS = (
    "submission,level,id,title,outcome before,outcome after,points before,points after,difference,"
    "undecided before,undecided after"
)

_Cells = Sequence[str | Decimal]


# -- CSV ---------------------------------------------------------------------------------------


def changes_csv(changes: Iterable[Changes]) -> str:
    """Return all changes, one row each: the total first, then its criteria, checks and adjustments."""
    rows: list[_Cells] = [_COLUMNS.split(",")]
    for submission in changes:
        rows.append(_total_row(submission))
        for part in submission.parts:
            rows.append(_part_row(submission.submission, part))
    return csv_text(rows)


def _total_row(changes: Changes) -> _Cells:
    before = _cell(changes.before)
    numbers = [before, changes.after, changes.difference, *changes.undecided]
    return [changes.submission, "total", "", "", "", "", *numbers]


def _part_row(submission: str, part: Change) -> _Cells:
    outcomes = map(_word, part.outcomes)
    numbers = [_cell(part.before), _cell(part.after), part.difference]
    return [submission, part.level, part.id, part.title, *outcomes, *numbers, "", ""]


def _cell(value: Decimal | None) -> str | Decimal:
    """Return points as a cell; empty if there are none."""
    return "" if value is None else value


def _word(outcome: Outcome | None) -> str:
    """Write an outcome: `not reached`; empty if there is none."""
    if outcome is None:
        return ""
    return outcome.value.replace("_", " ")


# -- terminal ----------------------------------------------------------------------------------


def print_changes(console: Console, changes: Mapping[str, Changes]) -> None:
    """Print the submissions with changed points, criteria and checks; those that change most come first."""
    found = {}
    reworded = 0
    for name, each in changes.items():
        if each.matters:
            found[name] = each
        elif each.words:
            reworded += 1
    words = f", {reworded} only in words" if reworded else ""
    all_judged = _counted(len(changes))
    if not found:
        console.print(f"No points change{words}; {all_judged} judged.")
        return
    console.print(changes_table(found))
    _print_summary(console, list(found.values()))
    _print_possible(console, found.values())
    kept = len(changes) - len(found)
    rest = "1 keeps its own" if kept == 1 else f"{kept} keep theirs"
    console.print(f"Points or outcomes change for {len(found)} of {all_judged}{words}; {rest}.")


def _counted(number: int) -> str:
    """Write a number of submissions: `1 submission`, `2 submissions`."""
    return f"{number} submission{'s' * (number != 1)}"


def changes_table(changes: Mapping[str, Changes]) -> Table:
    """Return the table of `print_changes`; each submission in it must have a change."""
    table = Table(box=None, padding=(0, 1), show_header=False, expand=False)
    table.add_column(overflow="fold")
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    table.add_column(justify="right", no_wrap=True)

    def rank(name: str) -> tuple[Decimal, str]:
        return -abs(changes[name].difference), name

    for name in sorted(changes, key=rank):
        _add_rows(table, name, changes[name])
    return table


def _add_rows(table: Table, name: str, changes: Changes) -> None:
    """Add the rows of one submission."""
    heading = Text(terminal_text(name, 80), "bold")
    total = Text(_step(changes.before, changes.after), "bold")
    table.add_row(heading, "", total, _signed(changes.difference))
    titles = Counter(part.title for part in changes.at("check"))
    for part in changes.parts:
        # Old and new have the same title after a change of the id; then the ids tell them apart.
        title = _title(part, by_id=titles[part.title] > 1)
        step = _step(part.before, part.after)
        table.add_row(title, _outcomes(part), step, _signed(part.difference))
    if len(set(changes.undecided)) > 1:
        undecided = Text("  undecided", "magenta")
        table.add_row(undecided, "", _step(*changes.undecided), "")


def _title(part: Change, *, by_id: bool) -> Text:
    """Return the indented title of a part, with the id of a check if wanted."""
    if part.level == "criterion":
        return Text(f"  {terminal_text(part.title, 80)}")
    if part.level == "adjustment":
        adjustment = terminal_text(f"{part.title}: {part.id}", 80)
        return Text(f"  {adjustment}", "dim")
    title = part.title
    if by_id:
        title += f" ({part.id})"
    return Text(f"    {terminal_text(title, 120)}", "dim")


def _outcomes(part: Change) -> Text:
    """Return the outcomes of a check: `failed → passed`, or one if both are the same."""
    if part.level != "check":
        return Text("")
    outcomes = [_word(outcome) or "not there" for outcome in part.outcomes]
    return Text(_arrow(outcomes), "dim")


def _arrow(texts: Iterable[str]) -> str:
    """Write the different texts with arrows between them."""
    return " → ".join(dict.fromkeys(texts))


def _step(before: Decimal | None, after: Decimal | None) -> str:
    """Write points before and after: `80 → 85.5`, `none → 80`, or `80` if they are the same."""
    texts = []
    for value in (before, after):
        texts.append("none" if value is None else points(value))
    return _arrow(texts)


def _signed(difference: Decimal) -> Text:
    """Return a difference in colour; empty if there is none."""
    if not difference:
        return Text("")
    return Text(signed(difference), "green" if difference > 0 else "red")


def _print_possible(console: Console, changes: Iterable[Changes]) -> None:
    """Print how many submissions have other possible points than before."""
    counts = Counter(each.possible for each in changes)
    for (before, after), number in counts.items():
        if before != after:
            out_of = f"{points(after)} points, before of {points(before)}"
            console.print(
                f"{_counted(number)}: of {out_of}; a difference can come from that alone."
            )


def _print_summary(console: Console, changes: Sequence[Changes]) -> None:
    """Print for each check how many submissions gain and lose by it, and the sum of their points."""
    checks = by_check(changes)
    if not checks or len(changes) < 2:
        return
    table = Table(
        "By check", "gain", "lose", "points", box=None, padding=(0, 1), header_style="bold"
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for check in checks:
        title = terminal_text(check.title, 80)
        table.add_row(title, str(check.gaining), str(check.losing), _signed(check.points))
    console.print("", table, "", sep="\n")

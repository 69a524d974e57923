"""What judging a class again changes, as tables: for the terminal, and as `changes.csv`."""

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
    "submission,level,id,title,outcome before,outcome after,points before,points after,difference"
)


def changes_csv(changes: Iterable[Changes]) -> str:
    """Return all that changes, a row each: the total first, then its criteria, checks and adjustments."""
    rows: list[Sequence[str | Decimal]] = [
        [*_COLUMNS.split(","), "undecided before", "undecided after"]
    ]
    for each in changes:
        before = "" if each.before is None else each.before
        rows.append(
            [
                each.submission,
                "total",
                "",
                "",
                "",
                "",
                before,
                each.after,
                each.difference,
                *each.undecided,
            ]
        )
        for part in each.parts:
            outcomes = map(_word, part.outcomes)
            numbers = ["" if p is None else p for p in (part.before, part.after)]
            names = [each.submission, part.level, part.id, part.title]
            rows.append([*names, *outcomes, *numbers, part.difference, "", ""])
    return csv_text(rows)


def _word(outcome: Outcome | None) -> str:
    return outcome.value.replace("_", " ") if outcome is not None else ""


def print_changes(console: Console, changes: Mapping[str, Changes]) -> None:
    """Print who changes, by how much, and in which criterion and check; those that change most come first."""
    found = {name: each for name, each in changes.items() if each.matters}
    reworded = sum(each.words and not each.matters for each in changes.values())
    words = f", {reworded} only in words" if reworded else ""
    if not found:
        console.print(f"No points change{words}; {_counted(len(changes))} judged.")
        return
    console.print(changes_table(found))
    _print_summary(console, list(found.values()))
    kept = len(changes) - len(found)
    for (before, after), number in Counter(each.possible for each in found.values()).items():
        if before != after:
            out_of = f"{points(after)} points, before of {points(before)}"
            console.print(
                f"{_counted(number)}: of {out_of}; a difference can come from that alone."
            )
    rest = "1 keeps its own" if kept == 1 else f"{kept} keep theirs"
    console.print(
        f"Points or outcomes change for {len(found)} of {_counted(len(changes))}{words}; {rest}."
    )


def _counted(number: int) -> str:
    return f"{number} submission{'s' * (number != 1)}"


def changes_table(changes: Mapping[str, Changes]) -> Table:
    """Return the table of `print_changes`, of those for whom something changes."""
    ordered = sorted(changes.items(), key=lambda item: (-abs(item[1].difference), item[0]))
    table = Table(box=None, padding=(0, 1), show_header=False, expand=False)
    table.add_column(overflow="fold")
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    for name, each in ordered:
        total = Text(_step(each.before, each.after), "bold")
        table.add_row(Text(terminal_text(name, 80), "bold"), "", total, _signed(each.difference))
        titles = Counter(part.title for part in each.at("check"))
        for part in each.parts:
            # Of a check that was renamed, only the ids tell old and new apart.
            what, outcomes = _described(part, by_id=titles[part.title] > 1)
            table.add_row(what, outcomes, _step(part.before, part.after), _signed(part.difference))
        if len(set(each.undecided)) > 1:
            table.add_row(Text("  undecided", "magenta"), "", _step(*each.undecided), "")
    return table


def _described(part: Change, *, by_id: bool) -> tuple[Text, Text]:
    """Return what changes, and the outcomes of a check."""
    if part.level == "criterion":
        return Text(f"  {terminal_text(part.title, 80)}"), Text("")
    if part.level == "adjustment":
        return Text(f"  {terminal_text(f'{part.title}: {part.id}', 80)}", "dim"), Text("")
    what = terminal_text(part.title + (f" ({part.id})" if by_id else ""), 120)
    outcomes = [_word(outcome) or "not there" for outcome in part.outcomes]
    return Text(f"    {what}", "dim"), Text(" → ".join(dict.fromkeys(outcomes)), "dim")


def _step(before: Decimal | None, after: Decimal | None) -> str:
    return " → ".join(
        dict.fromkeys(points(p) if p is not None else "none" for p in (before, after))
    )


def _signed(difference: Decimal) -> Text:
    return (
        Text(signed(difference), "green" if difference > 0 else "red") if difference else Text("")
    )


def _print_summary(console: Console, changes: Sequence[Changes]) -> None:
    """Print for each check how many gain and lose by it, and their points together."""
    found = by_check(changes)
    if not found or len(changes) < 2:
        return
    table = Table(
        "By check", "gain", "lose", "points", box=None, padding=(0, 1), header_style="bold"
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for title, gain, lose, together in found:
        table.add_row(terminal_text(title, 80), str(gain), str(lose), _signed(together))
    console.print("", table, "", sep="\n")

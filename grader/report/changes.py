"""What judging a class again changes, as tables: for the terminal, and as `changes.csv`."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal

from rich.console import Console
from rich.table import Table
from rich.text import Text

from grader.cohort.changes import Change, Changes
from grader.report.escape import terminal_text
from grader.report.grades_csv import BYTE_ORDER_MARK, csv_cell
from grader.report.views import points
from grader.result import Outcome

CHANGES_FILE = "changes.csv"

_COLUMNS = (
    "submission",
    "level",
    "id",
    "title",
    "outcome before",
    "outcome after",
    "points before",
    "points after",
    "difference",
    "undecided before",
    "undecided after",
)


def changes_csv(changes: Iterable[Changes]) -> str:
    """Return all that changes, a row each: the total first, then its criteria, checks and adjustments.

    It is written as `grades.csv` is, with a byte order mark.

    Parameters
    ----------
    changes : iterable of Changes
        Those in which points or outcomes differ.
    """
    file = io.StringIO(newline="")
    file.write(BYTE_ORDER_MARK)
    table = csv.writer(file, lineterminator="\r\n")
    table.writerow(_COLUMNS)
    for each in changes:
        table.writerows(_rows(each))
    return file.getvalue()


def _rows(changes: Changes) -> Iterable[Sequence[str | int | Decimal]]:
    name = csv_cell(changes.submission)
    undecided = [points(changes.undecided_before), points(changes.undecided_after)]
    yield [name, "total", "", "", "", "", *_numbers(changes.before, changes.after), *undecided]
    for part in changes.parts:
        outcomes = [_word(part.outcome_before), _word(part.outcome_after)]
        numbers = _numbers(part.before, part.after)
        yield [name, part.level, csv_cell(part.id), csv_cell(part.title), *outcomes, *numbers, "", ""]


def _numbers(before: Decimal | None, after: Decimal | None) -> list[str]:
    difference = (after or Decimal(0)) - (before or Decimal(0))
    return [points(p) if p is not None else "" for p in (before, after)] + [points(difference)]


def _word(outcome: Outcome | None) -> str:
    return outcome.value.replace("_", " ") if outcome is not None else ""


def print_changes(console: Console, changes: Mapping[str, Changes]) -> None:
    """Print who changes, by how much, and in which criterion and check; those that change most come first.

    Parameters
    ----------
    changes : mapping
        Name of the submission's folder -> what changes for it.
    """
    found = {name: each for name, each in changes.items() if each.matters}
    if not found:
        console.print(f"No points change{_words(changes)}; {_counted(len(changes), 'submission')} judged.")
        return
    console.print(changes_table(found))
    _print_summary(console, list(found.values()))
    kept = len(changes) - len(found)
    among = f"{len(found)} of {_counted(len(changes), 'submission')}"
    for (before, after), number in _totals(found.values()).items():
        out_of = f"{points(after)} points, before of {points(before)}"
        console.print(f"{_counted(number, 'submission')}: of {out_of}; a difference can come from that alone.")
    rest = "1 keeps its own" if kept == 1 else f"{kept} keep theirs"
    console.print(f"Points or outcomes change for {among}{_words(changes)}; {rest}.")


def _totals(changes: Iterable[Changes]) -> Counter[tuple[Decimal, Decimal]]:
    """Count for how many the points that can be had change, by what they were and are."""
    pairs = ((each.possible_before, each.possible_after) for each in changes)
    return Counter(pair for pair in pairs if pair[0] != pair[1])


def changes_table(changes: Mapping[str, Changes]) -> Table:
    """Return the table of `print_changes`, of those for whom something changes."""
    ordered = sorted(changes.items(), key=lambda item: (-abs(item[1].difference), item[0]))
    table = Table(box=None, padding=(0, 1), show_header=False, expand=False)
    table.add_column(overflow="fold")
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    for name, each in ordered:
        _add_submission(table, name, each)
    return table


def _add_submission(table: Table, name: str, changes: Changes) -> None:
    total = Text(_step(changes.before, changes.after), "bold")
    table.add_row(Text(terminal_text(name, 80), "bold"), "", total, _signed(changes.difference))
    titles = Counter(part.title for part in changes.at("check"))
    for part in changes.parts:
        what, outcomes = Text(f"  {terminal_text(part.title, 80)}"), Text("")
        if part.level == "adjustment":
            what = Text(f"  {terminal_text(f'{part.title}: {part.id}', 80)}", "dim")
        elif part.level == "check":
            # Of a check that was renamed, only the ids tell old and new apart.
            by_id = f" ({part.id})" if titles[part.title] > 1 else ""
            what = Text(f"    {terminal_text(part.title + by_id, 120)}", "dim")
            before, after = (_word(o) or "not there" for o in (part.outcome_before, part.outcome_after))
            outcomes = Text(before if before == after else f"{before} → {after}", "dim")
        table.add_row(what, outcomes, _step(part.before, part.after), _signed(part.difference))
    if changes.undecided_before != changes.undecided_after:
        step = _step(changes.undecided_before, changes.undecided_after)
        table.add_row(Text("  undecided", "magenta"), "", step, "")


def _step(before: Decimal | None, after: Decimal | None) -> str:
    was, is_ = (points(p) if p is not None else "none" for p in (before, after))
    return f"{was} → {is_}" if was != is_ else was


def _signed(difference: Decimal) -> Text:
    if not difference:
        return Text("")
    return Text(f"{'+' if difference > 0 else '−'}{points(abs(difference))}", "green" if difference > 0 else "red")


def _print_summary(console: Console, changes: Sequence[Changes]) -> None:
    """Print for each check how many gain and lose by it, and their points together."""
    met: dict[str, list[Change]] = {}
    for check in (check for each in changes for check in each.at("check")):
        met.setdefault(check.id, []).append(check)
    if not met or len(changes) < 2:
        return
    table = Table("By check", "gain", "lose", "points", box=None, padding=(0, 1), header_style="bold")
    for column in table.columns[1:]:
        column.justify = "right"
    sums = {name: sum((c.difference for c in found), Decimal(0)) for name, found in met.items()}
    for name, found in sorted(met.items(), key=lambda item: -abs(sums[item[0]])):
        gain, lose = sum(c.difference > 0 for c in found), sum(c.difference < 0 for c in found)
        table.add_row(terminal_text(found[0].title, 80), str(gain), str(lose), _signed(sums[name]))
    console.print()
    console.print(table)
    console.print()


def _words(changes: Mapping[str, Changes]) -> str:
    """Say how many change in words alone."""
    number = sum(each.words and not each.matters for each in changes.values())
    return f", {number} only in words" if number else ""


def _counted(number: int, one: str) -> str:
    return f"{number} {one}{'s' * (number != 1)}"

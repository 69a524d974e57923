"""The next steps of a teacher after a class was graded, from its summary."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import filterfalse
from pathlib import Path

from grader.cohort.entries import NOTHING_SUBMITTED
from grader.cohort.statistics import ClassSummary, Need

#: Names that a step lists.
_MOST_NAMED = 3
#: Words for the submissions with open questions, by their need, in the order of the steps.
_OPEN = {
    Need.VIOLATION: "interfered with the grader",
    Need.UNDECIDED: "undecided",
    Need.UNMEASURED: "with unmeasured numbers",
    Need.LATENESS: "possibly late",
}


@dataclass(frozen=True)
class Step:
    """A step: its reason, e.g. `2 undecided: ann, bob`, and a command or an instruction."""

    reason: str
    command: str

    def __str__(self) -> str:
        """Write the step in one line."""
        return f"{self.reason} → {self.command}"


def next_steps(summary: ClassSummary, results: Path, forms: Collection[str]) -> list[Step]:
    """Return the steps for exactly this class; `forms` are the names of the exports for a class."""
    return [
        *_questions(summary, results),
        *_ungraded(summary),
        *_missing_from_list(summary),
        *_returns(summary, results, forms),
    ]


def _questions(summary: ClassSummary, results: Path) -> Iterator[Step]:
    reasons = []
    for need, words in _OPEN.items():
        names = _named(summary, need)
        if names:
            reasons.append(_counted(names, words))
    if reasons:
        yield Step("; ".join(reasons), f"grade review {results}")


def _ungraded(summary: ClassSummary) -> Iterator[Step]:
    absent = set()
    for row in summary.rows:
        if row.entry.problem == NOTHING_SUBMITTED:
            absent.add(row.entry.name)
    names = list(filterfalse(absent.__contains__, _named(summary, Need.NOT_GRADED)))
    if names:
        yield Step(
            _counted(names, "not graded"), "remove the reason above, and run the same command again"
        )


def _missing_from_list(summary: ClassSummary) -> Iterator[Step]:
    """Yield a step for the graded submissions without a student's id, if others have one."""
    names = []
    listed = False
    for row in summary.rows:
        if row.entry.student_id is not None:
            listed = True
        elif row.result is not None:
            names.append(row.entry.name)
    if not listed:
        return
    if names:
        yield Step(
            _counted(names, "not on the class list"),
            "add these names to it, and run the same command again",
        )


def _returns(summary: ClassSummary, results: Path, forms: Collection[str]) -> Iterator[Step]:
    """Yield the steps that return points and reports, by the systems of the class's download."""
    export = f"grade export {results} --to"
    systems = set()
    takes_reports = False
    graded = 0
    reached = 0
    for row in summary.rows:
        if row.result is not None:
            graded += 1
            systems.add(row.entry.identity.system)
            takes_reports |= bool(row.entry.identity.handback)
            reached += any(person.email for person in row.entry.people)
    if not systems:
        return
    yield Step("the class, its mistakes and points", f"grade open {results}")
    for system in sorted(systems):
        if system.lower() in forms:
            yield Step(f"points into {system}", f"{export} {system.lower()}")
    if takes_reports:
        yield Step("reports into the same system", f"{export} feedback")
    elif reached:
        whom = "each student"
        if reached < graded:
            whom = f"the {reached} of {graded} with an address"
        yield Step(f"a mail to {whom}", f"{export} mail")


def _named(summary: ClassSummary, need: Need) -> list[str]:
    """Return the names of the submissions with a need, once each."""
    names: dict[str, None] = {}
    for todo in summary.todos:
        if todo.need is need:
            names[summary.rows[todo.row].entry.name] = None
    return list(names)


def _counted(names: Sequence[str], words: str) -> str:
    """Count and name submissions, e.g. `2 undecided: ann, bob`."""
    listed = ", ".join(names[:_MOST_NAMED])
    if len(names) > _MOST_NAMED:
        listed += f" and {len(names) - _MOST_NAMED} more"
    return f"{len(names)} {words}: {listed}"

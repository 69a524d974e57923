"""Check that a person grades: its points stay open until then."""

from __future__ import annotations

from pydantic import Field

from grader.checks.base import Context, inconclusive
from grader.lab import references as ref
from grader.lab.references import Level, Parameters
from grader.result import Finding, Location


class Person(Parameters):
    """A person grades it, at the desk of `grade review` or in overrides.yaml, by the levels that are given."""

    of_session = False

    levels: tuple[Level, ...] = Field((), description="What can be chosen at the desk, best first.")
    read: tuple[ref.Artifact, ...] = Field(
        (), description="Files that are shown to whoever grades it."
    )


def person(context: Context, p: Person) -> Finding:
    """Leave the points open, and list the files to read."""
    expected = "; ".join(f"{level.title} ({level.credit:.0%})" for level in p.levels)
    where = []
    for name in p.read:
        path = context.path_of(name)
        if path is not None:
            where.append(Location(file=path))
    return inconclusive(
        expected, "", "Your instructor grades this by hand.", where=where, retry=False
    )

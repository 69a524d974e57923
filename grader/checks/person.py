"""What the rubric leaves to a person: nothing is judged, and its points stay open until somebody has graded it."""

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
    """Leave it to a person, with the files that are to be read."""
    expected = "; ".join(f"{level.title} ({level.credit:.0%})" for level in p.levels)
    paths = [path for name in p.read if (path := context.path_of(name)) is not None]
    finding = inconclusive(expected, "", "Your instructor grades this by hand.", retry=False)
    return Finding(**{**vars(finding), "where": tuple(Location(file=path) for path in paths)})

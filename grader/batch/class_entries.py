"""What the class page is made of: the results in a folder, and what the last run knows beyond them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from grader.batch.job import Row
from grader.cohort.entries import ClassEntry, entries_in
from grader.cohort.roster import NOTHING_HANDED_IN
from grader.errors import GraderError


def entries_of(results: Path, rows: Sequence[Row], missing: Sequence[str]) -> list[ClassEntry]:
    """Return an entry for each submission of the run, for each other result in the folder, and for who is missing.

    Parameters
    ----------
    missing : sequence of str
        Who has not handed in.
    """
    entries = {entry.name: entry for entry in entries_in(results)}
    for name in missing:
        entries.setdefault(name, ClassEntry(name, None, NOTHING_HANDED_IN))
    for row in rows:
        handed = row.handed
        entry = entries.get(handed.name)
        if isinstance(row.ending, GraderError) or entry is None:
            problem = row.ending.problem if isinstance(row.ending, GraderError) else "Its results are not there."
            entry = ClassEntry(handed.name, None, problem)
        entries[handed.name] = replace(
            entry,
            # What only the archive tells stands in the record.
            submitted_at=handed.submitted_at or entry.submitted_at,
            student_id=handed.student_id or entry.student_id,
        )
    return sorted(entries.values(), key=lambda entry: entry.name)

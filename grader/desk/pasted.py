"""Questions of students, pasted at the desk as they came by mail."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from grader.desk.decisions import Decision
from grader.errors import UsageError
from grader.report.views import QUESTION, appeal_head
from grader.result import Result

#: Marks of quoted lines in a mail.
_QUOTED = re.compile(r"^(?:> ?)+", re.MULTILINE)


def pasted_appeal(text: str, results: Mapping[str, Result]) -> Decision:
    """Return the appeal in a text that starts like `Appeal: Lab 1, alice, check publisher.rate`; the question ends it.

    Parameters
    ----------
    results
        Results of the class by the names of their folders.

    Raises
    ------
    UsageError
        If the text names no check of a submission in the class, or asks nothing.
    """
    unquoted = _QUOTED.sub("", text)
    words = " ".join(unquoted.split())
    for name, check, head in _heads(results):
        _, found, rest = words.partition(f"{head} ")
        if found:
            _, _, asked = rest.partition(QUESTION)
            return _appeal(name, check, asked.strip())
    raise UsageError(
        "this text names no check of a submission in this class",
        remedy="Paste it whole, from `Appeal:` to its end.",
    )


def _heads(results: Mapping[str, Result]) -> Iterator[tuple[str, str, str]]:
    """Yield the folder, the check's id, and the first words of each possible question."""
    for name, result in results.items():
        for check in result.checks:
            head = " ".join(appeal_head(result, check).split())
            yield name, check.id, head


def _appeal(name: str, check: str, asked: str) -> Decision:
    """Return a question about a check as an appeal; raises UsageError if it asks nothing."""
    if not asked:
        raise UsageError(
            f"{name} asks nothing about {check}",
            remedy=f"The question stands after `{QUESTION}`; add it there.",
        )
    return Decision(names=(name,), level="check", id=check, change="appeal", comment=asked)

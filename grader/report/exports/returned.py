"""What a class gets back in another system's form: to whom which result belongs, and who is left out, and why."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from grader.cohort.entries import ClassEntry
from grader.recording.submission import Person
from grader.report.escape import line
from grader.report.exports.graded import graded
from grader.report.views import BONUS, Loss, adjustments_of, bonus_lines, losses_of, points
from grader.result import Result
from grader.result_folder import REPORT_FILE

#: Checks that are named in a comment, and in a mail.
_MOST_NAMED = 3
_MOST_LOSSES = 8
#: What some systems read as markup in a comment, and others show as it is.
_MARKUP = str.maketrans({"<": "‹", ">": "›", "&": "+"})


@dataclass(frozen=True)
class Share:
    """A person, and the result of what they handed in, alone or with others."""

    person: Person
    entry: ClassEntry
    result: Result

    @property
    def is_above(self) -> bool:
        """Whether there are more points than the lab has."""
        return self.result.final > self.result.score.possible


@dataclass(frozen=True)
class ReturnedClass:
    """A class, or one submission, whose results go back."""

    entries: Sequence[ClassEntry]
    #: In which the folders of the submissions' results lie.
    folder: Path
    #: How the grade book calls the column; empty for a new one, called after the lab.
    column: str = ""
    #: From whom mails come; empty to let the mail program say that.
    sender: str = ""

    @property
    def shares(self) -> Iterator[Share]:
        """Each person who has a result."""
        for entry in self.entries:
            if entry.result is not None:
                yield from (Share(person, entry, entry.result) for person in entry.people)

    def report(self, entry: ClassEntry) -> bytes | None:
        """Return the page of a submission's report, or None if there is none."""
        path = self.folder / entry.name / REPORT_FILE
        return path.read_bytes() if entry.report and path.is_file() else None


@dataclass
class Returned:
    """A file in another system's form."""

    content: bytes = b""
    #: How many students, or submissions, are in it.
    count: int = 0
    #: Why somebody is not in it -> their submissions.
    left_out: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    #: Notes for the person that imports the file; names of submissions stand behind a note, if it is about some.
    notes: dict[str, list[str]] = field(default_factory=dict)
    #: Further files of the same form, for students that this one cannot name.
    further: list[Returned] = field(default_factory=list)


def comment(result: Result) -> str:
    """Return one line that says to a student what was earned, and by what mistakes most was lost."""
    total = f"{points(result.final)} of {points(result.score.possible)} points."
    if result.adjustments:
        total += f" With adjustments: {', '.join(f'{view.title} {view.points}' for view in adjustments_of(result))}."
    if result.still_undecided:
        total += f" {points(result.still_undecided)} more are undecided; your instructor decides."
    if result.bonus:
        total += f" {BONUS}: {'; '.join(bonus_lines(result))}."
    if losses := losses_of(graded(result))[:_MOST_NAMED]:
        total += (
            f" Fix first: {'; '.join(f'{loss.check.title} ({_gain(loss)})' for loss in losses)}."
        )
    return line(total, 480).translate(_MARKUP)


def plain_report(result: Result) -> str:
    """Return a short report as plain text: the points of each part, and what to fix first."""
    view = graded(result)
    lines = [line(result.lab), comment(result), "", "The points of each part, as judged:"]
    for part in view.criteria:
        undecided = f" ({points(part.undecided)} undecided)" if part.undecided else ""
        lines.append(
            f"  {points(part.earned):>6} of {points(part.possible):<6} {line(part.title)}{undecided}"
        )
    for loss in losses_of(view)[:_MOST_LOSSES]:
        lines += ["", f"{line(loss.check.title)} ({_gain(loss)}): {line(loss.check.reason, 600)}"]
        lines += [line(loss.check.hint, 600)] if loss.check.hint else []
    return "\n".join([*lines, ""])


def _gain(loss: Loss) -> str:
    """Return the points that can be won, with those of what could not be tested because of it."""
    return f"{points(loss.check.lost + loss.opens)} points"

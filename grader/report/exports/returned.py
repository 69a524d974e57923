"""The results of a class in another system's form: each result with its people, and the reasons for missing ones."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from grader.cohort.entries import ClassEntry
from grader.languages.language import ENGLISH, ENGLISH_ONLY, Language, Languages
from grader.recording.submission import Person
from grader.report.escape import line
from grader.report.exports.graded import graded
from grader.report.views import BONUS, Loss, adjustments_of, bonus_lines, losses_of, points
from grader.result import Result
from grader.result_folder import REPORT_FILE

#: Most checks that are named in a comment.
_MOST_NAMED = 3
#: Most checks that are named in a mail.
_MOST_LOSSES = 8
#: Characters that some systems read as markup in a comment, and others show unchanged.
_MARKUP = str.maketrans({"<": "‹", ">": "›", "&": "+"})


@dataclass(frozen=True)
class Share:
    """A person, and the result of the person's submission, alone or with others."""

    person: Person
    entry: ClassEntry
    result: Result
    language: Language = ENGLISH

    @property
    def is_above(self) -> bool:
        """True if there are more points than the lab has."""
        return self.result.final > self.result.score.possible


@dataclass(frozen=True)
class ReturnedClass:
    """A class, or one submission, and where its results are returned to."""

    entries: Sequence[ClassEntry]
    #: Folder with a folder of results for each submission.
    folder: Path
    #: Heading of the column in the grade book; empty for a new one, named after the lab.
    column: str = ""
    #: Sender of mails; empty to leave the sender to the mail program.
    sender: str = ""
    #: Languages of texts for students.
    languages: Languages = ENGLISH_ONLY

    @property
    def shares(self) -> Iterator[Share]:
        """Each person with a result."""
        for entry in self.entries:
            if entry.result is None:
                continue
            for person in entry.people:
                yield Share(person, entry, entry.result, self.languages.of(person.language))

    def report(self, entry: ClassEntry) -> bytes | None:
        """Return the page of a submission's report, or None if there is none."""
        path = self.folder / entry.name / REPORT_FILE
        if entry.report and path.is_file():
            return path.read_bytes()
        return None


@dataclass
class Returned:
    """A file in another system's form."""

    content: bytes = b""
    #: Number of students, or submissions, in the file.
    count: int = 0
    #: Reasons for missing people, each with their submissions.
    left_out: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    #: Notes for the person that imports the file, each with the names of its submissions, if any.
    notes: dict[str, list[str]] = field(default_factory=dict)
    #: Further files of the same form, for students that this one cannot name.
    further: list[Returned] = field(default_factory=list)


def comment(result: Result, language: Language = ENGLISH) -> str:
    """Return one line for the student: the earned points, and the mistakes that cost most."""
    texts = [f"{points(result.final)} of {points(result.score.possible)} points."]
    if result.adjustments:
        changes = [f"{view.title} {view.points}" for view in adjustments_of(result)]
        texts.append(f"With adjustments: {', '.join(changes)}.")
    if result.still_undecided:
        undecided = points(result.still_undecided)
        texts.append(f"{undecided} more are undecided; your instructor decides.")
    if result.bonus:
        texts.append(f"{BONUS}: {'; '.join(bonus_lines(result))}.")
    losses = losses_of(graded(result))[:_MOST_NAMED]
    if losses:
        mistakes = [f"{loss.check.title} ({_gain(loss)})" for loss in losses]
        texts.append(f"Fix first: {'; '.join(mistakes)}.")
    text = " ".join(map(language.text, texts))
    return line(text, 480).translate(_MARKUP)


def plain_report(result: Result, language: Language = ENGLISH) -> str:
    """Return a short report as plain text: the points of each part, and the mistakes to fix first."""
    view = graded(result)
    text = language.text
    lines = [text(line(result.lab)), comment(result, language), ""]
    lines.append(text("The points of each part, as judged:"))
    for part in view.criteria:
        share = text(f"{points(part.earned):>6} of {points(part.possible):<6}")
        undecided = ""
        if part.undecided:
            undecided = text(f" ({points(part.undecided)} undecided)")
        lines.append(f"  {share} {text(line(part.title))}{undecided}")
    for loss in losses_of(view)[:_MOST_LOSSES]:
        check = loss.check
        reason = line(check.reason, 600)
        title = text(f"{line(check.title)} ({_gain(loss)})")
        lines += ["", f"{title}: {text(reason)}"]
        if check.hint:
            lines.append(text(line(check.hint, 600)))
    return "\n".join([*lines, ""])


def _gain(loss: Loss) -> str:
    """Write the points that a fix can win, with those of the checks that it makes possible."""
    return f"{points(loss.check.lost + loss.opens)} points"

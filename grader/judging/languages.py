"""The languages in which a report, a class page or a mail is shown: the student's, else the lab's."""

from __future__ import annotations

from collections.abc import Iterable

from grader.lab.lab_languages import lab_catalogues
from grader.lab.rubric import Rubric
from grader.languages.catalogue import NAMES
from grader.languages.language import Language, language_of
from grader.recording.submission import Person
from grader.report.page_languages import ShownIn


def language_of_people(people: Iterable[Person], rubric: Rubric) -> str:
    """Return the tag of the language that all people of a submission have; of the lab's if they differ or have none."""
    tags = {person.language for person in people}
    tag = tags.pop() if len(tags) == 1 else ""
    return tag or rubric.lab.language


def shown_in(rubric: Rubric, first: str) -> ShownIn:
    """Return the languages of a page, which is shown in one of them at first."""
    languages = [in_lab(rubric, tag) for tag in NAMES if tag != "en"]
    return ShownIn(tuple(languages), first)


def in_lab(rubric: Rubric, tag: str) -> Language:
    """Return a language with the messages of a lab and of the grader."""
    return language_of(tag, lab_catalogues(rubric, tag))

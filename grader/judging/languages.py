"""The languages of reports, class pages and mails: the student's, else the lab's."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from grader.cohort.entries import ClassEntry
from grader.errors import GraderError
from grader.judging.rubrics import rubric_of_class
from grader.lab.lab_languages import lab_catalogues
from grader.lab.rubric import Rubric
from grader.languages.catalogue import NAMES
from grader.languages.language import ENGLISH_ONLY, Language, Languages, language_of
from grader.recording.submission import Person


def language_of_people(people: Iterable[Person], rubric: Rubric) -> str:
    """Return the tag of the language that all people of a submission have; of the lab's if they differ or have none."""
    tags = set()
    for person in people:
        tags.add(person.language)
    if len(tags) != 1 or "" in tags:
        return rubric.lab.language
    return tags.pop()


def languages_of(rubric: Rubric, first: str) -> Languages:
    """Return the languages of a page, with the tag of the first one shown."""
    others = []
    for tag in NAMES:
        if tag != "en":
            others.append(in_lab(rubric, tag))
    return Languages(tuple(others), first)


def in_lab(rubric: Rubric, tag: str) -> Language:
    """Return a language with the messages of a lab and of the grader."""
    return language_of(tag, lab_catalogues(rubric, tag))


def languages_of_class(results: Path, entries: Sequence[ClassEntry]) -> Languages:
    """Return the languages of a class by the rubric kept with its results; English alone if none can be loaded."""
    try:
        rubric = rubric_of_class(results, entries, None)
    except GraderError:
        return ENGLISH_ONLY
    return languages_of(rubric, rubric.lab.language)

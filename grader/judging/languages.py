"""The languages of reports, class pages and mails: the student's, else the lab's."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from grader.errors import GraderError
from grader.judging.rubrics import rubric_of_class
from grader.lab.lab_languages import lab_catalogues
from grader.lab.rubric import Rubric
from grader.languages.catalogue import NAMES, engine_catalogues, read_catalogues
from grader.languages.language import ENGLISH_ONLY, Language, Languages
from grader.recording.submission import Person
from grader.user_cache import computed, state_of_code

if TYPE_CHECKING:
    from grader.cohort.entries import ClassEntry

#: A tag, a catalogue of its language, and the time of the last change and the size of that file.
_State: TypeAlias = tuple[str, Path, int, int]


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
    states: list[_State] = []
    for tag in NAMES:
        if tag != "en":
            states += _states_of(tag, rubric)
    others = _languages(tuple(states))
    return Languages(others, first)


def in_lab(rubric: Rubric, tag: str) -> Language:
    """Return a language with the messages of a lab and of the grader."""
    languages = languages_of(rubric, tag)
    return languages.of(tag)


def _states_of(tag: str, rubric: Rubric) -> Iterator[_State]:
    """Yield the states of the catalogues of a language; the lab's count before the grader's own."""
    catalogues = lab_catalogues(rubric, tag)
    catalogues += engine_catalogues(tag)
    for path in catalogues:
        state = path.stat()
        yield tag, path, state.st_mtime_ns, state.st_size


@functools.lru_cache(maxsize=8)
def _languages(states: tuple[_State, ...]) -> tuple[Language, ...]:
    """Return the languages of catalogues, from the user's cache; reading the catalogues takes 0.15 s."""
    key = (states, state_of_code())
    return computed("languages", key, partial(_read, states))


def _read(states: Iterable[_State]) -> tuple[Language, ...]:
    """Return the languages of catalogues, read from these."""
    paths: dict[str, list[Path]] = {}
    for tag, path, *_ in states:
        paths.setdefault(tag, []).append(path)
    languages = []
    for tag, catalogues in paths.items():
        messages = read_catalogues(catalogues)
        languages.append(Language(tag, messages))
    return tuple(languages)


def languages_of_class(results: Path, entries: Sequence[ClassEntry]) -> Languages:
    """Return the languages of a class by the rubric kept with its results; English alone if none can be loaded."""
    try:
        rubric = rubric_of_class(results, entries, None)
    except GraderError:
        return ENGLISH_ONLY
    return languages_of(rubric, rubric.lab.language)

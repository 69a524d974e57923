"""Points and limits of a rubric, edited beside a class, with the resulting changes. The rubric's comments stay."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import yaml

from grader.classroom.regrade import Regrade, recorded_in, regrade_all
from grader.errors import TEMPORARY, RubricError
from grader.files import replace_file
from grader.judging.rubrics import read_rubric, rubric_copy
from grader.lab.overrides import Overrides
from grader.lab.rubric import Rubric
from grader.report.views import points
from grader.result_folder import EDITED_RUBRIC

_NUMBER = re.compile(r"-?\d+(\.\d+)?\s?%?")


@dataclass(frozen=True)
class Limit:
    """A number of a rubric that can be edited."""

    #: Place of the number, such as "0/2/points": criterion, check, key.
    id: str
    criterion: str
    check: str
    title: str
    key: str
    value: str


def limits_of(rubric: Rubric) -> list[Limit]:
    """Return the points and parameters of all checks except bonus ones."""
    titles = {check.id: check.title for check in rubric.checks()}
    found = []
    for place, criterion, check, key, node in _numbers(rubric.text):
        title = titles.get(check, check)
        found.append(Limit(place, criterion, check, title, key, str(node.value)))
    return found


def edited(text: str, values: Mapping[str, str]) -> str:
    """Return a rubric's text with new values at some places, and matching sums.

    Raises RubricError if a value is not a number, or a place is unknown.
    """
    nodes = {place: node for place, _, _, _, node in _numbers(text)}
    for place, value in values.items():
        if not _fits(place, value.strip()):
            problem = f"{value[:40]!r} is not a number"
            raise RubricError(problem, [], remedy="Write a number, such as 5, 0.2 or 20 %.")
    changes = []
    for place, value in values.items():
        if place not in nodes:
            raise RubricError("the rubric has no such number", [], remedy="Open the page again.")
        changes.append((nodes[place], value.strip()))
    return _with_sums(_replaced(text, changes))


def would_change(results: Path, text: str, overrides: Overrides) -> Regrade:
    """Judge a class by a rubric's text; writes nothing. Raises RubricError with all its mistakes."""
    measure = _rubric_of(results, text), overrides
    return regrade_all(results, dict.fromkeys(recorded_in(results), measure), pages=False)


def save(results: Path, text: str) -> Path:
    """Write an edited rubric beside the submissions' folders, and return its path; raises RubricError with its mistakes."""
    _rubric_of(results, text)
    replace_file(results / EDITED_RUBRIC, text)
    return results / EDITED_RUBRIC


def _rubric_of(results: Path, text: str) -> Rubric:
    with tempfile.TemporaryDirectory(prefix=TEMPORARY) as folder:
        file = Path(folder, EDITED_RUBRIC)
        file.write_text(text, encoding="utf-8")
        return read_rubric(file, rubric_copy(recorded_in(results)[0]))


def _fits(place: str, value: str) -> bool:
    """Return whether a value is a number; points have no percent sign."""
    if place.endswith("/points") and value.endswith("%"):
        return False
    return _NUMBER.fullmatch(value) is not None


def _numbers(text: str) -> Iterator[tuple[str, str, str, str, yaml.ScalarNode]]:
    """Yield place, criterion, check, key and node of each number of a check; a shared number at its first place."""
    seen = set()
    criteria = _get(yaml.compose(text, Loader=yaml.SafeLoader), "criteria")
    for c, criterion in enumerate(criteria.value):
        criterion_id = _get(criterion, "id").value
        for k, check in enumerate(_items(criterion, "checks")):
            check_id = _get(check, "id").value
            for key, node in _numbers_of(check):
                if id(node) not in seen:
                    seen.add(id(node))
                    yield f"{c}/{k}/{key}", criterion_id, check_id, key, node


def _numbers_of(check: Any) -> Iterator[tuple[str, yaml.ScalarNode]]:
    """Yield the points of a check, and the numbers among its parameters, by their keys."""
    pairs = [("points", _get(check, "points"))]
    given = _get(check, "with")
    if isinstance(given, yaml.MappingNode):
        pairs += [(key.value, node) for key, node in given.value]
    for key, node in pairs:
        if isinstance(node, yaml.ScalarNode) and _NUMBER.fullmatch(node.value):
            yield key, node


def _with_sums(text: str) -> str:
    """Return a rubric's text with the sums of its checks as points of the criteria and of the lab."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    changes: list[tuple[Any, str]] = []
    total = Decimal(0)
    for criterion in _get(root, "criteria").value:
        node = _get(criterion, "points")
        own = Decimal(node.value)
        checks = _items(criterion, "checks")
        whole = sum((Decimal(_get(check, "points").value) for check in checks), Decimal(0))
        if checks and whole != own:
            changes.append((node, points(whole)))
        total += whole if checks else own
    lab = _get(_get(root, "lab"), "points")
    if Decimal(lab.value) != total:
        changes.append((lab, points(total)))
    return _replaced(text, changes)


def _replaced(text: str, changes: list[tuple[Any, str]]) -> str:
    """Return a text with new values for some nodes, the last node first."""
    for node, value in sorted(changes, key=lambda change: -change[0].start_mark.index):
        # The value comes after an anchor and a quotation mark.
        start = text.rindex(node.value, node.start_mark.index, node.end_mark.index)
        rest = text[start + len(node.value) :]
        text = f"{text[:start]}{value}{rest}"
    return text


def _get(node: Any, key: str) -> Any:
    """Return the node of a key in a mapping; None if the key is missing."""
    for name, value in node.value:
        if name.value == key:
            return value
    return None


def _items(node: Any, key: str) -> list[Any]:
    found = _get(node, key)
    if found is not None:
        return list(found.value)
    return []

"""A rubric's points and limits, moved beside a class: who would change, and by how much. Its comments stay."""

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
    """A number of a rubric that may be moved: its place as keys and list places, and how it is written."""

    id: str
    criterion: str
    check: str
    title: str
    key: str
    value: str


def limits_of(rubric: Rubric) -> list[Limit]:
    """Return the points of all checks but those of the bonus, and the numbers that they are given."""
    titles = {check.id: check.title for check in rubric.checks()}
    found = []
    for place, criterion, check, key, node in _numbers(rubric.text):
        found.append(Limit(place, criterion, check, titles.get(check, check), key, str(node.value)))
    return found


def edited(text: str, values: Mapping[str, str]) -> str:
    """Return a rubric's text with other values at some places, and sums that fit; raises RubricError for no number."""
    wrong = [value for place, value in values.items() if not _fits(place, value.strip())]
    if wrong:
        raise RubricError(
            f"{wrong[0][:40]!r} is not a number",
            [],
            remedy="Write a number, such as 5, 0.2 or 20 %.",
        )
    nodes = {place: node for place, _, _, _, node in _numbers(text)}
    unknown = [place for place in values if place not in nodes]
    if unknown:
        raise RubricError("the rubric has no such number", [], remedy="Open the page again.")
    return _with_sums(
        _replaced(text, [(nodes[place], value.strip()) for place, value in values.items()])
    )


def would_change(results: Path, text: str, overrides: Overrides) -> Regrade:
    """Judge a class by a rubric's text; writes nothing. Raises RubricError with all its mistakes."""
    measure = _rubric_of(results, text), overrides
    return regrade_all(results, dict.fromkeys(recorded_in(results), measure), pages=False)


def save(results: Path, text: str) -> Path:
    """Write an edited rubric beside the submissions' folders; returns where. Raises RubricError with its mistakes."""
    _rubric_of(results, text)
    replace_file(results / EDITED_RUBRIC, text)
    return results / EDITED_RUBRIC


def _rubric_of(results: Path, text: str) -> Rubric:
    with tempfile.TemporaryDirectory(prefix=TEMPORARY) as folder:
        file = Path(folder, EDITED_RUBRIC)
        file.write_text(text, encoding="utf-8")
        return read_rubric(file, rubric_copy(recorded_in(results)[0]))


def _fits(place: str, value: str) -> bool:
    return bool(_NUMBER.fullmatch(value)) and not (
        place.endswith("/points") and value.endswith("%")
    )


def _numbers(text: str) -> Iterator[tuple[str, str, str, str, yaml.ScalarNode]]:
    """Yield place, criterion, check, key and node of each number of a check; one that several share, at the first."""
    seen = set()
    for c, criterion in enumerate(
        _get(yaml.compose(text, Loader=yaml.SafeLoader), "criteria").value
    ):
        for k, check in enumerate(_items(criterion, "checks")):
            pairs = [("points", _get(check, "points"))]
            given = _get(check, "with")
            pairs += (
                [(key.value, node) for key, node in given.value]
                if isinstance(given, yaml.MappingNode)
                else []
            )
            for key, node in pairs:
                if (
                    isinstance(node, yaml.ScalarNode)
                    and _NUMBER.fullmatch(node.value)
                    and id(node) not in seen
                ):
                    seen.add(id(node))
                    yield (
                        f"{c}/{k}/{key}",
                        _get(criterion, "id").value,
                        _get(check, "id").value,
                        key,
                        node,
                    )


def _with_sums(text: str) -> str:
    """Return a rubric's text with the points of criteria and lab that its checks add up to."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    new, total = [], Decimal(0)
    for criterion in _get(root, "criteria").value:
        checks, own = _items(criterion, "checks"), _get(criterion, "points")
        whole = (
            sum((Decimal(_get(check, "points").value) for check in checks), Decimal(0))
            if checks
            else None
        )
        total += Decimal(own.value) if whole is None else whole
        new += [(own, points(whole))] if whole is not None and whole != Decimal(own.value) else []
    lab = _get(_get(root, "lab"), "points")
    return _replaced(text, [*new, *([(lab, points(total))] if Decimal(lab.value) != total else [])])


def _replaced(text: str, changes: list[tuple[Any, str]]) -> str:
    for node, value in sorted(changes, key=lambda change: -change[0].start_mark.index):
        start = text.rindex(
            node.value, node.start_mark.index, node.end_mark.index
        )  # behind an anchor, and a quote
        text = text[:start] + value + text[start + len(node.value) :]
    return text


def _get(node: Any, key: str) -> Any:
    return next((value for name, value in node.value if name.value == key), None)


def _items(node: Any, key: str) -> list[Any]:
    found = _get(node, key)
    return list(found.value) if found is not None else []

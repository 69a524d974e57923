"""Questions of a class for a person, and groups with the same mistake. Pure: equal results give an equal queue."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from enum import StrEnum

from grader.cohort.mistakes import gist
from grader.evidence.environment_gap import for_teachers
from grader.lab.rubric import Rubric
from grader.report.views import chosen_words
from grader.result import (
    ANSWERS,
    FOR_A_PERSON,
    WHOLE,
    Adjustment,
    AdjustmentKind,
    CheckResult,
    CriterionResult,
    Outcome,
    Result,
)


class Kind(StrEnum):
    """Reasons for asking a person, in the order of the queue."""

    APPEAL = "appeal"
    UNDECIDED = "undecided"
    TO_GRADE = "to grade"
    INTERFERENCE = "interference"
    NOTE = "note"


@dataclass(frozen=True)
class Part:
    """A check, a criterion, or a whole submission, with its current points."""

    #: `check`, `criterion` or empty for the whole.
    level: str
    id: str
    title: str
    earned: Decimal
    possible: Decimal


@dataclass(frozen=True)
class Item:
    """A question for a person; `name` is the submission's folder."""

    kind: Kind
    name: str
    part: Part
    text: str
    #: Hash of all decisions about the part until now; a new decision must be based on them.
    state: str
    #: Hash of all decisions about its criterion.
    criterion_state: str
    #: Points that depend on the answer.
    points: Decimal
    #: Folders of all submissions with the same mistake, this one first.
    same: tuple[str, ...]
    criterion: str = ""
    is_decided: bool = False
    #: Largest points for a decision, by its level: "check", "criterion", or empty for the whole.
    most: Mapping[str, Decimal] = field(default_factory=dict)

    @property
    def id(self) -> str:
        """Id for the desk's page."""
        return f"{self.kind.name.lower()}/{self.part.id}/{self.name}"


def queue_of(results: Mapping[str, Result], rubric: Rubric) -> list[Item]:
    """Return open and answered questions, by kind, check and name."""
    by_person: set[str] = set()
    order: dict[str, int] = {}
    for number, check in enumerate(rubric.checks()):
        order[check.id] = number
        if check.by_person:
            by_person.add(check.id)
    same = _same_mistakes(results)
    found: list[Item] = []
    for name, result in results.items():
        found += _of_whole(name, result)
        found += _of_checks(name, result, by_person, same)
    kinds = list(Kind)

    def place(item: Item) -> tuple[int, int, str]:
        return kinds.index(item.kind), order.get(item.part.id, -1), item.name

    return sorted(found, key=place)


def part_of(result: Result, level: str, id_: str) -> Part | None:
    """Return a part of a result, None if the part was not judged."""
    if not level:
        return Part("", WHOLE, "The whole submission", result.final, result.score.possible)
    judged: Iterable[CheckResult | CriterionResult] = result.criteria
    if level == "check":
        judged = result.checks
    for found in judged:
        if found.id == id_:
            return Part(level, id_, found.title, _earned(result, found), found.possible)
    return None


def _earned(result: Result, judged: CheckResult | CriterionResult) -> Decimal:
    """Return the points of a check or criterion with their adjustments."""
    parts = {judged.id}
    if isinstance(judged, CriterionResult):
        parts.update(check.id for check in judged.checks)
    earned = judged.earned
    for adjustment in result.adjustments:
        if adjustment.what in parts:
            earned += adjustment.points
    return earned


def state_of(result: Result, id_: str) -> str:
    """Return a hash of all adjustments of a part, of its criterion, and of its checks."""
    related = {id_}
    for criterion in result.criteria:
        inner = {check.id for check in criterion.checks}
        if criterion.id == id_:
            related |= inner
        elif id_ in inner:
            related.add(criterion.id)
    said = repr([a for a in result.adjustments if a.what in related])
    return hashlib.sha256(said.encode("utf-8", "surrogatepass")).hexdigest()[:16]


def _same_mistakes(results: Mapping[str, Result]) -> dict[tuple[str, str], tuple[str, ...]]:
    """Return the submissions with the same mistake in a check, by each of them, which comes first."""
    groups: defaultdict[tuple[object, ...], list[str]] = defaultdict(list)
    for name, result in results.items():
        for check in result.checks:
            asking = _asking(check)
            if check.outcome is not Outcome.PASSED or asking:
                words = (check.reason, check.hint, *asking)
                key = (check.id, check.outcome.decided, *map(gist, words))
                groups[key].append(name)
    found: dict[tuple[str, str], tuple[str, ...]] = {}
    for (id_, *_), names in groups.items():
        for name in names:
            others = [other for other in names if other != name]
            found[name, str(id_)] = (name, *others)
    return found


def _asking(check: CheckResult) -> list[str]:
    """Return the notes of a check that ask a person."""
    return [note for note in check.notes if FOR_A_PERSON in note]


def _of_whole(name: str, result: Result) -> Iterable[Item]:
    """Yield the questions about a whole submission: interference, and the choice among several files."""
    part = part_of(result, "", WHOLE)
    if part is None:
        return
    if result.violations:
        yield _interference(name, result, part)
    asked = [chosen_words(chosen) for chosen in result.chosen if chosen.is_open]
    if asked:
        points = result.score.possible
        yield _item_of_whole(Kind.NOTE, name, result, part, " ".join(asked), points, points)


def _interference(name: str, result: Result, part: Part) -> Item:
    """Return the question about interference, with the lost points of its checks."""
    text = " ".join(dict.fromkeys(violation.text for violation in result.violations))
    disturbed: set[str] = set()
    for violation in result.violations:
        disturbed.update(violation.checks)
    lost = Decimal(0)
    for check in result.checks:
        if check.id in disturbed:
            lost += check.lost
    return _item_of_whole(Kind.INTERFERENCE, name, result, part, text, lost, part.possible)


def _item_of_whole(
    kind: Kind, name: str, result: Result, part: Part, text: str, points: Decimal, most: Decimal
) -> Item:
    """Return a question about a whole submission, with the points at stake and its largest points."""
    state = state_of(result, WHOLE)
    is_answered = _is_answered(result.adjustments, (WHOLE,))
    return Item(kind, name, part, text, state, "", points, (name,), "", is_answered, {"": most})


def _is_answered(adjustments: Iterable[Adjustment], parts: Container[str]) -> bool:
    """Return whether an adjustment of one of some parts answers a question."""
    answers = [each for each in adjustments if each.kind in ANSWERS]
    return any(each.what in parts for each in answers)


def _of_checks(
    name: str, result: Result, by_person: set[str], same: Mapping[tuple[str, str], tuple[str, ...]]
) -> Iterable[Item]:
    for criterion in result.criteria:
        criterion_state = state_of(result, criterion.id)
        parts: list[CheckResult | CriterionResult] = [*criterion.checks]
        # A criterion that is graded as a whole has a check with its id.
        if all(check.id != criterion.id for check in criterion.checks):
            parts.insert(0, criterion)
        for judged in parts:
            level = "check" if isinstance(judged, CheckResult) else "criterion"
            asked = _asked_of(judged, criterion, result, by_person)
            part = part_of(result, level, judged.id) if asked else None
            if part is None:
                continue
            for kind, text, is_decided in asked:
                stake = part.possible - part.earned
                if kind is Kind.NOTE:
                    stake = part.earned
                yield Item(
                    kind,
                    name,
                    part,
                    text,
                    state_of(result, judged.id),
                    criterion_state,
                    stake,
                    same.get((name, judged.id), (name,)),
                    criterion.id,
                    is_decided,
                    {"criterion": criterion.possible, level: part.possible},
                )


def _asked_of(
    judged: CheckResult | CriterionResult,
    criterion: CriterionResult,
    result: Result,
    by_person: set[str],
) -> list[tuple[Kind, str, bool]]:
    """Return the questions about a part: kind, words, and True if it is answered."""
    said = [each for each in result.adjustments if each.what == judged.id]
    asked: list[tuple[Kind, str, bool]] = []
    appeals = [n for n, each in enumerate(said) if each.kind is AdjustmentKind.APPEAL]
    if appeals:
        last = appeals[-1]
        is_answered = _is_answered(said[last:], (judged.id,))
        asked.append((Kind.APPEAL, said[last].reason, is_answered))
    if isinstance(judged, CriterionResult):
        return asked
    if judged.undecided:
        is_open = any(check.id == judged.id for check in result.open_checks)
        if judged.id in by_person:
            asked.append((Kind.TO_GRADE, judged.reason, not is_open))
        else:
            asked.append((Kind.UNDECIDED, for_teachers(judged.reason), not is_open))
    elif notes := _asking(judged):
        is_answered = _is_answered(result.adjustments, (judged.id, criterion.id))
        asked.append((Kind.NOTE, " ".join(notes), is_answered))
    return asked

"""What of a class needs a person, and who made the same mistake. Pure: equal results give an equal queue."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from enum import Enum

from grader.cohort.mistakes import gist
from grader.lab.rubric import Rubric
from grader.report.views import chosen_words
from grader.result import (
    ANSWERS,
    FOR_A_PERSON,
    WHOLE,
    AdjustmentKind,
    CheckResult,
    CriterionResult,
    Outcome,
    Result,
)


class Kind(str, Enum):
    """Why a person is asked, in the order in which they are."""

    APPEAL = "appeal"
    UNDECIDED = "undecided"
    TO_GRADE = "to grade"
    INTERFERENCE = "interference"
    NOTE = "note"


@dataclass(frozen=True)
class Part:
    """A check, a criterion, or the whole of a submission, with the points that it has now."""

    #: `check`, `criterion` or empty for the whole.
    level: str
    id: str
    title: str
    earned: Decimal
    possible: Decimal


@dataclass(frozen=True)
class Item:
    """Something that a person is asked to decide; `name` is the submission's folder."""

    kind: Kind
    name: str
    part: Part
    text: str
    #: What people decided until now of the part and of its criterion, as hashes: whoever decides must have seen it.
    state: str
    criterion_state: str
    #: Points that depend on it.
    points: Decimal
    #: Others of the same mistake, by their folders.
    same: tuple[str, ...]
    criterion: str = ""
    is_decided: bool = False
    #: The most points of what may be decided with it: of a `check`, its `criterion`, or the whole (empty).
    most: Mapping[str, Decimal] = field(default_factory=dict)

    @property
    def id(self) -> str:
        """By which the desk's page knows it."""
        return "/".join((self.kind.name.lower(), self.part.id, self.name))


def queue_of(results: Mapping[str, Result], rubric: Rubric) -> list[Item]:
    """Return what is to be decided, and what has been, by kind, check and name."""
    by_person = {check.id for check in rubric.checks() if check.by_person}
    same = _same_mistakes(results)
    found = [
        item
        for name, result in results.items()
        for item in (*_of_whole(name, result), *_of_checks(name, result, by_person, same))
    ]
    kinds, checks = list(Kind), [check.id for check in rubric.checks()]
    order = {id_: n for n, id_ in enumerate(checks)}
    return sorted(found, key=lambda i: (kinds.index(i.kind), order.get(i.part.id, -1), i.name))


def part_of(result: Result, level: str, id_: str) -> Part | None:
    """Return a part of a result, None if nothing of it was judged."""
    if not level:
        return Part("", WHOLE, "The whole submission", result.final, result.score.possible)
    judged: Iterable[CheckResult | CriterionResult] = (
        result.checks if level == "check" else result.criteria
    )
    found = next((one for one in judged if one.id == id_), None)
    if found is None:
        return None
    inner = {check.id for check in found.checks} if isinstance(found, CriterionResult) else set()
    changes = (a.points for a in result.adjustments if a.what == id_ or a.what in inner)
    return Part(level, id_, found.title, found.earned + sum(changes, Decimal(0)), found.possible)


def state_of(result: Result, id_: str) -> str:
    """Return a hash of all that people said and decided of a part, of what it is part of, and of its own parts."""
    related = {id_}
    for criterion in result.criteria:
        inner = {check.id for check in criterion.checks}
        related |= inner if criterion.id == id_ else {criterion.id} if id_ in inner else set()
    said = repr([a for a in result.adjustments if a.what in related])
    return hashlib.sha256(said.encode("utf-8", "surrogatepass")).hexdigest()[:16]


def _same_mistakes(results: Mapping[str, Result]) -> dict[tuple[str, str], tuple[str, ...]]:
    """Return who lost points at each check, or is undecided there, for the same as one, who comes first."""
    groups: defaultdict[tuple[object, ...], list[str]] = defaultdict(list)
    of: dict[tuple[str, str], tuple[object, ...]] = {}
    for name, result in results.items():
        for check in result.checks:
            key = (
                check.id,
                check.outcome.decided,
                gist(check.reason),
                gist(check.hint),
                *map(gist, _asking(check)),
            )
            if check.outcome is not Outcome.PASSED or _asking(check):
                of[name, check.id] = key
                groups[key].append(name)
    return {
        (name, id_): (name, *(n for n in groups[key] if n != name))
        for (name, id_), key in of.items()
    }


def _asking(check: CheckResult) -> list[str]:
    return [note for note in check.notes if FOR_A_PERSON in note]


def _of_whole(name: str, result: Result) -> Iterable[Item]:
    """Yield the questions about a submission as a whole: interference, and the choice among several files."""
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
    """Return the question about interference, with the points that its checks lost."""
    text = " ".join(dict.fromkeys(violation.text for violation in result.violations))
    disturbed: set[str] = set()
    for violation in result.violations:
        disturbed.update(violation.checks)
    lost = sum((check.lost for check in result.checks if check.id in disturbed), Decimal(0))
    return _item_of_whole(Kind.INTERFERENCE, name, result, part, text, lost, part.possible)


def _item_of_whole(
    kind: Kind, name: str, result: Result, part: Part, text: str, points: Decimal, most: Decimal
) -> Item:
    """Return a question about a submission as a whole, with the points at stake and the most that it can have."""
    answers = [a for a in result.adjustments if a.what == WHOLE and a.kind in ANSWERS]
    state = state_of(result, WHOLE)
    answered, possible = bool(answers), {"": most}
    return Item(kind, name, part, text, state, "", points, (name,), "", answered, possible)


def _of_checks(
    name: str, result: Result, by_person: set[str], same: Mapping[tuple[str, str], tuple[str, ...]]
) -> Iterable[Item]:
    for criterion in result.criteria:
        criterion_state = state_of(result, criterion.id)
        parts: list[CheckResult | CriterionResult] = [*criterion.checks]
        if criterion.id not in {
            check.id for check in criterion.checks
        }:  # Graded as a whole, it is its own check.
            parts.insert(0, criterion)
        for judged in parts:
            level = "check" if isinstance(judged, CheckResult) else "criterion"
            asked = _asked_of(judged, criterion, result, by_person)
            part = part_of(result, level, judged.id) if asked else None
            if part is None:
                continue
            others = same.get((name, judged.id), (name,))
            states = state_of(result, judged.id), criterion_state
            most = {"criterion": criterion.possible, level: part.possible}
            for kind, text, is_decided in asked:
                stake = part.possible - part.earned if kind is not Kind.NOTE else part.earned
                yield Item(
                    kind, name, part, text, *states, stake, others, criterion.id, is_decided, most
                )


def _asked_of(
    judged: CheckResult | CriterionResult,
    criterion: CriterionResult,
    result: Result,
    by_person: set[str],
) -> list[tuple[Kind, str, bool]]:
    """Return why a person is asked about a part: the kind, the words, and whether that is answered."""
    said = [a for a in result.adjustments if a.what == judged.id]
    asked: list[tuple[Kind, str, bool]] = []
    if appeals := [n for n, each in enumerate(said) if each.kind is AdjustmentKind.APPEAL]:
        last = appeals[-1]
        is_answered = any(a.kind in ANSWERS for a in said[last:])
        asked.append((Kind.APPEAL, said[last].reason, is_answered))
    if isinstance(judged, CriterionResult):
        return asked
    if judged.undecided:
        kind = Kind.TO_GRADE if judged.id in by_person else Kind.UNDECIDED
        is_open = any(check.id == judged.id for check in result.open_checks)
        asked.append((kind, judged.reason, not is_open))
    elif notes := _asking(judged):
        about = (judged.id, criterion.id)
        is_answered = any(a.kind in ANSWERS for a in result.adjustments if a.what in about)
        asked.append((Kind.NOTE, " ".join(notes), is_answered))
    return asked

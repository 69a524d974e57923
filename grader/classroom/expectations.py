"""Fixtures: submissions with the verdict that they must get, and how a result differs from it."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from grader.errors import SubmissionError
from grader.lab.rubric import Rubric
from grader.lab.yaml_with_lines import Loc, Strict, parse_yaml, read_text, suggestion
from grader.result import CheckResult, CriterionResult, Outcome, Result

EXPECTED_FILE = "expected.yaml"


def _rising(value: Any) -> Any:
    if isinstance(value, (list, tuple)) and len(value) == 2:
        with suppress(ArithmeticError):  # of what is no number
            least, most = (Decimal(str(number)) for number in value)
            if least <= most:
                return least, most
    raise ValueError("the least and the most points are expected, such as [1, 5]")


_OR_EMPTY = BeforeValidator(lambda value: {} if value is None else value)
Bounds = Annotated[tuple[Decimal, Decimal], BeforeValidator(_rising)]
_NOTHING = (Decimal(0), Decimal(0))


class ExpectedCheck(Strict):
    """What a check must say."""

    outcome: Literal["passed", "partial", "failed", "not_reached"]
    #: The least and the most points. By default nothing where it fails; anything where it is partial.
    earned: Bounds | None = None
    #: What its reason or hint mentions; case does not matter.
    reason_has: str = ""

    def differences(self, check: CheckResult) -> Iterator[str]:
        """Say in what a check's result differs from this."""
        found = " | ".join(part for part in (check.measured, check.reason) if part)
        if check.outcome.value != self.outcome:
            is_now, wanted = (
                outcome.replace("_", " ") for outcome in (check.outcome.value, self.outcome)
            )
            yield f"{check.id} is {is_now}, not {wanted}: {found}"
        loses_all = check.outcome in (Outcome.FAILED, Outcome.NOT_REACHED)
        bounds = self.earned or (_NOTHING if loses_all else (check.earned, check.earned))
        if not bounds[0] <= check.earned <= bounds[1]:
            yield f"{check.id} earns {check.earned}, not {_span(*bounds)}: {found}"
        if self.reason_has.lower() not in f"{check.reason} {check.hint}".lower():
            yield f"{check.id} does not mention {self.reason_has!r}: {check.reason} {check.hint}"


class ExpectedCriterion(Strict):
    """The checks of a criterion that do not pass; the others must."""

    checks: Annotated[dict[str, ExpectedCheck], _OR_EMPTY] = Field(default_factory=dict)


class Expectation(Strict):
    """The verdict that a fixture must get."""

    about: str
    #: Those that run; only what they and the files decide is asserted.
    sessions: tuple[str, ...]
    #: Folder, relative to that in which the folder of fixtures lies, whose files are laid below the fixture's
    #: own.
    with_files_of: str | None = None
    #: Which of these are left out.
    without: tuple[str, ...] = ()
    #: Criteria that are asserted, by their id.
    criteria: Annotated[dict[str, ExpectedCriterion], _OR_EMPTY] = Field(default_factory=dict)
    #: The least and the most points of a criterion that a teacher would give; asserted where all of it is judged.
    teacher: dict[str, Bounds] = Field(default_factory=dict)
    #: Criteria for which the grader gives others, and why.
    apart: dict[str, str] = Field(default_factory=dict)
    #: The least and the most points of all that is judged.
    total: Bounds | None = None

    @model_validator(mode="after")
    def _asserts_something(self) -> Expectation:
        if not self.criteria and not self.teacher and self.total is None:
            raise ValueError("it asserts nothing: name a criterion or the total")
        if aims := self.apart.keys() - self.teacher.keys():
            raise ValueError(f"a teacher's range is missing for {', '.join(sorted(aims))}")
        return self

    def loses_in(self, criterion: str) -> bool:
        """Whether a check of a criterion is expected not to pass."""
        expected = self.criteria.get(criterion)
        return expected is not None and any(
            check.outcome != "passed" for check in expected.checks.values()
        )

    def unfit(self, rubric: Rubric) -> list[tuple[Loc, str]]:
        """Say what is named here, and where, that is not in a rubric."""
        return list(self._unfit(rubric))

    def _unfit(self, rubric: Rubric) -> Iterator[tuple[Loc, str]]:
        """Yield each name that a rubric does not have, or that nothing can be expected of."""
        for n, name in enumerate(self.sessions):
            if name not in rubric.sessions:
                words = f"the rubric has no session {name!r}"
                yield ("sessions", n), words + suggestion(name, rubric.sessions)
        listed = (*rubric.criteria, *rubric.bonus)
        known = {criterion.id: [check.id for check in criterion.checks] for criterion in listed}
        by_person = left_to_a_person(rubric)
        for name, criterion in self.criteria.items():
            yield from _unknown_criterion("criteria", name, known)
            yield from _unfit_checks(name, criterion.checks, known, by_person)
        for name in self.teacher:
            yield from _unknown_criterion("teacher", name, known)


def _unknown_criterion(
    part: str, name: str, known: Mapping[str, Collection[str]]
) -> Iterator[tuple[Loc, str]]:
    """Yield a criterion that a rubric does not have."""
    if name not in known:
        yield (part, name), f"the rubric has no criterion {name!r}{suggestion(name, known)}"


def _unfit_checks(
    name: str,
    checks: Iterable[str],
    known: Mapping[str, Collection[str]],
    by_person: Collection[str],
) -> Iterator[tuple[Loc, str]]:
    """Yield the checks of a criterion that the rubric does not have there, and those that a person grades."""
    for check in checks:
        loc = ("criteria", name, "checks", check)
        if name in known and check not in known[name]:
            words = f"the rubric's criterion {name!r} has no check {check!r}"
            yield loc, words + suggestion(check, known[name])
        elif check in by_person:
            yield loc, f"a person grades {check!r}, so nothing can be expected of it here"


@dataclass(frozen=True)
class Fixture:
    """A submission with its expected verdict."""

    name: str
    #: Folders of files, each laid over those before it.
    layers: tuple[Path, ...]
    expectation: Expectation

    def lay_out(self, target: Path) -> Path:
        """Make the submission below a folder, in place of an earlier one; returns its folder."""
        submission, left_out = target / self.name, shutil.ignore_patterns("__pycache__")
        shutil.rmtree(submission, ignore_errors=True)
        for number, layer in enumerate(self.layers):
            shutil.copytree(layer, submission, ignore=left_out, dirs_exist_ok=True)
            for name in self.expectation.without if number == 0 else ():
                (submission / name).unlink()
        return submission


def load_fixture(folder: Path, rubric: Rubric | None = None) -> Fixture:
    """Read a fixture; raises RubricError with every mistake in its `expected.yaml`, each with its line.

    A rubric that is given must have what it names.
    """
    path, what = folder / EXPECTED_FILE, f"what {folder.name} expects"
    plain, mistakes = parse_yaml(path, read_text(path, what, "Each fixture has one."), what)
    layers: list[Path] = []
    try:
        expectation = Expectation.model_validate(plain)
        base, own = expectation.with_files_of, folder / "submission"
        layers += [folder.resolve().parent.parent / base] if base is not None else []
        layers += [own] if own.is_dir() else []
        unfit = expectation.unfit(rubric) if rubric is not None else []
        for loc, words in (*unfit, *_absent(expectation, layers)):
            mistakes.add(loc, words)
    except ValidationError as error:
        mistakes.add_validation((), error)
    mistakes.raise_any("docs/fixtures.md describes its format.")
    return Fixture(folder.name, tuple(layers), expectation)


def _absent(expectation: Expectation, layers: Sequence[Path]) -> Iterator[tuple[Loc, str]]:
    """Say which of the files are not there that a fixture is laid out from."""
    if not layers:
        yield (), "it has no files: neither a folder 'submission' nor with_files_of"
    elif not layers[0].is_dir():
        yield ("with_files_of",), f"there is no folder {expectation.with_files_of!r}"
    else:
        gone = [
            (n, name)
            for n, name in enumerate(expectation.without)
            if not (layers[0] / name).is_file()
        ]
        yield from (
            (("without", n), f"there is no file {name!r} in {layers[0].name}") for n, name in gone
        )


def fixtures_in(folder: Path) -> list[Fixture]:
    """Read all fixtures of a folder, in the order of their names; raises SubmissionError if there are none."""
    found = sorted(path.parent for path in folder.glob(f"*/{EXPECTED_FILE}"))
    if not found:
        remedy = (
            "They come with a checkout of the grader; --fixtures names the folder that holds them."
        )
        raise SubmissionError("there are no fixtures", location=str(folder), remedy=remedy)
    return [load_fixture(path) for path in found]


def left_to_a_person(rubric: Rubric) -> frozenset[str]:
    """Return the checks that no grading decides: those that a person grades, and those that require one of them."""
    found: set[str] = set()
    for check in rubric.checks():
        if check.by_person or found.intersection(check.requires):
            found.add(check.id)
    return frozenset(found)


def solution(folder: Path, rubric: Rubric) -> Fixture:
    """Return the lab's own solution as a fixture: all points are earned but those that a person gives."""
    by_person = left_to_a_person(rubric)
    checks = [check for criterion in rubric.criteria for check in criterion.checks]
    most = sum((check.points for check in checks if check.id not in by_person), Decimal(0))
    expectation = Expectation(
        about="The lab's own solution earns all points.",
        sessions=tuple(rubric.sessions),
        criteria={criterion.id: ExpectedCriterion() for criterion in rubric.criteria},
        total=(most, most),
    )
    return Fixture("solution", (folder,), expectation)


@dataclass(frozen=True)
class Verdict:
    """How a result compares with what is expected."""

    differences: tuple[str, ...]
    #: Whether something that is asserted is undecided, so that another run may tell.
    undecided: bool


def compare(expectation: Expectation, result: Result, rubric: Rubric) -> Verdict:
    """Say in which points a result differs from what is expected.

    Checks by the files alone are asserted where they are named, or where their criterion has no others. Checks that
    a person decides are left out.
    """
    by_person = left_to_a_person(rubric)
    differences: list[str] = []
    undecided = False
    for found in (
        *_of_checks(expectation, result, rubric, by_person),
        *_of_teacher(expectation, result, rubric, by_person),
        _of_total(expectation, result, by_person),
    ):
        differences += found.differences
        undecided = undecided or found.undecided
    return Verdict(tuple(differences), undecided)


def _of_checks(
    expectation: Expectation, result: Result, rubric: Rubric, by_person: frozenset[str]
) -> Iterator[Verdict]:
    """Compare each criterion that is named with what its checks must say."""
    listed = (*result.criteria, *result.bonus)
    judged = {criterion.id: {check.id: check for check in criterion.checks} for criterion in listed}
    in_sessions = {check.id for check in rubric.checks() if check.session is not None}
    for name, expected in expectation.criteria.items():
        checks = judged.get(name, {})
        absent = [check for check in expected.checks if check not in checks]
        found = [f"{check} is expected, but was not judged" for check in absent]
        if not checks:
            found.append(f"{name} is expected, but nothing of it was judged")
        asserted = (checks.keys() & in_sessions or checks.keys()) | expected.checks.keys()
        compared = [each for id_, each in checks.items() if id_ in asserted - by_person]
        for check in compared:
            wanted = expected.checks.get(check.id, ExpectedCheck(outcome="passed"))
            found += wanted.differences(check)
        yield Verdict(tuple(found), any(not check.outcome.decided for check in compared))


def _of_teacher(
    expectation: Expectation, result: Result, rubric: Rubric, by_person: frozenset[str]
) -> Iterator[Verdict]:
    """Compare each criterion all of which is judged with the points that a teacher would give."""
    possible = {criterion.id: criterion.points for criterion in (*rubric.criteria, *rubric.bonus)}
    for criterion in (*result.criteria, *result.bonus):
        is_whole = criterion.possible == possible[criterion.id]
        left_out = by_person.intersection(check.id for check in criterion.checks)
        if criterion.id in expectation.teacher and is_whole and not left_out:
            found = tuple(_from_teacher(expectation, criterion))
            yield Verdict(found, bool(criterion.undecided))


def _of_total(expectation: Expectation, result: Result, by_person: frozenset[str]) -> Verdict:
    """Compare the points of all that is judged."""
    if expectation.total is None:
        return Verdict((), undecided=False)
    least, most = expectation.total
    earned = result.score.earned
    left = (check.undecided for check in result.checks if check.id in by_person)
    is_open = result.score.undecided > sum(left, Decimal(0))
    if least <= earned <= most:
        return Verdict((), is_open)
    return Verdict((f"it earns {earned} points in all, not {_span(least, most)}",), is_open)


def _from_teacher(expectation: Expectation, criterion: CriterionResult) -> Iterator[str]:
    """Say that a criterion earns what no teacher would give, or does so where that is said not to be."""
    least, most = expectation.teacher[criterion.id]
    if (least <= criterion.earned <= most) == (criterion.id in expectation.apart):
        wanted = f"{'not ' * (criterion.id not in expectation.apart)}{_span(least, most)}"
        yield f"{criterion.id} earns {criterion.earned}, {wanted} as a teacher would give"


def _span(least: Decimal, most: Decimal) -> str:
    return str(least) if least == most else f"from {least} to {most}"

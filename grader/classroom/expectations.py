"""Fixtures: submissions with an expected verdict, and the differences of a result from it."""

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
from grader.lab.similar_words import suggestion
from grader.lab.yaml_with_lines import Fault, Strict, parse_yaml, read_text
from grader.result import CheckResult, CriterionResult, Outcome, Result

EXPECTED_FILE = "expected.yaml"


def _rising(value: Any) -> Any:
    if isinstance(value, (list, tuple)) and len(value) == 2:
        # Decimal raises ArithmeticError for a text that is no number.
        with suppress(ArithmeticError):
            least = Decimal(str(value[0]))
            most = Decimal(str(value[1]))
            if least <= most:
                return least, most
    raise ValueError("the least and the most points are expected, such as [1, 5]")


_OR_EMPTY = BeforeValidator(lambda value: {} if value is None else value)
Bounds = Annotated[tuple[Decimal, Decimal], BeforeValidator(_rising)]
_NOTHING = (Decimal(0), Decimal(0))


class ExpectedCheck(Strict):
    """The expected finding of a check."""

    outcome: Literal["passed", "excused", "partial", "failed", "not_reached"]
    #: Least and most points. By default 0 for a failed check, and any points for a partial one.
    earned: Bounds | None = None
    #: A text in the reason or the hint; case does not matter.
    reason_has: str = ""

    def _is_outcome(self, check: CheckResult) -> bool:
        """Tell whether a check has the expected outcome; an excused check costs nothing, as a passed one."""
        if self.outcome == "passed":
            return check.outcome in (Outcome.PASSED, Outcome.EXCUSED)
        return check.outcome.value == self.outcome

    def differences(self, check: CheckResult) -> Iterator[str]:
        """Yield a sentence about each difference of a check's result."""
        found = " | ".join(filter(None, (check.measured, check.reason)))
        if not self._is_outcome(check):
            outcome = check.outcome.value.replace("_", " ")
            wanted = self.outcome.replace("_", " ")
            yield f"{check.id} is {outcome}, not {wanted}: {found}"
        bounds = self.earned
        if bounds is None and check.outcome in (Outcome.FAILED, Outcome.NOT_REACHED):
            bounds = _NOTHING
        if bounds is not None and not bounds[0] <= check.earned <= bounds[1]:
            yield f"{check.id} earns {check.earned}, not {_span(*bounds)}: {found}"
        if self.reason_has.lower() not in f"{check.reason} {check.hint}".lower():
            yield f"{check.id} does not mention {self.reason_has!r}: {check.reason} {check.hint}"


class ExpectedCriterion(Strict):
    """The checks of a criterion that must not pass; all other checks must pass."""

    checks: Annotated[dict[str, ExpectedCheck], _OR_EMPTY] = Field(default_factory=dict)


class Expectation(Strict):
    """The expected verdict of a fixture."""

    about: str
    #: Sessions that run; only checks of these and of the files are asserted.
    sessions: tuple[str, ...]
    #: Folder with files below the fixture's own, relative to the parent of the folder of fixtures.
    with_files_of: str | None = None
    #: Files of that folder that are left out.
    without: tuple[str, ...] = ()
    #: Asserted criteria, by their id.
    criteria: Annotated[dict[str, ExpectedCriterion], _OR_EMPTY] = Field(default_factory=dict)
    #: Least and most points of a teacher for a criterion; asserted if the whole criterion is judged.
    teacher: dict[str, Bounds] = Field(default_factory=dict)
    #: Criteria with other points from the grader, with the reason.
    apart: dict[str, str] = Field(default_factory=dict)
    #: Least and most points of all judged checks.
    total: Bounds | None = None

    @model_validator(mode="after")
    def _asserts_something(self) -> Expectation:
        if not self.criteria and not self.teacher and self.total is None:
            raise ValueError("it asserts nothing: name a criterion or the total")
        missing = sorted(self.apart.keys() - self.teacher.keys())
        if missing:
            raise ValueError(f"a teacher's range is missing for {', '.join(missing)}")
        return self

    def loses_in(self, criterion: str) -> bool:
        """Return whether a check of a criterion is expected not to pass."""
        expected = self.criteria.get(criterion)
        if expected is None:
            return False
        return any(check.outcome != "passed" for check in expected.checks.values())

    def unfit(self, rubric: Rubric) -> list[Fault]:
        """Return the names that a rubric does not have, with their places."""
        return list(self._unfit(rubric))

    def _unfit(self, rubric: Rubric) -> Iterator[Fault]:
        """Yield each unknown name, and each name without a possible expectation."""
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
) -> Iterator[Fault]:
    """Yield a criterion that a rubric does not have."""
    if name not in known:
        yield (part, name), f"the rubric has no criterion {name!r}{suggestion(name, known)}"


def _unfit_checks(
    name: str,
    checks: Iterable[str],
    known: Mapping[str, Collection[str]],
    by_person: Collection[str],
) -> Iterator[Fault]:
    """Yield the checks that a criterion of the rubric does not have, and checks that a person grades."""
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
    #: Folders of files; files of a later folder replace earlier ones.
    layers: tuple[Path, ...]
    expectation: Expectation

    def lay_out(self, target: Path) -> Path:
        """Make the submission below a folder, and replace an earlier one; returns its folder."""
        submission = target / self.name
        left_out = shutil.ignore_patterns("__pycache__")
        shutil.rmtree(submission, ignore_errors=True)
        for number, layer in enumerate(self.layers):
            shutil.copytree(layer, submission, ignore=left_out, dirs_exist_ok=True)
            if number == 0:
                for name in self.expectation.without:
                    (submission / name).unlink()
        return submission


def load_fixture(folder: Path, rubric: Rubric | None = None) -> Fixture:
    """Read a fixture; raises RubricError with every mistake in its `expected.yaml`, each with its line.

    With a rubric, the names in `expected.yaml` must be in it.
    """
    path = folder / EXPECTED_FILE
    described = f"what {folder.name} expects"
    text = read_text(path, described, "Each fixture has one.")
    plain, mistakes = parse_yaml(path, text, described)
    layers: list[Path] = []
    try:
        expectation = Expectation.model_validate(plain)
        if expectation.with_files_of is not None:
            layers.append(folder.resolve().parent.parent / expectation.with_files_of)
        own = folder / "submission"
        if own.is_dir():
            layers.append(own)
        if rubric is not None:
            unfit = expectation.unfit(rubric)
        else:
            unfit = []
        for loc, words in (*unfit, *_absent(expectation, layers)):
            mistakes.add(loc, words)
    except ValidationError as error:
        mistakes.add_validation((), error)
    mistakes.raise_any("docs/fixtures.md describes its format.")
    return Fixture(folder.name, tuple(layers), expectation)


def _absent(expectation: Expectation, layers: Sequence[Path]) -> Iterator[Fault]:
    """Yield a sentence about each missing file or folder of a fixture."""
    if not layers:
        yield (), "it has no files: neither a folder 'submission' nor with_files_of"
    elif not layers[0].is_dir():
        yield ("with_files_of",), f"there is no folder {expectation.with_files_of!r}"
    else:
        for number, name in enumerate(expectation.without):
            if not (layers[0] / name).is_file():
                yield ("without", number), f"there is no file {name!r} in {layers[0].name}"


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
    """Return the checks that the grader does not decide: checks that a person grades, and checks that require one."""
    found: set[str] = set()
    for check in rubric.checks():
        if check.by_person or found.intersection(check.requires):
            found.add(check.id)
    return frozenset(found)


def solution(folder: Path, rubric: Rubric) -> Fixture:
    """Return the lab's own solution as a fixture, which earns all points except in checks by a person."""
    by_person = left_to_a_person(rubric)
    checks = [check for criterion in rubric.criteria for check in criterion.checks]
    points = [check.points for check in checks if check.id not in by_person]
    most = sum(points, Decimal(0))
    criteria = {criterion.id: ExpectedCriterion() for criterion in rubric.criteria}
    expectation = Expectation(
        about="The lab's own solution earns all points.",
        sessions=tuple(rubric.sessions),
        criteria=criteria,
        total=(most, most),
    )
    return Fixture("solution", (folder,), expectation)


@dataclass(frozen=True)
class Verdict:
    """The differences of a result from an expectation."""

    differences: tuple[str, ...]
    #: True if something asserted is undecided; another run may decide it.
    undecided: bool


def compare(expectation: Expectation, result: Result, rubric: Rubric) -> Verdict:
    """Compare a result with an expectation.

    Checks of the files alone are asserted if they are named, or if their criterion has no other checks. Checks that a
    person decides are left out.
    """
    by_person = left_to_a_person(rubric)
    differences: list[str] = []
    undecided = False
    verdicts = [
        *_of_checks(expectation, result, rubric, by_person),
        *_of_teacher(expectation, result, rubric, by_person),
        _of_total(expectation, result, by_person),
    ]
    for found in verdicts:
        differences += found.differences
        undecided = undecided or found.undecided
    return Verdict(tuple(differences), undecided)


def _of_checks(
    expectation: Expectation, result: Result, rubric: Rubric, by_person: frozenset[str]
) -> Iterator[Verdict]:
    """Compare the checks of each named criterion with the expected ones."""
    listed = (*result.criteria, *result.bonus)
    judged = {}
    for criterion in listed:
        judged[criterion.id] = {check.id: check for check in criterion.checks}
    in_sessions = {check.id for check in rubric.checks() if check.session is not None}
    for name, expected in expectation.criteria.items():
        checks = judged.get(name, {})
        found = []
        for check_id in expected.checks:
            if check_id not in checks:
                found.append(f"{check_id} is expected, but was not judged")
        if not checks:
            found.append(f"{name} is expected, but nothing of it was judged")
        own = checks.keys() & in_sessions or checks.keys()
        asserted = (own | expected.checks.keys()) - by_person
        undecided = False
        for id_, check in checks.items():
            if id_ in asserted:
                wanted = expected.checks.get(id_, ExpectedCheck(outcome="passed"))
                found += wanted.differences(check)
                undecided = undecided or not check.outcome.decided
        yield Verdict(tuple(found), undecided)


def _of_teacher(
    expectation: Expectation, result: Result, rubric: Rubric, by_person: frozenset[str]
) -> Iterator[Verdict]:
    """Compare the points of each completely judged criterion with a teacher's."""
    possible = {criterion.id: criterion.points for criterion in (*rubric.criteria, *rubric.bonus)}
    for criterion in (*result.criteria, *result.bonus):
        is_whole = criterion.possible == possible[criterion.id]
        if criterion.id not in expectation.teacher or not is_whole:
            continue
        left_out = by_person.intersection(check.id for check in criterion.checks)
        if not left_out:
            found = tuple(_from_teacher(expectation, criterion))
            yield Verdict(found, bool(criterion.undecided))


def _of_total(expectation: Expectation, result: Result, by_person: frozenset[str]) -> Verdict:
    """Compare the points of all judged checks."""
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
    """Yield a sentence if a criterion does not earn a teacher's points, or earns them although it is `apart`."""
    least, most = expectation.teacher[criterion.id]
    is_apart = criterion.id in expectation.apart
    if (least <= criterion.earned <= most) == is_apart:
        wanted = _span(least, most)
        if not is_apart:
            wanted = f"not {wanted}"
        yield f"{criterion.id} earns {criterion.earned}, {wanted} as a teacher would give"


def _span(least: Decimal, most: Decimal) -> str:
    if least == most:
        return str(least)
    return f"from {least} to {most}"

"""Fixtures: submissions with the verdict that they must get, and how a result differs from it."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from grader.errors import SubmissionError
from grader.result import CheckResult, Outcome, Result
from grader.rubric import Rubric
from grader.yaml_with_lines import Strict, cannot_be_read, parse_yaml

EXPECTED_FILE = "expected.yaml"


def _empty(value: Any) -> Any:
    return {} if value is None else value


def _rising(value: Any) -> Any:
    if isinstance(value, (list, tuple)) and len(value) == 2 and value[0] <= value[1]:
        return tuple(Decimal(str(number)) for number in value)
    raise ValueError("the least and the most points are expected, such as [1, 5]")


Bounds = Annotated[tuple[Decimal, Decimal], BeforeValidator(_rising)]


class ExpectedCheck(Strict):
    """What a check must say.

    Attributes
    ----------
    earned : (Decimal, Decimal) or None
        The least and the most points. By default nothing where it fails; anything where it is partial.
    reason_has : str
        What its reason or hint mentions; case does not matter.
    """

    outcome: Literal["passed", "partial", "failed", "not_reached"]
    earned: Bounds | None = None
    reason_has: str = ""


class ExpectedCriterion(Strict):
    """The checks of a criterion that do not pass; the others must."""

    checks: Annotated[dict[str, ExpectedCheck], BeforeValidator(_empty)] = Field(default_factory=dict)


class Expectation(Strict):
    """The verdict that a fixture must get.

    Attributes
    ----------
    sessions : tuple of str
        Those that run; only what they and the files decide is asserted.
    with_files_of : str or None
        Folder, relative to that in which the folder of fixtures lies, whose files are laid below the fixture's own.
    without : tuple of str
        Which of these are left out.
    criteria : mapping
        Criteria that are asserted, by their id.
    total : (Decimal, Decimal) or None
        The least and the most points of all that is judged.
    """

    about: str
    sessions: tuple[str, ...]
    with_files_of: str | None = None
    without: tuple[str, ...] = ()
    criteria: Annotated[dict[str, ExpectedCriterion], BeforeValidator(_empty)]
    total: Bounds | None = None

    @model_validator(mode="after")
    def _asserts_something(self) -> Expectation:
        if not self.criteria and self.total is None:
            raise ValueError("it asserts nothing: name a criterion or the total")
        return self

    def loses_in(self, criterion: str) -> bool:
        """Whether a check of a criterion is expected not to pass."""
        expected = self.criteria.get(criterion)
        return expected is not None and any(check.outcome != "passed" for check in expected.checks.values())

    def unfit(self, rubric: Rubric) -> list[str]:
        """Say what is named here and is not in a rubric."""
        checks = {criterion.id: {check.id for check in criterion.checks} for criterion in rubric.criteria}
        found = [f"the rubric has no session {name!r}" for name in self.sessions if name not in rubric.sessions]
        for name, expected in self.criteria.items():
            if name not in checks:
                found.append(f"the rubric has no criterion {name!r}")
            else:
                unknown = [check for check in expected.checks if check not in checks[name]]
                found += [f"the rubric's criterion {name!r} has no check {check!r}" for check in unknown]
        return found


@dataclass(frozen=True)
class Fixture:
    """A submission with its expected verdict.

    Attributes
    ----------
    folder : Path
        Where `expected.yaml` and `submission/` lie.
    root : Path
        From which `with_files_of` is meant.
    """

    name: str
    folder: Path
    root: Path
    expectation: Expectation

    def lay_out(self, target: Path) -> Path:
        """Make the submission below a folder: its own files over those that it builds on; returns its folder."""
        submission = target / self.name
        expected = self.expectation
        if expected.with_files_of is not None:
            base = self.root / expected.with_files_of
            shutil.copytree(base, submission, ignore=shutil.ignore_patterns("__pycache__"))
            for name in expected.without:
                (submission / name).unlink()
        if (self.folder / "submission").is_dir():
            shutil.copytree(self.folder / "submission", submission, dirs_exist_ok=True)
        return submission


def load_fixture(folder: Path) -> Fixture:
    """Read a fixture.

    Raises
    ------
    RubricError
        With every mistake in its `expected.yaml`, each with its line.
    """
    path = folder / EXPECTED_FILE
    what = f"what {folder.name} expects"
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise cannot_be_read(what, path, problem, "Each fixture has one.") from problem
    plain, mistakes = parse_yaml(path, text, what)
    try:
        expectation = Expectation.model_validate(plain)
    except ValidationError as error:
        mistakes.add_validation((), error)
    mistakes.raise_any("fixtures/README.md says what stands in it.")
    return Fixture(folder.name, folder, folder.resolve().parent.parent, expectation)


def fixtures_in(folder: Path) -> list[Fixture]:
    """Read all fixtures of a folder, in the order of their names.

    Raises
    ------
    SubmissionError
        If there are none.
    RubricError
        With every mistake in the first `expected.yaml` that has some.
    """
    found = sorted(path.parent for path in folder.glob(f"*/{EXPECTED_FILE}"))
    if not found:
        raise SubmissionError(
            "there are no fixtures",
            where=str(folder),
            remedy="They come with a checkout of the grader; --fixtures names the folder that holds them.",
        )
    return [load_fixture(path) for path in found]


def solution(folder: Path, rubric: Rubric) -> Fixture:
    """Return the lab's own solution as a fixture: every check of the rubric passes, and all points are earned."""
    criteria = {criterion.id: ExpectedCriterion() for criterion in rubric.criteria}
    expectation = Expectation(
        about="The lab's own solution has all points.",
        sessions=tuple(rubric.sessions),
        criteria=criteria,
        total=(rubric.lab.points, rubric.lab.points),
    )
    return _Whole("solution", folder, folder, expectation)


class _Whole(Fixture):
    """A fixture whose folder is the submission itself."""

    def lay_out(self, target: Path) -> Path:
        """Copy the submission below a folder; returns the copy."""
        ignored = shutil.ignore_patterns("__pycache__")
        return Path(shutil.copytree(self.folder, target / self.name, ignore=ignored))


@dataclass(frozen=True)
class Verdict:
    """How a result compares with what is expected.

    Attributes
    ----------
    undecided : bool
        Whether something that is asserted is undecided, so that another run may tell.
    """

    differences: tuple[str, ...]
    undecided: bool


def compare(expectation: Expectation, result: Result, rubric: Rubric) -> Verdict:
    """Say in which points a result differs from what is expected."""
    differences: list[str] = []
    undecided = False
    judged = {criterion.id: criterion.checks for criterion in result.criteria}
    for name, expected in expectation.criteria.items():
        checks = judged.get(name, ())
        known = {check.id for check in checks}
        differences += [
            f"{identity} is expected, but was not judged" for identity in expected.checks if identity not in known
        ]
        if not checks:
            differences.append(f"{name} is expected, but nothing of it was judged")
        for check, wanted in _asserted(name, expected, checks, rubric):
            differences += _differences(check, wanted)
            undecided = undecided or not check.outcome.decided
    if expectation.total is not None:
        least, most = expectation.total
        undecided = undecided or bool(result.score.undecided)
        if not least <= result.score.earned <= most:
            differences.append(f"it earns {result.score.earned} points in all, not {_span(least, most)}")
    return Verdict(tuple(differences), undecided)


def _asserted(
    criterion: str, expected: ExpectedCriterion, checks: tuple[CheckResult, ...], rubric: Rubric
) -> list[tuple[CheckResult, ExpectedCheck]]:
    """Pair each check that the fixture speaks of with what it expects."""
    by_files = {check.id for check in rubric.checks() if check.session is None}
    whole = all(check.session is None for c in rubric.criteria if c.id == criterion for check in c.checks)
    passed = ExpectedCheck(outcome="passed")
    return [
        (check, expected.checks.get(check.id, passed))
        for check in checks
        if whole or check.id not in by_files or check.id in expected.checks
    ]


def _differences(check: CheckResult, wanted: ExpectedCheck) -> list[str]:
    found = []
    if check.outcome.value != wanted.outcome:
        found.append(f"{check.id} is {_word(check.outcome.value)}, not {_word(wanted.outcome)}: {_said(check)}")
    bounds = wanted.earned
    if bounds is None and check.outcome in (Outcome.FAILED, Outcome.NOT_REACHED):
        bounds = (Decimal(0), Decimal(0))
    if bounds is not None and not bounds[0] <= check.earned <= bounds[1]:
        found.append(f"{check.id} earns {check.earned}, not {_span(*bounds)}: {_said(check)}")
    if wanted.reason_has.lower() not in f"{check.reason} {check.hint}".lower():
        found.append(f"{check.id} does not mention {wanted.reason_has!r}: {check.reason} {check.hint}")
    return found


def _said(check: CheckResult) -> str:
    return " | ".join(part for part in (check.measured, check.reason) if part)


def _word(outcome: str) -> str:
    return outcome.replace("_", " ")


def _span(least: Decimal, most: Decimal) -> str:
    return str(least) if least == most else f"from {least} to {most}"

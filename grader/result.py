"""What judging a submission yields: findings, the score, and its JSON form.

Everything here is a frozen value. Points are `Decimal`; a finding carries *credit* (a share of
a check's points between 0 and 1), because checks know nothing of points.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal
from enum import Enum
from typing import Any

RESULT_SCHEMA = "ros-lab-grader/result/v1"


class Outcome(str, Enum):
    """The outcome of one check. `INCONCLUSIVE` and `ERROR` never cost points."""

    PASSED = "passed"
    PARTIAL = "partial"
    FAILED = "failed"
    NOT_REACHED = "not_reached"
    INCONCLUSIVE = "inconclusive"
    ERROR = "error"

    @property
    def decided(self) -> bool:
        """Whether this outcome says something about the student's work."""
        return self not in (Outcome.INCONCLUSIVE, Outcome.ERROR)


def outcome_of_points(earned: Decimal, possible: Decimal, undecided: Decimal) -> Outcome:
    """Return the outcome of a whole, such as a criterion, by its points."""
    lost = possible - earned - undecided
    if undecided and not lost:
        return Outcome.INCONCLUSIVE
    if earned == possible:
        return Outcome.PASSED
    return Outcome.PARTIAL if earned or not lost else Outcome.FAILED


@dataclass(frozen=True)
class Where:
    """Where the proof of a finding lies: a span of a recorded topic, a source line, an output line.

    Attributes
    ----------
    file : str or None
        Path relative to the submission's root.
    line : int or None
        Line of `file`, counted from 1.
    session : str or None
        The session whose recording holds the proof.
    topic : str or None
        Topic or service name in that recording.
    process : str or None
        Process of that session whose output holds the proof.
    start_s, end_s : float or None
        Time span, in seconds since the session's start.
    """

    file: str | None = None
    line: int | None = None
    session: str | None = None
    topic: str | None = None
    process: str | None = None
    start_s: float | None = None
    end_s: float | None = None

    def __str__(self) -> str:
        parts = []
        if self.file:
            parts.append(f"{self.file}:{self.line}" if self.line else self.file)
        if self.topic:
            parts.append(self.topic)
        if self.process:
            parts.append(f"output of {self.process}")
        if self.session:
            parts.append(f"recording '{self.session}'")
        if self.start_s is not None and self.end_s is not None:
            parts.append(f"{self.start_s:.2f}–{self.end_s:.2f} s")
        elif self.start_s is not None:
            parts.append(f"at {self.start_s:.2f} s")
        return ", ".join(parts)


@dataclass(frozen=True)
class Finding:
    """What one check found.

    Attributes
    ----------
    outcome : Outcome
        See `Outcome`.
    credit : Decimal
        Share of the check's points, from 0 to 1. 1 when passed, 0 when failed.
    expected, measured : str
        One line each, with units and the error of the measurement.
    reason : str
        Why points were lost, in a sentence; empty when passed.
    hint : str
        How to mend it; empty when passed. Overrides the rubric's hint where the check knows better.
    where : tuple of Where
        Where the proof lies.
    notes : tuple of str
        Advisories that cost nothing.
    retry : bool
        Whether another run can decide what is undecided.
    settled : Finding or None
        What it is if it stays undecided however often the session is recorded, since the student's own processes can
        bring that about; None where only the machine can, or a person has to decide.
    """

    outcome: Outcome
    credit: Decimal
    expected: str = ""
    measured: str = ""
    reason: str = ""
    hint: str = ""
    where: tuple[Where, ...] = ()
    notes: tuple[str, ...] = ()
    retry: bool = True
    settled: Finding | None = None


class ViolationKind(str, Enum):
    """What of the grader's own was touched in a session."""

    IMPERSONATES_NODE = "impersonates_node"
    PUBLISHES_ON_REFERENCE_TOPIC = "publishes_on_reference_topic"
    SPOOFS_CLOCK = "spoofs_clock"
    SECOND_SERVER = "second_server"
    CHANGES_REFERENCE = "changes_reference"
    FORGES_ROSOUT = "forges_rosout"
    FORGES_PARAMETER_EVENTS = "forges_parameter_events"
    ENDS_REFERENCE = "ends_reference"


@dataclass(frozen=True)
class Violation:
    """Something of the grader's own that was touched in a session: a fact, for a person to judge; not an intent.

    Attributes
    ----------
    session : str
        The session in whose recording it was seen.
    text : str
        What was seen, in a sentence.
    evidence : tuple of str
        What shows it: nodes, gids, counts, times.
    where : Where
        Where it lies in the recording.
    certain : bool
        Whether the recording leaves no other explanation than the submission's own processes.
    checks : tuple of str
        Ids of the checks that fail because what they measure was touched.
    """

    kind: ViolationKind
    session: str
    text: str
    evidence: tuple[str, ...] = ()
    where: Where = Where()
    certain: bool = True
    checks: tuple[str, ...] = ()


@dataclass(frozen=True)
class CheckResult:
    """A finding with the points that the rubric gives it."""

    id: str
    title: str
    session: str | None
    finding: Finding
    earned: Decimal
    possible: Decimal
    undecided: Decimal


@dataclass(frozen=True)
class CriterionResult:
    """One criterion of the rubric with its checks' results; points are sums over the checks."""

    id: str
    title: str
    description: str
    checks: tuple[CheckResult, ...]
    earned: Decimal
    possible: Decimal
    undecided: Decimal


class AdjustmentKind(str, Enum):
    """What changed the points after the judgement."""

    POINTS = "points"
    EXCUSED = "excused"
    BONUS = "bonus"
    SUBMITTED = "submitted"
    EXTENSION = "extension"
    LATE = "late"


@dataclass(frozen=True)
class Adjustment:
    """One change of the points after the judgement: by a person's decision, or by the rubric's policy.

    Attributes
    ----------
    what : str
        What it concerns: id of a check or a criterion, a due date, or "score" for the whole.
    points : Decimal
        What it adds to the score, or takes from it.
    reason : str
        Why, in a sentence.
    who, when : str
        Who decided it, and when; empty where the rubric's policy did.
    """

    kind: AdjustmentKind
    what: str
    points: Decimal
    reason: str
    who: str = ""
    when: str = ""


@dataclass(frozen=True)
class Score:
    """Points earned, possible, and undecided through no fault of the student's; as judged, before adjustments."""

    earned: Decimal
    possible: Decimal
    undecided: Decimal


@dataclass(frozen=True)
class Result:
    """The judgement of one submission.

    Attributes
    ----------
    submission : str
        Name of the submission's folder.
    score : Score
        Sums over all criteria.
    criteria : tuple of CriterionResult
        In the rubric's order.
    advisories : tuple of str
        Remarks for the student that cost nothing.
    problems : tuple of str
        What went wrong on the grader's side; never costs points.
    provenance : mapping
        Hashes of submission and rubric, versions, isolation level, times of the recordings.
    adjustments : tuple of Adjustment
        What changed the points after the judgement, in the order in which it was applied.
    violations : tuple of Violation
        What of the grader's own was touched, session by session.
    """

    submission: str
    lab: str
    score: Score
    criteria: tuple[CriterionResult, ...]
    advisories: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)
    adjustments: tuple[Adjustment, ...] = ()
    violations: tuple[Violation, ...] = ()

    @property
    def final(self) -> Decimal:
        """The points earned, with all adjustments."""
        return self.score.earned + sum((a.points for a in self.adjustments), Decimal(0))

    @property
    def still_undecided(self) -> Decimal:
        """The undecided points of checks that no person has decided since, by themselves or by their criterion."""
        by_hand = (AdjustmentKind.POINTS, AdjustmentKind.EXCUSED)
        decided = {a.what for a in self.adjustments if a.kind in by_hand}
        checks = (check for c in self.criteria if c.id not in decided for check in c.checks)
        return sum((check.undecided for check in checks if check.id not in decided), Decimal(0))

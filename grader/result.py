"""The result of judging a submission, and `result.json`: written, described by a schema and read by these classes alone.

Everything here is a frozen value. Points are `Decimal`; a finding carries *credit* (a share of
a check's points between 0 and 1), because checks know nothing of points.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields
from decimal import Decimal
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired

from pydantic import (
    ConfigDict,
    Field,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    with_config,
)
from typing_extensions import TypedDict

from grader.errors import RecordingError
from grader.json_text import json_text

RESULT_SCHEMA = "ros-lab-grader/result/v1"


def number(value: Decimal) -> int | float:
    """Return points as a JSON number: whole where they are whole."""
    return int(value) if value == value.to_integral_value() else float(value)


#: Beyond all points, and all seconds of a session.
_MOST = 10**9
_NUMBER = PlainSerializer(number)
#: Points that somebody has, and the change of points by an adjustment.
Points = Annotated[
    Decimal, Field(ge=0, le=_MOST), _NUMBER, WithJsonSchema({"type": "number", "minimum": 0})
]
Change = Annotated[Decimal, Field(ge=-_MOST, le=_MOST), _NUMBER, WithJsonSchema({"type": "number"})]
#: A share of a check's points, from 0 to 1.
Credit = Annotated[
    Decimal,
    Field(ge=0, le=1),
    _NUMBER,
    WithJsonSchema({"type": "number", "minimum": 0, "maximum": 1}),
]
#: Seconds since the session's start.
Seconds = Annotated[
    float,
    Field(ge=-_MOST, le=_MOST),
    PlainSerializer(lambda value: round(value, 3)),
    WithJsonSchema({"type": "number"}),
]


class Outcome(StrEnum):
    """The outcome of one check. `EXCUSED`, `INCONCLUSIVE` and `ERROR` never cost points."""

    PASSED = "passed"
    #: Wrong; another check charges the same mistake.
    EXCUSED = "excused"
    PARTIAL = "partial"
    FAILED = "failed"
    NOT_REACHED = "not_reached"
    INCONCLUSIVE = "inconclusive"
    ERROR = "error"

    @property
    def decided(self) -> bool:
        """True if this outcome says something about the student's work."""
        return self not in (Outcome.INCONCLUSIVE, Outcome.ERROR)

    @property
    def took_points(self) -> bool:
        """True if a measurement took points, all or some."""
        return self in (Outcome.FAILED, Outcome.PARTIAL)

    @property
    def goes_on(self) -> bool:
        """True if checks that require this one can be judged."""
        return self in (Outcome.PASSED, Outcome.EXCUSED, Outcome.PARTIAL)


def outcome_of_points(earned: Decimal, possible: Decimal, undecided: Decimal) -> Outcome:
    """Return the outcome of a whole, such as a criterion, by its points."""
    lost = possible - earned - undecided
    if undecided and not lost:
        return Outcome.INCONCLUSIVE
    if earned == possible:
        return Outcome.PASSED
    return Outcome.PARTIAL if earned or not lost else Outcome.FAILED


@dataclass(frozen=True)
class Location:
    """Where the proof of a finding lies: a line, from 1, of a file in the submission, or a place in a recording.

    There that is a topic or service, or the output of a process, in a span in seconds since the session's start.
    """

    file: str | None = None
    line: int | None = None
    session: str | None = None
    topic: str | None = None
    process: str | None = None
    start_s: Seconds | None = None
    end_s: Seconds | None = None

    def __str__(self) -> str:
        file = self.file
        if self.line:
            file = f"{self.file}:{self.line}"
        output = f"output of {self.process}" if self.process else ""
        recording = f"recording '{self.session}'" if self.session else ""
        return ", ".join(part for part in (file, output, recording, self.topic, self.span) if part)

    @property
    def span(self) -> str:
        """When it is, in words; empty where that is not known."""
        if self.start_s is None:
            return ""
        if self.end_s is None or self.end_s == self.start_s:
            return f"at {self.start_s:.3f} s"
        # A call takes a thousandth of a window's time.
        places = 3
        if self.end_s - self.start_s >= 1.0:
            places = 1
        return f"{self.start_s:.{places}f}–{self.end_s:.{places}f} s"


@dataclass(frozen=True)
class Finding:
    """The finding of one check."""

    outcome: Outcome
    #: Share of the check's points: 1 when passed, 0 when failed.
    credit: Decimal
    #: One line each, with units and the error of the measurement.
    expected: str = ""
    measured: str = ""
    #: Why points were lost, in a sentence, and how to fix it; empty when passed. It goes before the rubric's hint.
    reason: str = ""
    hint: str = ""
    where: tuple[Location, ...] = ()
    #: Advisories that cost nothing.
    notes: tuple[str, ...] = ()
    #: True if another recording can decide an undecided finding.
    retry: bool = True
    #: Finding in place of an undecided one after three recordings, because the student's own processes can cause the
    #: doubt; None if only the machine can cause it, or if a person has to decide.
    settled: Finding | None = None
    #: A line for each part that was counted, and for each that was not.
    counted: tuple[str, ...] = ()
    #: Id of the failed check that kept this one from being tested.
    blocked_by: str | None = None
    #: A reported claim that nothing measured, in a sentence, for a person to judge.
    unmeasured: str | None = None
    #: True if a crash, an early end or a limit of the program, if there was one, explains it better.
    unexplained: bool = False
    #: Share of the credit that checks which require this one can earn; None if the outcome tells. It is 0 if nothing
    #: reaches the program although this check earns a part, and 0.75 if a failed file was repaired on a copy.
    passes_on: Decimal | None = None
    #: True if an endpoint is in the graph and sent nothing. Checks of endpoints that require this one can be
    #: judged.
    is_silent: bool = False
    #: Names of the mistakes behind the loss; the dearest check of each name charges it.
    causes: tuple[str, ...] = ()
    #: Ids of the checks that charge a mistake which costs nothing here.
    charged_by: tuple[str, ...] = ()
    #: Name of the rule that decided; see `grader.judging.rules`.
    decided_by: str | None = None


class ViolationKind(StrEnum):
    """A kind of tampering with the grader's own endpoints or processes in a session."""

    IMPERSONATES_NODE = "impersonates_node"
    PUBLISHES_ON_REFERENCE_TOPIC = "publishes_on_reference_topic"
    SPOOFS_CLOCK = "spoofs_clock"
    SECOND_SERVER = "second_server"
    CHANGES_REFERENCE = "changes_reference"
    FORGES_ROSOUT = "forges_rosout"
    FORGES_PARAMETER_EVENTS = "forges_parameter_events"
    ENDS_REFERENCE = "ends_reference"
    DISTURBS_RECORDING = "disturbs_recording"

    @property
    def disturbs(self) -> bool:
        """True if it makes the recording unsound: one occurrence is not conclusive; the session is repeated."""
        return self in (ViolationKind.ENDS_REFERENCE, ViolationKind.DISTURBS_RECORDING)


@dataclass(frozen=True)
class Violation:
    """Tampering with the grader's own in a session: a fact, for a person to judge; not an intent."""

    kind: ViolationKind
    session: str
    text: str
    #: Evidence: nodes, gids, counts, times.
    evidence: tuple[str, ...] = ()
    where: Location = Location()
    #: True if the recording leaves no other explanation than the submission's own processes.
    certain: bool = True
    #: Ids of the checks that fail because of tampering with the measured object.
    checks: tuple[str, ...] = ()


@dataclass(frozen=True)
class CheckResult:
    """The finding of one check, as in `Finding`, with its points by the rubric.

    Points that nobody could decide are neither earned nor lost.
    """

    id: str
    title: str
    outcome: Outcome
    earned: Points
    possible: Points
    undecided: Points
    expected: str = ""
    measured: str = ""
    reason: str = ""
    hint: str = ""
    where: tuple[Location, ...] = ()
    notes: tuple[str, ...] = ()
    counted: tuple[str, ...] = ()
    session: str | None = None
    credit: Credit = Decimal(0)
    #: Commands that show a student the cause of the lost points.
    commands: tuple[str, ...] = ()
    #: Id of the failed check that kept this one from being tested.
    blocked_by: str | None = None
    #: Ids of the checks that charge a mistake which costs nothing here; None without such a mistake.
    charged_by: tuple[str, ...] | None = None
    #: A reported claim that nothing measured, in a sentence, for a person to judge.
    unmeasured: str | None = None
    #: Name of the rule that decided; None in results of earlier versions.
    decided_by: str | None = None
    #: True if a mistake here can hurt people or damage hardware; None otherwise.
    endangers: bool | None = None
    retry: Annotated[bool, Field(exclude=True)] = True

    @classmethod
    def of(cls, finding: Finding, **known: Any) -> CheckResult:
        """Return a finding with `known` values added: the check's id, title and session, and its points."""
        judged = {field.name for field in fields(cls)}
        found = {name: value for name, value in vars(finding).items() if name in judged}
        return cls(**{**found, **known})

    @property
    def try_again(self) -> str:
        """The command that tests it once more, in the submission's folder."""
        return f"grade . --sessions {self.session}" if self.session else "grade ."

    @property
    def lost(self) -> Decimal:
        """Points that are neither earned nor undecided."""
        return self.possible - self.earned - self.undecided

    @property
    def share(self) -> float | None:
        """Share of its points, from 0 to 1; None if it is undecided or has none."""
        if self.outcome.decided and self.possible:
            return float(self.earned / self.possible)
        return None


@dataclass(frozen=True)
class CriterionResult:
    """One criterion of the rubric with its checks' results; points are sums over the checks."""

    id: str
    title: str
    earned: Points
    possible: Points
    undecided: Points
    checks: tuple[CheckResult, ...]
    description: str = ""

    @property
    def outcome(self) -> Outcome:
        """The outcome of the criterion as a whole."""
        return outcome_of_points(self.earned, self.possible, self.undecided)


class AdjustmentKind(StrEnum):
    """The cause of a change of the points after the judgement."""

    POINTS = "points"
    EXCUSED = "excused"
    #: A person looked at it, and it stays as it was.
    REVIEWED = "reviewed"
    #: A student's request for a review by a person; the reason is the question.
    APPEAL = "appeal"
    BONUS = "bonus"
    SUBMITTED = "submitted"
    EXTENSION = "extension"
    LATE = "late"


@dataclass(frozen=True)
class Adjustment:
    """One change of the points after the judgement, by a named person or by the rubric's policy."""

    kind: AdjustmentKind
    #: Id of a check or a criterion, a due date, or "score" for the whole.
    what: str
    points: Change
    reason: str = ""
    who: str = ""
    when: str = ""
    #: Remark for the student, shown at the check or criterion.
    comment: str = ""


@dataclass(frozen=True)
class ChosenFile:
    """A file that was graded, of several that have the name of one of the lab's."""

    #: The file name that the lab asks for.
    expected: str
    path: str
    #: Files of the same name that were not graded.
    others: tuple[str, ...]
    #: The reason, as a clause.
    why: str
    #: True if nothing told them apart, and a person must look.
    is_open: bool = False


@dataclass(frozen=True)
class Timing:
    """When a submission was due and handed in, as the rubric's policy of lateness sees it."""

    #: With all extensions, e.g. "2026-11-20 23:59 +01:00".
    due: str
    #: The same without extensions; empty if there are none.
    due_for_all: str = ""
    #: In the same form, without offset if none is known; empty if nothing tells the time.
    submission_time: str = ""
    #: The source of that time, in words.
    source: str = ""
    #: The time of the newest file in the archive, for a person; it proves nothing.
    newest_file: str = ""
    #: The time of the last commit in the repository, for a person; it proves nothing.
    last_commit: str = ""
    #: The learning-management system that marks the submission as late; empty for none.
    marked_late_by: str = ""
    #: True if it was handed in after it was due; None if unknown.
    late: bool | None = None
    #: True if a person should look, because it may have been handed in late.
    may_be_late: bool = False

    @property
    def text(self) -> str:
        """All of it in a sentence."""
        due = f"due {self.due}"
        if self.due_for_all:
            due += f" (extended from {self.due_for_all})"
        if not self.submission_time:
            return "; ".join(["Time of submission not known", *self.clues, f"{due}."])
        verdicts = {True: "late", False: "in time", None: "not known whether in time"}
        known = f"Handed in {self.submission_time} (by {self.source})"
        text = f"{known}, {due}: {verdicts[self.late]}."
        if self.marked_late_by:
            text += f" {self.marked_late_by} marks it as late."
        return text

    @property
    def clues(self) -> tuple[str, ...]:
        """All signs of the time of submission that do not prove it, in words."""
        clues = []
        if self.marked_late_by:
            clues.append(f"{self.marked_late_by} marks it as late")
        if self.newest_file:
            clues.append(f"the newest file in it says {self.newest_file}")
        if self.last_commit:
            clues.append(f"the last commit says {self.last_commit}")
        return tuple(clues)


@dataclass(frozen=True)
class Score:
    """Points earned, possible, and undecided through no fault of the student's; as judged, before adjustments."""

    earned: Points
    possible: Points
    undecided: Points


@with_config(ConfigDict(extra="allow"))
class SessionProvenance(TypedDict):
    """When a session was recorded, how it was confined, the CPU time in s by role, and process -> limit that it hit."""

    started_ns: Annotated[int, Field(ge=0, lt=2**63)]
    duration_s: float
    isolation: str
    seed: NotRequired[int]
    cpu_s: NotRequired[dict[Literal["student", "reference", "grader"], float]]
    limits: NotRequired[dict[str, str]]


@with_config(ConfigDict(extra="allow"))
class PastScore(TypedDict):
    """Final points of a previous submission, the time of its recording, and the hash of its rubric."""

    #: Start of its first session; 0 if it has none.
    recorded_ns: Annotated[int, Field(ge=0, lt=2**63)]
    earned: float
    undecided: float
    possible: float
    rubric_sha256: str


@with_config(ConfigDict(extra="allow"))
class Provenance(TypedDict, total=False):
    """Where a result comes from: versions and hashes, the recorded sessions, and files that were not looked at.

    `handout_ros` is the distribution of ROS that the lab's handout was written for, as the rubric names it.
    """

    grader: str
    lab: str
    rubric_sha256: str
    #: Hash of the rubric and all files that it names.
    lab_sha256: str
    submission_sha256: str
    versions: dict[str, str]
    handout_ros: str
    sessions: dict[str, SessionProvenance]
    left_out: list[str]
    #: The student's previous submissions, oldest first.
    previous: list[PastScore]


#: Adjustments of the points of a check or a criterion by a person, not by a rule.
BY_HAND = (AdjustmentKind.POINTS, AdjustmentKind.EXCUSED)
#: Adjustments that answer a review, with any outcome.
ANSWERS = (*BY_HAND, AdjustmentKind.REVIEWED)
#: Target of an adjustment that concerns neither a check nor a criterion.
WHOLE = "score"
#: Name of the rule that takes the finding of the check itself.
MEASURED = "measured"
#: Opening of a note that asks a person to look.
FOR_A_PERSON = "For a person to read:"
#: Beginning of the last line of a summary in Markdown; the line tells a summary from a text of a student's.
EVIDENCE_LINE = "The evidence for each point is in `report.html`"


@dataclass(frozen=True)
class Result:
    """The judgement of one submission, called as its folder is."""

    submission: str
    lab: str
    score: Score
    criteria: tuple[CriterionResult, ...]
    #: Remarks for the student that cost nothing.
    advisories: tuple[str, ...] = ()
    #: Faults on the grader's side; never cost points.
    problems: tuple[str, ...] = ()
    provenance: Provenance = field(default_factory=Provenance)
    #: Adjustments in order of application.
    adjustments: tuple[Adjustment, ...] = ()
    #: Submitted extensions; their points are in no sum.
    bonus: tuple[CriterionResult, ...] = ()
    violations: tuple[Violation, ...] = ()
    #: Graded files with namesakes among the submitted files.
    chosen: tuple[ChosenFile, ...] = ()
    #: None if the rubric states no cost of lateness.
    timing: Timing | None = None

    @property
    def final(self) -> Decimal:
        """The points earned, with all adjustments."""
        return self.score.earned + sum((a.points for a in self.adjustments), Decimal(0))

    @property
    def checks(self) -> tuple[CheckResult, ...]:
        """All checks that the points are of, in the rubric's order."""
        return tuple(check for criterion in self.criteria for check in criterion.checks)

    @property
    def every_check(self) -> tuple[CheckResult, ...]:
        """All checks, including the bonus."""
        return (*self.checks, *(check for criterion in self.bonus for check in criterion.checks))

    def final_of(self, criterion: CriterionResult) -> Decimal:
        """Return the points earned in a criterion, with people's decisions on it and its checks."""
        of = {criterion.id, *(check.id for check in criterion.checks)}
        decided = (a.points for a in self.adjustments if a.kind in BY_HAND and a.what in of)
        return criterion.earned + sum(decided, Decimal(0))

    @property
    def beside_criteria(self) -> Decimal:
        """The points that belong to no criterion, such as a bonus, and those lost by lateness."""
        return self.final - sum(map(self.final_of, self.criteria), Decimal(0))

    @property
    def open_checks(self) -> tuple[CheckResult, ...]:
        """Undecided checks that no person has decided since, by themselves or by their criterion."""
        decided = {a.what for a in self.adjustments if a.kind in BY_HAND}
        checks = (
            check
            for criterion in self.criteria
            if criterion.id not in decided
            for check in criterion.checks
        )
        return tuple(check for check in checks if check.undecided and check.id not in decided)

    @property
    def still_undecided(self) -> Decimal:
        """The points of the checks that are open."""
        return sum((check.undecided for check in self.open_checks), Decimal(0))

    @property
    def rubric_sha256(self) -> str:
        """Hash of the rubric that it was judged by; empty if that is not known."""
        return self.provenance.get("rubric_sha256", "")

    @property
    def lab_sha256(self) -> str:
        """Hash of that rubric and all files that it names; empty if that is not known."""
        return self.provenance.get("lab_sha256", "")


# -- result.json -------------------------------------------------------------------------------


@cache
def _adapter() -> TypeAdapter[Result]:
    return TypeAdapter(Result)


def to_plain(result: Result) -> dict[str, Any]:
    """Return a result as plain data of the schema `ros-lab-grader/result/v1`."""
    plain: dict[str, Any] = _adapter().dump_python(result, mode="json", exclude_none=True)
    plain["score"]["final"] = number(result.final)
    return {"schema": RESULT_SCHEMA, **plain}


def to_json(result: Result) -> str:
    """Return `result.json`'s text; equal results give equal bytes."""
    return json_text(to_plain(result))


def read_result(plain: Any) -> Result:
    """Read the plain data of `result.json`; raises RecordingError if it is not a result of this version.

    Keys that this version does not know are passed over, so that a later `result.json` can be read too.
    """
    try:
        if not isinstance(plain, Mapping) or plain.get("schema") != RESULT_SCHEMA:
            raise ValueError(f"its schema is not {RESULT_SCHEMA}")
        return _adapter().validate_python(plain)
    except ValueError as problem:
        words = str(problem)
        if isinstance(problem, ValidationError):
            first = problem.errors(include_url=False, include_input=False)[0]
            words = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        remedy = f"Run `grade regrade` on the results folder. ({words})"
        raise RecordingError(
            "this is not a result of this version of grade", remedy=remedy
        ) from None


def load_result(file: Path) -> Result:
    """Read a file `result.json`; raises RecordingError if it cannot be read, FileNotFoundError if it is not there."""
    try:
        return read_result(json.loads(file.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise
    except (OSError, ValueError, RecursionError) as problem:
        remedy = "Run `grade regrade` on the results folder."
        raise RecordingError(
            f"{file.name} cannot be read", location=str(file), remedy=remedy
        ) from problem


def result_of_text(text: str | None) -> Result | None:
    """Return the result of a `result.json`'s text; None if there is none, or none of this version."""
    with suppress(RecordingError, ValueError, RecursionError):
        if text is None:
            return None
        return read_result(json.loads(text))
    return None


def result_schema() -> dict[str, Any]:
    """Return the JSON Schema of `result.json`, as it is written."""
    schema = _adapter().json_schema(mode="serialization")
    schema["properties"] = {"schema": {"const": RESULT_SCHEMA}, **schema["properties"]}
    final = {"type": "number", "minimum": 0, "description": "Points with all adjustments."}
    schema["$defs"]["Score"]["properties"]["final"] = final
    for part in (schema, *schema["$defs"].values()):
        if (
            "properties" in part
        ):  # Unknown values are left out, not written as null; all others are always there.
            nullable = {
                name
                for name, of in part["properties"].items()
                if {"type": "null"} in of.get("anyOf", ())
            }
            part["required"] = [name for name in part["properties"] if name not in nullable]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": RESULT_SCHEMA,
        **schema,
    }

"""`rubric.yaml` → `Rubric`: typed, and with all its mistakes reported at once, by line.

The rubric knows the lab: its names, rates, steps and points. Nothing of a lab stands in Python here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field, ValidationError, model_validator

from grader.lined_yaml import Loc, Strict, cannot_be_read, parse_yaml
from grader.policy import Policy


class LabSpec(Strict):
    """What the lab is called, how many points it has, and the package name of bare files."""

    id: str
    title: str
    points: Decimal
    package: str = Field("student_lab", description="Package under which bare files are installed.")
    solution: str | None = Field(None, description="Folder of a submission that earns all points.")


class ArtifactSpec(Strict):
    """A file that students hand in."""

    file: str = Field(description="The name that the lab asks for.")
    find: tuple[str, ...] = Field((), description="Patterns, best first; '**/x' matches x in any folder.")
    executable: str | None = Field(None, description="Name under which it is installed as an executable.")
    contains: tuple[str, ...] = Field((), description="Words that give the file away when its name is another.")

    @model_validator(mode="before")
    @classmethod
    def _default_patterns(cls, data: Any) -> Any:
        if isinstance(data, dict) and "find" not in data and isinstance(data.get("file"), str):
            return {**data, "find": (data["file"], f"**/{data['file']}")}
        return data


class ReferenceSpec(Strict):
    """A reference node: a program beside the rubric, started with a JSON configuration as its argument."""

    file: str
    node: str = Field(description="Fully qualified name of its node; all other nodes are the student's.")


class StartStep(Strict):
    """Start a student's artifact, the processes of a launch plan, or a reference node."""

    student: str | None = None
    launch: str | None = None
    reference: str | None = None
    name: str | None = Field(None, description="Name of the process; the artifact's or node's by default.")
    parameters: dict[str, Any] = Field(default_factory=dict, description="ROS parameters (student only).")
    remappings: dict[str, str] = Field(default_factory=dict, description="Name remappings (student only).")
    composed: dict[str, str] = Field(
        default_factory=dict, description="Name remappings besides, where the artifact's file holds others too."
    )
    if_ended: bool = Field(False, description="Start it again only if it has ended.")
    with_: dict[str, Any] = Field(default_factory=dict, alias="with", description="Settings (reference only).")

    @model_validator(mode="after")
    def _one_of_three(self) -> StartStep:
        if sum(x is not None for x in (self.student, self.launch, self.reference)) != 1:
            raise ValueError("exactly one of student, launch, reference is needed")
        return self


class WaitForStep(Strict):
    """Wait for a node, an endpoint, a service or a line of output; near misses of a name are found."""

    node: str | None = None
    publisher: str | None = None
    subscription: str | None = None
    service: str | None = None
    output_of: str | None = Field(None, description="Process whose output is watched.")
    text: str | None = Field(None, description="Text that the line holds (with output_of).")
    type: str | None = None
    timeout_s: float = Field(10.0, gt=0, le=300)

    @model_validator(mode="after")
    def _one_target(self) -> WaitForStep:
        targets = (self.node, self.publisher, self.subscription, self.service, self.output_of)
        if sum(x is not None for x in targets) != 1:
            raise ValueError("exactly one of node, publisher, subscription, service, output_of is needed")
        return self


class ObserveStep(Strict):
    """Let the system run for a time; the window opens with the first message on `first_message_on`."""

    duration_s: float = Field(gt=0, le=300)
    first_message_on: str | None = None
    timeout_s: float = Field(5.0, gt=0, le=300, description="How long the first message may take.")


class PublishStep(Strict):
    """Publish one message some times, offered so that every subscription is compatible."""

    topic: str
    type: str
    message: dict[str, Any]
    count: int = Field(10, ge=1, le=10_000)
    rate_hz: float = Field(100.0, gt=0, le=1000)


class CallStep(Strict):
    """Call a service; keeps each request, response and latency."""

    service: str
    type: str
    request: dict[str, Any] = Field(default_factory=dict)
    repeat: int = Field(1, ge=1, le=10_000)
    clients: int = Field(1, ge=1, le=16)
    timeout_s: float = Field(5.0, gt=0, le=60, description="For each call.")
    at_most_s: float = Field(30.0, gt=0, le=300, description="For all of them; what is not called by then is left.")


class GetParametersStep(Strict):
    """Read parameters of a student's node through its parameter services."""

    node: str
    names: tuple[str, ...]
    timeout_s: float = Field(5.0, gt=0, le=60)


class SetParametersStep(Strict):
    """Set parameters of a student's node through its parameter services."""

    node: str
    values: dict[str, Any]
    timeout_s: float = Field(5.0, gt=0, le=60)


class InterruptStep(Strict):
    """Send SIGINT, as Ctrl-C would, and wait for the exit; '*' means all of the student's processes."""

    process: str
    timeout_s: float = Field(4.0, gt=0, le=60)


class WaitExitStep(Strict):
    """Wait for a process to end by itself."""

    process: str
    timeout_s: float = Field(20.0, gt=0, le=600)


class PlanStep(Strict):
    """Evaluate a launch file with arguments, without starting what it describes."""

    launch: str
    arguments: dict[str, str] = Field(default_factory=dict)
    assume: dict[str, str] = Field(
        default_factory=dict, description="Values for arguments that the file uses without declaring them."
    )
    timeout_s: float = Field(10.0, gt=0, le=60)


STEP_KINDS: dict[str, type[Strict]] = {
    "start": StartStep,
    "wait_for": WaitForStep,
    "observe": ObserveStep,
    "publish": PublishStep,
    "call": CallStep,
    "get_parameters": GetParametersStep,
    "set_parameters": SetParametersStep,
    "interrupt": InterruptStep,
    "wait_exit": WaitExitStep,
    "plan": PlanStep,
}


@dataclass(frozen=True)
class Step:
    """One step of a session.

    Attributes
    ----------
    parameters : dict
        The validated value of the step's key, as plain data with its defaults.
    label : str or None
        By which checks refer to the step.
    """

    kind: str
    parameters: dict[str, Any]
    label: str | None = None


@dataclass(frozen=True)
class SessionSpec:
    """One experiment on a part of the submission.

    Attributes
    ----------
    needs : tuple of str
        Artifacts that its steps start.
    typical_s : float
        How long it takes with a correct submission; the longest session is started first.
    timeout_s : float
        When it is given up.
    """

    id: str
    title: str
    steps: tuple[Step, ...]
    needs: tuple[str, ...] = ()
    typical_s: float = 10.0
    timeout_s: float = 90.0


@dataclass(frozen=True)
class CheckSpec:
    """One check with its points; `parameters` is of the model that the check declares."""

    id: str
    title: str
    points: Decimal
    check: str
    parameters: BaseModel
    session: str | None = None
    requires: tuple[str, ...] = ()
    hint: str = ""


class FigureSpec(Strict):
    """A picture in the report, drawn from a session's recording."""

    kind: str
    title: str
    session: str
    with_: dict[str, Any] = Field(default_factory=dict, alias="with")


@dataclass(frozen=True)
class CriterionSpec:
    """A row of the lab's point table."""

    id: str
    title: str
    points: Decimal
    description: str
    checks: tuple[CheckSpec, ...]
    figures: tuple[FigureSpec, ...] = ()


@dataclass(frozen=True)
class Rubric:
    """A validated rubric.

    Attributes
    ----------
    folder : Path
        Folder from which `reference` paths are resolved.
    text : str
        The YAML text, a copy of which travels with each recording.
    policy : Policy
        What lateness costs.
    """

    lab: LabSpec
    artifacts: dict[str, ArtifactSpec]
    reference: dict[str, ReferenceSpec]
    sessions: dict[str, SessionSpec]
    criteria: tuple[CriterionSpec, ...]
    folder: Path
    text: str
    policy: Policy = field(default_factory=Policy)

    @property
    def sha256(self) -> str:
        """Hash of the rubric's text."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def checks(self) -> Iterable[CheckSpec]:
        """All checks, in the rubric's order."""
        return (check for criterion in self.criteria for check in criterion.checks)


def load_rubric(
    path: Path, parameters_of: Mapping[str, type[BaseModel]], folder: Path | None = None, *, only: bool = False
) -> Rubric:
    """Read and validate a rubric.

    Parameters
    ----------
    path : Path
        The YAML file.
    parameters_of : mapping
        Check name -> model of its parameters.
    folder : Path, optional
        Where `reference` files are looked up if they are not beside the rubric.
    only : bool
        Whether they are looked up in `folder` alone, since what lies beside the rubric is not to be executed.

    Raises
    ------
    RubricError
        With every mistake, each with file and line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise cannot_be_read("the rubric", path, problem, "Check --rubric.") from problem
    return _Loader(path, text, parameters_of, folder, only).load()


class _Loader:
    def __init__(
        self,
        path: Path,
        text: str,
        parameters_of: Mapping[str, type[BaseModel]],
        folder: Path | None,
        only: bool,
    ) -> None:
        self.path, self.text, self.parameters_of = path, text, parameters_of
        self.beside = folder if only and folder is not None else path.resolve().parent
        self.fallback = folder
        self.plain, self.mistakes = parse_yaml(path, text, "the rubric")

    def load(self) -> Rubric:
        allowed = {"lab", "artifacts", "reference", "sessions", "criteria", "policy"}
        for key in self.plain:
            if key not in allowed:
                self.mistakes.add((key,), f"unknown key; known are {', '.join(sorted(allowed))}")
        lab = self._model(LabSpec, ("lab",), self.plain.get("lab"))
        artifacts = self._models(ArtifactSpec, "artifacts")
        reference = self._models(ReferenceSpec, "reference")
        sessions = {
            str(k): self._session(str(k), v, artifacts, reference) for k, v in self._mapping("sessions").items()
        }
        criteria = tuple(self._criteria(sessions))
        policy = self._model(Policy, ("policy",), self.plain.get("policy"))
        self._check_whole(lab, criteria)
        folder = self._folder(reference)
        self.mistakes.raise_any("`grade checks` lists every check with its parameters.")
        return Rubric(lab, artifacts, reference, sessions, criteria, folder, self.text, policy)

    def _folder(self, reference: Mapping[str, ReferenceSpec]) -> Path:
        beside = self.beside
        for folder in (beside, self.fallback):
            if folder is not None and all((folder / spec.file).is_file() for spec in reference.values()):
                return folder
        for name, spec in reference.items():
            if not (beside / spec.file).is_file():
                self.mistakes.add(("reference", name, "file"), f"there is no file {spec.file} beside the rubric")
        return beside

    def _mapping(self, key: str) -> dict[Any, Any]:
        value = self.plain.get(key, {})
        if isinstance(value, dict):
            return value
        self.mistakes.add((key,), "a mapping is expected")
        return {}

    def _list(self, loc: Loc, value: Any) -> list[Any]:
        if isinstance(value, list):
            return value
        self.mistakes.add(loc, "a list is expected")
        return []

    def _model(self, model: type[Any], loc: Loc, value: Any) -> Any:
        try:
            return model.model_validate(value if value is not None else {})
        except ValidationError as error:
            self.mistakes.add_validation(loc, error)
            return None

    def _models(self, model: type[Any], key: str) -> dict[str, Any]:
        parsed = {str(k): self._model(model, (key, k), v) for k, v in self._mapping(key).items()}
        return {k: v for k, v in parsed.items() if v is not None}

    def _session(
        self, name: str, value: Any, artifacts: Mapping[str, Any], reference: Mapping[str, Any]
    ) -> SessionSpec:
        loc: Loc = ("sessions", name)
        if not isinstance(value, dict):
            self.mistakes.add(loc, "a mapping is expected")
            return SessionSpec(name, name, ())
        for key in set(value) - {"title", "steps", "typical_s", "timeout_s"}:
            self.mistakes.add((*loc, key), "unknown key; known are title, steps, typical_s, timeout_s")
        steps = tuple(
            step
            for index, raw in enumerate(self._list((*loc, "steps"), value.get("steps")))
            if (step := self._step((*loc, "steps", index), raw, artifacts, reference)) is not None
        )
        needs = [s.parameters["student"] or s.parameters["launch"] for s in steps if s.kind == "start"]
        needs += [s.parameters["launch"] for s in steps if s.kind == "plan"]
        times = {key: value[key] for key in ("typical_s", "timeout_s") if key in value}
        for key, time_s in times.items():
            if isinstance(time_s, bool) or not isinstance(time_s, (int, float)) or time_s <= 0:
                self.mistakes.add((*loc, key), "a time in seconds is expected")
                times[key] = 1.0
        return SessionSpec(
            name, str(value.get("title", name)), steps, tuple(dict.fromkeys(n for n in needs if n)), **times
        )

    def _step(self, loc: Loc, raw: Any, artifacts: Mapping[str, Any], reference: Mapping[str, Any]) -> Step | None:
        kinds = [k for k in raw if k != "label"] if isinstance(raw, dict) else []
        if len(kinds) != 1 or kinds[0] not in STEP_KINDS:
            self.mistakes.add(
                loc, f"a step has one key of {', '.join(STEP_KINDS)}, and a label where checks refer to it"
            )
            return None
        kind = kinds[0]
        model = self._model(STEP_KINDS[kind], (*loc, kind), raw[kind])
        if model is None:
            return None
        parameters = model.model_dump(mode="json", by_alias=True)
        for key, known in (("student", artifacts), ("launch", artifacts), ("reference", reference)):
            if parameters.get(key) is not None and parameters[key] not in known:
                self.mistakes.add((*loc, kind, key), f"{parameters[key]!r} is not defined above")
        label = raw.get("label")
        if label is not None and not isinstance(label, str):
            self.mistakes.add((*loc, "label"), "a name is expected")
        return Step(kind, parameters, label)

    def _criteria(self, sessions: Mapping[str, SessionSpec]) -> Iterable[CriterionSpec]:
        earlier: set[str] = set()
        for index, raw in enumerate(self._list(("criteria",), self.plain.get("criteria"))):
            loc: Loc = ("criteria", index)
            if not isinstance(raw, dict):
                self.mistakes.add(loc, "a mapping is expected")
                continue
            for key in set(raw) - {"id", "title", "points", "description", "checks", "figures"}:
                self.mistakes.add((*loc, key), "unknown key")
            for key in ("id", "title"):
                if not raw.get(key):
                    self.mistakes.add((*loc, key), "it is missing")
            checks = [
                self._check((*loc, "checks", n), check, sessions, earlier)
                for n, check in enumerate(self._list((*loc, "checks"), raw.get("checks")))
            ]
            found = tuple(check for check in checks if check is not None)
            points = self._points((*loc, "points"), raw.get("points"))
            total = sum((check.points for check in found), Decimal(0))
            if len(found) == len(checks) and total != points:
                self.mistakes.add((*loc, "points"), f"the checks' points add up to {total}, not to {points}")
            figures = tuple(
                figure
                for n, item in enumerate(self._list((*loc, "figures"), raw.get("figures", [])))
                if (figure := self._figure((*loc, "figures", n), item, sessions)) is not None
            )
            yield CriterionSpec(
                str(raw.get("id")),
                str(raw.get("title")),
                points,
                str(raw.get("description", "")),
                found,
                figures,
            )

    def _figure(self, loc: Loc, raw: Any, sessions: Mapping[str, SessionSpec]) -> FigureSpec | None:
        figure: FigureSpec | None = self._model(FigureSpec, loc, raw)
        if figure is not None and figure.session not in sessions:
            self.mistakes.add((*loc, "session"), f"there is no session {figure.session!r}")
        return figure

    def _points(self, loc: Loc, value: Any) -> Decimal:
        if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value < float("inf"):
            return Decimal(str(value))
        self.mistakes.add(loc, "a number of points is expected")
        return Decimal(0)

    def _check(self, loc: Loc, raw: Any, sessions: Mapping[str, SessionSpec], earlier: set[str]) -> CheckSpec | None:
        if not isinstance(raw, dict):
            self.mistakes.add(loc, "a mapping is expected")
            return None
        for key in set(raw) - {"id", "title", "points", "session", "check", "with", "requires", "hint"}:
            self.mistakes.add((*loc, key), "unknown key")
        identity = str(raw.get("id"))
        if not raw.get("id") or identity in earlier:
            self.mistakes.add((*loc, "id"), f"{identity!r} is missing or used twice")
        requires = tuple(str(r) for r in self._list((*loc, "requires"), raw.get("requires") or []))
        for required in requires:
            if required not in earlier:
                self.mistakes.add((*loc, "requires"), f"{required!r} is no earlier check")
        earlier.add(identity)
        session = raw.get("session")
        if session is not None and not (isinstance(session, str) and session in sessions):
            self.mistakes.add((*loc, "session"), f"there is no session {session!r}")
        points = self._points((*loc, "points"), raw.get("points"))
        parameters = self._parameters(loc, raw)
        if parameters is None:
            return None
        return CheckSpec(
            identity,
            str(raw.get("title", identity)),
            points,
            str(raw["check"]),
            parameters,
            session,
            requires,
            str(raw.get("hint", "")),
        )

    def _parameters(self, loc: Loc, raw: dict[str, Any]) -> BaseModel | None:
        name = raw.get("check")
        model = self.parameters_of.get(name) if isinstance(name, str) else None
        if model is None:
            known = ", ".join(sorted(self.parameters_of))
            self.mistakes.add((*loc, "check"), f"there is no check {name!r}; known are {known}")
            return None
        parsed: BaseModel | None = self._model(model, (*loc, "with"), raw.get("with", {}))
        return parsed

    def _check_whole(self, lab: LabSpec | None, criteria: tuple[CriterionSpec, ...]) -> None:
        total = sum((criterion.points for criterion in criteria), Decimal(0))
        if lab is not None and total != lab.points:
            self.mistakes.add(("lab", "points"), f"the criteria's points add up to {total}, not to {lab.points}")
        names = [criterion.id for criterion in criteria]
        for name in {n for n in names if names.count(n) > 1}:
            self.mistakes.add(("criteria",), f"the criterion {name!r} stands here twice")

"""The typed model of `rubric.yaml`; all mistakes are reported at once, each with its line.

The rubric contains all facts about a lab: names, rates, steps and points. The grader's code contains none.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from functools import cache, cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    PlainValidator,
    SerializeAsAny,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    create_model,
    field_validator,
    model_validator,
)
from pydantic.json_schema import models_json_schema

from grader.lab.file_patterns import mistake_in
from grader.lab.lab_code import is_own, model_at, own_parameters, require_own
from grader.lab.policy import Policy
from grader.lab.references import (
    CheckId,
    EarlierCheckId,
    FileBeside,
    InterfaceFolder,
    Kinds,
    Level,
    Loadable,
    OwnCheck,
    Parameters,
    RosName,
    Scope,
    SessionId,
    interfaces_in,
    one_of,
    readable_interfaces,
)
from grader.lab.similar_words import suggestion
from grader.lab.steps import STEPS, Step
from grader.lab.yaml_with_lines import Fault, Loc, Strict, mistakes_at, parse_yaml, read_text
from ros_bag.fields import also_defined
from ros_bag.interfaces import InterfacePackage

#: `file.py:function`, beside the rubric.
_OWN_PATTERN = r"\.py:\w+$"
#: `file.py:name`, as a whole value in JSON.
_FUNCTION = re.compile(r'"([^"\\]+\.py:\w+)"')
#: The check that a person makes.
BY_PERSON = "person"
#: Parameters of this check beside `by: person`.
#: Ending of a file with the fingerprints of a text of the handout.
FINGERPRINTS_ENDING = ".sha256"
_GRADED = ("levels", "read")
_REMEDY = "`grade checks` lists every check with its parameters."


def _points(value: Any) -> Decimal:
    is_number = isinstance(value, (int, float, Decimal)) and not isinstance(value, bool)
    if not is_number or not 0 <= value < float("inf"):
        raise ValueError("a number of points is expected")
    return Decimal(str(value))


Points = Annotated[
    Decimal, BeforeValidator(_points), WithJsonSchema({"type": "number", "minimum": 0})
]


def _wrong_sums(plain: Mapping[str, Any]) -> Iterator[Fault]:
    """Find points that differ from the sum of their parts; values that are not numbers are other mistakes."""
    wholes: list[tuple[Loc, Any, str, Any]] = [
        (("lab",), plain.get("lab"), "criteria", plain.get("criteria"))
    ]
    for key in ("criteria", "bonus"):
        rows = plain.get(key)
        if not isinstance(rows, list):
            continue
        for number, row in enumerate(rows):
            if isinstance(row, dict):
                wholes.append(((key, number), row, "checks", row.get("checks")))
    for loc, whole, kind, parts in wholes:
        with suppress(KeyError, TypeError, ValueError):
            total = sum((_points(part["points"]) for part in parts), Decimal(0))
            if total != _points(whole["points"]):
                stated = whole["points"]
                words = f"the {kind}' points add up to {total}, not to {stated}"
                yield (*loc, "points"), words


class LabSpec(Parameters):
    """Name and points of the lab, and the package name for bare files."""

    id: str
    title: str
    points: Points
    package: str = Field("student_lab", description="Package under which bare files are installed.")
    language: Literal["en", "de", "es"] = Field(
        "en",
        description="First language of reports, and language of mails; the class list can name another for a student.",
    )
    ros: str | None = Field(
        None,
        description="Distribution of ROS that the handout was written for; the report names it.",
    )
    build_timeout_s: float = Field(
        90.0,
        gt=0,
        le=100,
        description="Time for `colcon build` of a submission's packages; what takes longer is undecided.",
    )
    environment: str | None = Field(
        None,
        description="Folder of the installation of ROS 2 for students' programs, e.g. `/opt/ros/jazzy`; `grade --ros` has "
        "priority.",
    )
    requirements: tuple[str, ...] = Field(
        (),
        description="Python packages for students' programs besides NumPy and SciPy, in the form of pip, "
        "e.g. `transforms3d>=0.4`; `grade --python lab` installs them.",
    )
    solution: str | None = Field(None, description="Folder of a submission that earns all points.")
    handout: str | None = Field(
        None,
        description="Folder, or file, of the code and the text that students are given. `grade similarity` does not count "
        "this code, and the checks of written texts do not count this text. A `.sha256` file stands for a text that may not "
        "be passed on: `python -m grader.evidence.text.given TEXT` prints its fingerprints.",
    )


def _can_match(pattern: str) -> str:
    mistake = mistake_in(pattern)
    if mistake:
        raise ValueError(mistake)
    return pattern


FilePattern = Annotated[str, AfterValidator(_can_match)]


class ArtifactSpec(Parameters):
    """A file that students submit."""

    file: FilePattern = Field(description="The name that the lab asks for.")
    find: tuple[FilePattern, ...] = Field(
        default_factory=lambda data: (data.get("file"), f"**/{data.get('file')}"),
        description="Patterns, best first: '*' within a name, '**/' any folders, 'x' the file in the root alone.",
    )
    executable: str | None = Field(
        None, description="Name under which it is installed as an executable."
    )
    contains: tuple[str, ...] = Field(
        (),
        description="Words that give the file away when its name is another, or when several have its name.",
    )


class ReferenceSpec(Parameters):
    """A reference node: a program beside the rubric, started with a JSON configuration as its argument."""

    file: FileBeside
    node: RosName = Field(
        description="Fully qualified name of its node; all other nodes are the student's."
    )
    settings: Loadable | None = Field(
        None,
        description="file.py:Class, the dataclass of what a start step may give it; without, all is passed on.",
    )


# -- sessions --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StepSpec:
    """One step of a session, and its label for checks."""

    kind: str
    step: Step
    label: str | None = None

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """The parameters as plain data, with their defaults."""
        return self.step.model_dump(mode="json", by_alias=True)


@cache
def _entry_of(kind: str) -> type[Strict]:
    """Return the model of a step's mapping in the list of steps."""
    model = STEPS[kind]
    fields: dict[str, Any] = {kind: (model, ...), "label": (str | None, None)}
    return create_model(model.__name__, __base__=Parameters, **fields)


def _step(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, StepSpec):
        return value
    kinds = []
    if isinstance(value, dict):
        kinds += [str(key) for key in value if key != "label"]
    if len(kinds) != 1 or kinds[0] not in STEPS:
        near = ""
        if len(kinds) == 1:
            near = suggestion(kinds[0], STEPS)
        raise ValueError(
            f"a step has one key of {', '.join(STEPS)}, and a label where checks refer to it{near}"
        )
    if info.context is not None:
        info.context.session = info.data.get("id")
    kind = kinds[0]
    entry = _entry_of(kind).model_validate(value, context=info.context)
    return StepSpec(kind, getattr(entry, kind), getattr(entry, "label"))  # noqa: B009


class SessionSpec(Parameters):
    """One experiment on a part of the submission."""

    id: str
    title: str = Field(default_factory=lambda data: data.get("id"))
    steps: tuple[
        Annotated[StepSpec, PlainValidator(_step), WithJsonSchema({"$ref": "#/$defs/Step"})], ...
    ]
    typical_s: float = Field(
        10.0,
        gt=0,
        description="How long it takes with a correct submission; the longest session is started first.",
    )
    timeout_s: float = Field(90.0, gt=0, description="Time after which the session is stopped.")

    @model_validator(mode="after")
    def _labels_are_different(self) -> SessionSpec:
        wrong: list[Fault] = []
        earlier: set[str | None] = {None}
        for number, step in enumerate(self.steps):
            if step.label is not None and step.label in earlier:
                wrong.append((("steps", number, "label"), f"{step.label!r} labels an earlier step"))
            earlier.add(step.label)
        if wrong:
            raise mistakes_at(wrong)
        return self

    @property
    def needs(self) -> tuple[str, ...]:
        """Artifacts that the steps start."""
        names: dict[str, None] = {}
        for spec in self.steps:
            if spec.kind not in ("start", "plan"):
                continue
            name = spec.parameters.get("student") or spec.parameters.get("launch")
            if name:
                names[name] = None
        return tuple(names)


# -- criteria --------------------------------------------------------------------------------------


class _OfKind(Parameters):
    """A check or a figure; its kind decides about the parameters under `with`."""

    #: Key of the kind.
    key: ClassVar[str]
    #: Attribute of `Kinds` with the models of parameters.
    models: ClassVar[str]

    @field_validator("check", "kind", check_fields=False)
    @classmethod
    def _is_known(cls, value: str, info: ValidationInfo) -> str:
        if info.context is None:
            return value
        if is_own(value) and cls.own_check(value, info.context) is not None:
            require_own(info.context, value)
        elif cls.own_check(value, info.context) is None:
            one_of(value, cls.key, getattr(info.context.kinds, cls.models))
        return value

    @classmethod
    def own_check(cls, kind: str, scope: Scope) -> OwnCheck | None:
        """Return a check of the lab's own; None if the kind is built in."""
        return None

    @property
    def given(self) -> Parameters:
        """The parameters, of the model of the kind."""
        parameters: Parameters = getattr(self, "parameters")  # noqa: B009
        return parameters

    @field_validator("parameters", mode="before", check_fields=False)
    @classmethod
    def _of_kind(cls, value: Any, info: ValidationInfo) -> Any:
        kind = info.data.get(cls.key)
        if isinstance(value, BaseModel):
            return value
        if kind is None or info.context is None:
            return Parameters()
        info.context.session = info.data.get("session")
        own = cls.own_check(kind, info.context)
        if own is not None:
            return own_parameters(info.context, own, value)
        model: type[Parameters] = getattr(info.context.kinds, cls.models)[kind]
        if model.of_session and info.data.get("session", "") is None:
            raise ValueError(f"{kind} looks at a recording; say which by the key session")
        return model.model_validate({} if value is None else value, context=info.context)


class CheckSpec(_OfKind):
    """One check with its points; `parameters` has the model of the check."""

    key = "check"
    models = "checks"

    id: str = Field(min_length=1)
    title: str = Field(default_factory=lambda data: data.get("id"))
    points: Points
    session: SessionId | None = None
    check: str = Field(
        description="`grade checks` lists them; or file.py:function beside the rubric, of the lab's own."
    )
    parameters: SerializeAsAny[BaseModel] = Field(
        alias="with", default_factory=dict, validate_default=True
    )
    requires: tuple[EarlierCheckId, ...] = ()
    also_in: tuple[SessionId, ...] = Field(
        (),
        description="Other sessions that can show it. If it fails in its own, the checks that require it are judged in "
        "the first of these sessions where it is passed.",
    )
    cause: str | None = Field(
        None,
        description="Name of the mistake. Its dearest check charges it; its other checks are excused.",
    )
    excused_by: tuple[EarlierCheckId, ...] = Field(
        (),
        description="Where one of these checks took points, none are lost here: one mistake costs once.",
    )
    endangers: bool = Field(
        False,
        description="A mistake here can hurt people or damage hardware; the report asks to fix it before all others.",
    )
    hint: str = ""
    replaces: tuple[str, ...] = Field(
        (), description="Ids of earlier checks that have become part of this one."
    )

    @property
    def by_person(self) -> bool:
        """True if a person grades the check."""
        return self.check == BY_PERSON

    @property
    def levels(self) -> tuple[Level, ...]:
        """Credit levels of a check that a person grades."""
        if not self.by_person:
            return ()
        return tuple(getattr(self.parameters, "levels", ()))

    @model_validator(mode="before")
    @classmethod
    def _follows(cls, value: Any, info: ValidationInfo) -> Any:
        value = _by(value)
        if info.context is not None and isinstance(value, dict):
            info.context.begin_check(str(value.get("id")))
        return value

    @classmethod
    def own_check(cls, kind: str, scope: Scope) -> OwnCheck | None:
        """Return a check of the lab's own, or one that was built in once; None if it is built in."""
        if is_own(kind):
            return OwnCheck(scope.folder, kind)
        if kind in scope.kinds.checks:
            return None
        return scope.kinds.former().get(kind)

    @field_validator("id")
    @classmethod
    def _is_new(cls, value: str, info: ValidationInfo) -> str:
        if info.context is not None and value in info.context.earlier:
            raise ValueError(f"{value!r} is used twice")
        return value


class FigureSpec(_OfKind):
    """A picture in the report, drawn from a session's recording."""

    key = "kind"
    models = "figures"

    kind: str
    title: str
    session: SessionId
    shows: tuple[CheckId, ...] = Field(
        (),
        description="Checks whose loss it shows: it stands beside the first of them that lost points, else folded.",
    )
    parameters: SerializeAsAny[BaseModel] = Field(
        alias="with", default_factory=dict, validate_default=True
    )


class CriterionSpec(Parameters):
    """A row of the lab's point table; a row that is `by: person` as a whole is its own only check."""

    id: str = Field(min_length=1)
    title: str = Field(min_length=1)
    points: Points
    description: str = ""
    checks: tuple[CheckSpec, ...] = Field(min_length=1)
    figures: tuple[FigureSpec, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _by_person(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        if "by" not in value or "checks" in value:
            return value
        own = {key: value[key] for key in ("id", "title", "points", "by", *_GRADED) if key in value}
        kept = {key: value[key] for key in value if key not in ("by", *_GRADED)}
        return {**kept, "checks": [own]}


def _by(value: Any) -> Any:
    """Return a check `by: person` in the form of other checks, with its kind and parameters."""
    if not isinstance(value, dict):
        return value
    if "check" in value or value.get("by") != BY_PERSON:
        return value
    kept = {key: value[key] for key in value if key not in ("by", *_GRADED)}
    given = {key: value[key] for key in _GRADED if key in value}
    return {**kept, "check": BY_PERSON, "with": given}


def _with_ids(value: Any) -> Any:
    """Return sessions with their names as ids."""
    if not isinstance(value, dict):
        return value
    found: dict[str, Any] = {}
    for name, spec in value.items():
        if isinstance(spec, dict):
            spec = {**spec, "id": str(name)}
        found[str(name)] = spec
    return found


class RubricFile(Parameters):
    """The contents of a rubric."""

    lab: LabSpec
    interfaces: InterfaceFolder | None = None
    asked_interfaces: InterfaceFolder | None = Field(
        None,
        description="Folder beside the rubric: interfaces that students are asked to define. The rubric may name "
        "their types; those of a submission are used.",
    )
    artifacts: dict[str, ArtifactSpec] = Field(
        default_factory=dict, description="What students hand in."
    )
    reference: dict[str, ReferenceSpec] = Field(
        default_factory=dict, description="Nodes of our own."
    )
    sessions: Annotated[dict[str, SessionSpec], BeforeValidator(_with_ids)] = Field(
        default_factory=dict
    )
    criteria: tuple[CriterionSpec, ...] = Field(min_length=1)
    bonus: tuple[CriterionSpec, ...] = Field(
        (),
        description="Extensions, in the same form: judged where they are handed in, and shown beside the points.",
    )
    # Not validated, because the validator of the defaults alone would be built at each start.
    policy: Policy = Policy.model_construct()

    @model_validator(mode="after")
    def _criteria_are_different(self) -> RubricFile:
        wrong: list[Fault] = []
        earlier: set[str] = set()
        for key, criteria in (("criteria", self.criteria), ("bonus", self.bonus)):
            for number, criterion in enumerate(criteria):
                if criterion.id in earlier:
                    words = f"the criterion {criterion.id!r} stands here twice"
                    wrong.append(((key, number, "id"), words))
                earlier.add(criterion.id)
        if wrong:
            raise mistakes_at(wrong)
        return self

    @model_validator(mode="after")
    def _bonus_has_sessions(self) -> RubricFile:
        """Require a session that starts an artifact from each bonus check, to tell whether the bonus was submitted."""
        words = "a check of the bonus needs a session that starts an artifact"
        wrong: list[Fault] = []
        for n, criterion in enumerate(self.bonus):
            for m, check in enumerate(criterion.checks):
                if not self.needed_first(check):
                    wrong.append((("bonus", n, "checks", m, "session"), words))
        if wrong:
            raise mistakes_at(wrong)
        return self

    def needed_first(self, check: CheckSpec) -> str:
        """Return the first artifact that a check's session starts; empty if there is none."""
        session = self.sessions.get(check.session or "")
        if session is None or not session.needs:
            return ""
        return session.needs[0]

    @property
    def bonus_sessions(self) -> frozenset[str]:
        """Sessions of bonus checks only."""
        return _sessions_of(self.bonus) - _sessions_of(self.criteria)

    @property
    def bonus_artifacts(self) -> frozenset[str]:
        """Artifacts of the bonus only, which are optional."""
        bonus_sessions = self.bonus_sessions
        optional: set[str] = set()
        required: set[str] = set()
        for id_, session in self.sessions.items():
            if id_ in bonus_sessions:
                optional.update(session.needs)
            else:
                required.update(session.needs)
        return frozenset(optional - required)


def _sessions_of(criteria: Iterable[CriterionSpec]) -> frozenset[str]:
    """Return the sessions of the checks of some criteria."""
    found: set[str] = set()
    for criterion in criteria:
        for check in criterion.checks:
            if check.session is not None:
                found.add(check.session)
    return frozenset(found)


class Rubric(RubricFile):
    """A validated rubric."""

    #: Folder of the files that the rubric names.
    folder: Path
    #: YAML of the rubric; recordings keep a copy.
    text: str

    @property
    def sha256(self) -> str:
        """Hash of the rubric's text."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def reference_programs(self) -> list[Path]:
        """Files of the reference nodes."""
        found = []
        for spec in self.reference.values():
            found.append(self.folder / spec.file)
        return found

    @cached_property
    def functions(self) -> tuple[str, ...]:
        """Functions and classes, "file.py:name", in reference nodes and checks."""
        return _functions_in((*self.reference.values(), *self.checks()))

    @cached_property
    def functions_of_figures(self) -> tuple[str, ...]:
        """Functions, "file.py:name", in figures."""
        figures: list[FigureSpec] = []
        for criterion in (*self.criteria, *self.bonus):
            figures += criterion.figures
        return _functions_in(figures)

    @cached_property
    def names_in_checks(self) -> frozenset[str]:
        """Names of the ROS graph in the checks."""
        found: set[str] = set()
        for spec in self.checks():
            found.update(spec.given.references().names)
            for each in spec.given.sought():
                found.add(each.name)
        return frozenset(found)

    @property
    def interface_packages(self) -> list[InterfacePackage]:
        """The lab's own messages, services and actions."""
        return interfaces_in(self.folder, self.interfaces)

    def checks(self) -> Iterable[CheckSpec]:
        """Yield all checks, in the rubric's order, bonus checks last."""
        for criterion in (*self.criteria, *self.bonus):
            yield from criterion.checks


def functions_of(part: BaseModel) -> list[str]:
    """Return the functions and classes, "file.py:name", in a reference node, a check or a figure."""
    return _FUNCTION.findall(part.model_dump_json(exclude={"title", "hint"}))


def _functions_in(parts: Iterable[BaseModel]) -> tuple[str, ...]:
    found: list[str] = []
    for part in parts:
        found += functions_of(part)
    return tuple(found)


def load_rubric(path: Path, kinds: Kinds, *folders: Path) -> Rubric:
    """Read and validate a rubric; raises RubricError with every mistake, each with file and line.

    Parameters
    ----------
    path
        The rubric.
    kinds
        Models of the parameters of checks and figures.
    folders
        Folders for the files that the rubric names; the first one without a mistake counts. Without folders, the
        rubric's own.
    """
    text = read_text(path, "the rubric", "Name a lab's folder, or its rubric.yaml.")
    plain, mistakes = parse_yaml(path, text, "the rubric")
    for loc, words in _wrong_sums(plain):
        mistakes.add(loc, words)
    errors = []
    for folder in folders or (path.resolve().parent,):
        try:
            with also_defined(_interfaces_beside(folder, plain)):
                found = RubricFile.model_validate(plain, context=Scope(plain, folder, kinds))
        except ValidationError as error:
            errors.append(error)
            continue
        mistakes.raise_any(_REMEDY)
        return Rubric(**dict(found), folder=folder, text=text)
    mistakes.add_validation((), min(errors, key=lambda error: error.error_count()))
    raise mistakes.error(_REMEDY)


def _interfaces_beside(folder: Path, plain: Mapping[str, Any]) -> list[InterfacePackage]:
    """Return the readable packages of interfaces in the folders that a rubric names."""
    found = []
    for key in ("interfaces", "asked_interfaces"):
        found += readable_interfaces(folder, plain.get(key))
    return found


def own_models(rubric: Rubric) -> dict[str, type[Parameters]]:
    """Return the parameters of the lab's own checks that a rubric uses, by "file.py:function"."""
    names = {spec.check: None for spec in rubric.checks() if is_own(spec.check)}
    return {name: model_at(rubric.folder, name) for name in names}


def json_schema(
    kinds: Kinds, own: Mapping[str, type[Parameters]] = MappingProxyType({})
) -> dict[str, Any]:
    """Return the JSON Schema of rubrics, by which editors complete and check them while they are written.

    Parameters
    ----------
    own
        Parameters of a lab's own checks, by "file.py:function"; see `own_models`.
    """
    listed: list[type[BaseModel]] = [
        RubricFile,
        *STEPS.values(),
        *kinds.checks.values(),
        *own.values(),
        *kinds.figures.values(),
    ]
    refs, schema = models_json_schema([(model, "validation") for model in listed])
    defs = schema["$defs"]

    def ref(model: type[BaseModel]) -> dict[str, Any]:
        return refs[model, "validation"]

    defs["Step"] = {
        "type": "object",
        "properties": {
            **{kind: ref(model) for kind, model in STEPS.items()},
            "label": {"type": "string"},
        },
        "additionalProperties": False,
        "oneOf": [{"required": [kind]} for kind in STEPS],
    }
    for spec, models, more in ((CheckSpec, kinds.checks, own), (FigureSpec, kinds.figures, {})):
        part = defs[spec.__name__]
        known: dict[str, Any] = {"enum": list(models)}
        if spec is CheckSpec:
            known = {"anyOf": [known, {"type": "string", "pattern": _OWN_PATTERN}]}
        part["properties"][spec.key] |= known
        part["allOf"] = []
        for name, model in {**models, **more}.items():
            chosen = {"properties": {spec.key: {"const": name}}}
            given = {"properties": {"with": ref(model)}}
            part["allOf"].append({"if": chosen, "then": given})
    person = ref(kinds.checks[BY_PERSON])["$ref"].rpartition("/")[2]
    graded = {"by": {"const": BY_PERSON}}
    for key in _GRADED:
        graded[key] = defs[person]["properties"][key]
    for name, instead in (("CheckSpec", "check"), ("CriterionSpec", "checks")):
        defs[name]["properties"] |= graded
        defs[name]["required"].remove(instead)
        defs[name]["anyOf"] = [{"required": [instead]}, {"required": ["by"]}]
    defs["SessionSpec"]["properties"].pop("id")
    defs["SessionSpec"]["required"].remove("id")
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Rubric"}
    return {**head, **ref(RubricFile), "$defs": defs}

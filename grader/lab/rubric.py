"""`rubric.yaml` → `Rubric`: one typed model, whose mistakes are reported all at once, each with its line.

The rubric knows the lab: its names, rates, steps and points. Nothing of a lab stands in Python here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar

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
from grader.lab.steps import STEPS, Step
from grader.lab.yaml_with_lines import Loc, Strict, mistakes_at, parse_yaml, read_text, suggestion
from grader.recording.definitions import also_defined
from grader.recording.interfaces import InterfacePackage

#: `file.py:function`, beside the rubric.
_OWN_PATTERN = r"\.py:\w+$"
#: The check that a person makes, and what it is given where it is written as `by: person`.
BY_PERSON, _GRADED = "person", ("levels", "read")
_REMEDY = "`grade checks` lists every check with its parameters."


def _points(value: Any) -> Decimal:
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float, Decimal))
        or not 0 <= value < float("inf")
    ):
        raise ValueError("a number of points is expected")
    return Decimal(str(value))


Points = Annotated[
    Decimal, BeforeValidator(_points), WithJsonSchema({"type": "number", "minimum": 0})
]


def _wrong_sums(plain: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
    """Find points that are not those of their parts together; what is no number is a mistake of its own."""
    wholes: list[tuple[Loc, Any, str, Any]] = [
        (("lab",), plain.get("lab"), "criteria", plain.get("criteria"))
    ]
    for key in ("criteria", "bonus"):
        listed = enumerate(rows if isinstance(rows := plain.get(key), list) else ())
        wholes += [
            ((key, n), each, "checks", each.get("checks"))
            for n, each in listed
            if isinstance(each, dict)
        ]
    for loc, whole, of, parts in wholes:
        with suppress(KeyError, TypeError, ValueError):
            total = sum((_points(part["points"]) for part in parts), Decimal(0))
            if total != _points(whole["points"]):
                yield (
                    (*loc, "points"),
                    f"the {of}' points add up to {total}, not to {whole['points']}",
                )


class LabSpec(Parameters):
    """What the lab is called, how many points it has, and the package name of bare files."""

    id: str
    title: str
    points: Points
    package: str = Field("student_lab", description="Package under which bare files are installed.")
    ros: str | None = Field(
        None,
        description="Distribution of ROS that the handout was written for; the report names it.",
    )
    solution: str | None = Field(None, description="Folder of a submission that earns all points.")
    handout: str | None = Field(
        None,
        description="Folder of the code that students are given; `grade similarity` does not count it.",
    )


def _can_match(pattern: str) -> str:
    if words := mistake_in(pattern):
        raise ValueError(words)
    return pattern


FilePattern = Annotated[str, AfterValidator(_can_match)]


class ArtifactSpec(Parameters):
    """A file that students hand in."""

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
    """One step of a session, and the label by which checks refer to it."""

    kind: str
    step: Step
    label: str | None = None

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """What it is given, as plain data with its defaults."""
        return self.step.model_dump(mode="json", by_alias=True)


#: Kind of a step -> model of its mapping in the list of steps.
_ENTRIES: dict[str, type[Strict]] = {
    kind: create_model(
        model.__name__, __base__=Parameters, **{kind: (model, ...), "label": (str | None, None)}
    )  # type: ignore[call-overload]
    for kind, model in STEPS.items()
}


def _step(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, StepSpec):
        return value
    kinds = [str(key) for key in value if key != "label"] if isinstance(value, dict) else []
    if len(kinds) != 1 or kinds[0] not in STEPS:
        near = suggestion(kinds[0], STEPS) if len(kinds) == 1 else ""
        raise ValueError(
            f"a step has one key of {', '.join(STEPS)}, and a label where checks refer to it{near}"
        )
    if info.context is not None:
        info.context.session = info.data.get("id")
    entry = _ENTRIES[kinds[0]].model_validate(value, context=info.context)
    return StepSpec(kinds[0], getattr(entry, kinds[0]), getattr(entry, "label"))  # noqa: B009


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
        labels = [step.label for step in self.steps]
        again = [n for n, label in enumerate(labels) if label is not None and label in labels[:n]]
        if again:
            raise mistakes_at(
                (("steps", n, "label"), f"{labels[n]!r} labels an earlier step") for n in again
            )
        return self

    @property
    def needs(self) -> tuple[str, ...]:
        """Artifacts that its steps start."""
        given = [spec.parameters for spec in self.steps if spec.kind in ("start", "plan")]
        return tuple(
            dict.fromkeys(name for p in given if (name := p.get("student") or p.get("launch")))
        )


# -- criteria --------------------------------------------------------------------------------------


class _OfKind(Parameters):
    """A check or a figure: its kind says what stands behind `with`."""

    #: The key that names the kind, and where the scope has the models of parameters.
    key: ClassVar[str]
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
    """One check with its points; `parameters` is of the model that the check declares."""

    key, models = "check", "checks"

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
    excused_by: tuple[EarlierCheckId, ...] = Field(
        (),
        description="Where one of these checks took points, none are lost here: one mistake costs once.",
    )
    hint: str = ""
    replaces: tuple[str, ...] = Field(
        (), description="Ids of earlier checks that have become part of this one."
    )

    @property
    def by_person(self) -> bool:
        """Whether a person grades it."""
        return self.check == BY_PERSON

    @property
    def levels(self) -> tuple[Level, ...]:
        """By what a person grades it."""
        return tuple(getattr(self.parameters, "levels", ())) if self.by_person else ()

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

    key, models = "kind", "figures"

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
    """A row of the lab's point table; one that is `by: person` as a whole has itself as its only check."""

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
    """Return a check with its kind in place of `by: person`, and what that is given."""
    if not isinstance(value, dict):
        return value
    if "check" in value or value.get("by") != BY_PERSON:
        return value
    kept = {key: value[key] for key in value if key not in ("by", *_GRADED)}
    return {
        **kept,
        "check": BY_PERSON,
        "with": {key: value[key] for key in _GRADED if key in value},
    }


def _with_ids(value: Any) -> Any:
    """Have each session know its name."""
    if not isinstance(value, dict):
        return value
    return {
        str(name): {**spec, "id": str(name)} if isinstance(spec, dict) else spec
        for name, spec in value.items()
    }


class RubricFile(Parameters):
    """All that stands in a rubric."""

    lab: LabSpec
    interfaces: InterfaceFolder | None = None
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
    policy: Policy = Policy()

    @model_validator(mode="after")
    def _criteria_are_different(self) -> RubricFile:
        locs = [
            (key, n, "id") for key in ("criteria", "bonus") for n in range(len(getattr(self, key)))
        ]
        names = [criterion.id for criterion in (*self.criteria, *self.bonus)]
        if again := [n for n, name in enumerate(names) if name in names[:n]]:
            raise mistakes_at(
                (locs[n], f"the criterion {names[n]!r} stands here twice") for n in again
            )
        return self

    @model_validator(mode="after")
    def _bonus_has_sessions(self) -> RubricFile:
        """Each of its checks needs a session that starts something: else nothing says whether it was handed in."""
        checks = [
            (n, m, check)
            for n, each in enumerate(self.bonus)
            for m, check in enumerate(each.checks)
        ]
        if idle := [(n, m) for n, m, check in checks if not self.needed_first(check)]:
            words = "a check of the bonus needs a session that starts an artifact"
            raise mistakes_at((("bonus", n, "checks", m, "session"), words) for n, m in idle)
        return self

    def needed_first(self, check: CheckSpec) -> str:
        """Return the first artifact that a check's session starts; empty if there is none."""
        session = self.sessions.get(check.session or "")
        return next(iter(session.needs), "") if session is not None else ""

    @property
    def bonus_sessions(self) -> frozenset[str]:
        """Sessions that nothing but the bonus looks at."""
        shown = {check.session for criterion in self.criteria for check in criterion.checks}
        return (
            frozenset(str(check.session) for criterion in self.bonus for check in criterion.checks)
            - shown
        )

    @property
    def bonus_artifacts(self) -> frozenset[str]:
        """Artifacts that nothing but the bonus is about: where they were not handed in, nothing is missing."""
        bonus = self.bonus_sessions
        shown = {
            name
            for id_, session in self.sessions.items()
            if id_ not in bonus
            for name in session.needs
        }
        return frozenset(name for id_ in bonus for name in self.sessions[id_].needs) - shown


class Rubric(RubricFile):
    """A validated rubric, the folder of the files that it names, and its YAML, a copy of which goes with recordings."""

    folder: Path
    text: str

    @property
    def sha256(self) -> str:
        """Hash of the rubric's text."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def interface_packages(self) -> list[InterfacePackage]:
        """The lab's own messages, services and actions."""
        return interfaces_in(self.folder, self.interfaces)

    def checks(self) -> Iterable[CheckSpec]:
        """All checks, in the rubric's order, those of the bonus last."""
        return (check for criterion in (*self.criteria, *self.bonus) for check in criterion.checks)


def load_rubric(path: Path, kinds: Kinds, *folders: Path) -> Rubric:
    """Read and validate a rubric; raises RubricError with every mistake, each with file and line.

    The files that it names are looked up in the first of the folders in which all is right; by default, beside it.
    """
    text = read_text(path, "the rubric", "Name a lab's folder, or its rubric.yaml.")
    plain, mistakes = parse_yaml(path, text, "the rubric")
    for loc, words in _wrong_sums(plain):
        mistakes.add(loc, words)
    errors = []
    for folder in folders or (path.resolve().parent,):
        try:
            with also_defined(readable_interfaces(folder, plain.get("interfaces"))):
                found = RubricFile.model_validate(plain, context=Scope(plain, folder, kinds))
        except ValidationError as error:
            errors.append(error)
            continue
        mistakes.raise_any(_REMEDY)
        return Rubric(**dict(found), folder=folder, text=text)
    mistakes.add_validation((), min(errors, key=lambda error: error.error_count()))
    raise mistakes.error(_REMEDY)


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
        part["allOf"] = [
            {
                "if": {"properties": {spec.key: {"const": name}}},
                "then": {"properties": {"with": ref(model)}},
            }
            for name, model in {**models, **more}.items()
        ]
    person = ref(kinds.checks[BY_PERSON])["$ref"].rpartition("/")[2]
    graded = {
        "by": {"const": BY_PERSON},
        **{key: defs[person]["properties"][key] for key in _GRADED},
    }
    for name, instead in (("CheckSpec", "check"), ("CriterionSpec", "checks")):
        defs[name]["properties"] |= graded
        defs[name]["required"].remove(instead)
        defs[name]["anyOf"] = [{"required": [instead]}, {"required": ["by"]}]
    defs["SessionSpec"]["properties"].pop("id")
    defs["SessionSpec"]["required"].remove("id")
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Rubric"}
    return {**head, **ref(RubricFile), "$defs": defs}

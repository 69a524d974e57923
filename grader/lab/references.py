"""What a part of a rubric may refer to, and types of its values: each is checked when the rubric loads.

A reference is a type of text. Its value is looked up in the `Scope` with which the rubric is validated; a part that is
made without one, as in Python, is taken at its word.
"""

from __future__ import annotations

import ast
import difflib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    StringConstraints,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from grader.lab.patterns import compiled
from grader.lab.yaml_with_lines import Loc, Strict, mistakes_at, suggestion
from grader.recording.definitions import (
    also_defined,
    field_steps,
    fields_of,
    installed_types,
    packages_with,
    types_in,
)
from grader.recording.interfaces import PARTS, InterfacePackage, packages_of, read_folder

#: Topics that every ROS system has.
_STANDARD_TOPICS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/rosout": "rcl_interfaces/msg/Log",
    "/parameter_events": "rcl_interfaces/msg/ParameterEvent",
}
_ENDPOINTS = ("topic", "publisher", "subscription", "service", "action", "action_client")


class Parameters(Strict):
    """Base of what stands behind a `with`, and of all that has a session: values are of their types as they stand."""

    model_config = ConfigDict(strict=True)
    #: What the example of it in `grade checks` has beside what is required.
    example: ClassVar[Mapping[str, Any]] = {}
    #: Whether it says something of a session's recording, so that it cannot be without one.
    of_session: ClassVar[bool] = True
    #: Keys of which exactly one is given.
    exactly_one: ClassVar[tuple[str, ...]] = ()

    @field_validator("*", mode="before")
    @classmethod
    def _lists_are_tuples(cls, value: Any, info: ValidationInfo) -> Any:
        if "tuple[" not in str(cls.model_fields[str(info.field_name)].annotation):
            return value
        if isinstance(value, dict):
            return {
                key: tuple(inner) if isinstance(inner, list) else inner
                for key, inner in value.items()
            }
        return tuple(value) if isinstance(value, list) else value

    @model_validator(mode="after")
    def _one_is_given(self) -> Parameters:
        if (
            self.exactly_one
            and sum(getattr(self, key) is not None for key in self.exactly_one) != 1
        ):
            raise ValueError(f"exactly one of {', '.join(self.exactly_one)} is needed")
        return self

    def sought(self) -> Sequence[Sought]:
        """Return the endpoints or nodes that only the graph shows, and that must be there."""
        return ()

    def references(self) -> References:
        """Return the names and steps in the values whose types are references."""
        return references_in(type(self), vars(self))


class Sought(NamedTuple):
    """An endpoint or a node that must be in the graph.

    The kind is publisher, subscription, service, action or node; a node has no type.
    """

    kind: str
    name: str
    type: str | None = None


@dataclass(frozen=True)
class References:
    """Names in the ROS graph, and labels of steps, to which a part of a rubric refers."""

    names: frozenset[str]
    steps: frozenset[str]


def references_in(model: type[Parameters], values: Mapping[str, Any]) -> References:
    """Return the names and steps in values of a model, also in plain data of a recording.

    For example, `{"service": "/arm/enable"}` of a step `call` refers to the name `/arm/enable`.
    """
    names = set()
    steps = set()
    for reference, text in _fields_referring(model, values):
        if reference.to == "name":
            names.add(text)
        elif reference.to == "step":
            steps.add(text)
    return References(frozenset(names), frozenset(steps))


def _fields_referring(
    model: type[Parameters], values: Mapping[str, Any]
) -> Iterator[tuple[Reference, str]]:
    """Yield each text in values of a model, with the reference in its type."""
    for name, field_info in model.model_fields.items():
        value = values.get(name, values.get(field_info.alias or name))
        yield from _marked(field_info.metadata, value)
        yield from _referring(field_info.annotation, value)


def _marked(metadata: Iterable[object], value: Any) -> Iterator[tuple[Reference, str]]:
    """Yield a text with each reference in the metadata of its type."""
    if not isinstance(value, str):
        return
    for mark in metadata:
        if isinstance(mark, Reference):
            yield mark, value


def _referring(kind: Any, value: Any) -> Iterator[tuple[Reference, str]]:
    """Yield each text in a value of a type, with the reference in its type."""
    origin = get_origin(kind)
    arguments = get_args(kind)
    if isinstance(value, Parameters):
        yield from _fields_referring(type(value), vars(value))
    elif origin is Annotated:
        yield from _marked(arguments[1:], value)
        yield from _referring(arguments[0], value)
    elif origin in (Union, UnionType):
        for option in arguments:
            yield from _referring(option, value)
    elif isinstance(value, Mapping):
        yield from _mapping_referring(kind, value)
    elif isinstance(value, (list, tuple)) and arguments:
        for part in value:
            yield from _referring(arguments[0], part)


def _mapping_referring(kind: Any, value: Mapping[str, Any]) -> Iterator[tuple[Reference, str]]:
    """Yield the references in a mapping: plain data of a model, or keys and values of types."""
    if isinstance(kind, type) and issubclass(kind, Parameters):
        yield from _fields_referring(kind, value)
        return
    arguments = get_args(kind)
    if len(arguments) != 2:
        return
    for key, inner in value.items():
        yield from _referring(arguments[0], key)
        yield from _referring(arguments[1], inner)


class StepText(NamedTuple):
    """A step as it stands in the YAML, before it is known to be right."""

    kind: str
    parameters: Mapping[str, Any]
    label: Any


class OwnCheck(NamedTuple):
    """A check of a lab's own: the folder of its file, and "file.py:function"."""

    folder: Path
    name: str


@dataclass(frozen=True)
class Kinds:
    """What a rubric can use: name of a check, and kind of a figure -> model of its parameters."""

    checks: Mapping[str, type[Parameters]]
    figures: Mapping[str, type[Parameters]]
    #: Returns the checks that were built in once, by their names in recorded rubrics.
    former: Callable[[], Mapping[str, OwnCheck]] = dict


@dataclass
class Scope:
    """What a rubric defines, read from its plain YAML before any part of it is validated."""

    plain: Mapping[str, Any]
    #: From which files beside the rubric are resolved.
    folder: Path
    kinds: Kinds
    #: Session and check of the part that is being validated, and the checks before it.
    session: str | None = None
    check: str | None = None
    earlier: list[str] = field(default_factory=list)

    def begin_check(self, name: str) -> None:
        """Note that a check is being validated."""
        self.earlier += [] if self.check is None else [self.check]
        self.check, self.session = name, None

    def names(self, part: str) -> list[str]:
        """Return what is defined in a part of the rubric: artifacts, reference nodes, sessions."""
        return [str(name) for name in _mapping(self.plain.get(part))]

    @cached_property
    def check_ids(self) -> list[str]:
        """Return the ids of all checks."""
        listed = (each for key in ("criteria", "bonus") for each in _list(self.plain.get(key)))
        criteria = map(_mapping, listed)
        return [
            str(_mapping(check).get("id"))
            for criterion in criteria
            for check in _list(criterion.get("checks"))
        ]

    def settings_of(self, reference: str) -> str:
        """Return how the rubric names the class of a reference node's settings."""
        return str(_mapping(_mapping(self.plain.get("reference")).get(reference)).get("settings"))

    @property
    def steps(self) -> list[StepText] | None:
        """Return the steps of the present session; None where it is not defined."""
        session = _mapping(self.plain.get("sessions")).get(self.session or "")
        listed = [_mapping(step) for step in _list(_mapping(session).get("steps"))]
        kinds = ((step, kind) for step in listed for kind in step if kind != "label")
        found = [StepText(kind, _mapping(step[kind]), step.get("label")) for step, kind in kinds]
        return None if session is None else found

    @cached_property
    def written(self) -> Counter[str]:
        """Return all names and other words of one piece that stand in the rubric, and how often each does."""
        return Counter(re.findall(r"[\w~/.-]+", "\n".join(_texts(self.plain))))

    @cached_property
    def types(self) -> dict[str, set[str]]:
        """Return the types of topics, services and actions that are waited for, typed, or the new name of others."""
        found = {topic: {name} for topic, name in _STANDARD_TOPICS.items()}
        for part in _parts(self.plain):
            renamed = [
                *_mapping(part.get("remappings")).values(),
                *_mapping(part.get("composed")).values(),
            ]
            awaited = [_mapping(part.get("wait_for")).get(key) for key in _ENDPOINTS]
            typed = (
                [part.get(key) for key in _ENDPOINTS] if isinstance(part.get("type"), str) else []
            )
            for name in (n for n in (*renamed, *awaited, *typed) if isinstance(n, str)):
                found.setdefault(name, set()).update({part["type"]} if name in typed else ())
            if isinstance(part.get("action"), str) and typed:
                found[f"{part['action']}/_action/feedback"] = {f"{part['type']}_FeedbackMessage"}
        return found


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _list(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list) else ()


def _texts(value: Any) -> Iterator[str]:
    """Give all keys and texts in a value that are of one piece."""
    inner = [*value, *value.values()] if isinstance(value, Mapping) else _list(value)
    yield from (value,) if isinstance(value, str) and " " not in value else ()
    for part in inner:
        yield from _texts(part)


def _parts(value: Any) -> Iterator[Mapping[str, Any]]:
    """Give all mappings in a value."""
    if isinstance(value, Mapping):
        yield value
    for inner in value.values() if isinstance(value, Mapping) else _list(value):
        yield from _parts(inner)


@dataclass(frozen=True)
class Reference:
    """Marks a type of values that are looked up in the scope; says what they are to whoever writes a rubric."""

    what: str
    #: Raises ValueError if there is no such thing.
    look_up: Callable[[Scope, Any, ValidationInfo], object]
    #: What may stand there, for the examples of `grade checks`; None where that is any text.
    example: str | None = None
    #: Kind of the referent, if judging asks for it: a name in the ROS graph, or a step by its label.
    to: Literal["name", "step", ""] = ""

    def _check(self, value: Any, info: ValidationInfo) -> Any:
        if isinstance(info.context, Scope):
            self.look_up(info.context, value, info)
        return value

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return AfterValidator(self._check).__get_pydantic_core_schema__(source, handler)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        examples = {} if self.example is None else {"examples": [self.example]}
        return {**handler(schema), "description": self.what, **examples}


def one_of(value: str, what: str, known: Iterable[str], location: str = "") -> str:
    """Return a name if it is known; raises ValueError if it is not, with what may be meant."""
    names = list(known)
    if value not in names:
        raise ValueError(f"there is no {what} {value!r}{location}{suggestion(value, names)}")
    return value


# -- what is defined in the rubric -----------------------------------------------------------------


def _defined(part: str, what: str, example: str) -> Reference:
    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        one_of(value, what, scope.names(part))

    return Reference(f"Name of the {what}.", look_up, example)


def _before(scope: Scope, value: str, info: ValidationInfo) -> None:
    if value not in scope.earlier:
        one_of(value, "check", scope.check_ids)
        raise ValueError(f"{value!r} is not an earlier check")


def step_label(*kinds: str) -> Reference:
    """Return the type of a label of a step of the session, of one of these kinds; of any without."""

    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        labelled = {
            str(step.label): step.kind for step in scope.steps or () if step.label is not None
        }
        if scope.steps is not None:
            one_of(value, "step labelled", labelled, f" in session '{scope.session}'")
            if kinds and labelled[value] not in kinds:
                raise ValueError(
                    f"{value!r} labels a step of kind {labelled[value]}; {' or '.join(kinds)} is needed"
                )

    example = "window" if kinds == ("observe",) else "".join(kinds[:1]) or "step"
    return Reference(
        f"Label of the step{f', of kind {kinds[0]}' if kinds else ''}.", look_up, example, "step"
    )


def _refusal(scope: Scope, value: str, info: ValidationInfo) -> None:
    if not any(
        step.label == value and step.parameters.get("refusal_expected")
        for step in scope.steps or ()
    ):
        raise ValueError(
            f"the step {value!r} lacks refusal_expected: true, so that its values are taken for valid"
        )


def _name_of_process(start: Mapping[str, Any]) -> str:
    """Return the name that a step `start` gives its process."""
    for key in ("name", "student"):
        if start.get(key):
            return str(start[key])
    return str(start.get("reference"))


def _process(*more: str) -> Reference:
    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        starts = [step.parameters for step in scope.steps or () if step.kind == "start"]
        # How the processes of a launch file are called stands in that file.
        if scope.steps is not None and not any("launch" in start for start in starts):
            names = [_name_of_process(start) for start in starts]
            one_of(value, "process", [*names, *more], f" in session '{scope.session}'")

    return Reference("Name of a process that the session starts.", look_up, "talker")


Artifact = Annotated[str, _defined("artifacts", "artifact", "talker")]
ReferenceNode = Annotated[str, _defined("reference", "reference node", "robot")]
SessionId = Annotated[str, _defined("sessions", "session", "talking")]
CheckId = Annotated[
    str,
    Reference("Id of a check.", lambda scope, value, _: one_of(value, "check", scope.check_ids)),
]
#: While a check is judged, the findings of those before it are known.
EarlierCheckId = Annotated[str, Reference("Id of an earlier check.", _before, "talker.publishes")]
AnyStep = Annotated[str, step_label()]
CallLabel = Annotated[str, step_label("call")]
GoalLabel = Annotated[str, step_label("send_goal")]
PlanLabel = Annotated[str, step_label("plan")]
GetLabel = Annotated[str, step_label("get_parameters")]
SetLabel = Annotated[str, step_label("set_parameters")]
RefusalLabel = Annotated[
    SetLabel, Reference("Label of a set_parameters step, with refusal_expected.", _refusal)
]
TransitionLabel = Annotated[str, step_label("change_state")]
ExitLabel = Annotated[str, step_label("wait_exit")]
LinkLabel = Annotated[str, step_label("link")]
Window = Annotated[str, step_label("observe")]
Process = Annotated[str, _process()]
StudentProcesses = Annotated[str, _process("*")]


# -- what is in the ROS graph ----------------------------------------------------------------------


def _known_topic(scope: Scope, value: str, info: ValidationInfo) -> None:
    """Look for one that is nearly so named; another may be a reference node's own, or be one of several by number."""
    near = (
        difflib.get_close_matches(value, scope.types, n=1, cutoff=0.75)
        if value not in scope.types
        else []
    )
    if near and re.sub(r"\d", "", near[0]) != re.sub(r"\d", "", value):
        words = "no step waits for it, and nothing gives its type"
        raise ValueError(f"{value!r} is not known: {words}{suggestion(value, near)}")


#: Shorter names, or parts of them with fewer letters beside the one that differs, are too often alike.
_LEAST_LETTERS, _LEAST_AROUND = 5, 2


def _not_misspelt(scope: Scope, value: str, info: ValidationInfo) -> None:
    """Refuse a name that stands here alone where one that differs by a letter stands before it, or more often."""
    if len(value) < _LEAST_LETTERS or scope.written[value] != 1:
        return
    names = list(scope.written)
    others = [
        name for n, name in enumerate(names) if scope.written[name] > 1 or n < names.index(value)
    ]
    if near := [name for name in others if _one_letter_apart(value, name)]:
        raise ValueError(f"{value!r} stands here alone; did you mean '{near[0]}', as elsewhere?")


def _one_letter_apart(a: str, b: str) -> bool:
    """Whether one letter is missing, too much, another, or swapped with its neighbour.

    Digits, a plural, parts of one or two letters and a leading slash are meant: joint1 and joint2, goal and goals,
    gain_x and gain_y, vx_max and vy_max.
    """
    start = _alike(a, b)
    end = _alike(a[start:][::-1], b[start:][::-1])
    left, right = a[start : len(a) - end], b[start : len(b) - end]
    rest = a[len(a) - end :]
    around = re.split(r"[_/.]", a[:start])[-1] + re.split(r"[_/.]", rest)[0]
    more, ends = left + right, re.fullmatch(r"|[_/.].*", rest)
    if len(around) < _LEAST_AROUND:
        return False
    is_plural = more == "s" and bool(ends)
    is_absolute = more == "/" and not start
    if is_plural or is_absolute or re.search(r"\d", more):
        return False
    is_swapped = len(left) == 2 and left == right[::-1]
    return is_swapped or max(len(left), len(right)) == 1


def _alike(a: str, b: str) -> int:
    """Return with how many letters two texts begin alike."""
    return next(
        (n for n, (one, other) in enumerate(zip(a, b, strict=False)) if one != other),
        min(len(a), len(b)),
    )


#: A name that students' programs are to use, such as that of a ROS parameter.
GivenName = Annotated[str, Reference("A name, as students are to give it.", _not_misspelt)]
#: A topic, service or node that may be named here for the first time: "/a/b", "a", "~/a".
RosName = Annotated[
    str,
    StringConstraints(pattern=r"^(~/|/)?[A-Za-z_{][A-Za-z0-9_{}]*(/[A-Za-z_{][A-Za-z0-9_{}]*)*$"),
    Reference("Name of a topic, a service or a node.", _not_misspelt, to="name"),
]
#: One that is used besides; where a step waits for it or its type stands somewhere, fields are looked up in that.
Topic = Annotated[str, Reference("A topic or service.", _known_topic, "/chatter", "name")]

_EXAMPLES = {
    "msg": "std_msgs/msg/String",
    "srv": "std_srvs/srv/SetBool",
    "action": "example_interfaces/action/Fibonacci",
}


def _interface(value: str, folder: str) -> None:
    package, _, rest = value.partition("/")
    if not re.fullmatch(rf"{folder}/[A-Z][A-Za-z0-9]*", rest):
        raise ValueError(f"{value!r} is not a type such as {_EXAMPLES[folder]}")
    known = types_in(package, folder)
    if known:
        one_of(value, "type", known)
    # A package that is not known here may be known where submissions are graded.
    elif near := difflib.get_close_matches(package, packages_with(folder), n=1, cutoff=0.8):
        raise ValueError(f"there is no type {value!r}{suggestion(package, near)}")


def _type_in(folder: str, what: str) -> Reference:
    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        _interface(value, folder)

    return Reference(what, look_up, _EXAMPLES[folder])


MessageType = Annotated[str, _type_in("msg", "A message type.")]
ServiceType = Annotated[str, _type_in("srv", "A service type.")]
ActionType = Annotated[str, _type_in("action", "An action type.")]


def _of_endpoint(scope: Scope, value: str, info: ValidationInfo) -> None:
    folders = {"service": "srv", "action": "action", "action_client": "action"}
    _interface(
        value, next((folder for key, folder in folders.items() if info.data.get(key)), "msg")
    )


#: A service's or an action's where such a key stands before it.
AnyType = Annotated[
    str, Reference("A message, service or action type.", _of_endpoint, _EXAMPLES["msg"])
]


def _type_at(name: str, path: str) -> str | None:
    """Return the type of a field; None where the type is not known here."""
    spelled = name
    for step in field_steps(path):
        if isinstance(step, int):
            if not spelled.endswith("]"):
                raise ValueError(f"a {spelled} has no elements, so that [{step}] says nothing")
            spelled = spelled[: spelled.rindex("[")]
            continue
        fields = _fields_in(spelled)
        if fields is None:
            return None
        if step not in fields:
            raise ValueError(f"{spelled} has no field {step!r}" + suggestion(step, fields))
        spelled = fields[step]
    return spelled


def _fields_in(spelled: str) -> Mapping[str, str] | None:
    """Return the fields of a type, of which an array and a primitive have none; None where it is not known here."""
    return fields_of(spelled) if spelled.count("/") == 2 and not spelled.endswith("]") else {}


_PRIMITIVE_NUMBER = re.compile(r"float\d+|u?int\d+|bool|boolean|byte|octet|char|double|float")


def _is_number(spelled: str) -> bool:
    return _PRIMITIVE_NUMBER.fullmatch(spelled) is not None


def _holds_numbers(spelled: str) -> bool:
    """Whether a type is made of numbers only: a number, a vector or quaternion, a time, or an array of these."""
    element = spelled.partition("[")[0]
    fields = _fields_in(element)
    if not fields:
        return fields is None or _is_number(element)
    return all(map(_holds_numbers, fields.values()))


def _field(kind: str, fits: Callable[[str], bool], example: str) -> Reference:
    """Return the type of a field's path, which is looked up in the types of the topics that stand before it.

    The kind says in words what the field holds; whether one does, a type says as `.msg` files spell it.
    """

    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        several = (
            info.data.get("streams") or info.data.get("topics") or {"": info.data.get("topic")}
        )
        for topic in several.values():
            _look_up_field(scope, topic, value, kind, fits)

    return Reference(
        f"Path of a field that holds {kind}, such as pose.position.x or data[0].", look_up, example
    )


def _look_up_field(
    scope: Scope, topic: str, path: str, kind: str, fits: Callable[[str], bool]
) -> None:
    found = [_type_at(name, path) for name in sorted(scope.types.get(topic, ()))]
    if found and not any(spelled is None or fits(spelled) for spelled in found):
        raise ValueError(f"{path!r} of {topic} is a {found[0]}; it must hold {kind}")


def stamped(info: ValidationInfo, topics: Iterable[str], path: str = "header.stamp") -> None:
    """Look for a time stamp in the messages of topics that are matched by it; raises ValueError if one has none."""
    if isinstance(info.context, Scope):
        for topic in topics:
            _look_up_field(info.context, topic, path, *_STAMP)


def holds(info: ValidationInfo, topic: str, path: str, count: int) -> None:
    """Look for so many numbers in a field of a topic's messages; raises ValueError if it is known to hold others."""
    types = info.context.types.get(topic, ()) if isinstance(info.context, Scope) else ()
    found = [_count_in(spelled) for name in types if (spelled := _type_at(name, path)) is not None]
    if found and not {count, None} & set(found):
        raise ValueError(f"{path!r} of {topic} holds {found[0]} numbers, not {count}")


def _count_in(spelled: str) -> int | None:
    """Return for how many numbers a type is taken, a time for one; None where that is not known, as of an array."""
    fields = _fields_in(spelled)
    if spelled.endswith("]") or fields is None:
        return None
    counts = (
        [1] if not fields or spelled in _TIMES else [_count_in(each) for each in fields.values()]
    )
    return None if None in counts else sum(filter(None, counts))


def _by_pattern(scope: Scope, value: str, info: ValidationInfo) -> None:
    if "pattern" in info.data:  # Else that has a mistake of its own.
        (_TEXT_FIELD if info.data["pattern"] else _NUMBERS).look_up(scope, value, info)


_NUMBERS = _field("numbers (one, an array, or a message of numbers)", _holds_numbers, "data")
_TEXT_FIELD = _field("a text", lambda spelled: spelled in ("string", "wstring"), "data")
FieldPath = Annotated[str, _NUMBERS]
TextField = Annotated[str, _TEXT_FIELD]
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
_STAMP = ("a time stamp", lambda spelled: spelled == "builtin_interfaces/msg/Time")
StampField = Annotated[str, _field(*_STAMP, "header.stamp")]
#: A text where the key `pattern` stands before it, which finds the numbers in it; else numbers.
NumbersField = Annotated[
    str,
    Reference(
        "Path of a field that holds numbers; or a text, with a pattern that finds them in it.",
        _by_pattern,
        "data",
    ),
]
#: What a pattern can be compared with.
WordField = Annotated[
    str,
    _field(
        "a text or one number",
        lambda spelled: spelled in ("string", "wstring") or _is_number(spelled),
        "data",
    ),
]


def _wrong_fields(name: str, values: Mapping[str, Any], loc: Loc = ()) -> Iterator[tuple[Loc, str]]:
    for key, value in values.items():
        try:
            spelled = _type_at(name, key)
        except ValueError as problem:
            yield (*loc, key), str(problem)
        else:
            if isinstance(value, Mapping) and spelled is not None:
                yield from _wrong_fields(spelled, value, (*loc, key))


def fields_of_type(part: str = "", label: str | None = None) -> Reference:
    """Return the type of values by the name of their field, or of one such name.

    They are of a message, or of a `part` of a service ("_Request", "_Response") or of an action ("_Goal", "_Result",
    "_Feedback"). Of which, the key `type` before it says, or else the step that the key `label` before it names.
    """

    def look_up(scope: Scope, value: str | Mapping[str, Any], info: ValidationInfo) -> None:
        name = info.data.get("type")
        if label is not None:
            types = (
                s.parameters.get("type")
                for s in scope.steps or ()
                if s.label == info.data.get(label)
            )
            name = next(types, None)
        if isinstance(name, str) and name.count("/") == 2:
            wrong = list(
                _wrong_fields(name + part, {value: None} if isinstance(value, str) else value)
            )
            if wrong:
                raise mistakes_at(wrong)

    return Reference("By the names of fields.", look_up)


# -- files beside the rubric -----------------------------------------------------------------------


def _beside(scope: Scope, name: str) -> list[str]:
    """Return the files in the folder of a file, as a rubric names them; none outside of its own folder."""
    top = scope.folder.resolve()
    folder = (top / name).resolve().parent
    inside = folder.glob("*") if folder.is_relative_to(top) else ()
    return [path.relative_to(top).as_posix() for path in inside if path.is_file()]


def _file(scope: Scope, value: str, info: ValidationInfo) -> None:
    one_of(value, "file", _beside(scope, value), " beside the rubric")


@dataclass(frozen=True)
class Definition:
    """A function or class of a Python file beside the rubric, and all others of the file, by their names."""

    node: ast.FunctionDef | ast.ClassDef
    beside: Mapping[str, ast.FunctionDef | ast.ClassDef]


def definition_at(scope: Scope, value: str) -> Definition:
    """Look up "file.py:name"; the file is not run, for it may do anything. Raises ValueError if there is none."""
    file = value.partition(":")[0]
    one_of(file, "Python file", _beside(scope, file), " beside the rubric")
    return definition_in(scope.folder, value)


def definition_in(folder: Path, value: str) -> Definition:
    """Look up "file.py:name" in a folder, where the file is; raises ValueError if it has no such name."""
    file, _, name = value.partition(":")
    try:
        found = _definitions((folder / file).read_bytes())
    except (SyntaxError, ValueError) as problem:
        raise ValueError(f"{file} is not valid Python: {problem}") from problem
    return Definition(found[one_of(name, "function or class", found, f" in {file}")], found)


@lru_cache(maxsize=32)
def _definitions(source: bytes) -> dict[str, ast.FunctionDef | ast.ClassDef]:
    return {
        node.name: node
        for node in ast.parse(source).body
        if isinstance(node, (ast.FunctionDef, ast.ClassDef))
    }


def interfaces_in(folder: Path, name: object) -> list[InterfacePackage]:
    """Return the packages in the folder of that name beside a rubric; none where there is no such folder."""
    inside = isinstance(name, str) and (folder / name).resolve().is_relative_to(folder.resolve())
    return list(packages_of(read_folder(folder / str(name)))) if inside else []


def readable_interfaces(folder: Path, name: object) -> list[InterfacePackage]:
    """Return those of the packages that are written as ROS asks for."""
    return [
        package
        for package in interfaces_in(folder, name)
        if not package.problem and _is_readable(package)
    ]


def _is_readable(package: InterfacePackage) -> bool:
    try:
        return bool(package.fields)
    except ValueError:
        return False


def _interfaces(scope: Scope, value: str, info: ValidationInfo) -> None:
    packages = interfaces_in(scope.folder, value)
    if not packages:
        raise ValueError(
            f"there is no folder {value!r} beside the rubric with msg/, srv/ or action/ files in it"
        )
    with also_defined(readable_interfaces(scope.folder, value)):
        wrong = [
            f"{package.name}: {words}" for package in packages if (words := _wrong_in(package))
        ]
    if wrong:
        raise ValueError("; ".join(wrong))


def _wrong_in(package: InterfacePackage) -> str:
    """Say what is wrong with a package of the lab's, as far as that is known without building it."""
    if package.problem:
        return package.problem
    if any(installed_types(package.name, kind) for kind in PARTS):
        return "ROS has a package of this name, which counts"
    try:
        messages = package.fields
    except ValueError as problem:
        return str(problem)
    spelled = {name: fields_of(name) or {} for name in messages}
    used = {kind.partition("[")[0] for fields in spelled.values() for kind in fields.values()}
    unknown = sorted(name for name in used if "/" in name and fields_of(name) is None)
    return f"there is no type {unknown[0].replace('/msg/', '/')}" if unknown else ""


InterfaceFolder = Annotated[
    str,
    Reference(
        "Folder beside the rubric: packages of .msg, .srv and .action files.",
        _interfaces,
        "interfaces",
    ),
]
FileBeside = Annotated[str, Reference("File beside the rubric.", _file, "reference/robot.py")]
Loadable = Annotated[
    str,
    Reference(
        "file.py:name, beside the rubric.",
        lambda scope, value, info: definition_at(scope, value),
        "oracles.py:expected",
    ),
]


# -- values ----------------------------------------------------------------------------------------


def _share(value: Any) -> float:
    number = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*%\s*", value) if isinstance(value, str) else None
    share = float(number[1]) / 100 if number else value
    if isinstance(share, bool) or not isinstance(share, (int, float)) or not 0 <= share <= 1:
        raise ValueError("a share from 0 to 1 is expected, such as 2% or 0.02")
    return float(share)


_SHARE_NUMBER = {"type": "number", "minimum": 0, "maximum": 1}
_SHARE_TEXT = {"type": "string", "pattern": r"^\s*\d+(\.\d+)?\s*%\s*$"}
#: A share, written as 0.02 or as 2%.
Share = Annotated[
    float,
    BeforeValidator(_share),
    WithJsonSchema(
        {"description": "A share, such as 2% or 0.02.", "anyOf": [_SHARE_NUMBER, _SHARE_TEXT]}
    ),
]


class Level(Parameters):
    """A level by which a person grades."""

    title: str
    credit: Share = Field(description="Share of the points that it earns.")
    description: str = Field("", description="What earns it.")


#: A regular expression.
Pattern = Annotated[
    str,
    AfterValidator(lambda value: compiled(value).pattern),
    WithJsonSchema({"type": "string", "format": "regex"}),
]


def _several(value: Any) -> Any:
    return (
        (value,) if isinstance(value, str) else tuple(value) if isinstance(value, list) else value
    )


_TEXT = {"type": "string"}
#: One or more regular expressions, of which the first counts that finds anything; the number is its last group.
Patterns = Annotated[
    tuple[Pattern, ...],
    BeforeValidator(_several),
    WithJsonSchema(
        {
            "description": "One or more regular expressions.",
            "anyOf": [_TEXT, {"type": "array", "items": _TEXT}],
        }
    ),
]

Reliability = Literal["reliable", "best_effort"]
Durability = Literal["volatile", "transient_local"]
History = Literal["keep_last", "keep_all"]
#: As `lifecycle_msgs` labels them.
LifecycleState = Literal["unconfigured", "inactive", "active", "finalized"]
LifecycleTransition = Literal["configure", "activate", "deactivate", "cleanup", "shutdown"]
_Single = Literal["bool", "integer", "double", "string"]
ParameterType = Literal[
    _Single, "byte_array", "bool_array", "integer_array", "double_array", "string_array"
]

"""References and types of values in a rubric, checked when the rubric loads.

A reference is a type of text. Its value is looked up in the `Scope` of the rubric's validation. Parts that are made
without a scope, as in Python, are not checked.
"""

from __future__ import annotations

import ast
import difflib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
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
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema
from pydantic_core.core_schema import with_info_after_validator_function

from grader.lab.patterns import compiled
from grader.lab.similar_words import suggestion
from grader.lab.yaml_with_lines import Fault, Loc, Strict, mistakes_at
from ros_bag.fields import (
    NoSuchField,
    also_defined,
    fields_of,
    holds_numbers,
    installed_types,
    is_number,
    numbers_in,
    packages_with,
    type_at,
    types_in,
)
from ros_bag.interfaces import PARTS, InterfacePackage, packages_of, read_folder

#: Topics that every ROS system has.
_STANDARD_TOPICS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/rosout": "rcl_interfaces/msg/Log",
    "/parameter_events": "rcl_interfaces/msg/ParameterEvent",
}
_ENDPOINTS = ("topic", "publisher", "subscription", "service", "action", "action_client")


class Parameters(Strict):
    """Base of the mappings under `with`, and of parts with a session; values must have the types of the fields."""

    model_config = ConfigDict(strict=True)
    #: Optional keys in the example of `grade checks`.
    example: ClassVar[Mapping[str, Any]] = {}
    #: True if a recorded session is required.
    of_session: ClassVar[bool] = True
    #: Alternative keys; exactly one of them must be given.
    exactly_one: ClassVar[tuple[str, ...]] = ()

    @model_validator(mode="before")
    @classmethod
    def _lists_are_tuples(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        keys = _keys_of_tuples(cls)
        frozen = dict(values)
        for key in keys.intersection(values):
            frozen[key] = _with_tuples(values[key])
        return frozen

    @model_validator(mode="after")
    def _one_is_given(self) -> Parameters:
        given = [key for key in self.exactly_one if getattr(self, key) is not None]
        if self.exactly_one and len(given) != 1:
            raise ValueError(f"exactly one of {', '.join(self.exactly_one)} is needed")
        return self

    def sought(self) -> Sequence[Sought]:
        """Return the endpoints or nodes that only the graph shows, and that must be there."""
        return ()

    def references(self) -> References:
        """Return the names and steps in the values with reference types."""
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


@cache
def _keys_of_tuples(model: type[Parameters]) -> frozenset[str]:
    """Return the keys of a model's fields that hold tuples, each also by its name."""
    found: set[str] = set()
    for name, field_info in model.model_fields.items():
        if "tuple[" in str(field_info.annotation):
            found.update((name, field_info.alias or name))
    return frozenset(found)


def _with_tuples(value: Any) -> Any:
    """Return a list, or each list in a mapping, as a tuple."""
    if isinstance(value, dict):
        return {key: _frozen(inner) for key, inner in value.items()}
    return _frozen(value)


def _frozen(value: Any) -> Any:
    """Return a list as a tuple, and any other value as it is."""
    if isinstance(value, list):
        return tuple(value)
    return value


class StepText(NamedTuple):
    """A step of the YAML, before its validation."""

    kind: str
    parameters: Mapping[str, Any]
    label: Any


class OwnCheck(NamedTuple):
    """A check of a lab's own: the folder of its file, and "file.py:function"."""

    folder: Path
    name: str


@dataclass(frozen=True)
class Kinds:
    """Models of parameters, by names of checks and by kinds of figures."""

    checks: Mapping[str, type[Parameters]]
    figures: Mapping[str, type[Parameters]]
    #: Returns the checks that were built in once, by their names in recorded rubrics.
    former: Callable[[], Mapping[str, OwnCheck]] = dict


@dataclass
class Scope:
    """The definitions of a rubric, read from its plain YAML before any part is validated."""

    plain: Mapping[str, Any]
    #: Folder of the files beside the rubric.
    folder: Path
    kinds: Kinds
    #: Session of the part that is being validated.
    session: str | None = None
    #: Check that is being validated.
    check: str | None = None
    #: Previous checks.
    earlier: list[str] = field(default_factory=list)

    def begin_check(self, name: str) -> None:
        """Begin the validation of a check."""
        if self.check is not None:
            self.earlier.append(self.check)
        self.check = name
        self.session = None

    def names(self, part: str) -> list[str]:
        """Return the names in a part of the rubric: artifacts, reference nodes, sessions."""
        return list(map(str, _mapping(self.plain.get(part))))

    @cached_property
    def check_ids(self) -> list[str]:
        """The ids of all checks."""
        found = []
        for key in ("criteria", "bonus"):
            for criterion in _list(self.plain.get(key)):
                for check in _list(_mapping(criterion).get("checks")):
                    found.append(str(_mapping(check).get("id")))
        return found

    def settings_of(self, reference: str) -> str:
        """Return the rubric's name for the class of a reference node's settings."""
        nodes = _mapping(self.plain.get("reference"))
        return str(_mapping(nodes.get(reference)).get("settings"))

    @property
    def steps(self) -> list[StepText] | None:
        """The steps of the present session; None if it is not defined."""
        session = _mapping(self.plain.get("sessions")).get(self.session or "")
        if session is None:
            return None
        found = []
        for step in map(_mapping, _list(_mapping(session).get("steps"))):
            for kind, parameters in step.items():
                if kind != "label":
                    found.append(StepText(kind, _mapping(parameters), step.get("label")))
        return found

    @cached_property
    def written(self) -> Counter[str]:
        """Numbers of occurrences of names and other single words in the rubric."""
        return Counter(re.findall(r"[\w~/.-]+", "\n".join(_texts(self.plain))))

    @cached_property
    def types(self) -> dict[str, set[str]]:
        """Types of topics, services and actions with a type, an awaited endpoint or a new name in the rubric."""
        found = {topic: {name} for topic, name in _STANDARD_TOPICS.items()}
        for part in _parts(self.plain):
            for name in _untyped_names(part):
                found.setdefault(name, set())
            type_name = part.get("type")
            if not isinstance(type_name, str):
                continue
            for key in _ENDPOINTS:
                endpoint = part.get(key)
                if isinstance(endpoint, str):
                    found.setdefault(endpoint, set()).add(type_name)
            action = part.get("action")
            if isinstance(action, str):
                found[f"{action}/_action/feedback"] = {f"{type_name}_FeedbackMessage"}
        return found


def _untyped_names(part: Mapping[str, Any]) -> Iterator[str]:
    """Yield the new names in a part of a rubric, and the names of awaited endpoints."""
    awaited = _mapping(part.get("wait_for"))
    names: list[Any] = []
    for key in ("remappings", "composed"):
        names += _mapping(part.get(key)).values()
    names += map(awaited.get, _ENDPOINTS)
    for name in names:
        if isinstance(name, str):
            yield name


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _list(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list) else ()


def _texts(value: Any) -> Iterator[str]:
    """Yield all keys and texts in a value without blanks."""
    if isinstance(value, str) and " " not in value:
        yield value
    if isinstance(value, Mapping):
        for key in value:
            yield from _texts(key)
    for inner in _inner(value):
        yield from _texts(inner)


def _parts(value: Any) -> Iterator[Mapping[str, Any]]:
    """Yield all mappings in a value."""
    if isinstance(value, Mapping):
        yield value
    for inner in _inner(value):
        yield from _parts(inner)


def _inner(value: Any) -> Iterable[Any]:
    """Return the values in a mapping or a list."""
    if isinstance(value, Mapping):
        return value.values()
    return _list(value)


@dataclass(frozen=True)
class Reference:
    """Marks a type of values that are looked up in the scope, and describes them to authors of rubrics."""

    what: str
    #: Raises ValueError for an unknown value.
    look_up: Callable[[Scope, Any, ValidationInfo], object]
    #: Value in the examples of `grade checks`; None if any text is possible.
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
        # An `AfterValidator` would inspect the signature for each field.
        return with_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        described = {**handler(schema), "description": self.what}
        if self.example is not None:
            described["examples"] = [self.example]
        return described


def one_of(value: str, what: str, known: Iterable[str], location: str = "") -> str:
    """Return a known name; raises ValueError, with a suggestion, for another one."""
    names = list(known)
    if value not in names:
        raise ValueError(f"there is no {what} {value!r}{location}{suggestion(value, names)}")
    return value


# -- definitions in the rubric ---------------------------------------------------------------------


def _defined(part: str, what: str, example: str) -> Reference:
    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        one_of(value, what, scope.names(part))

    return Reference(f"Name of the {what}.", look_up, example)


def _before(scope: Scope, value: str, info: ValidationInfo) -> None:
    if value not in scope.earlier:
        one_of(value, "check", scope.check_ids)
        raise ValueError(f"{value!r} is not an earlier check")


def step_label(*kinds: str) -> Reference:
    """Return the type of labels of the session's steps, of some kinds; without kinds, of all."""

    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        if scope.steps is None:
            return
        labelled = {str(step.label): step.kind for step in scope.steps if step.label is not None}
        one_of(value, "step labelled", labelled, f" in session '{scope.session}'")
        kind = labelled[value]
        if kinds and kind not in kinds:
            raise ValueError(
                f"{value!r} labels a step of kind {kind}; {' or '.join(kinds)} is needed"
            )

    if not kinds:
        return Reference("Label of the step.", look_up, "step", to="step")
    example = kinds[0]
    if kinds == ("observe",):
        example = "window"
    return Reference(f"Label of the step, of kind {kinds[0]}.", look_up, example, to="step")


def _refusal(scope: Scope, value: str, info: ValidationInfo) -> None:
    for step in scope.steps or ():
        if step.label == value and step.parameters.get("refusal_expected"):
            return
    raise ValueError(
        f"the step {value!r} lacks refusal_expected: true, so that its values are taken for valid"
    )


def _name_of_process(start: Mapping[str, Any]) -> str:
    """Return the name of the process of a step `start`."""
    for key in ("name", "student"):
        if start.get(key):
            return str(start[key])
    return str(start.get("reference"))


def _process(*more: str) -> Reference:
    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        if scope.steps is None:
            return
        names = list(more)
        for step in scope.steps:
            if step.kind != "start":
                continue
            # A launch file names its processes itself.
            if "launch" in step.parameters:
                return
            names.append(_name_of_process(step.parameters))
        one_of(value, "process", names, f" in session '{scope.session}'")

    return Reference("Name of a process that the session starts.", look_up, "talker")


Artifact = Annotated[str, _defined("artifacts", "artifact", "talker")]
ReferenceNode = Annotated[str, _defined("reference", "reference node", "robot")]
SessionId = Annotated[str, _defined("sessions", "session", "talking")]
CheckId = Annotated[
    str,
    Reference("Id of a check.", lambda scope, value, _: one_of(value, "check", scope.check_ids)),
]
#: A check can use the findings of earlier ones.
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
Window = Annotated[str, step_label("observe", "publish")]
Process = Annotated[str, _process()]
StudentProcesses = Annotated[str, _process("*")]


# -- names and types of the ROS graph --------------------------------------------------------------


def _known_topic(scope: Scope, value: str, info: ValidationInfo) -> None:
    """Refuse a misspelt known topic; other topics can be a reference node's, or one of several with a number."""
    if value in scope.types:
        return
    near = difflib.get_close_matches(value, scope.types, n=1, cutoff=0.75)
    if near and re.sub(r"\d", "", near[0]) != re.sub(r"\d", "", value):
        words = "no step waits for it, and nothing gives its type"
        raise ValueError(f"{value!r} is not known: {words}{suggestion(value, near)}")


#: Letters from which a name can be misspelt; shorter names are often alike.
_LEAST_LETTERS = 5
#: Letters beside the different one, in a part of a name, from which the part can be misspelt.
_LEAST_AROUND = 2


def _not_misspelt(scope: Scope, value: str, info: ValidationInfo) -> None:
    """Refuse a name that occurs once if a name with one other letter occurs earlier, or more often."""
    if len(value) < _LEAST_LETTERS or scope.written[value] != 1:
        return
    is_earlier = True
    for name, times in scope.written.items():
        is_earlier = is_earlier and name != value
        if (is_earlier or times > 1) and _one_letter_apart(value, name):
            raise ValueError(f"{value!r} stands here alone; did you mean '{name}', as elsewhere?")


def _one_letter_apart(a: str, b: str) -> bool:
    """Return whether one letter is missing, additional, another, or swapped with its neighbour.

    Digits, a plural, parts of one or two letters and a leading slash count as intended: joint1 and joint2, goal and
    goals, gain_x and gain_y, vx_max and vy_max.
    """
    start = _alike(a, b)
    end = _alike(a[start:][::-1], b[start:][::-1])
    left = a[start : len(a) - end]
    right = b[start : len(b) - end]
    rest = a[len(a) - end :]
    before = re.split(r"[_/.]", a[:start])[-1]
    after = re.split(r"[_/.]", rest)[0]
    if len(before) + len(after) < _LEAST_AROUND:
        return False
    more = left + right
    ends = re.fullmatch(r"|[_/.].*", rest)
    is_plural = more == "s" and bool(ends)
    is_absolute = more == "/" and not start
    if is_plural or is_absolute:
        return False
    if re.search(r"\d", more):
        return False
    is_swapped = len(left) == 2 and left == right[::-1]
    return is_swapped or max(len(left), len(right)) == 1


def _alike(a: str, b: str) -> int:
    """Return the number of equal first letters of two texts."""
    count = 0
    for one, other in zip(a, b, strict=False):
        if one != other:
            break
        count += 1
    return count


#: A name that students' programs must use, such as the name of a ROS parameter.
GivenName = Annotated[str, Reference("A name, as students are to give it.", _not_misspelt)]
#: A topic, service or node, which can be new: "/a/b", "a", "~/a".
RosName = Annotated[
    str,
    StringConstraints(pattern=r"^(~/|/)?[A-Za-z_{][A-Za-z0-9_{}]*(/[A-Za-z_{][A-Za-z0-9_{}]*)*$"),
    Reference("Name of a topic, a service or a node.", _not_misspelt, to="name"),
]
#: A topic or service in use; if a step waits for it, or its type is given, fields are looked up in the type.
Topic = Annotated[str, Reference("A topic or service.", _known_topic, "/chatter", to="name")]

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
        return
    # The computer that grades can have a package that is unknown here.
    near = difflib.get_close_matches(package, packages_with(folder), n=1, cutoff=0.8)
    if near:
        raise ValueError(f"there is no type {value!r}{suggestion(package, near)}")


def _type_in(folder: str, what: str) -> Reference:
    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        _interface(value, folder)

    return Reference(what, look_up, _EXAMPLES[folder])


MessageType = Annotated[str, _type_in("msg", "A message type.")]
ServiceType = Annotated[str, _type_in("srv", "A service type.")]
ActionType = Annotated[str, _type_in("action", "An action type.")]


def _of_endpoint(scope: Scope, value: str, info: ValidationInfo) -> None:
    if info.data.get("service"):
        _interface(value, "srv")
    elif info.data.get("action") or info.data.get("action_client"):
        _interface(value, "action")
    else:
        _interface(value, "msg")


#: Type of a service or an action after such a key, else of a message.
AnyType = Annotated[
    str, Reference("A message, service or action type.", _of_endpoint, _EXAMPLES["msg"])
]


def _type_at(name: str, path: str) -> str | None:
    """Return the type of a field; None if a type is unknown here. Raises ValueError, with a suggestion."""
    try:
        return type_at(name, path)
    except NoSuchField as problem:
        raise ValueError(f"{problem}{suggestion(problem.field, problem.known)}") from problem


def _field(kind: str, fits: Callable[[str], bool], example: str) -> Reference:
    """Return the type of a field's path, which is looked up in the types of the topics before it.

    Parameters
    ----------
    kind
        Contents of the field, in words.
    fits
        Returns whether a type, spelled as in `.msg` files, has these contents.
    example
        An example of a path.
    """

    def look_up(scope: Scope, value: str, info: ValidationInfo) -> None:
        several = info.data.get("streams") or info.data.get("topics")
        if not several:
            several = {"": info.data.get("topic")}
        for topic in several.values():
            _look_up_field(scope, topic, value, kind, fits)

    return Reference(
        f"Path of a field that holds {kind}, such as pose.position.x or data[0].", look_up, example
    )


def _look_up_field(
    scope: Scope, topic: str, path: str, kind: str, fits: Callable[[str], bool]
) -> None:
    found = [_type_at(name, path) for name in sorted(scope.types.get(topic, ()))]
    if None in found or any(map(fits, filter(None, found))):
        return
    if found:
        raise ValueError(f"{path!r} of {topic} is a {found[0]}; it must hold {kind}")


def stamped(info: ValidationInfo, topics: Iterable[str], path: str = "header.stamp") -> None:
    """Raise ValueError if the messages of a topic, which are matched by their time stamps, have none."""
    if isinstance(info.context, Scope):
        for topic in topics:
            _look_up_field(info.context, topic, path, *_STAMP)


def holds(info: ValidationInfo, topic: str, path: str, count: int) -> None:
    """Raise ValueError if a field of a topic's messages is known to hold another number of numbers."""
    if not isinstance(info.context, Scope):
        return
    found = []
    for name in info.context.types.get(topic, ()):
        spelled = _type_at(name, path)
        if spelled is not None:
            found.append(numbers_in(spelled))
    if not found or None in found:
        return
    if count not in found:
        raise ValueError(f"{path!r} of {topic} holds {found[0]} numbers, not {count}")


def _by_pattern(scope: Scope, value: str, info: ValidationInfo) -> None:
    # Without the key, the pattern itself has a mistake.
    if "pattern" in info.data:
        reference = _TEXT_FIELD if info.data["pattern"] else _NUMBERS
        reference.look_up(scope, value, info)


_NUMBERS = _field("numbers (one, an array, or a message of numbers)", holds_numbers, "data")
_TEXT_FIELD = _field("a text", lambda spelled: spelled in ("string", "wstring"), "data")
FieldPath = Annotated[str, _NUMBERS]
TextField = Annotated[str, _TEXT_FIELD]
_STAMP = ("a time stamp", lambda spelled: spelled == "builtin_interfaces/msg/Time")
StampField = Annotated[str, _field(*_STAMP, "header.stamp")]
#: A text if a key `pattern`, which finds the numbers in it, comes before; else numbers.
NumbersField = Annotated[
    str,
    Reference(
        "Path of a field that holds numbers; or a text, with a pattern that finds them in it.",
        _by_pattern,
        "data",
    ),
]
#: A field that can be compared with a pattern.
WordField = Annotated[
    str,
    _field(
        "a text or one number",
        lambda spelled: spelled in ("string", "wstring") or is_number(spelled),
        "data",
    ),
]


def _wrong_fields(name: str, values: Mapping[str, Any], loc: Loc = ()) -> Iterator[Fault]:
    for key, value in values.items():
        try:
            spelled = _type_at(name, key)
        except ValueError as problem:
            yield (*loc, key), str(problem)
        else:
            if isinstance(value, Mapping) and spelled is not None:
                yield from _wrong_fields(spelled, value, (*loc, key))


def fields_of_type(part: str = "", label: str | None = None) -> Reference:
    """Return the type of values by the names of their fields, or of one such name.

    Parameters
    ----------
    part
        Part of a service ("_Request", "_Response") or of an action ("_Goal", "_Result", "_Feedback"); empty for a
        message.
    label
        Key with the label of a step that has the type; without it, the key `type` has the type.
    """

    def look_up(scope: Scope, value: str | Mapping[str, Any], info: ValidationInfo) -> None:
        name = info.data.get("type")
        if label is not None:
            name = _type_of_step(scope, info.data.get(label))
        if not isinstance(name, str) or name.count("/") != 2:
            return
        if isinstance(value, str):
            value = {value: None}
        wrong = list(_wrong_fields(name + part, value))
        if wrong:
            raise mistakes_at(wrong)

    return Reference("By the names of fields.", look_up)


def _type_of_step(scope: Scope, label: Any) -> Any:
    """Return the type that a step is given; None if there is no such step."""
    for step in scope.steps or ():
        if step.label == label:
            return step.parameters.get("type")
    return None


# -- files beside the rubric -----------------------------------------------------------------------


def _beside(scope: Scope, name: str) -> list[str]:
    """Return the files in the folder of a file, as a rubric names them; none outside of the rubric's folder."""
    top = scope.folder.resolve()
    folder = (top / name).resolve().parent
    inside = folder.glob("*") if folder.is_relative_to(top) else ()
    return [path.relative_to(top).as_posix() for path in inside if path.is_file()]


def _file(scope: Scope, value: str, info: ValidationInfo) -> None:
    one_of(value, "file", _beside(scope, value), " beside the rubric")


@dataclass(frozen=True, eq=False)
class Definition:
    """A function or class of a Python file beside the rubric, and all functions and classes of the file, by name."""

    node: ast.FunctionDef | ast.ClassDef
    beside: Mapping[str, ast.FunctionDef | ast.ClassDef]


def definition_at(scope: Scope, value: str) -> Definition:
    """Return the definition at "file.py:name" without executing the file; raises ValueError if there is none."""
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
    return found[one_of(name, "function or class", found, f" in {file}")]


@lru_cache(maxsize=32)
def _definitions(source: bytes) -> dict[str, Definition]:
    found: dict[str, ast.FunctionDef | ast.ClassDef] = {}
    for node in ast.parse(source).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found[node.name] = node
    definitions: dict[str, Definition] = {}
    for name, defined in found.items():
        definitions[name] = Definition(defined, found)
    return definitions


def interfaces_in(folder: Path, name: object) -> list[InterfacePackage]:
    """Return the packages in a folder beside a rubric; empty if the folder is missing."""
    if not isinstance(name, str):
        return []
    inside = (folder / name).resolve()
    if not inside.is_relative_to(folder.resolve()):
        return []
    return list(packages_of(read_folder(folder / name)))


def readable_interfaces(folder: Path, name: object) -> list[InterfacePackage]:
    """Return the packages in a folder beside a rubric with correct definitions."""
    found = []
    for package in interfaces_in(folder, name):
        if not package.problem and _is_readable(package):
            found.append(package)
    return found


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
    wrong = []
    with also_defined(readable_interfaces(scope.folder, value)):
        for package in packages:
            problem = _wrong_in(package)
            if problem:
                wrong.append(f"{package.name}: {problem}")
    if wrong:
        raise ValueError("; ".join(wrong))


def _wrong_in(package: InterfacePackage) -> str:
    """Describe a mistake of a lab's package, as far as it is known without building it; empty if there is no mistake."""
    if package.problem:
        return package.problem
    if any(installed_types(package.name, kind) for kind in PARTS):
        return "ROS has a package of this name, which counts"
    try:
        messages = package.fields
    except ValueError as problem:
        return str(problem)
    used: set[str] = set()
    for message in messages:
        for spelled in (fields_of(message) or {}).values():
            used.add(spelled.partition("[")[0])
    for name in sorted(used):
        if "/" in name and fields_of(name) is None:
            return f"there is no type {name.replace('/msg/', '/')}"
    return ""


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
    """Read a share such as 0.02 or "2 %"; raises ValueError for another value."""
    share = value
    if isinstance(value, str):
        number = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*%\s*", value)
        share = value
        if number:
            share = float(number[1]) / 100
    is_number = isinstance(share, (int, float)) and not isinstance(share, bool)
    if not is_number or not 0 <= share <= 1:
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
    """A credit level for grading by a person."""

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
    return (value,) if isinstance(value, str) else _frozen(value)


_TEXT = {"type": "string"}
#: One or more regular expressions; the first one with a match counts, and the number is its last group.
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

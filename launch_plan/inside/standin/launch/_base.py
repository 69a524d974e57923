"""The ground on which the stand-in rests: entities, substitutions, conditions, and the fields they are made of.

A class of the stand-in is a row: its fields, each with its default and the attribute that XML and YAML give it, and
what it performs. One constructor takes the arguments of all of them, as strictly as the original does; one parser
reads all of them. Every object remembers the line that builds it: a substitution is resolved long after that
line, so without this the student would be shown a place in the grader.
"""

from __future__ import annotations

import collections.abc
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from launch_plan.inside import problems
from launch_plan.inside.problems import (
    blaming,
    mistake,
    shown,
)
from launch_plan.jazzy import RENAMED

#: The evaluator, whose own lines are no part of a launch file.
EVALUATOR = Path(__file__).resolve().parents[2]

SourceLine = tuple[str, int]
REQUIRED: Any = object()
POSITIONAL = True

_T = TypeVar("_T")
_declared_lines: list[SourceLine] = []


@contextmanager
def written_at(file: str, line: int) -> Iterator[None]:
    """Attribute whatever is constructed inside to a line of an XML or YAML launch file."""
    _declared_lines.append((file, line))
    try:
        yield
    finally:
        _declared_lines.pop()


def calling_line() -> SourceLine | None:
    """The innermost line outside the evaluation from which the current call comes."""
    if _declared_lines:
        return _declared_lines[-1]
    frame = sys._getframe(1)
    while frame is not None:
        name = frame.f_code.co_filename
        if not name.startswith(f"{EVALUATOR}/") and not name.startswith("<"):
            return name, frame.f_lineno
        frame = frame.f_back  # type: ignore[assignment]
    return None


#: Actions and substitutions by the names under which XML and YAML launch files know them.
exposed_actions: dict[str, Any] = {}
exposed_substitutions: dict[str, Any] = {}


def expose_action(name: str) -> Callable[[_T], _T]:
    """Make an action known to XML and YAML launch files."""
    return lambda exposed: exposed_actions.setdefault(name, exposed)


def expose_substitution(name: str) -> Callable[[_T], _T]:
    """Make a substitution known to XML and YAML launch files."""
    return lambda exposed: exposed_substitutions.setdefault(name, exposed)


class Field:
    """An argument of a class, which is read by its name once it is given.

    Parameters
    ----------
    default
        What it is if it is not given; `REQUIRED` if it must be.
    positional : bool
        It may be given without its keyword.
    attribute : str
        Its name in XML and YAML; empty if it cannot stand there.
    kind : type
        The type that it has; `read_as` is the one as which XML and YAML read it, if that is another, and
        `can_be_str` says whether a text may stand there where `kind` is another type.
    types, remedy
        What may be given, and what to do if something else is; empty if anything may.
    read : callable
        The value that an attribute of XML or YAML stands for, with the parser's help.
    normal : callable
        The form in which the value is used, if it is not that of the class.
    nested : callable
        The value that elements inside of the one of XML or YAML stand for, with the parser's help.
    """

    def __init__(
        self,
        default: Any = REQUIRED,
        positional: bool = False,
        *,
        attribute: str = "",
        kind: Any = str,
        types: Any = (),
        remedy: str = "",
        read_as: Any = None,
        can_be_str: bool = True,
        read: Callable[[Any, Any], Any] | None = None,
        normal: Callable[[Any], Any] | None = None,
        nested: Callable[[Any, Any], Any] | None = None,
    ) -> None:
        self.read_as, self.can_be_str = kind if read_as is None else read_as, can_be_str
        self.read, self.nested = type(self).reading if read is None else read, nested
        self.normal = type(self).normalized if normal is None else normal
        self.default, self.positional = default, positional
        self.attribute, self.kind, self.types, self.remedy = attribute, kind, types, remedy
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, made: Any, owner: type | None = None) -> Any:
        if made is None:
            return self
        if self.name not in made.given:
            raise AttributeError(
                f"'{type(made).__name__}' has no '{self.name}': its base class was not initialised"
            )
        return made.given[self.name]

    def checked(self, value: Any, made: Any) -> Any:
        """The value as it is kept."""
        if self.types:
            ensure_argument_type(value, self.types, self.name, type(made).__name__, self.remedy)
        return None if value is None and self.default is None else self.normal(value)

    @staticmethod
    def normalized(value: Any) -> Any:
        """The value in the form in which it is used where nothing else is said."""
        return value

    @staticmethod
    def reading(value: Any, parser: Any) -> Any:
        """How it is read where nothing else is said."""
        return parser.escape_characters(value) if isinstance(value, str) else value


class Text(Field):
    """A text that may hold substitutions."""

    @staticmethod
    def normalized(value: Any) -> Any:
        return normalize_to_list_of_substitutions(value)

    @staticmethod
    def reading(value: Any, parser: Any) -> Any:
        return parser.parse_substitution(value)


class Typed(Field):
    """A value of a type, or a text with substitutions that becomes one."""

    def checked(self, value: Any, made: Any) -> Any:
        from .utilities.type_utils import normalize_typed_substitution

        super().checked(value, made)
        return normalize_typed_substitution(value, self.kind)

    @staticmethod
    def reading(value: Any, parser: Any) -> Any:
        return parser.parse_if_substitutions(value)


class Texts(Field):
    """A list of texts."""

    @staticmethod
    def normalized(value: Any) -> Any:
        return [normalize_to_list_of_substitutions(item) for item in value]


class Pairs(Field):
    """Texts by texts."""

    @staticmethod
    def normalized(value: Any) -> Any:
        normal = normalize_to_list_of_substitutions
        return [(normal(name), normal(item)) for name, item in value.items()]


def fields_of(cls: Any) -> dict[str, Field]:
    """The fields of a class by their names, those of its bases first; what a class sets anew is none any more."""
    found: dict[str, Field] | None = vars(cls).get("_fields")
    if found is not None:
        return found
    found = {}
    for base in reversed(cls.__mro__):
        for name, value in vars(base).items():
            found.pop(name, None)
            if isinstance(value, Field):
                found[name] = value
    cls._fields = found
    return found


class Located:
    """Something that a launch file constructs out of its fields, with the line that does so."""

    source_line: SourceLine | None = None
    given: dict[str, Any]

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:
        self = object.__new__(cls)
        self.source_line = calling_line()
        self.given = {}
        return self

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        for name, value in _bound(type(self), args, kwargs).items():
            self.given[name] = fields_of(type(self))[name].checked(value, self)
        self.made()

    def made(self) -> None:
        """Do what is to be done once all fields are known."""

    def describe(self) -> str:
        """Text for people."""
        return f"{type(self).__name__}()"

    def described(self, field: str) -> str:
        return " + ".join(sub.describe() for sub in self.given[field])

    def text(self, field: str, context: Any) -> str:
        """A field, resolved."""
        return perform_substitutions(context, self.given[field])


def _bound(cls: type, args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    """Values by field, complete, as a call binds them."""
    fields, name = fields_of(cls), cls.__name__
    positional = [title for title, field in fields.items() if field.positional]
    if len(args) > len(positional):
        takes = f"{len(positional)} of them" if positional else "none of them"
        message = f"{name}() is given {len(args)} values without a keyword, and takes {takes} so"
        raise mistake(TypeError, message, "positional_argument", "Write keywords: name=value.")
    given = dict(zip(positional, args, strict=False))
    twice = sorted(set(given) & set(kwargs))
    if twice:
        message = f"{name}() got multiple values for argument '{twice[0]}'"
        raise mistake(TypeError, message, "positional_argument", "Give it once.")
    given |= kwargs
    unknown = [title for title in kwargs if title not in fields]
    missing = [
        title for title, field in fields.items() if field.default is REQUIRED and title not in given
    ]
    meant = [title for title in unknown if RENAMED.get(title) in missing]
    if missing and not meant:
        by_keyword = not fields[missing[0]].positional
        what, kind = (
            ("keyword-only", "missing_keyword")
            if by_keyword
            else ("positional", "missing_argument")
        )
        message = f"{name}() is missing the required {what} argument '{missing[0]}'"
        remedy = "Give what is missing by its keyword." if by_keyword else "Give what is missing."
        raise mistake(TypeError, message, kind, remedy)
    for title in meant or unknown:
        message = f"{name}() got an unexpected keyword argument '{title}'"
        raise mistake(TypeError, message, "unknown_keyword", problems.keyword_remedy(title, fields))
    return {title: given.get(title, field.default) for title, field in fields.items()}


def read_element(cls: type, entity: Any, parser: Any) -> dict[str, Any]:
    """The arguments of a class, of an element of XML or YAML."""
    kwargs: dict[str, Any] = parser.condition(entity)
    for name, field in fields_of(cls).items():
        value = None
        if field.nested is not None:
            value = field.nested(entity, parser)
        elif field.attribute:
            optional, kind = field.default is not REQUIRED, field.read_as
            value = entity.get_attr(
                field.attribute, optional=optional, data_type=kind, can_be_str=field.can_be_str
            )
            value = None if value is None else field.read(value, parser)
        if value is not None:
            kwargs[name] = value
    return kwargs


class InvalidLaunchFileError(Exception):
    """A launch file could not be read as what its name says it is."""


class SubstitutionFailure(Exception):
    """A substitution has no value."""


class InvalidConditionExpressionError(Exception):
    """The text of a condition is neither true nor false."""


class Substitution(Located):
    """A text that is known only while launching."""

    #: How many arguments it must have at least where it is written `$(name ...)`, if not those without a default.
    least: int | None = None

    @classmethod
    def parse(cls, data: Any) -> tuple[Any, dict[str, Any]]:
        """The class and its arguments, of what is written `$(name argument ...)`."""
        fields = fields_of(cls)
        required = sum(field.default is REQUIRED for field in fields.values())
        least = required if cls.least is None else cls.least
        if not least <= len(data) <= len(fields):
            span = str(least) if least == len(fields) else f"{least} to {len(fields)}"
            message = f"the substitution {cls.__name__} takes {span} arguments, not {len(data)}"
            raise mistake(TypeError, message, "bad_markup", "Correct this element of the file.")
        return cls, dict(zip(fields, data, strict=False))

    def describe(self) -> str:
        fields = [name for name, value in self.given.items() if isinstance(value, list)]
        return f"{type(self).__name__}({', '.join(_words(self.given[name]) for name in fields)})"

    def perform(self, context: Any) -> str:
        """The text."""
        return ""


def _words(subs: list[Any]) -> str:
    return " + ".join(
        sub.describe() if isinstance(sub, Substitution) else _words(sub) for sub in subs
    )


class Condition(Located):
    """Decides whether an action is carried out."""

    predicate = Field(None, types=(Callable, type(None)))

    def holds(self, context: Any) -> bool:
        """What the predicate says."""
        return bool(self.predicate(context))

    def evaluate(self, context: Any) -> bool:
        """Whether the action is carried out."""
        with blaming(self):
            return self.holds(context)


class LaunchDescriptionEntity(Located):
    """Whatever may stand in a launch description."""

    def describe_sub_entities(self) -> list[Any]:
        """Entities that follow whenever this one is visited."""
        return []

    def describe_conditional_sub_entities(self) -> list[tuple[str, Iterable[Any]]]:
        """Entities that may follow, with the reason."""
        return []

    def visit(self, context: Any) -> list[Any] | None:
        """Carry it out; yields the entities to visit next."""
        raise NotImplementedError

    def get_asyncio_future(self) -> None:
        """There is no event loop here, so there is no future."""
        return


class Action(LaunchDescriptionEntity):
    """An intention, perhaps under a condition."""

    condition = Field(
        None, types=(Condition, type(None)), remedy="Wrap it: condition=IfCondition(...)."
    )

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> tuple[Any, dict[str, Any]]:
        """The class and its arguments, of an element of XML or YAML."""
        return cls, read_element(cls, entity, parser)

    def get_sub_entities(self) -> list[Any]:
        return []

    def describe_sub_entities(self) -> list[Any]:
        return list(self.get_sub_entities()) if self.condition is None else []

    def describe_conditional_sub_entities(self) -> list[tuple[str, Iterable[Any]]]:
        """Entities that follow if the condition holds."""
        if self.condition is None:
            return []
        return [(f"Conditionally included by {self.describe()}", self.get_sub_entities())]

    def visit(self, context: Any) -> list[Any] | None:
        """Carry out the action if its condition holds."""
        found: list[Any] | None = context.session.visit_action(self, context)
        return found

    #: The method of the context or of its executor that carries out the action, where that is all there is to it.
    performs = ""

    def execute(self, context: Any) -> Any:
        """Carry out the action; yields the entities to visit next."""
        if hasattr(context.session, self.performs):
            return getattr(context.session, self.performs)(self, context)
        return getattr(context, self.performs)() if self.performs else None


class Event(Located):
    """Something that happened."""

    name: Any = property(lambda self: f"{type(self).__module__}.{type(self).__name__}")


SomeSubstitutionsType_types_tuple = (str, Path, Substitution, collections.abc.Iterable)
SomeEntitiesType_types_tuple = (LaunchDescriptionEntity, collections.abc.Iterable)


def ensure_argument_type(
    argument: Any, types: Any, argument_name: str, caller: str | None = None, remedy: str = ""
) -> None:
    """Check the type of an argument."""
    wanted = tuple(types) if isinstance(types, collections.abc.Iterable) else (types,)
    if not isinstance(argument, wanted):
        names = list(dict.fromkeys(getattr(t, "__name__", str(t)) for t in wanted))
        listed = ", ".join(names[:-1]) + " or " + names[-1] if len(names) > 1 else names[0]
        where = f" of {caller}" if caller else ""
        message = (
            f"argument '{argument_name}'{where} must be of type {listed}, but {shown(argument)}"
        )
        kind = _KIND_OF_ARGUMENT.get(argument_name, "bad_type" if remedy else "exception")
        raise mistake(TypeError, message, kind, remedy or "Give a value of this type.")


#: Arguments whose mistakes are a kind of their own.
_KIND_OF_ARGUMENT = {
    "condition": "bad_condition",
    "period": "bad_period",
    "parameters": "parameters_not_list",
    "param_file": "bad_parameter_value",
    "value": "bad_parameter_value",
    "text": "bad_text",
}


def is_a_subclass(obj: Any, entity_type: type) -> bool:
    try:
        return isinstance(obj, entity_type) or issubclass(obj, entity_type)
    except TypeError:
        return False


def normalize_to_list_of_substitutions(subs: Any) -> list[Substitution]:
    """Bring text, a path, a substitution, or a list of them into the form of a list of substitutions."""
    if isinstance(subs, (str, Path, Substitution)):
        return [_as_substitution(subs)]
    if isinstance(subs, collections.abc.Iterable):
        return [_as_substitution(item) for item in subs]
    raise _no_text(f"only text, substitutions, or a list of them can stand here, but {shown(subs)}")


def _as_substitution(item: Any) -> Substitution:
    if isinstance(item, (str, Path)):
        from .substitutions import TextSubstitution

        return TextSubstitution(text=str(item))
    if isinstance(item, Substitution):
        return item
    raise _no_text(f"only text or substitutions can stand in a list here, but {shown(item)}")


def _no_text(message: str) -> Any:
    remedy = "Give text or a substitution: '100.0' for 100.0, 'true' for True."
    return mistake(TypeError, message, "bad_text", remedy)


def perform_substitution(context: Any, substitution: Substitution) -> str:
    """Resolve one substitution, noting the line that wrote it if that fails."""
    with blaming(substitution):
        return substitution.perform(context)


def perform_substitutions(context: Any, subs: Iterable[Substitution]) -> str:
    """Resolve a list of substitutions to one text."""
    return "".join([context.perform_substitution(sub) for sub in subs])

"""Base classes of the stand-in: entities, substitutions, conditions, and their fields.

A class of the stand-in lists its fields, each with the default and the attribute in XML and YAML, and defines its effect.
One constructor binds the arguments of all classes, as strictly as the real `launch`, and one parser reads all of them.
Each object keeps the line that constructed it, because a substitution is resolved much later.
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

#: The evaluator. Its own lines are no part of a launch file.
EVALUATOR = Path(__file__).resolve().parents[2]

SourceLine = tuple[str, int]
REQUIRED: Any = object()
POSITIONAL = True

_T = TypeVar("_T")
_declared_lines: list[SourceLine] = []


@contextmanager
def written_at(file: str, line: int) -> Iterator[None]:
    """Attribute the objects constructed in this block to a line of an XML or YAML launch file."""
    _declared_lines.append((file, line))
    try:
        yield
    finally:
        _declared_lines.pop()


def calling_line() -> SourceLine | None:
    """Return file and line of the innermost frame outside the evaluator."""
    if _declared_lines:
        return _declared_lines[-1]
    frame = sys._getframe(1)
    while frame is not None:
        name = frame.f_code.co_filename
        if not name.startswith((f"{EVALUATOR}/", "<")):
            return name, frame.f_lineno
        frame = frame.f_back  # type: ignore[assignment]
    return None


#: Actions and substitutions by their names in XML and YAML launch files.
exposed_actions: dict[str, Any] = {}
exposed_substitutions: dict[str, Any] = {}


def expose_action(name: str) -> Callable[[_T], _T]:
    """Make an action known to XML and YAML launch files."""
    return lambda exposed: exposed_actions.setdefault(name, exposed)


def expose_substitution(name: str) -> Callable[[_T], _T]:
    """Make a substitution known to XML and YAML launch files."""
    return lambda exposed: exposed_substitutions.setdefault(name, exposed)


class Field:
    """An argument of a class, and the attribute of its objects.

    Parameters
    ----------
    default
        The value of a missing argument; `REQUIRED` for an argument that must be given.
    positional : bool
        True if the argument may be given without its keyword.
    attribute : str
        The name in XML and YAML; empty if the argument has none.
    kind : type
        The type of the value. XML and YAML read it as `read_as`, if given; `can_be_str` permits a text in place of
        another type.
    types, remedy
        Accepted types, and the instruction for any other value; empty if all types are accepted.
    read : callable
        Function of an XML or YAML attribute and the parser; returns the value.
    written : bool
        True if XML and YAML require the attribute, although Python does not.
    normal : callable
        Function that brings the value into its normal form, instead of `normalized` of the class.
    nested : callable
        Function of an XML or YAML element and the parser; returns the value given by the elements inside.
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
        written: bool = False,
        read: Callable[[Any, Any], Any] | None = None,
        normal: Callable[[Any], Any] | None = None,
        nested: Callable[[Any, Any], Any] | None = None,
    ) -> None:
        self.default = default
        self.positional = positional
        self.attribute = attribute
        self.kind = kind
        self.types = types
        self.remedy = remedy
        self.read_as = kind if read_as is None else read_as
        self.can_be_str = can_be_str
        self.optional = default is not REQUIRED and not written
        self.read = type(self).reading if read is None else read
        self.normal = type(self).normalized if normal is None else normal
        self.nested = nested
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, made: Any, owner: type | None = None) -> Any:
        if made is None:
            return self
        if self.name not in made.given:
            title = type(made).__name__
            message = f"'{title}' has no '{self.name}': its base class was not initialised"
            raise AttributeError(message)
        return made.given[self.name]

    def checked(self, value: Any, made: Any) -> Any:
        """Return the value in its normal form."""
        if self.types:
            ensure_argument_type(value, self.types, self.name, type(made).__name__, self.remedy)
        if value is None and self.default is None:
            return None
        return self.normal(value)

    @staticmethod
    def normalized(value: Any) -> Any:
        """Return the normal form of a value."""
        return value

    @staticmethod
    def reading(value: Any, parser: Any) -> Any:
        """Return the value of an attribute of XML or YAML."""
        return parser.escape_characters(value) if isinstance(value, str) else value


class Text(Field):
    """A text, perhaps with substitutions."""

    @staticmethod
    def normalized(value: Any) -> Any:
        return normalize_to_list_of_substitutions(value)

    @staticmethod
    def reading(value: Any, parser: Any) -> Any:
        return parser.parse_substitution(value)


class Typed(Field):
    """A value of a type, or a text with substitutions to be read as that type."""

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
    """A mapping of texts to texts, kept as pairs."""

    @staticmethod
    def normalized(value: Any) -> Any:
        normal = normalize_to_list_of_substitutions
        return [(normal(name), normal(item)) for name, item in value.items()]


def fields_of(cls: Any) -> dict[str, Field]:
    """Return the fields of a class by name, inherited ones first; another attribute of the name removes a field."""
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
    """An object of a launch file, with its fields and the line that constructs it."""

    source_line: SourceLine | None = None
    given: dict[str, Any]

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:
        self = object.__new__(cls)
        self.source_line = calling_line()
        self.given = {}
        return self

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        fields = fields_of(type(self))
        for name, value in _bound(type(self), args, kwargs).items():
            self.given[name] = fields[name].checked(value, self)
        self.made()

    def made(self) -> None:
        """Finish the construction, with all fields known."""

    def describe(self) -> str:
        """Return a text for people."""
        return f"{type(self).__name__}()"

    def described(self, field: str) -> str:
        return " + ".join(sub.describe() for sub in self.given[field])

    def text(self, field: str, context: Any) -> str:
        """Return a field, resolved."""
        return perform_substitutions(context, self.given[field])


def _bound(cls: type, args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    """Return all values by field, as a call of the class binds them."""
    fields = fields_of(cls)
    positional = [title for title, field in fields.items() if field.positional]
    if len(args) > len(positional):
        takes = f"{len(positional)} of them" if positional else "none of them"
        message = (
            f"{cls.__name__}() is given {len(args)} values without a keyword, and takes {takes} so"
        )
        raise mistake(TypeError, message, "positional_argument", "Write keywords: name=value.")
    given = dict(zip(positional, args, strict=False))
    twice = sorted(set(given) & set(kwargs))
    if twice:
        message = f"{cls.__name__}() got multiple values for argument '{twice[0]}'"
        raise mistake(TypeError, message, "positional_argument", "Give it once.")
    given |= kwargs
    _require_known(cls.__name__, fields, given)
    return {title: given.get(title, field.default) for title, field in fields.items()}


def _require_known(name: str, fields: dict[str, Field], given: dict[str, Any]) -> None:
    """Refuse missing arguments and unknown keywords; a renamed keyword counts as unknown, not as missing."""
    unknown = [title for title in given if title not in fields]
    required = [title for title, field in fields.items() if field.default is REQUIRED]
    missing = [title for title in required if title not in given]
    meant = [title for title in unknown if RENAMED.get(title) in missing]
    if missing and not meant:
        raise _missing(name, missing[0], fields[missing[0]])
    for title in meant or unknown:
        message = f"{name}() got an unexpected keyword argument '{title}'"
        raise mistake(TypeError, message, "unknown_keyword", problems.keyword_remedy(title, fields))


def _missing(name: str, title: str, field: Field) -> Any:
    what = "keyword-only"
    kind = "missing_keyword"
    remedy = "Give what is missing by its keyword."
    if field.positional:
        what = "positional"
        kind = "missing_argument"
        remedy = "Give what is missing."
    message = f"{name}() is missing the required {what} argument '{title}'"
    return mistake(TypeError, message, kind, remedy)


def read_element(cls: type, entity: Any, parser: Any) -> dict[str, Any]:
    """Return the arguments of a class that an element of XML or YAML gives."""
    kwargs: dict[str, Any] = parser.condition(entity)
    for name, field in fields_of(cls).items():
        value = None
        if field.nested is not None:
            value = field.nested(entity, parser)
        elif field.attribute:
            value = _read_attribute(field, entity, parser)
        if value is not None:
            kwargs[name] = value
    return kwargs


def _read_attribute(field: Field, entity: Any, parser: Any) -> Any:
    value = entity.get_attr(
        field.attribute,
        optional=field.optional,
        data_type=field.read_as,
        can_be_str=field.can_be_str,
    )
    return None if value is None else field.read(value, parser)


class InvalidLaunchFileError(Exception):
    """Raised for a launch file that cannot be read in the language of its name."""


class SubstitutionFailure(Exception):
    """Raised for a substitution without a value."""


class InvalidConditionExpressionError(Exception):
    """Raised for the text of a condition that is neither true nor false."""


class Substitution(Located):
    """A text known only during the launch."""

    #: Fewest arguments in the form `$(name ...)`; None for the number of required fields.
    least: int | None = None

    @classmethod
    def parse(cls, data: Any) -> tuple[Any, dict[str, Any]]:
        """Return the class and the arguments of the form `$(name argument ...)`."""
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
        listed = ", ".join(_words(self.given[name]) for name in fields)
        return f"{type(self).__name__}({listed})"

    def perform(self, context: Any) -> str:
        """Return the text."""
        return ""


def _words(subs: list[Any]) -> str:
    words: list[str] = []
    for sub in subs:
        words.append(sub.describe() if isinstance(sub, Substitution) else _words(sub))
    return " + ".join(words)


class Condition(Located):
    """A condition for the execution of an action."""

    predicate = Field(None, types=(Callable, type(None)))

    def holds(self, context: Any) -> bool:
        """Return the result of the predicate."""
        return bool(self.predicate(context))

    def evaluate(self, context: Any) -> bool:
        """Return whether the action is to be executed."""
        with blaming(self):
            return self.holds(context)


class LaunchDescriptionEntity(Located):
    """An item of a launch description."""

    def describe_sub_entities(self) -> list[Any]:
        """Return the entities that follow each visit of this one."""
        return []

    def describe_conditional_sub_entities(self) -> list[tuple[str, Iterable[Any]]]:
        """Return the entities that may follow, with the reason."""
        return []

    def visit(self, context: Any) -> list[Any] | None:
        """Execute the entity, and return the entities to visit next."""
        raise NotImplementedError

    def get_asyncio_future(self) -> None:
        """Return None, because there is no event loop."""
        return


class Action(LaunchDescriptionEntity):
    """An intention, perhaps under a condition."""

    condition = Field(
        None, types=(Condition, type(None)), remedy="Wrap it: condition=IfCondition(...)."
    )

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> tuple[Any, dict[str, Any]]:
        """Return the class and the arguments of an element of XML or YAML."""
        return cls, read_element(cls, entity, parser)

    def get_sub_entities(self) -> list[Any]:
        return []

    def describe_sub_entities(self) -> list[Any]:
        return list(self.get_sub_entities()) if self.condition is None else []

    def describe_conditional_sub_entities(self) -> list[tuple[str, Iterable[Any]]]:
        """Return the entities that follow if the condition holds."""
        if self.condition is None:
            return []
        return [(f"Conditionally included by {self.describe()}", self.get_sub_entities())]

    def visit(self, context: Any) -> list[Any] | None:
        """Execute the action if its condition holds."""
        found: list[Any] | None = context.session.visit_action(self, context)
        return found

    #: Name of the method of the executor or of the context that is the whole effect of the action.
    performs = ""

    def execute(self, context: Any) -> Any:
        """Execute the action, and return the entities to visit next."""
        if not self.performs:
            return None
        if hasattr(context.session, self.performs):
            return getattr(context.session, self.performs)(self, context)
        return getattr(context, self.performs)()


class Event(Located):
    """An event of the launch."""

    name: Any = property(lambda self: f"{type(self).__module__}.{type(self).__name__}")


SomeSubstitutionsType_types_tuple = (str, Path, Substitution, collections.abc.Iterable)
SomeEntitiesType_types_tuple = (LaunchDescriptionEntity, collections.abc.Iterable)


def ensure_argument_type(
    argument: Any, types: Any, argument_name: str, caller: str | None = None, remedy: str = ""
) -> None:
    """Check the type of an argument."""
    wanted = tuple(types) if isinstance(types, collections.abc.Iterable) else (types,)
    if isinstance(argument, wanted):
        return
    names = list(dict.fromkeys(getattr(t, "__name__", str(t)) for t in wanted))
    listed = names[-1]
    if len(names) > 1:
        listed = f"{', '.join(names[:-1])} or {names[-1]}"
    where = f" of {caller}" if caller else ""
    message = f"argument '{argument_name}'{where} must be of type {listed}, but {shown(argument)}"
    kind = _KIND_OF_ARGUMENT.get(argument_name, "bad_type" if remedy else "exception")
    raise mistake(TypeError, message, kind, remedy or "Give a value of this type.")


#: Kind of a mistake by the name of the argument.
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
    """Return a text, a path, a substitution, or a list of them as a list of substitutions."""
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


def as_default(value: Any) -> list[Substitution]:
    """Return a default as substitutions; other values become text, e.g. `5` for 5."""
    items = value if isinstance(value, collections.abc.Iterable) else (value,)
    texts: list[Any] = []
    for item in items:
        texts.append(item if isinstance(item, (str, Substitution)) else str(item))
    return normalize_to_list_of_substitutions(texts)

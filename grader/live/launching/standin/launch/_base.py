"""The ground on which the stand-in rests: entities, substitutions, conditions, and where each was written.

Every object that a launch file builds remembers the line of that file. A substitution is resolved long
after the line that wrote it, so without this the student would be shown a place in the grader.
"""

from __future__ import annotations

import collections.abc
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

#: The stand-in, and the script that evaluates with it.
STANDIN_ROOT = str(Path(__file__).resolve().parents[2]) + os.sep

SourceLine = tuple[str, int]

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
    """The innermost line outside the stand-in from which the current call comes."""
    if _declared_lines:
        return _declared_lines[-1]
    frame = sys._getframe(1)
    while frame is not None:
        name = frame.f_code.co_filename
        if not name.startswith(STANDIN_ROOT) and not name.startswith("<"):
            return name, frame.f_lineno
        frame = frame.f_back  # type: ignore[assignment]
    return None


def blame(error: BaseException, source: Any) -> None:
    """Note on an exception which object of the launch file it came from; the innermost one stays."""
    if getattr(error, "launch_source", None) is None:
        line = getattr(source, "source_line", None)
        if line is not None:
            error.launch_source = line  # type: ignore[attr-defined]
            error.launch_object = type(source).__name__  # type: ignore[attr-defined]


class Located:
    """Something that a launch file constructs, with the line that does so."""

    source_line: SourceLine | None = None

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:
        self = object.__new__(cls)
        self.source_line = calling_line()
        return self


class UnsupportedByStandin(ImportError):
    """The launch file uses something real that the stand-in cannot evaluate: not the student's fault."""


class InvalidLaunchFileError(Exception):
    """A launch file could not be read as what its name says it is."""

    def __init__(self, extension: str = "", *, likely_errors: Iterable[BaseException] = ()) -> None:
        self.likely_errors = tuple(likely_errors)
        kind = f"({extension}) " if extension else ""
        why = "; ".join(f"{type(e).__name__}: {e}" for e in self.likely_errors)
        super().__init__(f"the launch file {kind}could not be read: {why or 'unknown format'}")
        self.__cause__ = self.likely_errors[0] if self.likely_errors else None


class SubstitutionFailure(Exception):
    """A substitution has no value."""


class InvalidConditionExpressionError(Exception):
    """The text of a condition is neither true nor false."""


class Substitution(Located):
    """A text that is known only while launching."""

    def __init__(self) -> None:
        pass

    def describe(self) -> str:
        """Text for people."""
        return f"{type(self).__name__}()"

    def perform(self, context: Any) -> str:
        """The text."""
        return ""


class Condition(Located):
    """Decides whether an action is carried out."""

    def __init__(self, *, predicate: Callable[[Any], bool] | None = None) -> None:
        if predicate is not None and not callable(predicate):
            raise TypeError(f"a condition's predicate must be callable, not {type(predicate).__name__}")
        self._predicate = predicate
        self._last_evaluation: bool | None = None

    def describe(self) -> str:
        """Text for people."""
        return f"{type(self).__name__}()"

    def evaluate(self, context: Any) -> bool:
        """Whether the action is carried out."""
        if self._predicate is None:
            raise RuntimeError("this condition has no predicate")
        try:
            self._last_evaluation = self._predicate(context)
        except Exception as error:
            blame(error, self)
            raise
        return self._last_evaluation


class LaunchDescriptionEntity(Located):
    """Whatever may stand in a launch description."""

    context_of_completion: Any = None

    def describe(self) -> str:
        """Text for people."""
        return f"<{type(self).__name__}>"

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

    def __init__(self, *, condition: Condition | None = None) -> None:
        ensure_argument_type(condition, (Condition, type(None)), "condition", type(self).__name__)
        self.__condition = condition

    @property
    def condition(self) -> Condition | None:
        """The condition, if any."""
        return self.__condition

    def get_sub_entities(self) -> list[Any]:
        """Entities inside this action."""
        return []

    def describe_sub_entities(self) -> list[Any]:
        """Entities that follow whenever this one is visited."""
        return list(self.get_sub_entities()) if self.__condition is None else []

    def describe_conditional_sub_entities(self) -> list[tuple[str, Iterable[Any]]]:
        """Entities that follow if the condition holds."""
        if self.__condition is None:
            return []
        return [(f"Conditionally included by {self.describe()}", self.get_sub_entities())]

    def visit(self, context: Any) -> list[Any] | None:
        """Carry out the action if its condition holds."""
        if self.__condition is not None:
            holds = self.__condition.evaluate(context)
            context.session.note_condition(self, holds)
            if not holds:
                return None
        result: list[Any] | None = self.execute(context)
        context.session.completed(self)
        return result

    def execute(self, context: Any) -> list[Any] | None:
        """Carry out the action; yields the entities to visit next."""
        return None

    def complete(self, event: Any, session: Any) -> None:
        """Let it be known that the action is over, once it is; most are so at once."""
        session.emit(event, {"on_completion_of": type(self).__name__})


def no_action(given: Any, position: int, parent: Any) -> AttributeError:
    """The error about something in a list of actions that is none."""
    error = AttributeError(f"item {position} of {type(parent).__name__} is no action: {shown(given)}")
    blame(error, parent)
    return error


class Event(Located):
    """Something that happened."""

    name = "launch.Event"


SomeSubstitutionsType = Any
SomeSubstitutionsType_types_tuple = (str, Path, Substitution, collections.abc.Iterable)
SomeEntitiesType = Any
SomeEntitiesType_types_tuple = (LaunchDescriptionEntity, collections.abc.Iterable)


def shown(value: Any) -> str:
    """A value for a message: what was written, where that can be told, and its type."""
    plain = isinstance(value, (str, int, float, list, tuple, dict, set)) and " object at 0x" not in repr(value)
    if value is None:
        return "None is given"
    given = f"{value!r:.120}" if plain else "what is given"
    return f"{given} is of type '{type(value).__name__}'"


def ensure_argument_type(argument: Any, types: Any, argument_name: str, caller: str | None = None) -> None:
    """Check the type of an argument.

    Raises
    ------
    TypeError
        It is none of `types`.
    """
    wanted = tuple(types) if isinstance(types, collections.abc.Iterable) else (types,)
    if not isinstance(argument, wanted):
        names = list(dict.fromkeys(getattr(t, "__name__", str(t)) for t in wanted))
        listed = ", ".join(names[:-1]) + " or " + names[-1] if len(names) > 1 else names[0]
        where = f" of {caller}" if caller else ""
        raise TypeError(f"argument '{argument_name}'{where} must be of type {listed}, but {shown(argument)}")


def is_a(obj: Any, entity_type: type) -> bool:
    """Whether `obj` is an instance of a type."""
    return isinstance(obj, entity_type)


def isclassinstance(obj: Any) -> bool:
    """Whether `obj` is an instance of a class, as anything is."""
    return hasattr(obj, "__class__")


def is_a_subclass(obj: Any, entity_type: type) -> bool:
    """Whether `obj` is an instance of a type, or a class below it."""
    try:
        return isinstance(obj, entity_type) or issubclass(obj, entity_type)
    except TypeError:
        return False


def normalize_to_list_of_substitutions(subs: Any) -> list[Substitution]:
    """Bring text, a path, a substitution, or a list of them into the form of a list of substitutions.

    Raises
    ------
    TypeError
        Something else is in it.
    """
    if isinstance(subs, (str, Path, Substitution)):
        return [_as_substitution(subs)]
    if isinstance(subs, collections.abc.Iterable):
        return [_as_substitution(item) for item in subs]
    raise TypeError(f"only text, substitutions, or a list of them can stand here, but {shown(subs)}")


def _as_substitution(item: Any) -> Substitution:
    if isinstance(item, (str, Path)):
        from .substitutions import TextSubstitution

        return TextSubstitution(text=str(item))
    if isinstance(item, Substitution):
        return item
    raise TypeError(f"only text or substitutions can stand in a list here, but {shown(item)}")


def perform_substitution(context: Any, substitution: Substitution) -> str:
    """Resolve one substitution, noting the line that wrote it if that fails."""
    try:
        return substitution.perform(context)
    except Exception as error:
        blame(error, substitution)
        raise


def perform_substitutions(context: Any, subs: Iterable[Substitution]) -> str:
    """Resolve a list of substitutions to one text."""
    return "".join([context.perform_substitution(sub) for sub in subs])

"""Launch descriptions and their sources."""

from __future__ import annotations

from typing import Any, NamedTuple

from launch_plan.inside import executor as _executor
from launch_plan.inside.problems import LimitExceededError, blaming, mistake, no_action

from ._base import (
    POSITIONAL,
    Field,
    LaunchDescriptionEntity,
    Located,
    Text,
    perform_substitutions,
)


class LaunchDescription(LaunchDescriptionEntity):
    """A list of entities."""

    initial_entities = Field(None, POSITIONAL)
    deprecated_reason = Field(None)

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        if len(args) > 1:
            message = f"LaunchDescription() is given {len(args)} values without a keyword, and takes one: a list"
            remedy = "Put the actions into a list: LaunchDescription([...])."
            raise mistake(TypeError, message, "positional_argument", remedy)
        super().__init__(*args, **kwargs)

    def made(self) -> None:
        """Copy the list of entities."""
        self.entities: list[Any] = []
        if self.initial_entities is not None:
            self.entities = list(self.initial_entities)

    @property
    def deprecated(self) -> bool:
        return self.deprecated_reason is not None

    def visit(self, context: Any) -> list[Any]:
        """Return the entities."""
        if self.deprecated:
            context.session.warn(f"deprecated launch description: {self.deprecated_reason}", self)
        return self.entities

    def describe_sub_entities(self) -> list[Any]:
        return self.entities

    def add_entity(self, entity: Any) -> None:
        self.entities.append(entity)

    add_action = add_entity

    def get_launch_arguments(self, conditional_inclusion: bool = False) -> list[Any]:
        """Return the arguments that can be found without a launch."""
        pairs = self.get_launch_arguments_with_include_launch_description_actions(
            conditional_inclusion
        )
        return [argument for argument, _ in pairs]

    def get_launch_arguments_with_include_launch_description_actions(
        self, conditional_inclusion: bool = False
    ) -> list[tuple[Any, list[Any] | None]]:
        """Return the arguments that can be found without a launch, with the includes around each."""
        search = _ArgumentSearch()
        search.collect(self.entities, conditional_inclusion, _Way(None, (), 0), self)
        return search.found


class _Way(NamedTuple):
    """The way from the outermost description to the present entities."""

    includes: list[Any] | None
    #: Files of the includes. A file is not searched again from inside itself.
    files: tuple[str, ...]
    depth: int


class _ArgumentSearch:
    """A search for arguments, each found once by its name."""

    def __init__(self) -> None:
        self.found: list[tuple[Any, list[Any] | None]] = []

    def collect(self, entities: Any, conditional: bool, way: _Way, parent: Any) -> None:
        """Add the arguments of entities up to a reset of the configurations."""
        from .actions import ResetLaunchConfigurations

        if way.depth > _executor.DEPTH_LIMIT:
            raise LimitExceededError("the launch description is nested without end")
        for position, entity in enumerate(entities, start=1):
            if not hasattr(entity, "describe_sub_entities"):
                raise no_action(entity, position, parent)
            self._add(entity, conditional, way)
            if isinstance(entity, ResetLaunchConfigurations):
                return
            nested = _way_into(entity, way)
            if nested is None:
                continue
            with blaming(entity):
                self.collect(entity.describe_sub_entities(), False, nested, entity)
                for _, following in entity.describe_conditional_sub_entities():
                    self.collect(following, True, nested, entity)

    def _add(self, entity: Any, conditional: bool, way: _Way) -> None:
        from .actions import DeclareLaunchArgument

        if not isinstance(entity, DeclareLaunchArgument):
            return
        known = [argument.name for argument, _ in self.found]
        if entity.name not in known:
            entity._conditionally_included = conditional or entity.condition is not None
            self.found.append((entity, way.includes))


def _way_into(entity: Any, way: _Way) -> _Way | None:
    """Return the way to the entities inside an entity; None for a file that includes itself."""
    from .actions import IncludeLaunchDescription

    if not isinstance(entity, IncludeLaunchDescription):
        return way._replace(depth=way.depth + 1)
    location = entity.launch_description_source.location_without_context() or ""
    if location in way.files:
        return None
    includes = way.includes if way.includes is not None else []
    includes.append(entity)
    return _Way(includes, (*way.files, location), way.depth + 1)


class LaunchDescriptionSource(Located):
    """A source of a launch description."""

    launch_description = Field(None, POSITIONAL)
    location: Any = Text("<string>", POSITIONAL)
    method = Field("unspecified mechanism", POSITIONAL)

    def made(self) -> None:
        self.__path = self.location
        self.location = " + ".join(str(sub) for sub in self.__path)
        self.__expanded: str | None = None
        self.__read: dict[str, Any] = {}

    def try_get_launch_description_without_context(self) -> Any:
        """Return the description, or None if its path is known only during the launch."""
        if self.launch_description is not None:
            return self.launch_description
        try:
            location = self.location_without_context()
            return None if location is None else self.__read_once(location)
        except Exception:
            return None

    def location_without_context(self) -> str | None:
        """Return the path, or None if it is known only during the launch."""
        from ._context import LaunchContext

        try:
            return perform_substitutions(LaunchContext(), self.__path)
        except Exception:
            return None

    def get_launch_description(self, context: Any) -> Any:
        if self.__expanded is None:
            self.__expanded = perform_substitutions(context, self.__path)
            self.location = self.__expanded
        if self.launch_description is not None:
            return self.launch_description
        return self.__read_once(self.__expanded)

    def __read_once(self, location: str) -> Any:
        if location not in self.__read:
            self.__read[location] = self._get_launch_description(location)
        return self.__read[location]

    def _get_launch_description(self, location: str) -> Any:
        raise RuntimeError("this source holds no launch description")


#: Most levels of a printed description.
_DEEPEST_SHOWN = 20


class LaunchIntrospector:
    """A printer of launch descriptions."""

    def format_launch_description(self, launch_description: Any) -> str:
        """Return a line for each entity, indented by its depth."""
        return "\n".join(_lines(launch_description, 0))


def _lines(entity: Any, depth: int) -> list[str]:
    lines = ["    " * depth + entity.describe()]
    if depth < _DEEPEST_SHOWN:
        for inner in entity.describe_sub_entities():
            lines += _lines(inner, depth + 1)
    return lines

"""Launch descriptions, and where they come from."""

from __future__ import annotations

from typing import Any

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
        """Keep a list of one's own."""
        self.entities: list[Any] = (
            [] if self.initial_entities is None else list(self.initial_entities)
        )

    @property
    def deprecated(self) -> bool:
        return self.deprecated_reason is not None

    def visit(self, context: Any) -> list[Any]:
        """The entities."""
        if self.deprecated:
            context.session.warn(f"deprecated launch description: {self.deprecated_reason}", self)
        return self.entities

    def describe_sub_entities(self) -> list[Any]:
        return self.entities

    def add_entity(self, entity: Any) -> None:
        self.entities.append(entity)

    add_action = add_entity

    def get_launch_arguments(self, conditional_inclusion: bool = False) -> list[Any]:
        """The arguments that can be found without launching."""
        pairs = self.get_launch_arguments_with_include_launch_description_actions(
            conditional_inclusion
        )
        return [argument for argument, _ in pairs]

    def get_launch_arguments_with_include_launch_description_actions(
        self, conditional_inclusion: bool = False
    ) -> list[tuple[Any, list[Any] | None]]:
        """The arguments that can be found without launching, with the includes that lead to each."""
        found: list[tuple[Any, list[Any] | None]] = []
        _collect_arguments(self.entities, found, conditional_inclusion, (None, (), 0), self)
        return found


def _collect_arguments(
    entities: Any,
    found: list[Any],
    conditional: bool,
    way: tuple[list[Any] | None, tuple[str, ...], int],
    parent: Any,
) -> None:
    # `way`: the includes on the way here, their files, and the depth; a file is not gone into again from itself.
    from .actions import DeclareLaunchArgument, IncludeLaunchDescription, ResetLaunchConfigurations

    if way[2] > _executor.DEPTH_LIMIT:
        raise LimitExceededError("the launch description is nested without end")
    for position, entity in enumerate(entities, start=1):
        if not hasattr(entity, "describe_sub_entities"):
            raise no_action(entity, position, parent)
        known = [argument.name for argument, _ in found]
        if isinstance(entity, DeclareLaunchArgument) and entity.name not in known:
            entity._conditionally_included = conditional or entity.condition is not None
            found.append((entity, way[0]))
        if isinstance(entity, ResetLaunchConfigurations):
            return
        nested = (*way[:2], way[2] + 1)
        if isinstance(entity, IncludeLaunchDescription):
            location = entity.launch_description_source.location_without_context() or ""
            if location in way[1]:
                continue
            includes = way[0] if way[0] is not None else []
            includes.append(entity)
            nested = (includes, (*way[1], location), way[2] + 1)
        with blaming(entity):
            _collect_arguments(entity.describe_sub_entities(), found, False, nested, entity)
            for _, following in entity.describe_conditional_sub_entities():
                _collect_arguments(following, found, True, nested, entity)


class LaunchDescriptionSource(Located):
    """Where a launch description comes from."""

    launch_description = Field(None, POSITIONAL)
    location: Any = Text("<string>", POSITIONAL)
    method = Field("unspecified mechanism", POSITIONAL)

    def made(self) -> None:
        self.__path, self.location = self.location, " + ".join(str(sub) for sub in self.location)
        self.__expanded: str | None = None
        self.__read: dict[str, Any] = {}

    def try_get_launch_description_without_context(self) -> Any:
        """The description, or None if its path is known only while launching."""
        if self.launch_description is not None:
            return self.launch_description
        try:
            location = self.location_without_context()
            return None if location is None else self.__read_once(location)
        except Exception:
            return None

    def location_without_context(self) -> str | None:
        """The path, or None if it is known only while launching."""
        from ._context import LaunchContext

        try:
            return perform_substitutions(LaunchContext(), self.__path)
        except Exception:
            return None

    def get_launch_description(self, context: Any) -> Any:
        if self.__expanded is None:
            self.location = self.__expanded = perform_substitutions(context, self.__path)
        known = self.launch_description
        return self.__read_once(self.__expanded) if known is None else known

    def __read_once(self, location: str) -> Any:
        if location not in self.__read:
            self.__read[location] = self._get_launch_description(location)
        return self.__read[location]

    def _get_launch_description(self, location: str) -> Any:
        raise RuntimeError("this source holds no launch description")


class LaunchIntrospector:
    """Shows launch descriptions to people."""

    def format_launch_description(self, launch_description: Any) -> str:
        """One line for each entity, indented by its depth."""
        return "\n".join(_lines(launch_description, 0))


def _lines(entity: Any, depth: int) -> list[str]:
    lines = [f"{'    ' * depth}{entity.describe()}"]
    for inner in entity.describe_sub_entities() if depth < 20 else []:
        lines += _lines(inner, depth + 1)
    return lines

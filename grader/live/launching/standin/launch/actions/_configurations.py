"""Actions on arguments, configurations and the environment, and those that hold others."""

from __future__ import annotations

import collections.abc
import os
from pathlib import Path
from typing import Any

from .._base import (
    Action,
    Substitution,
    blame,
    no_action,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from .._description import LaunchDescriptionSource
from .._sources import AnyLaunchDescriptionSource
from ..frontend.expose import expose_action
from ..utilities.type_utils import normalize_typed_substitution, perform_typed_substitution


@expose_action("arg")
class DeclareLaunchArgument(Action):
    """Declares an argument of the launch file."""

    def __init__(
        self,
        name: str,
        *,
        default_value: Any = None,
        description: str | None = None,
        choices: Any = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.__name = name
        self.__default_value = None if default_value is None else normalize_to_list_of_substitutions(default_value)
        if choices is not None:
            if len(choices) == 0:
                raise RuntimeError(f"the list of choices of the argument '{name}' is empty")
            fixed = default_value is not None and not isinstance(default_value, (Substitution, list))
            if fixed and default_value not in choices:
                raise RuntimeError(
                    f"the default_value '{default_value}' of the argument '{name}' is not among its choices {choices}"
                )
        self.__given_description = description
        self.__choices = choices
        self._conditionally_included = False

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<arg>`."""
        _, kwargs = parser.common(entity)
        kwargs["name"] = parser.escape_characters(entity.get_attr("name"))
        default = entity.get_attr("default", optional=True)
        if default is not None:
            kwargs["default_value"] = parser.parse_substitution(default)
        description = entity.get_attr("description", optional=True)
        if description is not None:
            kwargs["description"] = parser.escape_characters(description)
        choices = entity.nested("choice")
        if choices:
            kwargs["choices"] = [parser.escape_characters(choice.get_attr("value")) for choice in choices]
        return cls, kwargs

    @property
    def name(self) -> str:
        """Name of the argument."""
        return self.__name

    @property
    def default_value(self) -> list[Substitution] | None:
        """Its default."""
        return self.__default_value

    @property
    def description(self) -> str:
        """What it is for."""
        if self.__given_description is None:
            return "no description given" if self.__choices is None else f"One of: {self.__choices}"
        if self.__choices is None:
            return self.__given_description
        ending = "" if self.__given_description.endswith(".") else "."
        return f"{self.__given_description}{ending} Valid choices are: {self.__choices}"

    @property
    def choices(self) -> Any:
        """The values that it may have."""
        return self.__choices

    def execute(self, context: Any) -> None:
        """Give the configuration its default, or check what it has."""
        self._note(context)
        if self.__name not in context.launch_configurations:
            if self.__default_value is None:
                raise RuntimeError(f"the required launch argument '{self.__name}' was not given")
            value = perform_substitutions(context, self.__default_value)
            context.launch_configurations[self.__name] = value
        if self.__choices is not None:
            value = context.launch_configurations[self.__name]
            if value not in self.__choices:
                raise RuntimeError(
                    f"the launch argument '{self.__name}' is '{value}', but it must be one of {self.__choices}"
                )

    def _note(self, context: Any) -> None:
        default = None
        if self.__default_value is not None:
            try:
                default = perform_substitutions(context, self.__default_value)
            except Exception:
                if self.__name not in context.launch_configurations:
                    raise
        entry = {
            "name": str(self.__name),
            "default": default,
            "description": str(self.__given_description or ""),
            "choices": None if self.__choices is None else [str(c) for c in self.__choices],
            "included": len(context.session.include_chain) > 1,
            "source": self.source_line,
        }
        context.session.arguments.append(entry)


@expose_action("let")
class SetLaunchConfiguration(Action):
    """Sets a launch configuration."""

    def __init__(self, name: Any, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__name = normalize_to_list_of_substitutions(name)
        self.__value = normalize_to_list_of_substitutions(value)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<let>`."""
        return parser.with_substitutions(cls, entity, {"name": "name", "value": "value"})

    def execute(self, context: Any) -> None:
        """Set it."""
        name = perform_substitutions(context, self.__name)
        context.launch_configurations[name] = perform_substitutions(context, self.__value)


class UnsetLaunchConfiguration(Action):
    """Removes a launch configuration."""

    def __init__(self, name: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__name = normalize_to_list_of_substitutions(name)

    def execute(self, context: Any) -> None:
        """Remove it."""
        context.launch_configurations.pop(perform_substitutions(context, self.__name), None)


class PushLaunchConfigurations(Action):
    """Begins a scope of launch configurations."""

    def execute(self, context: Any) -> None:
        """Begin it."""
        context._push_launch_configurations()


class PopLaunchConfigurations(Action):
    """Ends a scope of launch configurations."""

    def execute(self, context: Any) -> None:
        """End it."""
        context._pop_launch_configurations()


@expose_action("reset")
class ResetLaunchConfigurations(Action):
    """Removes all launch configurations but those given."""

    def __init__(self, launch_configurations: Any = None, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__kept = launch_configurations or {}

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<reset>`."""
        _, kwargs = parser.common(entity)
        kwargs["launch_configurations"] = parser.pairs(entity, "keep")
        return cls, kwargs

    def execute(self, context: Any) -> None:
        """Remove them."""
        normal = normalize_to_list_of_substitutions
        kept = {
            perform_substitutions(context, normal(name)): _kept_value(context, value)
            for name, value in self.__kept.items()
        }
        context.launch_configurations.clear()
        context.launch_configurations.update(kept)


def _kept_value(context: Any, value: Any) -> Any:
    # What other actions keep among the configurations, such as a list of parameters, stays as it is; and so
    # does a list that mixes text with substitutions.
    parts = value if isinstance(value, collections.abc.Iterable) else [value]
    if isinstance(value, str) or not all(isinstance(part, Substitution) for part in parts):
        return value
    return perform_substitutions(context, normalize_to_list_of_substitutions(value))


class PushEnvironment(Action):
    """Begins a scope of environment variables."""

    def execute(self, context: Any) -> None:
        """Begin it."""
        context._push_environment()


class PopEnvironment(Action):
    """Ends a scope of environment variables."""

    def execute(self, context: Any) -> None:
        """End it."""
        context._pop_environment()


@expose_action("reset_env")
class ResetEnvironment(Action):
    """Returns to the environment that the launch began with."""

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<reset_env>`."""
        return parser.with_substitutions(cls, entity, {})

    def execute(self, context: Any) -> None:
        """Return to it."""
        context._reset_environment()


@expose_action("set_env")
class SetEnvironmentVariable(Action):
    """Sets an environment variable for the processes that follow."""

    def __init__(self, name: Any, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__name = normalize_to_list_of_substitutions(name)
        self.__value = normalize_to_list_of_substitutions(value)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<set_env>`."""
        return parser.with_substitutions(cls, entity, {"name": "name", "value": "value"})

    @property
    def name(self) -> list[Substitution]:
        """Name of the variable."""
        return self.__name

    @property
    def value(self) -> list[Substitution]:
        """Its value."""
        return self.__value

    def execute(self, context: Any) -> None:
        """Set it."""
        name = perform_substitutions(context, self.__name)
        context.environment[name] = perform_substitutions(context, self.__value)


@expose_action("append_env")
class AppendEnvironmentVariable(Action):
    """Adds to an environment variable for the processes that follow."""

    def __init__(self, name: Any, value: Any, prepend: Any = False, separator: Any = os.pathsep, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__name = normalize_to_list_of_substitutions(name)
        self.__value = normalize_to_list_of_substitutions(value)
        self.__prepend = normalize_typed_substitution(prepend, bool)
        self.__separator = normalize_to_list_of_substitutions(separator)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<append_env>`."""
        _, kwargs = parser.with_substitutions(
            cls, entity, {"name": "name", "value": "value"}, {"separator": "separator"}
        )
        prepend = entity.get_attr("prepend", optional=True, data_type=bool)
        if prepend is not None:
            kwargs["prepend"] = parser.parse_if_substitutions(prepend)
        return cls, kwargs

    def execute(self, context: Any) -> None:
        """Add to it."""
        name = perform_substitutions(context, self.__name)
        value = perform_substitutions(context, self.__value)
        separator = perform_substitutions(context, self.__separator)
        prepend = perform_typed_substitution(context, self.__prepend, bool)
        if name in context.environment:
            before = context.environment[name]
            value = separator.join([value, before] if prepend else [before, value])
        context.environment[name] = value


@expose_action("unset_env")
class UnsetEnvironmentVariable(Action):
    """Removes an environment variable for the processes that follow."""

    def __init__(self, name: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.__name = normalize_to_list_of_substitutions(name)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<unset_env>`."""
        return parser.with_substitutions(cls, entity, {"name": "name"})

    @property
    def name(self) -> list[Substitution]:
        """Name of the variable."""
        return self.__name

    def execute(self, context: Any) -> None:
        """Remove it."""
        context.environment.pop(perform_substitutions(context, self.__name), None)


@expose_action("group")
class GroupAction(Action):
    """Holds other actions, in a scope of their own unless told otherwise."""

    def __init__(
        self,
        actions: Any,
        *,
        scoped: bool = True,
        forwarding: bool = True,
        launch_configurations: Any = None,
        **left_over_kwargs: Any,
    ) -> None:
        super().__init__(**left_over_kwargs)
        self.__actions = actions
        self.__scoped = scoped
        self.__forwarding = forwarding
        self.__configurations = launch_configurations or {}
        self.__inside: list[Any] | None = None

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<group>`."""
        _, kwargs = parser.common(entity)
        for name in ("scoped", "forwarding"):
            value = entity.get_attr(name, data_type=bool, optional=True)
            if value is not None:
                kwargs[name] = value
        kept = parser.pairs(entity, "keep")
        if kept:
            kwargs["launch_configurations"] = kept
        kwargs["actions"] = [parser.parse_action(e) for e in entity.children if e.type_name != "keep"]
        return cls, kwargs

    def get_sub_entities(self) -> list[Any]:
        """The actions, between those that begin and end the scope."""
        if self.__inside is None:
            actions = list(self.__actions)
            sets = [SetLaunchConfiguration(name, value) for name, value in self.__configurations.items()]
            begin = [PushLaunchConfigurations(), PushEnvironment()]
            end = [PopEnvironment(), PopLaunchConfigurations()]
            for position, action in enumerate(actions, start=1):
                if not hasattr(action, "visit"):
                    raise no_action(action, position, self)
            if not self.__scoped:
                self.__inside = [*sets, *actions]
            elif self.__forwarding:
                self.__inside = [*begin, *sets, *actions, *end]
            else:
                reset = [ResetEnvironment(), ResetLaunchConfigurations(self.__configurations)]
                self.__inside = [*begin, *reset, *actions, *end]
        return self.__inside

    def execute(self, context: Any) -> list[Any]:
        """The actions."""
        return self.get_sub_entities()


class _EndOfInclude(Action):
    def __init__(self, restored: dict[str, Any]) -> None:
        super().__init__()
        self.__restored = restored

    def execute(self, context: Any) -> None:
        context.session.include_chain.pop()
        context.extend_locals(self.__restored)


@expose_action("include")
class IncludeLaunchDescription(Action):
    """Visits another launch description."""

    def __init__(self, launch_description_source: Any, *, launch_arguments: Any = None, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if not isinstance(launch_description_source, LaunchDescriptionSource):
            launch_description_source = AnyLaunchDescriptionSource(launch_description_source)
        self.__source = launch_description_source
        self.__arguments = () if launch_arguments is None else tuple(launch_arguments)

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<include>`."""
        _, kwargs = parser.common(entity)
        kwargs["launch_description_source"] = parser.parse_substitution(entity.get_attr("file"))
        pairs = [*entity.nested("arg"), *entity.nested("let")]
        kwargs["launch_arguments"] = [
            (parser.parse_substitution(e.get_attr("name")), parser.parse_substitution(e.get_attr("value")))
            for e in pairs
        ]
        return cls, kwargs

    @property
    def launch_description_source(self) -> Any:
        """Where it comes from."""
        return self.__source

    @property
    def launch_arguments(self) -> Any:
        """What it is given."""
        return self.__arguments

    def describe(self) -> str:
        """Text for people."""
        return f"IncludeLaunchDescription({self.__source.location})"

    def get_sub_entities(self) -> list[Any]:
        """The description, if it is known without launching."""
        description = self.__source.try_get_launch_description_without_context()
        return [] if description is None else [description]

    def _names_without_context(self) -> list[str]:
        from .._context import LaunchContext

        normal = normalize_to_list_of_substitutions
        try:
            return [perform_substitutions(LaunchContext(), normal(name)) for name, _ in self.__arguments]
        except Exception:
            return []

    def execute(self, context: Any) -> list[Any]:
        """The description, after what it is given."""
        session = context.session
        description = self.__source.get_launch_description(context)
        file = str(Path(self.__source.location).absolute())
        restored = {
            name: value
            for name, value in context.get_locals_as_dict().items()
            if name in ("current_launch_file_path", "current_launch_file_directory")
        }
        session.enter_include(file)
        here = {"current_launch_file_path": file, "current_launch_file_directory": str(Path(file).parent)}
        context.extend_locals(here)
        normal = normalize_to_list_of_substitutions
        given = {}
        for name, value in self.__arguments:
            given[perform_substitutions(context, normal(name))] = value
        self._check_required(context, description, list(given))
        self._note(context, file, given)
        sets = [SetLaunchConfiguration(name, value) for name, value in self.__arguments]
        return [*sets, description, _EndOfInclude(restored)]

    def _check_required(self, context: Any, description: Any, given: list[str]) -> None:
        for argument, includes in description.get_launch_arguments_with_include_launch_description_actions():
            if argument._conditionally_included or argument.default_value is not None:
                continue
            names = given + [name for include in includes or [] for name in include._names_without_context()]
            if argument.name not in names:
                error = RuntimeError(
                    f"the launch description needs the argument '{argument.name}' "
                    f"({argument.description}); it was given: {', '.join(given) or 'nothing'}"
                )
                outermost = len(context.session.include_chain) < 2
                blame(error, (includes or [argument])[0] if outermost else self)
                raise error

    def _note(self, context: Any, file: str, given: dict[str, Any]) -> None:
        if len(context.session.include_chain) < 2:
            return
        plain = {}
        for name, value in given.items():
            plain[name] = perform_substitutions(context, normalize_to_list_of_substitutions(value))
        source = self.source_line
        entry = {"file": file, "arguments": plain, "when": context.session.when, "source": source}
        context.session.includes.append(entry)

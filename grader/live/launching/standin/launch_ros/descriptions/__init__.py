"""Descriptions of nodes inside other processes, and of parameters."""

from __future__ import annotations

from typing import Any

from launch._base import Located, Substitution, normalize_to_list_of_substitutions
from launch._catalogue import missing_name

from ..parameter_descriptions import Parameter, ParameterFile, ParameterValue
from ..utilities import normalize_parameters, normalize_remap_rules

__all__ = ["ComposableLifecycleNode", "ComposableNode", "Parameter", "ParameterFile", "ParameterValue"]


def __getattr__(name: str) -> Any:
    return missing_name(__name__, name)


class ComposableNode(Located):
    """A node to be loaded into a container."""

    def __init__(
        self,
        *,
        package: Any,
        plugin: Any,
        name: Any = None,
        namespace: Any = None,
        parameters: Any = None,
        remappings: Any = None,
        extra_arguments: Any = None,
        condition: Any = None,
    ) -> None:
        normal = normalize_to_list_of_substitutions
        self.package: list[Substitution] = normal(package)
        self.node_plugin: list[Substitution] = normal(plugin)
        self.node_name = None if name is None else normal(name)
        self.node_namespace = None if namespace is None else normal(namespace)
        self.parameters = None if parameters is None else normalize_parameters(parameters)
        self.remappings = list(normalize_remap_rules(remappings)) if remappings else None
        self.extra_arguments = normalize_parameters(extra_arguments) if extra_arguments else None
        self.__condition = condition

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        """From `<composable_node>`."""
        from ..actions import Node

        _, kwargs = parser.common(entity)
        kwargs["package"] = parser.parse_substitution(entity.get_attr("pkg"))
        kwargs["plugin"] = parser.parse_substitution(entity.get_attr("plugin"))
        for name in ("name", "namespace"):
            value = entity.get_attr(name, optional=True)
            if value is not None:
                kwargs[name] = parser.parse_substitution(value)
        kwargs.update(Node.parse_ros(entity, parser))
        extra = parser.pairs(entity, "extra_arg")
        if extra:
            kwargs["extra_arguments"] = [{name: value} for name, value in extra.items()]
        entity.assert_entity_completely_parsed()
        return cls, kwargs

    def condition(self) -> Any:
        """The condition, if any."""
        return self.__condition


class ComposableLifecycleNode(ComposableNode):
    """A lifecycle node to be loaded into a container."""

    def __init__(self, *, autostart: Any = False, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.node_autostart = autostart

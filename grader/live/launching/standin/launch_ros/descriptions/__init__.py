"""Descriptions of nodes inside other processes, and of parameters."""

from __future__ import annotations

from typing import Any

from launch._base import Action, Field, Located, Text

from ..parameter_descriptions import Parameter, ParameterFile, ParameterValue
from ..utilities import normalize_parameters, normalize_remap_rules


class _Parameters(Field):
    def normal(self, value: Any) -> Any:
        return normalize_parameters(value)


class ComposableNode(Located):
    """A node to be loaded into a container."""

    package = Text(attribute="pkg")
    plugin = Text(attribute="plugin")
    name = Text(None, attribute="name")
    namespace = Text(None, attribute="namespace")
    parameters = _Parameters(None)
    remappings: Any = Field(None)
    extra_arguments = _Parameters(None)
    condition: Any = Field(None)

    node_plugin = property(lambda self: self.plugin)
    node_name = property(lambda self: self.name)
    node_namespace = property(lambda self: self.namespace)

    def made(self) -> None:
        self.remappings = list(normalize_remap_rules(self.given["remappings"] or ())) or None
        self.condition = lambda: self.given["condition"]

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> Any:
        from ..actions._node import parse_ros

        kwargs = Action.parse.__func__(cls, entity, parser)[1]  # type: ignore[attr-defined]
        kwargs.update(parse_ros(entity, parser))
        extra = parser.pairs(entity, "extra_arg")
        if extra:
            kwargs["extra_arguments"] = [{name: value} for name, value in extra.items()]
        entity.assert_entity_completely_parsed()
        return cls, kwargs


class ComposableLifecycleNode(ComposableNode):
    """A lifecycle node to be loaded into a container."""

    autostart = Field(False)
    node_autostart = property(lambda self: self.autostart)

"""Descriptions of nodes inside other processes, and of parameters."""

from __future__ import annotations

from typing import Any

from launch._base import Field, Located, Text

from ..parameter_descriptions import (
    Parameter,
    ParameterFile,
    ParameterValue,
    read_parameters,
    read_remappings,
)
from ..utilities import normalize_parameters, normalize_remap_rules


def _extra(entity: Any, parser: Any) -> Any:
    return [{name: value} for name, value in parser.pairs(entity, "extra_arg").items()] or None


class ComposableNode(Located):
    package = Text(attribute="pkg")
    plugin = Text(attribute="plugin")
    name = Text(None, attribute="name", written=True)
    namespace = Text(None, attribute="namespace")
    parameters = Field(None, normal=normalize_parameters, nested=read_parameters)
    remappings: Any = Field(None, nested=read_remappings)
    extra_arguments = Field(None, normal=normalize_parameters, nested=_extra)
    condition: Any = Field(None)

    node_plugin = property(lambda self: self.plugin)
    node_name = property(lambda self: self.name)
    node_namespace = property(lambda self: self.namespace)

    def made(self) -> None:
        self.remappings = list(normalize_remap_rules(self.given["remappings"] or ())) or None
        self.condition = lambda: self.given["condition"]


class ComposableLifecycleNode(ComposableNode):
    autostart = Field(False)
    node_autostart = property(lambda self: self.autostart)

"""`grade checks`: list the checks that a rubric can use."""

from __future__ import annotations

import argparse
import types
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rich.console import Console
from rich.padding import Padding
from rich.text import Text

_KINDS = {str: "text", float: "number", int: "whole number", bool: "true or false"}


def run(arguments: Sequence[str], console: Console) -> int:
    """List the checks; returns the exit status."""
    from grader.checks import REGISTRY

    argparse.ArgumentParser(prog="grade checks", description="List the checks that a rubric can use.").parse_args(
        arguments
    )
    for name, check in REGISTRY.items():
        console.print(f"[bold]{name}[/]: {' '.join((check.parameters.__doc__ or '').split())}")
        for key, field in check.parameters.model_fields.items():
            said = f"{key}: {_kind(field.annotation)}, {_need(field)}. {field.description or ''}".rstrip()
            console.print(Padding(Text(said), (0, 0, 0, 4), expand=False))
    return 0


def _need(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True)
    if default is None or default in ((), {}):
        return "optional"
    if isinstance(default, BaseModel):
        default = default.model_dump()
    return f"default {default!r}"


def _kind(annotation: Any) -> str:
    """Say what stands in YAML for a type."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kind(inner[0])
    if origin in (Union, types.UnionType):
        return " or ".join(_kind(each) for each in inner if each is not type(None))
    if origin is Literal:
        return " or ".join(map(repr, inner))
    if origin is tuple:
        return f"list ({_kind(inner[0])} each)"
    if origin is not None and issubclass(origin, Mapping):
        return "mapping"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"mapping ({', '.join(annotation.model_fields)})"
    return _KINDS.get(annotation, "any value")

"""`grade checks`: list the checks that a rubric can use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from grader.commands.arguments import parser_of

_KINDS = {"string": "text", "number": "number", "integer": "whole number", "boolean": "true or false"}


def run(arguments: Sequence[str], console: Console) -> int:
    """List the checks; returns the exit status."""
    from grader.checks.registry import REGISTRY

    parser_of("grade checks", "List the checks that a rubric can use.").parse_args(arguments)
    for name, check in REGISTRY.items():
        schema = check.parameters.model_json_schema()
        console.print(f"[bold]{name}[/]: {' '.join(schema['description'].split())}")
        for key, part in schema.get("properties", {}).items():
            words = f"{key}: {_kind(part, schema)}, {_need(key, part, schema)}. {part.get('description', '')}".rstrip()
            console.print(Padding(Text(words), (0, 0, 0, 4), expand=False))
    return 0


def _need(key: str, part: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    if key in schema.get("required", ()):
        return "required"
    default = part.get("default")
    return "optional" if default is None or default in ([], {}) else f"default {default!r}"


def _kind(part: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    """Say what stands in YAML for a part of a JSON Schema."""
    if "$ref" in part:
        model = schema["$defs"][part["$ref"].rpartition("/")[2]]
        return f"mapping ({', '.join(model['properties'])})"
    if "anyOf" in part:
        return " or ".join(_kind(each, schema) for each in part["anyOf"] if each.get("type") != "null")
    if "enum" in part or "const" in part:
        return " or ".join(map(repr, part.get("enum", [part.get("const")])))
    if part.get("type") == "array":
        return f"list ({_kind(part['items'], schema)} each)"
    if part.get("type") == "object":
        return "mapping"
    return _KINDS.get(part.get("type", ""), "any value")

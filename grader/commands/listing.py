"""What a rubric can use, listed: checks, steps and figures with their parameters, those within them, and an example."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import yaml
from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from grader.commands import COMMANDS
from grader.commands.arguments import add_flag, parser_of
from grader.lab.references import Parameters
from grader.lab.yaml_with_lines import meant

_KINDS = {
    "string": "text",
    "number": "number",
    "integer": "whole number",
    "boolean": "true or false",
}
#: What stands in an example for a key of this name, unless its type says more than that it is a text or a number.
_NAMED: Mapping[str, Any] = {
    **{
        "topic": "/chatter",
        "service": "/enable",
        "action": "/fibonacci",
        "node": "/talker",
        "name": "rate",
    },
    **{"child": "robot", "parent": "odom", "names": ["rate"]},
    **{
        "rate_hz": 10,
        "tick_s": 0.1,
        "least_s": 1,
        "most_s": 5,
        "within_s": 0.5,
        "tolerance": 0.01,
        "index": 0,
    },
    **{"full_within": "2%", "zero_beyond": "20%", "full_within_s": 0.003, "zero_beyond_s": 0.01},
    **{"message": {"data": "hello"}, "request": {"data": True}, "response": {"success": True}},
    **{
        "refused": {"success": False},
        "recovered": {"success": True},
        "values": {"rate": 10.0},
        "value": True,
    },
    **{
        "pattern": r"rms: ([0-9.]+)",
        "label": "mean",
        "key": "mean",
        "executable": "talker",
        "default": "10",
    },
}
_Schema = Mapping[str, Any]


@dataclass(frozen=True)
class Parameter:
    """A key of a mapping in the rubric: what stands there, and of a mapping or a list of these, their keys."""

    name: str
    type: str
    required: bool
    default: Any = None
    description: str = ""
    parameters: list[Parameter] = field(default_factory=list)


@dataclass(frozen=True)
class Entry:
    """A check, a step or a figure; the example is YAML as it stands in a list of a rubric."""

    name: str
    description: str
    parameters: list[Parameter]
    example: str


def entries_of(command: str) -> list[Entry]:
    """Describe what a command lists, by the names under which a rubric knows it."""
    from grader.judging.rubrics import rubric_kinds
    from grader.lab.steps import STEPS

    kinds = rubric_kinds()
    if command == "checks":
        return entries_of_checks(kinds.checks)
    if command == "steps":
        return _entries(STEPS, {}, "")
    around = {"title": "What was published", "session": "talking"}
    return _entries(kinds.figures, around, "kind")


def entries_of_checks(models: Mapping[str, type[Parameters]]) -> list[Entry]:
    """Describe checks by the models of their parameters."""
    around = {"id": "talker.right", "title": "It is right", "points": 5, "session": "talking"}
    return _entries(models, around, "check")


def _entries(
    models: Mapping[str, type[Parameters]], around: Mapping[str, Any], key: str
) -> list[Entry]:
    """Describe models.

    Parameters
    ----------
    around
        Other keys in an example.
    key
        Key of the name in an example, whose parameters are behind `with`; empty if the name is the key of its parameters.
    """
    found = []
    for name, model in models.items():
        schema = model.model_json_schema()
        values = {**_example_of(schema, schema), **model.example}
        entry = {**around, key: name, "with": values} if key else {name: values}
        text = yaml.safe_dump([entry], sort_keys=False, allow_unicode=True, width=110)
        about = " ".join(schema.get("description", "").split())
        found.append(Entry(name, about, list(parameters_in(schema, schema)), text))
    return found


def run_listing(command: str, arguments: Sequence[str], console: Console) -> int:
    """Print what is asked for of what a command lists; returns the exit status."""
    entries, words = entries_of(command), COMMANDS[command]
    parser = parser_of(f"grade {command}", f"{words[:1].upper()}{words[1:]}.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these, each with an example")
    add_flag(parser, "--json", "as JSON, with all examples")
    options = parser.parse_args(arguments)
    known = [entry.name for entry in entries]
    if unknown := [name for name in options.names if name not in known]:
        parser.error(f"there is no {unknown[0]!r}{meant(unknown[0], known)}")
    chosen = [entry for entry in entries if entry.name in options.names or not options.names]
    if options.json:
        print(json.dumps([asdict(entry) for entry in chosen], indent=1, default=str))
        return 0
    for entry in chosen:
        console.print(Text(f"{entry.name}: ", "bold").append(entry.description, "not bold"))
        for parameter in entry.parameters:
            _print_parameter(parameter, 4, console)
        if options.names:
            console.print(Padding(Text(f"\n{entry.example}"), (0, 0, 0, 4), expand=False))
    if not options.names:
        console.print(
            Text(
                f"\n`grade {command} NAME` shows an example, `--json` everything for programs.",
                "dim",
            )
        )
    return 0


def _print_parameter(parameter: Parameter, indent: int, console: Console) -> None:
    default = (
        "optional" if parameter.default in (None, [], {}) else f"default {parameter.default!r}"
    )
    need = "required" if parameter.required else default
    words = f"{parameter.name}: {parameter.type}, {need}. {parameter.description}".rstrip()
    console.print(Padding(Text(words), (0, 0, 0, indent), expand=False))
    for inner in parameter.parameters:
        _print_parameter(inner, indent + 4, console)


# -- out of a JSON Schema --------------------------------------------------------------------------


def parameters_in(model: _Schema, schema: _Schema) -> Iterator[Parameter]:
    """Describe the keys of a model, which is a part of a schema."""
    for name, part in model.get("properties", {}).items():
        required = name in model.get("required", ())
        inner = _model_within(part, schema)
        nested = (
            list(parameters_in(inner, schema)) if inner is not None and inner is not model else []
        )
        about = next(
            (
                each["description"]
                for each in (part, *part.get("anyOf", ()))
                if "description" in each
            ),
            "",
        )
        yield Parameter(
            name,
            _kind(part, schema),
            required,
            part.get("default"),
            " ".join(about.split()),
            nested,
        )


def _model_within(part: _Schema, schema: _Schema) -> _Schema | None:
    """Return the model of a part, of its elements or of its values."""
    if "$ref" in part:
        found: _Schema = schema["$defs"][part["$ref"].rpartition("/")[2]]
        return found
    inner = [
        *part.get("anyOf", ()),
        part.get("items"),
        part.get("additionalProperties"),
        *part.get("prefixItems", ()),
    ]
    models = (_model_within(each, schema) for each in inner if isinstance(each, Mapping))
    return next((model for model in models if model is not None), None)


def _kind(part: _Schema, schema: _Schema) -> str:
    """Say what stands in YAML for a part of a JSON Schema."""
    if "$ref" in part:
        return "mapping"
    if "anyOf" in part:
        return " or ".join(
            _kind(each, schema) for each in part["anyOf"] if each.get("type") != "null"
        )
    if "enum" in part or "const" in part:
        return " or ".join(map(repr, part.get("enum", [part.get("const")])))
    if part.get("type") == "array":
        elements = part.get("prefixItems", [part.get("items", {})])
        return f"list ({', '.join(_kind(each, schema) for each in elements)}{' each' * ('items' in part)})"
    if part.get("type") == "object":
        values = part.get("additionalProperties")
        return (
            f"mapping of names to {_kind(values, schema)}"
            if isinstance(values, Mapping) and values
            else "mapping"
        )
    return _KINDS.get(part.get("type", ""), "any value")


def _example_of(part: _Schema, schema: _Schema, name: str = "") -> Any:
    """Return what may stand in YAML for a part of a JSON Schema: of a mapping what is required."""
    if "$ref" in part:
        return _example_of(schema["$defs"][part["$ref"].rpartition("/")[2]], schema)
    if "examples" in part or "enum" in part or "const" in part:
        return next(iter(part.get("examples") or part.get("enum") or [part.get("const")]))
    if name in _NAMED:
        return _NAMED[name]
    if "anyOf" in part:
        return _example_of(
            next(each for each in part["anyOf"] if each.get("type") != "null"), schema
        )
    if part.get("type") == "array":
        return [
            _example_of(each, schema) for each in part.get("prefixItems", [part.get("items", {})])
        ]
    if part.get("type") == "object":
        values, properties = part.get("additionalProperties"), part.get("properties", {})
        named = {
            each: _example_of(properties[each], schema, each) for each in part.get("required", ())
        }
        return (
            {"name": _example_of(values, schema)}
            if isinstance(values, Mapping) and values
            else named
        )
    if part.get("type") in ("number", "integer"):
        least = max(part.get("minimum", 0), part.get("exclusiveMinimum", 0))
        return min(least + 1, part.get("maximum", part.get("exclusiveMaximum", least + 2) / 2))
    return {"boolean": True, "string": r"(\d+)" if part.get("format") == "regex" else "text"}.get(
        part.get("type", ""), {}
    )

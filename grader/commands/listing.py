"""Lists of checks, steps and figures for rubrics, with their parameters and an example."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import yaml
from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from grader.commands import COMMANDS
from grader.commands.arguments import add_flag, as_sentence, parser_of
from grader.commands.outline import outline_of, own_api
from grader.lab.references import Parameters
from grader.lab.similar_words import meant

_KINDS = {
    "string": "text",
    "number": "number",
    "integer": "whole number",
    "boolean": "true or false",
}
#: Values of examples by the name of a key, for texts and numbers without a stricter type.
_NAMED: Mapping[str, Any] = {
    "topic": "/chatter",
    "service": "/enable",
    "action": "/fibonacci",
    "node": "/talker",
    "name": "rate",
    "child": "robot",
    "parent": "odom",
    "names": ["rate"],
    "rate_hz": 10,
    "tick_s": 0.1,
    "least_s": 1,
    "most_s": 5,
    "within_s": 0.5,
    "tolerance": 0.01,
    "index": 0,
    "full_within": "2%",
    "zero_beyond": "20%",
    "full_within_s": 0.003,
    "zero_beyond_s": 0.01,
    "message": {"data": "hello"},
    "request": {"data": True},
    "response": {"success": True},
    "refused": {"success": False},
    "recovered": {"success": True},
    "values": {"rate": 10.0},
    "value": True,
    "pattern": r"rms: ([0-9.]+)",
    "label": "mean",
    "key": "mean",
    "executable": "talker",
    "default": "10",
}
_Schema = Mapping[str, Any]


@dataclass(frozen=True)
class Parameter:
    """A key of a mapping in the rubric; `parameters` are the keys of a nested mapping, or of a list of mappings."""

    name: str
    type: str
    required: bool
    default: Any = None
    description: str = ""
    parameters: list[Parameter] = field(default_factory=list)


@dataclass(frozen=True)
class Entry:
    """A check, a step or a figure; the example is YAML of one element of a list in a rubric."""

    name: str
    description: str
    parameters: list[Parameter]
    example: str


def entries_of(command: str) -> list[Entry]:
    """Describe the checks, steps or figures, by their names in a rubric."""
    from grader.judging.rubrics import rubric_kinds
    from grader.lab.steps import STEPS

    kinds = rubric_kinds()
    if command == "checks":
        return entries_of_checks(kinds.checks)
    if command == "steps":
        return [_entry(name, model, {}, "") for name, model in STEPS.items()]
    around = {"title": "What was published", "session": "talking"}
    return [_entry(name, model, around, "kind") for name, model in kinds.figures.items()]


def entries_of_checks(models: Mapping[str, type[Parameters]]) -> list[Entry]:
    """Describe checks by the models of their parameters."""
    around = {"id": "talker.right", "title": "It is right", "points": 5, "session": "talking"}
    return [_entry(name, model, around, "check") for name, model in models.items()]


def _entry(name: str, model: type[Parameters], around: Mapping[str, Any], key: str) -> Entry:
    """Describe a model, with an example.

    The example has the keys `around`, the name under `key`, and the parameters under `with`. Without a key, the
    parameters are under the name, e.g. `{observe: {duration_s: 4}}`.
    """
    schema = model.model_json_schema()
    values = {**_example_of(schema, schema), **model.example}
    if key:
        example = {**around, key: name, "with": values}
    else:
        example = {name: values}
    text = yaml.safe_dump([example], sort_keys=False, allow_unicode=True, width=110)
    about = " ".join(schema.get("description", "").split())
    return Entry(name, about, list(parameters_in(schema, schema)), text)


def parser_of_listing(command: str) -> argparse.ArgumentParser:
    """Return the parser of a command that lists checks, steps or figures."""
    parser = parser_of(f"grade {command}", as_sentence(COMMANDS[command]))
    words = "list only these, each with an example"
    if command == "checks":
        words += "; Context, Submission, Messages and all other names of grader.own_checks too"
    parser.add_argument("names", nargs="*", metavar="NAME", help=words)
    add_flag(parser, "--json", "print JSON, with all examples")
    return parser


def run_listing(command: str, arguments: Sequence[str], console: Console) -> int:
    """Print the chosen checks, steps or figures; returns the exit status."""
    parser = parser_of_listing(command)
    entries = entries_of(command)
    own = own_api() if command == "checks" else {}
    options = parser.parse_args(arguments)
    known = [*(entry.name for entry in entries), *own]
    for name in options.names:
        if name not in known:
            parser.error(f"there is no {name!r}{meant(name, known)}")
    chosen = entries
    if options.names:
        chosen = [entry for entry in entries if entry.name in options.names]
    if options.json:
        print(json.dumps([asdict(entry) for entry in chosen], indent=1, default=str))
        return 0
    for entry in chosen:
        _print_entry(entry, console, with_example=bool(options.names))
    if not options.names:
        words = f"\n`grade {command} NAME` shows an example, `--json` everything for programs."
        console.print(Text(words, "dim"))
    _print_outlines(options.names, own, console)
    return 0


def _print_outlines(names: Sequence[str], own: Mapping[str, Any], console: Console) -> None:
    """Print the outlines of the names in the interface of own checks."""
    for name in names:
        if name in own:
            console.print(f"{outline_of(own[name])}\n", soft_wrap=True, markup=False)


def _print_entry(entry: Entry, console: Console, *, with_example: bool) -> None:
    console.print(Text(f"{entry.name}: ", "bold").append(entry.description, "not bold"))
    for parameter in entry.parameters:
        _print_parameter(parameter, 4, console)
    if with_example:
        console.print(Padding(Text(f"\n{entry.example}"), (0, 0, 0, 4), expand=False))


def _print_parameter(parameter: Parameter, indent: int, console: Console) -> None:
    if parameter.required:
        need = "required"
    elif parameter.default in (None, [], {}):
        need = "optional"
    else:
        need = f"default {parameter.default!r}"
    words = f"{parameter.name}: {parameter.type}, {need}. {parameter.description}".rstrip()
    console.print(Padding(Text(words), (0, 0, 0, indent), expand=False))
    for inner in parameter.parameters:
        _print_parameter(inner, indent + 4, console)


# -- descriptions from a JSON Schema ---------------------------------------------------------------


def parameters_in(model: _Schema, schema: _Schema) -> Iterator[Parameter]:
    """Yield a description of each key of a model in a schema."""
    required = model.get("required", ())
    for name, part in model.get("properties", {}).items():
        kind = _kind(part, schema)
        default = part.get("default")
        nested = _nested(part, model, schema)
        yield Parameter(name, kind, name in required, default, _description(part), nested)


def _description(part: _Schema) -> str:
    """Return the description of a part, or else of its first described alternative, in one line."""
    for each in (part, *part.get("anyOf", ())):
        if "description" in each:
            return " ".join(each["description"].split())
    return ""


def _nested(part: _Schema, model: _Schema, schema: _Schema) -> list[Parameter]:
    """Describe the keys of a model within a part; none for a model that contains itself."""
    inner = _model_within(part, schema)
    if inner is None or inner is model:
        return []
    return list(parameters_in(inner, schema))


def _referenced(part: _Schema, schema: _Schema) -> _Schema:
    """Return the model that a part refers to, e.g. by `{"$ref": "#/$defs/Pose"}`."""
    name = part["$ref"].rpartition("/")[2]
    found: _Schema = schema["$defs"][name]
    return found


def _model_within(part: _Schema, schema: _Schema) -> _Schema | None:
    """Return the model of a part, of its elements or of its values; None if there is no model."""
    if "$ref" in part:
        return _referenced(part, schema)
    inner = [*part.get("anyOf", ()), part.get("items"), part.get("additionalProperties")]
    inner += part.get("prefixItems", ())
    for each in inner:
        if isinstance(each, Mapping):
            model = _model_within(each, schema)
            if model is not None:
                return model
    return None


def _alternatives(part: _Schema) -> list[_Schema]:
    """Return the alternatives of a part, except null."""
    return [each for each in part["anyOf"] if each.get("type") != "null"]


def _kind(part: _Schema, schema: _Schema) -> str:
    """Return the kind of YAML for a part of a JSON Schema, e.g. `list (number each)`."""
    if "$ref" in part:
        return "mapping"
    if "anyOf" in part:
        return " or ".join(_kind(each, schema) for each in _alternatives(part))
    if "enum" in part or "const" in part:
        values = part.get("enum", [part.get("const")])
        return " or ".join(map(repr, values))
    type_ = part.get("type", "")
    if type_ == "array":
        return _kind_of_list(part, schema)
    if type_ == "object":
        return _kind_of_mapping(part, schema)
    return _KINDS.get(type_, "any value")


def _kind_of_list(part: _Schema, schema: _Schema) -> str:
    if "prefixItems" in part:
        kinds = [_kind(each, schema) for each in part["prefixItems"]]
    else:
        kinds = [_kind(part.get("items", {}), schema)]
    each = " each" if "items" in part else ""
    return f"list ({', '.join(kinds)}{each})"


def _kind_of_mapping(part: _Schema, schema: _Schema) -> str:
    values = part.get("additionalProperties")
    if isinstance(values, Mapping) and values:
        return f"mapping of names to {_kind(values, schema)}"
    return "mapping"


def _example_of(part: _Schema, schema: _Schema, name: str = "") -> Any:
    """Return an example for a part of a JSON Schema; a mapping gets its required keys."""
    if "$ref" in part:
        return _example_of(_referenced(part, schema), schema)
    for key in ("examples", "enum"):
        if part.get(key):
            return part[key][0]
    if "const" in part:
        return part["const"]
    if name in _NAMED:
        return _NAMED[name]
    if "anyOf" in part:
        return _example_of(_alternatives(part)[0], schema)
    return _example_by_type(part, schema)


def _example_by_type(part: _Schema, schema: _Schema) -> Any:
    match part.get("type"):
        case "array":
            elements = part.get("prefixItems", [part.get("items", {})])
            return [_example_of(each, schema) for each in elements]
        case "object":
            return _example_of_mapping(part, schema)
        case "number" | "integer":
            least = max(part.get("minimum", 0), part.get("exclusiveMinimum", 0))
            return min(least + 1, part.get("maximum", part.get("exclusiveMaximum", least + 2) / 2))
        case "boolean":
            return True
        case "string":
            return r"(\d+)" if part.get("format") == "regex" else "text"
    return {}


def _example_of_mapping(part: _Schema, schema: _Schema) -> dict[str, Any]:
    values = part.get("additionalProperties")
    if isinstance(values, Mapping) and values:
        return {"name": _example_of(values, schema)}
    properties = part.get("properties", {})
    return {each: _example_of(properties[each], schema, each) for each in part.get("required", ())}

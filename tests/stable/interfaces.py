"""Interfaces for others, a fact a line; `python -m tests.stable.interfaces` keeps the present ones.

For example `grade regrade --apply` is an option, `UsageError 2` an exit status, `Result.submission: string` a key of
result.json, `LabSpec requires id, title` a part of rubrics, and `graded(credit)` a parameter of own checks.
"""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from grader import errors, own_checks
from grader.commands.all_parsers import parser_of_all
from grader.commands.outline import own_api
from grader.judging.rubrics import rubric_kinds
from grader.lab.rubric import json_schema
from grader.result import result_schema

KEPT = Path(__file__).parent


def commands() -> Iterator[str]:
    """Yield the commands with their arguments and options."""
    yield from _of_parser(parser_of_all(), "grade")


def _of_parser(parser: argparse.ArgumentParser, command: str) -> Iterator[str]:
    yield command
    for action in parser._actions:
        for option in action.option_strings:
            yield f"{command} {option}"
        if isinstance(action, argparse._SubParsersAction):
            for name, part in action.choices.items():
                yield from _of_parser(part, f"{command} {name}")
        elif not action.option_strings:
            yield f"{command} {action.metavar}"


def exit_statuses() -> Iterator[str]:
    """Yield the exit status of each error."""
    for name, kind in inspect.getmembers(errors, inspect.isclass):
        if issubclass(kind, errors.GraderError):
            yield f"{name} {kind.exit_status}"


def result() -> Iterator[str]:
    """Yield the keys of result.json, with their types."""
    schema = result_schema()
    yield f"{schema['$id']}"
    yield from _of_schema(schema, "Result")


def rubric() -> Iterator[str]:
    """Yield the keys of rubrics, with their types."""
    yield from _of_schema(json_schema(rubric_kinds()), "Rubric")


def _of_schema(schema: Mapping[str, Any], name: str) -> Iterator[str]:
    for model, part in {name: schema, **schema["$defs"]}.items():
        for key, value in part.get("properties", {}).items():
            yield f"{model}.{key}: {_type(value)}"
        required = ", ".join(sorted(part.get("required", ()))) or "nothing"
        yield f"{model} requires {required}"


def _type(part: Mapping[str, Any]) -> str:
    """Return the type of a part, e.g. `string`, or the types of its alternatives."""
    if "$ref" in part:
        return str(part["$ref"]).rpartition("/")[2]
    if "anyOf" in part:
        return " or ".join(sorted(_type(each) for each in part["anyOf"]))
    return str(part.get("type", "any"))


def own_checks_api() -> Iterator[str]:
    """Yield the names for own checks, with their parameters."""
    yield f"API_VERSION {own_checks.API_VERSION}"
    for name in vars(own_checks):
        if not name.startswith("_"):
            yield name
    for name, thing in own_api().items():
        if inspect.isfunction(thing):
            yield from _of_function(name, thing)
            continue
        for member, value in inspect.getmembers(thing):
            if not member.startswith("_"):
                yield f"{name}.{member}"
                if inspect.isfunction(value):
                    yield from _of_function(f"{name}.{member}", value)


def _of_function(name: str, function: Callable[..., Any]) -> Iterator[str]:
    required = []
    for parameter in inspect.signature(function).parameters.values():
        yield f"{name}({parameter.name})"
        if parameter.default is inspect.Parameter.empty:
            required.append(parameter.name)
    yield f"{name} requires {', '.join(required) or 'nothing'}"


INTERFACES: Mapping[str, Callable[[], Iterator[str]]] = {
    "commands": commands,
    "exit_statuses": exit_statuses,
    "result": result,
    "rubric": rubric,
    "own_checks": own_checks_api,
}


def kept_file(name: str) -> Path:
    """Return the file of an interface."""
    return KEPT / f"{name}.txt"


if __name__ == "__main__":
    for interface, facts in INTERFACES.items():
        text = "".join(f"{line}\n" for line in sorted(set(facts())))
        kept_file(interface).write_text(text, encoding="utf-8")

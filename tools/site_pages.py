"""What the documentation site has besides the pages in `docs/`; a hook of mkdocs.

Where a page says `<!-- generated: NAME -->`, what the grader's own models say comes in its place. A link from a page to
a file of the repository leads to a copy of it in the site.
"""

from __future__ import annotations

import contextlib
import html
import importlib
import io
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pydantic import BaseModel
from rich.console import Console

ROOT = Path(__file__).resolve().parents[1]
#: Where copies of the repository's files lie in the site.
COPIES = "repository"
_GENERATED = re.compile(r"<!-- generated: (\w+)(?: (\w+))? -->")
#: A command of a command, as argparse lists it.
_PART = re.compile(r"^    ([a-z]+) {2,}\S", re.MULTILINE)
_LINK_OUT = re.compile(r"(?<=\]\()\.\./([^)#\s]+)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add copies of the files of the repository to which pages lead, and which the navigation names."""
    paths = {path for page in files.documentation_pages() for path in _LINK_OUT.findall(page.content_string)}
    paths |= set(re.findall(rf"'{COPIES}/([^']+)'", str(config.nav)))
    for path in sorted(paths):
        if (ROOT / path).is_file():
            files.append(File.generated(config, f"{COPIES}/{path}", abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Fill in what is generated, and lead links out of `docs/` to the copies."""
    if page.file.src_uri.startswith(f"{COPIES}/"):
        return markdown
    filled = _GENERATED.sub(lambda found: GENERATED[found[1]](*filter(None, [found[2]])), markdown)
    return _LINK_OUT.sub(rf"{COPIES}/\1", filled)


# -- models ----------------------------------------------------------------------------------------


def _resolved(part: Mapping[str, Any], schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """Follow a reference, and leave out that a value may be missing."""
    choices = [each for each in part.get("anyOf", ()) if each.get("type") != "null"]
    if len(choices) == 1:
        rest = {key: value for key, value in part.items() if key != "anyOf"}
        return _resolved({**choices[0], **rest}, schema)
    if "$ref" in part:
        name = part["$ref"].rpartition("/")[2]
        return {**schema["$defs"][name], **{key: value for key, value in part.items() if key != "$ref"}}
    return part


_KINDS = {"string": "text", "number": "number", "integer": "whole number", "boolean": "`true` or `false`"}
_BOUNDS = {"exclusiveMinimum": "above", "minimum": "from", "exclusiveMaximum": "below", "maximum": "to"}


def _kind(part: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    """Say what stands in YAML for a part of a JSON Schema."""
    part = _resolved(part, schema)
    if "anyOf" in part:
        kinds = list(dict.fromkeys(_kind(each, schema) for each in part["anyOf"]))
        return "share" if "such as 2%" in part.get("description", "") or _is_share(part) else " or ".join(kinds)
    if "enum" in part or "const" in part:
        return ", ".join(f"`{value}`" for value in part.get("enum", [part.get("const")]))
    if part.get("type") == "array":
        return f"list of: {_kind(part.get('items', {}), schema)}"
    if part.get("type") == "object":
        values = part.get("additionalProperties")
        return f"mapping of names to: {_kind(values, schema)}" if isinstance(values, dict) else "mapping"
    bounds = " ".join(f"{word} {part[key]:g}" for key, word in _BOUNDS.items() if key in part)
    return f"{_KINDS.get(part.get('type', ''), 'any value')} {bounds}".strip()


def _is_share(part: Mapping[str, Any]) -> bool:
    return any("%" in each.get("pattern", "") for each in part["anyOf"])


def _need(key: str, part: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    if key in schema.get("required", ()):
        return "**required**"
    default = part.get("default")
    return "optional" if default is None or default in ([], {}, "") else f"`{_written(default)}`"


def _written(value: Any) -> str:
    """Write a default as YAML has it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_written(inner)}" for key, inner in value.items()) + "}"
    return str(value)


def _meaning(part: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    """Return what is said of a value; of a list or a mapping, also what is said of its parts."""
    part = _resolved(part, schema)
    values = part.get("items") or part.get("additionalProperties")
    return part.get("description") or (_meaning(values, schema) if isinstance(values, dict) else "")


def _rows(part: Mapping[str, Any], schema: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Give a line of a table for each key of a model, and for the keys of the models in it."""
    for key, inner in part.get("properties", {}).items():
        cells = (_kind(inner, schema), _need(key, inner, part), " ".join(_meaning(inner, schema).split()))
        yield f"| `{prefix}{key}` | " + " | ".join(_cell(cell) for cell in cells) + " |"
        nested, path = _resolved(inner, schema), f"{prefix}{key}"
        if isinstance(values := nested.get("items"), dict):
            nested, path = _resolved(values, schema), f"{path}[]"
        elif isinstance(values := nested.get("additionalProperties"), dict):
            nested, path = _resolved(values, schema), f"{path}.NAME"
        yield from _rows(nested, schema, f"{path}.")


def _cell(text: str) -> str:
    return html.escape(text, quote=False).replace("|", "&#124;").replace("*'", "\\*'")


def table(schema: Mapping[str, Any]) -> str:
    """Return the table of a model's keys."""
    rows = list(_rows(schema, schema))
    return "\n".join(["| key | value | default | |", "|---|---|---|---|", *rows]) if rows else "It has no settings."


def _section(name: str, model: type[BaseModel], more: str = "", level: int = 2) -> str:
    schema = model.model_json_schema()
    return f"{'#' * level} {name}\n\n{schema.get('description', '')}\n\n{more}{table(schema)}\n"


# -- what pages ask for ----------------------------------------------------------------------------


def checks() -> str:
    """Return a section for each check, below a heading for each of their modules."""
    from grader.checks.registry import REGISTRY

    groups: dict[str, list[str]] = {}
    for name, check in REGISTRY.items():
        groups.setdefault(check.find.__module__, []).append(_section(name, check.parameters, level=3))
    return "\n".join(f"## {_heading(module)}\n\n" + "\n".join(parts) for module, parts in groups.items())


def _heading(module: str) -> str:
    """Return what the checks of a module are of: its first sentence, without how it begins and goes on."""
    said = (importlib.import_module(module).__doc__ or module).partition(".")[0].partition(":")[0]
    said = said.removeprefix("Checks of ").removeprefix("Checks that ")
    return said[:1].upper() + said[1:]


def steps() -> str:
    """Return a section for each kind of step."""
    from grader.lab.steps import STEPS

    one = "Exactly one of {} is given.\n\n"
    return "\n".join(
        _section(name, step, one.format(", ".join(f"`{key}`" for key in step.targets)) if step.targets else "")
        for name, step in STEPS.items()
    )


def figures() -> str:
    """Return a section for each kind of figure."""
    from grader.report.figures import FIGURES

    return "\n".join(_section(name, figure) for name, figure in FIGURES.items())


def model(name: str) -> str:
    """Return the keys of a part of a rubric."""
    from grader.judging.rubrics import rubric_kinds
    from grader.lab.rubric import json_schema

    schema = json_schema(rubric_kinds())
    part = schema["$defs"][name]
    # What has a page or a section of its own is not told again.
    told = {key: value for key, value in part["properties"].items() if key not in ("checks", "figures", "steps")}
    return table({**part, "properties": told, "$defs": schema["$defs"]})


def commands() -> str:
    """Return what each command says of itself."""
    from grader.commands import COMMANDS

    sections = [f"## grade\n\n```text\n{_help('grade')}```\n"]
    for name in COMMANDS:
        said = _help(name)
        parts = _PART.findall(said)
        sections.append(f"## grade {name}\n\n```text\n{said}```\n")
        sections += [f"### grade {name} {part}\n\n```text\n{_help(name, part)}```\n" for part in parts]
    return "\n".join(sections)


def _help(*words: str) -> str:
    said, width = io.StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "100"
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        importlib.import_module(f"grader.commands.{words[0]}").run([*words[1:], "--help"], Console())
    os.environ.pop("COLUMNS") if width is None else os.environ.update(COLUMNS=width)
    return said.getvalue()


GENERATED: Mapping[str, Callable[..., str]] = {
    "checks": checks,
    "steps": steps,
    "figures": figures,
    "model": model,
    "commands": commands,
}

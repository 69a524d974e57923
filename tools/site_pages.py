"""Hook of mkdocs: generated parts of pages, and copies of files of the repository.

A mark `<!-- generated: NAME -->` in a page is replaced by a description from the grader's models. A link from a page to a
file of the repository leads to a copy of the file in the site.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import io
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from rich.console import Console

from grader import __version__
from grader.checks.registry import REGISTRY
from grader.commands import COMMANDS
from grader.commands.listing import (
    Entry,
    Parameter,
    entries_of,
    entries_of_checks,
    parameters_in,
)
from grader.commands.outline import FUNCTIONS, outline
from grader.judging.rubrics import read_rubric, rubric_kinds
from grader.lab.rubric import json_schema, own_models
from grader.lab.steps import STEPS

ROOT = Path(__file__).resolve().parents[1]
#: Folder of the site for copies of the repository's files.
COPIES = "repository"
_GENERATED = re.compile(r"<!-- generated: (\w+)([^>]*) -->")
#: Keys of a part of a rubric with a page or a section of their own.
_APART = ("checks", "figures", "steps")
#: Keys with their values listed on a page.
_KINDS = ("check", "kind")
#: A subcommand in a list by argparse.
_PART = re.compile(r"^    ([a-z]+) {2,}\S", re.MULTILINE)
#: Marks of Markdown and HTML.
_MARK = re.compile(r"[<>\[\]*|\\]")
_LINK_OUT = re.compile(r"(?<=\]\()\.\./([^)#\s]+)")


def on_config(config: MkDocsConfig) -> None:
    """State the documented release below each page."""
    config.copyright = f"Documentation of grade {__version__}"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add copies of the repository's files that pages link to or the navigation names."""
    paths = {
        path
        for page in files.documentation_pages()
        for path in _LINK_OUT.findall(page.content_string)
    }
    paths |= set(re.findall(rf"'{COPIES}/([^']+)'", str(config.nav)))
    for path in sorted(paths):
        if (ROOT / path).is_file():
            files.append(File.generated(config, f"{COPIES}/{path}", abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Insert the generated parts, and lead links out of `docs/` to the copies."""
    if page.file.src_uri.startswith(f"{COPIES}/"):
        return markdown.replace("](docs/", "](../")
    filled = _GENERATED.sub(lambda found: GENERATED[found[1]](*found[2].split()), markdown)
    return _LINK_OUT.sub(rf"{COPIES}/\1", filled)


# -- checks, steps, figures, and keys of a rubric ----------------------------------------------------


def table(parameters: Iterable[Parameter]) -> str:
    """Return the table of the keys of a mapping, nested keys included."""
    rows = list(_rows(parameters))
    if not rows:
        return "It has no parameters."
    head = ["<div class='keys' markdown>\n", "| key | value | default | |", "|---|---|---|---|"]
    return "\n".join([*head, *rows, "\n</div>"])


def _rows(parameters: Iterable[Parameter], prefix: str = "") -> Iterator[str]:
    for each in parameters:
        value = plain(each.type.replace("number or text", "share"))
        name = f"{prefix}{each.name}"
        yield f"| `{name}` | {value} | {_need(each)} | {plain(each.description)} |"
        if each.type.startswith("list"):
            name += "[]"
        elif each.type.startswith("mapping of"):
            name += ".NAME"
        yield from _rows(each.parameters, f"{name}.")


def _need(parameter: Parameter) -> str:
    if parameter.required:
        return "**required**"
    if parameter.default in (None, [], {}, ""):
        return "optional"
    value = json.dumps(parameter.default).replace('"', "")
    return f"`{value}`"


def plain(text: str) -> str:
    """Return a text of a model as Markdown, with marks escaped outside of code: `a*b` for `a&#42;b`."""
    parts = text.split("`")
    for place in range(0, len(parts), 2):
        parts[place] = _MARK.sub(lambda found: f"&#{ord(found[0])};", parts[place])
    return "`".join(parts)


def described_steps() -> str:
    """Return a section for each kind of step, with a sentence on keys that exclude each other."""
    entries = []
    for entry in entries_of("steps"):
        keys = ", ".join(f"`{key}`" for key in STEPS[entry.name].exactly_one)
        if keys:
            about = f"{entry.description} Exactly one of {keys} is given."
            entry = replace(entry, description=about)
        entries.append(entry)
    return _sections(entries)


def _sections(entries: Iterable[Entry], level: int = 2) -> str:
    return "\n".join(
        f"{'#' * level} {entry.name}\n\n{plain(entry.description)}\n\n"
        f"{table(entry.parameters)}\n\n```yaml\n{entry.example}```\n"
        for entry in entries
    )


def grouped_checks() -> str:
    """Return a section for each check, below a heading for each module of checks."""
    groups: dict[str, list[Entry]] = {}
    for entry in entries_of("checks"):
        groups.setdefault(REGISTRY[entry.name].find.__module__, []).append(entry)
    return "\n".join(
        f"## {_heading(module)}\n\n{_sections(group, 3)}" for module, group in groups.items()
    )


def overview() -> str:
    """Return a table of all checks, each with the first sentence of its description."""
    first = {
        entry.name: re.split(r"[.;] ", entry.description)[0].rstrip(".")
        for entry in entries_of("checks")
    }
    rows = (f"| [{name}](#{name}) | {plain(said)}. |" for name, said in first.items())
    return "\n".join(["| check | |", "|---|---|", *rows])


def own_checks(rubric: str, folder: str) -> str:
    """Return a section for each of a lab's own checks whose file is in a folder beside the rubric."""
    models = own_models(read_rubric(ROOT / rubric))
    inside = {name: model for name, model in models.items() if name.startswith(f"{folder}/")}
    return _sections(entries_of_checks(inside), 3)


def _heading(module: str) -> str:
    """Return the subject of a module of checks: the start of its docstring, without `Checks of`."""
    said = re.split(r"[.:,]", importlib.import_module(module).__doc__ or module)[0]
    said = re.sub(r"^(The )?[Cc]hecks? (of|that) ", "", said)
    return said[:1].upper() + said[1:]


def part(name: str) -> str:
    """Return the keys of a part of a rubric."""
    schema = json_schema(rubric_kinds())
    keys = []
    for each in parameters_in(schema["$defs"][name], schema):
        if each.name in _KINDS:
            each = replace(each, type="text")
        if each.name not in _APART:
            keys.append(each)
    return table(keys)


# -- commands and code -------------------------------------------------------------------------------


def commands_said() -> str:
    """Return the help of each command and subcommand."""
    sections = [f"## grade\n\n```text\n{_help('grade')}```\n"]
    for name in COMMANDS:
        said = _help(name)
        sections.append(f"## grade {name}\n\n```text\n{said}```\n")
        parts = _PART.findall(said)
        sections += [
            f"### grade {name} {part}\n\n```text\n{_help(name, part)}```\n" for part in parts
        ]
    return "\n".join(sections)


def _help(*words: str) -> str:
    said, width = io.StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "88"
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        importlib.import_module(f"grader.commands.{words[0]}").run(
            [*words[1:], "--help"], Console()
        )
    os.environ.pop("COLUMNS") if width is None else os.environ.update(COLUMNS=width)
    return said.getvalue()


def code(path: str, *names: str) -> str:
    """Return the signatures and docstrings of classes and functions of a file."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    found = {node.name: node for node in tree.body if isinstance(node, (ast.ClassDef, *FUNCTIONS))}
    return "\n\n".join(f"```python\n{outline(found[name])}\n```" for name in names)


GENERATED: Mapping[str, Callable[..., str]] = {
    "overview": overview,
    "checks": grouped_checks,
    "own_checks": own_checks,
    "steps": described_steps,
    "figures": lambda: _sections(entries_of("figures")),
    "part": part,
    "commands": commands_said,
    "code": code,
}

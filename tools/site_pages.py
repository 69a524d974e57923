"""What the documentation site has besides the pages in `docs/`; a hook of mkdocs.

Where a page says `<!-- generated: NAME -->`, what the grader's own models say comes in its place. A link from a page to
a file of the repository leads to a copy of it in the site.
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

from grader.checks.registry import REGISTRY
from grader.commands import COMMANDS
from grader.commands.listing import (
    Entry,
    Parameter,
    entries_of,
    entries_of_checks,
    parameters_in,
)
from grader.judging.rubrics import read_rubric, rubric_kinds
from grader.lab.rubric import json_schema, own_models
from grader.lab.steps import STEPS

ROOT = Path(__file__).resolve().parents[1]
#: Where copies of the repository's files lie in the site.
COPIES = "repository"
_GENERATED = re.compile(r"<!-- generated: (\w+)([^>]*) -->")
#: Keys of a part of a rubric that have a page or a section of their own.
_APART = ("checks", "figures", "steps")
#: Keys whose values a page lists.
_KINDS = ("check", "kind")
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
#: A command of a command, as argparse lists it.
_PART = re.compile(r"^    ([a-z]+) {2,}\S", re.MULTILINE)
_LINK_OUT = re.compile(r"(?<=\]\()\.\./([^)#\s]+)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add copies of the files of the repository to which pages lead, and which the navigation names."""
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
    """Fill in what is generated, and lead links out of `docs/` to the copies."""
    if page.file.src_uri.startswith(f"{COPIES}/"):
        return markdown.replace("](docs/", "](../")
    filled = _GENERATED.sub(lambda found: GENERATED[found[1]](*found[2].split()), markdown)
    return _LINK_OUT.sub(rf"{COPIES}/\1", filled)


# -- checks, steps, figures, and keys of a rubric ----------------------------------------------------


def table(parameters: Iterable[Parameter]) -> str:
    """Return the table of the keys of a mapping, with those within them."""
    rows = list(_rows(parameters))
    if not rows:
        return "It has no parameters."
    return "\n".join(
        [
            "<div class='keys' markdown>\n",
            "| key | value | default | |",
            "|---|---|---|---|",
            *rows,
            "\n</div>",
        ]
    )


def _rows(parameters: Iterable[Parameter], prefix: str = "") -> Iterator[str]:
    for each in parameters:
        cells = (
            _plain(each.type.replace("number or text", "share")),
            _need(each),
            _plain(each.description),
        )
        yield f"| `{prefix}{each.name}` | " + " | ".join(cells) + " |"
        within = (
            "[]"
            if each.type.startswith("list")
            else ".NAME"
            if each.type.startswith("mapping of")
            else ""
        )
        yield from _rows(each.parameters, f"{prefix}{each.name}{within}.")


def _need(parameter: Parameter) -> str:
    if parameter.required:
        return "**required**"
    value = parameter.default
    return "optional" if value in (None, [], {}, "") else f"`{json.dumps(value)}`".replace('"', "")


def _plain(text: str) -> str:
    """Return a text of a model as Markdown that shows it as it is, but for what it sets as code."""
    parts = text.split("`")
    parts[::2] = (
        re.sub(r"[<>\[\]*|\\]", lambda found: f"&#{ord(found[0])};", part) for part in parts[::2]
    )
    return "`".join(parts)


def described_steps() -> str:
    """Return a section for each kind of step; of some keys of a step exactly one is given."""
    one = " Exactly one of {} is given."
    entries = entries_of("steps")
    targets = {
        entry.name: ", ".join(f"`{key}`" for key in STEPS[entry.name].exactly_one)
        for entry in entries
    }
    return _sections(
        replace(
            entry,
            description=entry.description
            + (one.format(targets[entry.name]) if targets[entry.name] else ""),
        )
        for entry in entries
    )


def _sections(entries: Iterable[Entry], level: int = 2) -> str:
    return "\n".join(
        f"{'#' * level} {entry.name}\n\n{_plain(entry.description)}\n\n"
        f"{table(entry.parameters)}\n\n```yaml\n{entry.example}```\n"
        for entry in entries
    )


def grouped_checks() -> str:
    """Return a section for each check, below a heading for each of their modules."""
    groups: dict[str, list[Entry]] = {}
    for entry in entries_of("checks"):
        groups.setdefault(REGISTRY[entry.name].find.__module__, []).append(entry)
    return "\n".join(
        f"## {_heading(module)}\n\n{_sections(group, 3)}" for module, group in groups.items()
    )


def overview() -> str:
    """Return a table of all checks, each with the first sentence of what it says of itself."""
    first = {
        entry.name: re.split(r"[.;] ", entry.description)[0].rstrip(".")
        for entry in entries_of("checks")
    }
    rows = (f"| [{name}](#{name}) | {_plain(said)}. |" for name, said in first.items())
    return "\n".join(["| check | |", "|---|---|", *rows])


def own_checks(rubric: str, folder: str) -> str:
    """Return a section for each of a lab's own checks whose file is in a folder beside the rubric."""
    models = own_models(read_rubric(ROOT / rubric))
    inside = {name: model for name, model in models.items() if name.startswith(f"{folder}/")}
    return _sections(entries_of_checks(inside), 3)


def _heading(module: str) -> str:
    """Return what the checks of a module are of: how its docstring begins, without that they are checks."""
    said = re.split(r"[.:,]", importlib.import_module(module).__doc__ or module)[0]
    said = re.sub(r"^(The )?[Cc]hecks? (of|that) ", "", said)
    return said[:1].upper() + said[1:]


def part(name: str) -> str:
    """Return the keys of a part of a rubric."""
    schema = json_schema(rubric_kinds())
    # What has a page or a section of its own is not told again.
    told = [
        each for each in parameters_in(schema["$defs"][name], schema) if each.name not in _APART
    ]
    return table(replace(each, type="text") if each.name in _KINDS else each for each in told)


# -- commands and code -------------------------------------------------------------------------------


def commands_said() -> str:
    """Return what each command says of itself, and each of their own commands."""
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
    """Return classes and functions of a file by what they are given and say of themselves."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    found = {node.name: node for node in tree.body if isinstance(node, (ast.ClassDef, *_FUNCTIONS))}
    return "\n\n".join(f"```python\n{ast.unparse(_outside(found[name]))}\n```" for name in names)


def _outside(node: ast.stmt) -> ast.stmt:
    """Leave out of a class or function what is none of others' business."""
    if isinstance(node, _FUNCTIONS):
        node.body = node.body[:1] if ast.get_docstring(node) else [ast.Expr(ast.Constant(...))]
    elif isinstance(node, ast.ClassDef):
        node.body = [_outside(each) for each in node.body if not _name_of(each).startswith("_")]
    return node


def _name_of(node: ast.stmt) -> str:
    target = getattr(node, "target", node)
    return str(getattr(target, "name", getattr(target, "id", "")))


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

"""Make pages of HTML that need no other file: style and script within, named by their hashes in the page's policy.

All text of students passes `shown`, by the template engine's `finalize`, before it is escaped.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import re
from decimal import Decimal
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from grader.lab.steps.words import fields
from grader.languages.language import ENGLISH_ONLY, Languages
from grader.report import views
from grader.report.compiled_templates import CompiledTemplates
from grader.report.escape import line, shown
from grader.report.figures.link import percent
from grader.report.figures.svg import HALF, NARROW, WIDE, duration
from grader.report.page_languages import with_languages

_FOLDER = Path(__file__).parent / "templates"
#: Single blanks in a style sheet that mean nothing: around brackets and semicolons, and after colons and commas.
_BLANKS = re.compile(r" ?([{};]) ?|([:,]) ")


def render_page(
    name: str,
    styles: tuple[str, ...],
    scripts: tuple[str, ...],
    languages: Languages = ENGLISH_ONLY,
    **values: Any,
) -> str:
    """Return a page, made of files in the folder of templates; equal arguments give equal bytes."""
    page = _template(name, styles, scripts).render(**values)
    if languages.others:
        page = with_languages(page, languages)
    # A lone surrogate cannot be encoded. `shown` has replaced them all, and this changes nothing.
    return page.encode("utf-8", "replace").decode("utf-8")


@functools.lru_cache(maxsize=8)
def _template(name: str, styles: tuple[str, ...], scripts: tuple[str, ...]) -> Template:
    environment = Environment(
        loader=FileSystemLoader(_FOLDER),
        bytecode_cache=CompiledTemplates(_FOLDER / "__pycache__"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_fit_to_show,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(
        line=line,
        duration=duration,
        prose=prose,
        breakable=breakable,
        fields=fields,
        percent=percent,
        points=views.points,
        tenths=views.tenths,
        signed=views.signed,
        tenths_signed=_tenths_signed,
    )
    css = "".join(map(_read, styles))
    js = "".join(map(_read, scripts))
    policy = (
        f"default-src 'none'; style-src {_hash(css)}; script-src {_hash(js)}; "
        "base-uri 'none'; form-action 'none'"
    )
    environment.globals.update(
        widths=(WIDE, HALF, NARROW),
        anchor=views.anchor,
        badge_of=views.badge_of,
        share_of=views.share_of,
        css=Markup(css),
        js=Markup(js),
        policy=policy,
    )
    return environment.get_template(name)


def _fit_to_show(value: Any) -> Any:
    """Return text as it can be shown; the grader's own markup, and numbers, stay as they are."""
    if isinstance(value, Markup) or not isinstance(value, str):
        return value
    return shown(value)


def _tenths_signed(value: Decimal) -> str:
    return views.signed(value.quantize(Decimal("0.1")))


def prose(text: str) -> Markup:
    """Return text as it can be shown, with the parts between backticks as code.

    With an odd number of backticks, all of it is text.
    """
    parts = shown(text).split("`")
    if len(parts) % 2 == 0:
        return Markup.escape(shown(text))
    page = Markup("")
    for number, part in enumerate(parts):
        form = Markup("<code>{}</code>") if number % 2 else Markup("{}")
        page += form.format(part)
    return page


def breakable(name: str) -> Markup:
    """Return a name as it can be shown, with permitted line breaks after `_`, `.` and `-`."""
    return Markup("<wbr>").join(re.split(r"(?<=[_.-])(?=.)", shown(name)))


def _read(name: str) -> str:
    """Return a style sheet or a script without indentation and lines of comment, a sheet also without blanks at signs."""
    text = (_FOLDER / name).read_text(encoding="utf-8")
    kept = ""
    for row in text.splitlines():
        code = row.strip()
        if not code.startswith("//"):
            kept += f"{code}\n"
    if name.endswith(".css"):
        return _BLANKS.sub(r"\1\2", " ".join(kept.split())).replace(";}", "}")
    return kept


def _hash(text: str) -> str:
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'"

"""A page of HTML that needs nothing else: style and script within it, named by their hashes in its policy.

All that comes from students passes `shown`, through the template engine's last stage, before it is escaped.
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
from grader.report import views
from grader.report.escape import line, shown
from grader.report.figures.link import percent
from grader.report.figures.svg import HALF, NARROW, WIDE, duration

_FOLDER = Path(__file__).parent / "templates"


def render_page(name: str, styles: tuple[str, ...], scripts: tuple[str, ...], **values: Any) -> str:
    """Return a page, made of files in the folder of templates; equal arguments give equal bytes."""
    page = _template(name, styles, scripts).render(**values)
    # A lone surrogate cannot be written; all that is shown was cleaned of them, so this changes nothing.
    return page.encode("utf-8", "replace").decode("utf-8")


@functools.lru_cache(maxsize=8)
def _template(name: str, styles: tuple[str, ...], scripts: tuple[str, ...]) -> Template:
    environment = Environment(
        loader=FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        # Text is made fit to be shown; markup of ours and numbers stay as they are.
        finalize=lambda value: (
            shown(value) if isinstance(value, str) and not isinstance(value, Markup) else value
        ),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(
        line=line, duration=duration, prose=prose, breakable=breakable, fields=fields
    )
    environment.filters.update(percent=percent)
    environment.filters.update(points=views.points, tenths=views.tenths, signed=views.signed)
    environment.filters.update(
        tenths_signed=lambda value: views.signed(value.quantize(Decimal("0.1")))
    )
    environment.globals.update(
        widths=(WIDE, HALF, NARROW),
        anchor=views.anchor,
        badge_of=views.badge_of,
        share_of=views.share_of,
    )
    css, js = ("".join(map(_read, files)) for files in (styles, scripts))
    environment.globals.update(
        css=Markup(css),
        js=Markup(js),
        policy=(
            f"default-src 'none'; style-src {_hash(css)}; script-src {_hash(js)}; base-uri 'none'; form-action 'none'"
        ),
    )
    return environment.get_template(name)


def prose(text: str) -> Markup:
    """Make text fit to be shown, with what stands between backticks as code."""
    parts = shown(text).split("`")
    if len(parts) % 2 == 0:
        return Markup.escape(shown(text))
    pieces = [Markup("<code>{}</code>") if n % 2 else Markup("{}") for n in range(len(parts))]
    return Markup("").join(piece.format(part) for piece, part in zip(pieces, parts, strict=True))


def breakable(name: str) -> Markup:
    """Make a name fit to be shown, with leave to break it behind its marks."""
    return Markup("<wbr>").join(re.split(r"(?<=[_.-])(?=.)", shown(name)))


def _read(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'"

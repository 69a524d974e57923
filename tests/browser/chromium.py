"""A real Chromium for the tests of pages, and their common actions on a page."""

from __future__ import annotations

import importlib.resources
import io
import os
import shutil
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, Route, expect, sync_playwright
from pypdf import PdfReader

ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
DESK, PHONE = (1240, 900), (390, 844)
#: A4 at 96 dots per inch, the size for a browser's rules for paper.
PAPER = (794, 1123)
# A busy machine takes longer to show a page than Playwright's own timeout of five seconds.
expect.set_options(timeout=30_000)


def chromium() -> str:
    """Give Chromium's path. Where it could have been installed, a test without it fails; elsewhere it is skipped."""
    found = None
    for name in ("google-chrome", "chromium-browser", "chromium"):
        found = shutil.which(name) or found
    if found is None:
        missing = "there is no Chromium; `tools/install-system-packages dev` installs it (as root, on Debian)"
        if os.geteuid() == 0 or os.environ.get("CI"):
            pytest.fail(missing, pytrace=False)
        pytest.skip(missing)
    return found


@contextmanager
def browser() -> Iterator[Browser]:
    """Start Chromium, and stop it in the end."""
    path = chromium()
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        try:
            yield started
        finally:
            started.close()


@dataclass
class Visit:
    """An opened page, with its requests and complaints."""

    page: Page
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def axe(self, *, grave: bool = False) -> list[str]:
        """Give axe-core's findings, a line each; the serious and critical ones alone if `grave`."""
        script = importlib.resources.files("axe_playwright_python") / "axe.min.js"
        self.page.evaluate(script.read_text(encoding="utf-8"))
        found: dict[str, Any] = self.page.evaluate(
            "axe.run({resultTypes: ['violations'], preload: false})"
        )
        made = []
        for v in found["violations"]:
            if grave and v["impact"] not in ("serious", "critical"):
                continue
            node = v["nodes"][0]
            made.append(f"{v['id']}: {v['help']}: {node['target']} {node['failureSummary']}")
        return made

    def unread(self) -> list[str]:
        """Give skipped levels of headings, and controls or pictures without a name for a screen reader."""
        found: list[str] = self.page.evaluate(UNREAD)
        return found


@contextmanager
def visit(
    started: Browser,
    file: Path,
    size: tuple[int, int] = DESK,
    *,
    dark: bool = False,
    scripts: bool = True,
) -> Iterator[Visit]:
    """Open a file, and see that it asks for nothing else and complains of nothing."""
    context = started.new_context(
        viewport={"width": size[0], "height": size[1]},
        color_scheme="dark" if dark else "light",
        java_script_enabled=scripts,
        reduced_motion="reduce",
    )
    seen = Visit(context.new_page())

    def let_files_pass(route: Route) -> None:
        seen.requests.append(route.request.url)
        if route.request.url.startswith("file:"):
            route.continue_()
        else:
            route.abort()

    context.route("**/*", let_files_pass)
    seen.page.on("console", lambda message: seen.complaints.append(message.text))
    seen.page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    try:
        seen.page.goto(file.as_uri())
        yield seen
        assert seen.complaints == []
        assert [url for url in seen.requests if not url.startswith("file:")] == []
    finally:
        context.close()


#: Headings below a skipped level, and controls, groups and pictures in view without a name.
UNREAD = """() => {
  const seen = e => e.checkVisibility() && !e.closest('[aria-hidden=true]');
  const named = e => e.ariaLabel || e.title || e.textContent.trim() || e.labels && e.labels.length
    || document.getElementById(e.getAttribute('aria-labelledby'));
  const found = [];
  let level = 0;
  for (const heading of [...document.querySelectorAll('h1, h2, h3, h4')].filter(seen)) {
    const next = Number(heading.tagName[1]);
    if (next > level + 1) found.push(`h${level} to h${next}: ${heading.textContent}`);
    level = next;
  }
  const controls = 'button, a[href], input, select, textarea, summary, svg[role=img], [role=group], [role=region]';
  for (const e of [...document.querySelectorAll(controls)].filter(seen)) {
    if (!named(e)) found.push(e.outerHTML.slice(0, 120));
  }
  for (const picture of [...document.querySelectorAll('figure svg')].filter(seen)) {
    if (!picture.closest('[role=img], [aria-label], [aria-labelledby]')) found.push(picture.outerHTML.slice(0, 120));
  }
  for (const e of [...document.querySelectorAll('details')].filter(seen)) {
    if (e.firstElementChild.tagName !== 'SUMMARY') found.push(e.outerHTML.slice(0, 120));
  }
  return found;
}"""


def printed(started: Browser, file: Path) -> PdfReader:
    """Print a file on A4, and give its pages."""
    page = started.new_page()
    try:
        page.goto(file.as_uri())
        return PdfReader(io.BytesIO(page.pdf(format="A4", prefer_css_page_size=True)))
    finally:
        page.close()


def letters(text: str) -> str:
    """Return a text without blanks and ligatures, to compare texts of a PDF."""
    return "".join(unicodedata.normalize("NFKC", text).split())


#: Cells with more lines than half of their letters, at the width of A4 between its margins.
NARROW = """() => {
  document.body.style.width = '688px';
  return [...document.querySelectorAll('td, th, dd, dt, .check-title, .name, figcaption, li')].filter(cell => {
  const range = document.createRange();
  range.selectNodeContents(cell);
  const lines = new Set([...range.getClientRects()].filter(r => r.width).map(r => Math.round(r.top)));
  return lines.size > 3 && cell.textContent.trim().length < 3 * lines.size;
  }).map(cell => cell.outerHTML.slice(0, 200));
}"""

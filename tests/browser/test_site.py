"""The documentation as a site: built without a warning, nothing loaded from elsewhere, usable by all."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from playwright.sync_api import Browser, expect

from tests.browser.chromium import DESK, PHONE, browser, visit
from tests.documentation import ROOT
from tests.thorough import part

pytestmark = pytest.mark.browser

PAGES = ("index", "first-lab", "policy", "figures")
#: Pages at a desk in light colours, and on a phone in dark ones; every run examines one of each.
STATES = [*product(PAGES, [(DESK, False)]), *product(reversed(PAGES), [(PHONE, True)])]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site as `make docs` does."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Give a browser to all tests of this file."""
    with browser() as started:
        yield started


def pages(site: Path) -> list[Path]:
    """Return the pages of the site, except the page for missing ones, which needs a web server."""
    return [page for page in sorted(site.rglob("*.html")) if page.name != "404.html"]


@pytest.mark.parametrize(("name", "screen"), part(STATES, 4))
def test_nothing_keeps_anyone_from_using_it(
    name: str, screen: tuple[tuple[int, int], bool], chromium: Browser, site: Path
) -> None:
    """axe-core has no serious or critical finding: text, code, tables of people and of the models."""
    size, dark = screen
    with visit(chromium, site / f"{name}.html", size, dark=dark) as seen:
        assert seen.axe() == []


def test_every_page_and_every_link_leads_to_something(chromium: Browser, site: Path) -> None:
    """Pages load nothing from elsewhere, and fit a phone; pages, files and sections that they link are there."""
    links, anchors = set(), set()
    # One page of the browser for all: with a new one for each, everything takes twice the time.
    with visit(chromium, site / "index.html", PHONE) as seen:
        for page in pages(site):
            seen.page.goto(page.as_uri())
            assert seen.page.evaluate("document.documentElement.scrollWidth") == PHONE[0], page
            links |= set(seen.page.eval_on_selector_all("a[href]", "all => all.map(a => a.href)"))
            names = seen.page.eval_on_selector_all("[id]", "all => all.map(e => e.id)")
            anchors |= {f"{page}#{name}" for name in names}
    inside = [urlsplit(link) for link in links if link.startswith("file:")]
    missing = [part.geturl() for part in inside if not Path(unquote(part.path)).is_file()]
    assert missing == []
    named = set()
    for p in inside:
        if p.fragment and p.path.endswith(".html"):
            named.add(f"{unquote(p.path)}#{unquote(p.fragment)}")
    assert len(named) > 100
    assert named - anchors == set()


def test_checks_are_found_by_the_search_without_a_server(chromium: Browser, site: Path) -> None:
    """A typed name leads to the section of the generated page."""
    with visit(chromium, site / "index.html") as seen:
        seen.page.locator("input.md-search__input").click()
        seen.page.keyboard.type("topic_rate")
        result = seen.page.locator("a.md-search-result__link[href*='checks.html']").first
        expect(result).to_be_visible()

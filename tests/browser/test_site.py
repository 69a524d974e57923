"""The documentation as a site: built without a warning, nothing loaded from elsewhere, usable by all."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from itertools import product
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

import pytest
from playwright.sync_api import Browser, expect

from grader import __version__
from tests.browser.chromium import DESK, PHONE, browser, visit
from tests.documentation import ROOT
from tests.thorough import part

pytestmark = pytest.mark.browser

PAGES = ("index", "first-lab", "policy", "figures", "lab-go-to-goal")
#: Pages at a desk in light colours, and on a phone in dark ones; every run examines one.
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


@pytest.mark.parametrize(("name", "screen"), part(STATES, 8))
def test_nothing_keeps_anyone_from_using_it(
    name: str, screen: tuple[tuple[int, int], bool], chromium: Browser, site: Path
) -> None:
    """axe-core has no serious or critical finding: text, code, tables of people and of the models."""
    size, dark = screen
    with visit(chromium, site / f"{name}.html", size, dark=dark) as seen:
        # The theme's own navigation has two landmarks of one name.
        assert seen.axe(grave=True) == []


class _Names(HTMLParser):
    """Collects the targets of links and the ids of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.ids: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep the target of a link and the id of any element."""
        found = dict(attrs)
        if tag == "a":
            self.links.add(found.get("href") or "")
        self.ids.add(found.get("id") or "")


def test_pages_fit_a_phone_and_load_nothing_from_elsewhere(chromium: Browser, site: Path) -> None:
    """No page of the site is wider than a phone, or asks a network for anything."""
    # One page of the browser for all: with a new one for each, everything takes twice the time.
    with visit(chromium, site / "index.html", PHONE) as seen:
        for page in part(pages(site), 4):
            seen.page.goto(page.as_uri())
            assert seen.page.evaluate("document.documentElement.scrollWidth") == PHONE[0], page
    assert [request for request in seen.requests if not request.startswith("file:")] == []


def test_every_link_leads_to_something(site: Path) -> None:
    """Pages, files and sections that pages link are there."""
    links, anchors = set(), set()
    for page in pages(site):
        names = _Names()
        names.feed(page.read_text(encoding="utf-8"))
        links |= {urljoin(page.as_uri(), link) for link in names.links}
        anchors |= {f"{page}#{name}" for name in names.ids}
    inside = [urlsplit(link) for link in links if link.startswith("file:")]
    missing = [p.geturl() for p in inside if not Path(unquote(p.path)).is_file()]
    assert missing == []
    named = set()
    for p in inside:
        if p.fragment and p.path.endswith(".html"):
            named.add(f"{unquote(p.path)}#{unquote(p.fragment)}")
    assert len(named) > 100
    assert named - anchors == set()


def test_each_shipped_lab_is_in_the_gallery_with_a_report(site: Path) -> None:
    """A page with a rubric and a report of a real grading for every lab; each page names its release."""
    names = ["09-01", *(folder.parent.name for folder in (ROOT / "labs").glob("*/rubric.yaml"))]
    gallery = (site / "labs.html").read_text(encoding="utf-8")
    for name in names:
        page = (site / f"lab-{name}.html").read_text(encoding="utf-8")
        report = (site / f"lab-{name}-report.html").read_text(encoding="utf-8")
        assert f'href="lab-{name}.html"' in gallery
        assert f'href="lab-{name}-report.html"' in page
        assert 'id="rubric"' in page
        assert "What to fix first" in report
    assert f"Documentation of grade {__version__}" in gallery


def test_checks_are_found_by_the_search_without_a_server(chromium: Browser, site: Path) -> None:
    """A typed name leads to the section of the generated page."""
    with visit(chromium, site / "index.html") as seen:
        seen.page.locator("input.md-search__input").click()
        seen.page.keyboard.type("topic_rate")
        result = seen.page.locator("a.md-search-result__link[href*='checks.html']").first
        expect(result).to_be_visible()

"""A report in another language, in a real browser: the reader's switch, parts that are built later, and code."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from grader.judging.judgement import judge_recordings
from grader.judging.languages import in_lab
from grader.judging.rubrics import read_rubric
from grader.lab.lab_languages import lab_catalogues
from grader.lab.overrides import Overrides
from grader.languages.catalogue import Message, engine_catalogues, read_catalogues
from grader.languages.language import Language, Languages
from grader.report.page_languages import with_languages
from tests.browser.chromium import DESK, browser, visit

pytestmark = pytest.mark.browser

KEPT = Path(__file__).resolve().parents[1] / "recordings/launch_wrong_executable"
#: Texts outside of code and output, and the code and the output.
TEXTS = """() => {
  const texts = [], code = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const parent = walker.currentNode.parentElement;
    if (parent.closest("script, style, noscript, #language, #languages")) { continue; }
    (parent.closest("pre, code, [translate=no]") ? code : texts).push(walker.currentNode.data.trim());
  }
  return [texts.filter(Boolean), code.filter(Boolean)];
}"""
#: Names of the elements of a page, in order of their number.
ELEMENTS = "() => Array.from(document.querySelectorAll('body *'), e => e.tagName + '.' + e.getAttribute('class'))"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Give a browser to all tests of this file."""
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a report with each message between «» as its German.

    Such a German is complete whatever the catalogues have, and shows which texts were found.
    """
    rubric = read_rubric(None)
    messages = []
    for message in read_catalogues([*lab_catalogues(rubric, "de"), *engine_catalogues("de")]):
        messages.append(Message(message.english, f"«{message.english}»", message.files))
    page = judge_recordings(KEPT, rubric, Overrides()).page
    english = re.sub(r'<div id="languages".*\n', "", page)
    languages = Languages((Language("de", messages), in_lab(rubric, "es")))
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(with_languages(english, languages), encoding="utf-8")
    return path


def unfolded(page: Page) -> None:
    """Build and unfold all parts of a page."""
    page.locator("#toggle").click()
    page.wait_for_function("!document.querySelector('details:not([open])')")
    page.wait_for_timeout(300)


def test_the_reader_switches_the_language(chromium: Browser, report: Path) -> None:
    """The choice changes texts, the language of the page and its address, and is there again after a visit."""
    with visit(chromium, report, DESK) as seen:
        page = seen.page
        assert page.locator("html").get_attribute("lang") == "en"
        expect(page.locator("#fix")).to_contain_text("What to fix first")
        page.locator("#language").select_option("de")
        expect(page.locator("html")).to_have_attribute("lang", "de")
        expect(page.locator("#fix")).to_contain_text("«What to fix first»")
        assert "language=de" in page.url
        page.goto(report.as_uri())
        expect(page.locator("html")).to_have_attribute("lang", "de")
        page.locator("#language").select_option("en")
        expect(page.locator("html")).to_have_attribute("lang", "en")
        expect(page.locator("#fix")).not_to_contain_text("«")
        assert seen.complaints == []


def test_all_texts_change_and_nothing_else(chromium: Browser, report: Path) -> None:
    """Parts that are built later change too; elements, code and output are the same as in English."""
    found = {}
    for tag in ("en", "de"):
        with visit(chromium, report, DESK) as seen:
            page = seen.page
            page.goto(f"{report.as_uri()}?language={tag}")
            expect(page.locator("html")).to_have_attribute("lang", tag)
            unfolded(page)
            texts, code = page.evaluate(TEXTS)
            found[tag] = texts, Counter(code), Counter(page.evaluate(ELEMENTS))
    assert found["de"][1:] == found["en"][1:]
    prose = re.compile(r"^[A-Z][a-z]+ [a-z]+ [a-z]+ ")
    assert [text for text in found["de"][0] if prose.match(text) and "«" not in text] == []
    assert sum("«" in text for text in found["de"][0]) > 300


def test_texts_of_scripts_are_translated(chromium: Browser, report: Path) -> None:
    """A script's text is translated when it appears, with numbers in the language's form."""
    with visit(chromium, report, DESK) as seen:
        page = seen.page
        page.goto(f"{report.as_uri()}?language=de")
        expect(page.locator("#toggle")).to_have_text("«Expand all»")
        page.locator("#toggle").click()
        expect(page.locator("#toggle")).to_have_text("«Collapse all»")
        page.locator("#find-words").fill("publisher")
        expect(page.locator("#found")).to_contain_text("«")
        assert not re.search(r"\d\.\d", page.locator(".strip").inner_text())

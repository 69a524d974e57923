"""The report of one submission in a real browser: nothing asked of a network, usable by all, and on paper."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from grader import result_folder
from grader.judging import rubrics
from grader.result import Outcome, load_result
from tests.browser.chromium import DESK, NARROW, PAPER, PHONE, browser, letters, printed, visit
from tests.regraded import judge_results
from tests.thorough import part

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("judged_before")]

KEPT = Path(__file__).resolve().parents[1] / "recordings"
NAMES = ("solution", "service_never_answers", "qos_invented_numbers", "launch_wrong_executable")
#: Reports in light and in dark colours; every run examines one.
STATES = [*product(NAMES, [False]), *product(reversed(NAMES), [True])]
#: Adjustments of one report.
OVERRIDES = """
overrides:
  - {submission: service_never_answers, check: service.enables, set: 1, reason: Seen, who: JS, when: 2026-11-21}
  - {submission: service_never_answers, bonus: 3, reason: An action server, who: JS, when: 2026-11-21}
"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Give a browser to all tests of this file."""
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Give the reports of some kept recordings."""
    rubric = rubrics.read_rubric(None)
    folder = tmp_path_factory.mktemp("reports")
    (folder / "overrides.yaml").write_text(OVERRIDES, encoding="utf-8")
    overrides = rubrics.read_overrides(None, folder, rubric)
    for name in NAMES:
        shutil.copytree(KEPT / name, folder / name / result_folder.RECORDINGS)
        judge_results(folder / name, rubric, overrides)
    return {name: folder / name / result_folder.REPORT_FILE for name in NAMES}


@dataclass(frozen=True)
class Measures:
    """Measurements of one report on a phone and on paper.

    Attributes
    ----------
    width : int
        Width of the page on a phone, in px.
    narrow, narrow_unfolded : list of str
        Columns on paper that are one letter wide, with all parts as they are, and unfolded.
    smallest : float
        Smallest letter in a figure on a phone, in px.
    outside : list of str
        Lines of text in figures that are cut off there.
    """

    width: int
    narrow: list[str]
    narrow_unfolded: list[str]
    smallest: float
    outside: list[str]


def narrow_on_paper(page: Page) -> list[str]:
    """Return columns that are one letter wide when the page is printed; afterwards the page is as before."""
    page.set_viewport_size({"width": PAPER[0], "height": PAPER[1]})
    page.emulate_media(media="print")
    found: list[str] = page.evaluate(NARROW)
    page.evaluate("document.body.style.width = ''")
    page.emulate_media(media="screen")
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    return found


@pytest.fixture(scope="module")
def measures(chromium: Browser, reports: dict[str, Path]) -> dict[str, Measures]:
    """Open each report once, and measure it folded and unfolded."""
    found = {}
    for name, file in reports.items():
        with visit(chromium, file, PHONE) as seen:
            width = seen.page.evaluate("document.documentElement.scrollWidth")
            folded = narrow_on_paper(seen.page)
            seen.page.get_by_role("button", name="Expand all").click()
            smallest, outside = seen.page.evaluate(WRITTEN)
            unfolded = narrow_on_paper(seen.page)
            found[name] = Measures(width, folded, unfolded, smallest, outside)
    return found


@pytest.mark.parametrize(("name", "dark"), part(STATES, 8))
def test_nothing_keeps_anyone_from_using_it(
    name: str, dark: bool, chromium: Browser, reports: dict[str, Path]
) -> None:
    """Nothing is found by axe-core or unread by a screen reader with all parts unfolded; no network is asked."""
    with visit(chromium, reports[name], PHONE if dark else DESK, dark=dark) as seen:
        seen.page.get_by_role("button", name="Expand all").click()
        assert seen.axe() == []
        assert seen.unread() == []
        assert seen.requests == [reports[name].as_uri()]


def test_a_link_to_a_check_unfolds_it(chromium: Browser, reports: dict[str, Path]) -> None:
    """A class page links to a check; the report shows that check, even one that is folded."""
    with visit(chromium, reports["solution"]) as seen:
        seen.page.goto(f"{reports['solution'].as_uri()}#check-qos.honest")
        seen.page.reload()
        expect(seen.page.locator("#check-qos\\.honest")).to_have_attribute("open", "")
        expect(seen.page.locator("#check-qos\\.honest .body")).to_be_in_viewport()


def test_without_scripts_all_is_there(chromium: Browser, reports: dict[str, Path]) -> None:
    """Failures are shown, parts can be unfolded, and every button works."""
    with visit(chromium, reports["service_never_answers"], scripts=False) as seen:
        expect(seen.page.locator("button:visible")).to_have_count(0)
        expect(seen.page.locator("#check-service\\.enables .reason")).to_be_visible()
        output = seen.page.locator("details.output").first
        output.locator("summary").click()
        expect(output).to_have_attribute("open", "")


@pytest.mark.parametrize("name", NAMES)
def test_paper_has_what_cost_points_and_nothing_else(
    name: str, chromium: Browser, reports: dict[str, Path]
) -> None:
    """Head, lost checks with sentences and figures; no folded proof of passed checks, no output, no versions."""
    paper = printed(chromium, reports[name])
    assert len(paper.pages) <= (2 if name == "solution" else 6)
    text = letters(" ".join(page.extract_text() for page in paper.pages))
    result = load_result(reports[name].with_name(result_folder.RESULT_FILE))
    for check in result.checks:
        assert letters(check.title) in text
        if check.outcome in (Outcome.FAILED, Outcome.PARTIAL):
            assert letters(check.reason)[:20] in text
            assert letters(check.measured)[:20] in text
    for folded in (
        "Output of",
        "appeal",
        "Send this to your instructor",
        "Try again",
        "Does not cover",
    ):
        assert letters(folded) not in text


@pytest.mark.parametrize("unfolded", [False, True], ids=["folded", "unfolded"])
def test_no_column_on_paper_is_one_letter_wide(
    unfolded: bool, measures: dict[str, Measures]
) -> None:
    """Not even if somebody unfolds all parts before they print."""
    for name, found in measures.items():
        assert (found.narrow_unfolded if unfolded else found.narrow) == [], name


def test_a_phone_shows_it_without_scrolling_sideways(measures: dict[str, Measures]) -> None:
    """Only tables and output scroll, in themselves."""
    assert {name: found.width for name, found in measures.items()} == dict.fromkeys(NAMES, PHONE[0])


def test_what_is_written_in_figures_can_be_read_on_a_phone(measures: dict[str, Measures]) -> None:
    """No letter is smaller than 9.5 px, and no line ends outside of its picture."""
    for name, found in measures.items():
        assert found.smallest >= 9.5, name
        assert found.outside == [], name


#: Smallest size of letters in the pictures that are shown, and lines of text that are cut off.
WRITTEN = """() => {
  const sizes = [], outside = [];
  for (const picture of document.querySelectorAll('svg.chart')) {
    const frame = picture.getBoundingClientRect();
    for (const text of frame.width ? picture.querySelectorAll('text') : []) {
      const box = text.getBoundingClientRect();
      sizes.push(parseFloat(getComputedStyle(text).fontSize) * frame.width / picture.viewBox.baseVal.width);
      if (box.left < frame.left - 1 || box.right > frame.right + 1) outside.push(text.textContent);
    }
  }
  return [Math.min(...sizes), outside];
}"""

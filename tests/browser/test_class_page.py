"""The class page in a real browser: sorted, filtered, by keyboard, on a phone, printed, and without scripts."""

from __future__ import annotations

import re
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from grader.cohort.anonymous import anonymous
from grader.cohort.entries import ClassEntry
from grader.cohort.statistics import ClassSummary, summarise
from grader.judging.rubrics import read_rubric
from grader.report.class_page import render
from grader.result import Outcome
from tests.browser.chromium import DESK, NARROW, PAPER, PHONE, browser, letters, printed, visit
from tests.sample_class import sample_class
from tests.thorough import part

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Give a browser to all tests of this file."""
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def entries() -> list[ClassEntry]:
    """Give a class of forty."""
    return sample_class(read_rubric(None))


@pytest.fixture(scope="module")
def summary(entries: list[ClassEntry]) -> ClassSummary:
    """Give the class in numbers."""
    return summarise(entries, read_rubric(None))


@pytest.fixture(scope="module")
def file(summary: ClassSummary, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the class page as a file."""
    path = tmp_path_factory.mktemp("class") / "index.html"
    path.write_text(render(summary), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def desk(chromium: Browser, file: Path) -> Iterator[Page]:
    """Give a page of the browser for all tests of the class page, and see that none made it complain."""
    with visit(chromium, file) as seen:
        yield seen.page


@pytest.fixture
def page(desk: Page, file: Path) -> Page:
    """Give the class page loaded anew on a desk."""
    desk.set_viewport_size({"width": DESK[0], "height": DESK[1]})
    desk.emulate_media(media="screen")
    desk.goto("about:blank")
    desk.goto(file.as_uri())
    return desk


def names(page: Page) -> list[str]:
    """Give the names of the students that the table shows, in its order."""
    found = []
    for text in page.locator("#class-table .student:visible").all_text_contents():
        found.append(text.strip())
    return found


def heading(page: Page, name: str) -> Locator:
    """Give a column's heading in the table of students."""
    return page.locator("#class-table thead th").filter(has_text=re.compile(name))


def by_points(summary: ClassSummary, descending: bool) -> list[str]:
    """Give the names by points, those that were not graded last."""
    graded = [(row.result.final, row.entry.name) for row in summary.rows if row.result is not None]
    graded.sort(key=lambda pair: -pair[0] if descending else pair[0])
    return [name for _, name in graded] + [
        row.entry.name for row in summary.rows if row.result is None
    ]


# -- sorting -----------------------------------------------------------------------------------


def test_points_sort_from_the_top_then_from_the_bottom(page: Page, summary: ClassSummary) -> None:
    """The first click shows the strongest first, the second the weakest; students without a grade stay last."""
    button = heading(page, "Points").get_by_role("button")
    button.click()
    assert names(page) == by_points(summary, descending=True)
    expect(heading(page, "Points")).to_have_attribute("aria-sort", "descending")
    button.click()
    assert names(page) == by_points(summary, descending=False)
    expect(heading(page, "Points")).to_have_attribute("aria-sort", "ascending")


def test_one_column_at_a_time_says_that_it_is_sorted(page: Page) -> None:
    """Sorting by another column takes the mark from the first, and the status names the last."""
    heading(page, "Points").get_by_role("button").click()
    heading(page, "Student").get_by_role("button").click()
    assert page.locator("#class-table th[aria-sort]").count() == 1
    expect(heading(page, "Student")).to_have_attribute("aria-sort", "ascending")
    assert names(page) == sorted(names(page), key=lambda name: name.replace("ë", "e"))
    expect(page.get_by_role("status")).to_contain_text("by Student, ascending")


def test_a_criterion_sorts_by_its_points(page: Page, summary: ClassSummary) -> None:
    """Numbers are compared as numbers: 9.5 comes after 15 from the top."""
    heading(page, "QoS").get_by_role("button").click()
    place = [column.id for column in summary.columns].index("qos")
    cells = {row.entry.name: row.cells[place] for row in summary.rows}
    shown = []
    for cell in (cells[name] for name in names(page)):
        if cell is not None:
            shown.append(cell.earned)
    assert shown == sorted(shown, reverse=True)
    assert len(set(shown)) > 3


def test_the_table_of_checks_sorts_by_discrimination(page: Page) -> None:
    """The table of checks is a separate one: the order of students stays."""
    before = names(page)
    table = page.locator("table.check-table")
    table.get_by_role("button", name="Discrimination").click()
    shown = table.locator("tbody tr td:last-child").evaluate_all(
        "cells => cells.map(c => c.dataset.value || '')"
    )
    known = [Decimal(value) for value in shown if value]
    assert len(known) > 10
    assert known == sorted(known, reverse=True)
    assert "" not in shown[: len(known)]
    assert names(page) == before


# -- filtering ---------------------------------------------------------------------------------


def test_a_name_is_found_while_it_is_typed(page: Page) -> None:
    """Part of a name, in any case; the status says how many are left."""
    page.get_by_label("Name").press_sequentially("Noah")
    assert [name.partition("_")[0] for name in names(page)] == ["noah"]
    expect(page.get_by_role("status")).to_have_text("1 of 40 shown.")
    page.get_by_role("button", name="Show all").click()
    expect(page.get_by_role("status")).to_have_text("40 of 40 shown.")
    expect(page.get_by_label("Name")).to_have_value("")


def test_a_criterion_and_an_outcome_filter(page: Page, summary: ClassSummary) -> None:
    """Only students without points in the criterion are left."""
    page.get_by_label("Criterion or check").select_option("Service Node as a whole")
    page.get_by_label("Outcome").select_option("failed")
    place = [column.id for column in summary.columns].index("service")
    cells = [(row.entry.name, row.cells[place]) for row in summary.rows]
    wanted = [name for name, cell in cells if cell is not None and cell.outcome is Outcome.FAILED]
    assert len(wanted) > 2
    assert names(page) == wanted


def test_a_check_and_lost_points_filter(page: Page, summary: ClassSummary) -> None:
    """A check is a finer question than its criterion; unreachable points are lost too."""
    page.get_by_label("Criterion or check").select_option(
        "Refuses while safety is off, and recovers"
    )
    page.get_by_label("Outcome").select_option("points lost")
    lost = (Outcome.PARTIAL, Outcome.FAILED, Outcome.NOT_REACHED)
    refuses = []
    for row in summary.rows:
        if row.result is not None:
            refuses.append(
                (
                    row.entry.name,
                    next((c.outcome for c in row.result.checks if c.id == "service.refuses"), None),
                )
            )
    wanted = [name for name, outcome in refuses if outcome in lost]
    assert {Outcome.PARTIAL, Outcome.NOT_REACHED} <= {outcome for _, outcome in refuses}
    assert names(page) == wanted


def test_an_outcome_alone_means_any_criterion(page: Page, summary: ClassSummary) -> None:
    """Students without a judgement are found without naming a criterion."""
    page.get_by_label("Outcome").select_option("not judged")
    assert names(page) == [row.entry.name for row in summary.rows if row.result is None]


def test_what_needs_attention_is_found(page: Page, summary: ClassSummary) -> None:
    """The same submissions as in the list of things to do."""
    page.get_by_label("Needs attention").check()
    needy = {todo.row for todo in summary.todos}
    assert names(page) == [row.entry.name for n, row in enumerate(summary.rows) if n in needy]
    assert len(needy) == 4


def test_the_students_of_a_mistake_are_shown_in_the_table(
    page: Page, summary: ClassSummary
) -> None:
    """The button at a mistake filters the table, says so, and takes one there."""
    page.get_by_label("Name").fill("nobody is called this")
    mistake = summary.mistakes[2]
    button = page.locator("#mistake-2").get_by_role("button", name="Show in the table")
    button.click()
    made = {one.row for one in mistake.made_by}
    expect(page.get_by_role("status")).to_contain_text(f"{len(made)} of 40 shown, with the mistake")
    assert names(page) == [row.entry.name for n, row in enumerate(summary.rows) if n in made]
    expect(page.get_by_role("status")).to_be_focused()


def test_filtered_rows_stay_hidden_when_sorted(page: Page) -> None:
    """Sorting shows nothing that was filtered away."""
    page.get_by_label("Needs attention").check()
    before = names(page)
    heading(page, "Points").get_by_role("button").click()
    assert sorted(names(page)) == sorted(before)


def test_the_address_says_what_is_shown(chromium: Browser, page: Page, file: Path) -> None:
    """The address shows the same students in the same order again; an address of nonsense shows all."""
    page.get_by_label("Criterion or check").select_option(
        "Refuses while safety is off, and recovers"
    )
    page.get_by_label("Outcome").select_option("points lost")
    heading(page, "Points").get_by_role("button").click()
    page.get_by_label("Name").fill("a")
    assert len(names(page)) > 1
    assert "in=service.refuses" in page.url
    with visit(chromium, file) as other:
        other.page.goto(page.url)
        assert names(other.page) == names(page)
        assert (
            other.page.get_by_role("status").text_content()
            == page.get_by_role("status").text_content()
        )
        other.page.evaluate(
            "location.hash = '#show?in=<b>&outcome=__proto__&by=99d&mistake=constructor&name='"
        )
        expect(other.page.get_by_role("status")).to_contain_text("40 of 40 shown")
    page.get_by_role("button", name="Show all").click()
    expect(page.get_by_role("status")).to_contain_text("40 of 40 shown")
    assert "in=" not in page.url


def test_names_of_those_shown_are_copied(page: Page) -> None:
    """A line each, in the order of the table."""
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.get_by_label("Needs attention").check()
    page.get_by_role("button", name="Copy names").click()
    expect(page.get_by_role("status")).to_contain_text("4 names copied.")
    assert page.evaluate("navigator.clipboard.readText()").split("\n") == names(page)


def test_the_last_row_holds_the_means_of_those_shown(page: Page) -> None:
    """The means of the columns add up to the mean of the points, of all students and of any part."""
    for typed in ("a", "o"):
        page.get_by_label("Name").fill(typed)
        cells = []
        for text in page.locator("#class-table tfoot tr > *").all_text_contents():
            cells.append(text.strip())
        total, *columns = [Decimal(text.replace("–", "0")) for text in cells[1:] if text]
        graded = page.locator("#class-table tbody tr:visible td.total[data-value]").count()
        assert cells[0] == f"Mean of {graded}"
        assert abs(sum(columns) - total) <= Decimal("0.04")


def test_the_head_stays_while_students_scroll(page: Page) -> None:
    """With the last student in sight, the titles of the columns are too."""
    table = page.locator(".students .scroll")
    table.scroll_into_view_if_needed()
    table.evaluate("part => { part.scrollTop = part.scrollHeight; }")
    assert table.evaluate("part => part.scrollTop") > 100
    expect(heading(page, "Points")).to_be_in_viewport()
    top, head = (place.bounding_box() for place in (table, heading(page, "Points")))
    assert top is not None
    assert head is not None
    assert abs(top["y"] - head["y"]) <= 2


# -- without a mouse ---------------------------------------------------------------------------


def test_all_can_be_done_with_the_keyboard(page: Page, summary: ClassSummary) -> None:
    """From the field for a name, Tab leads through the filters to the table and its headings; keys sort it."""
    page.get_by_label("Name").focus()
    reached = []
    for _ in range(8):
        page.keyboard.press("Tab")
        reached.append(
            page.evaluate("document.activeElement.id || document.activeElement.textContent.trim()")
        )
    assert reached[:5] == ["f-place", "f-outcome", "f-needs", "f-reset", "f-copy"]
    assert reached[-2:] == ["Student", "Points of 100"]
    page.keyboard.press("Enter")
    assert names(page) == by_points(summary, descending=True)
    page.keyboard.press("Space")
    assert names(page) == by_points(summary, descending=False)
    assert page.evaluate("document.activeElement.textContent") == "Points of 100"


def test_focus_is_seen(page: Page) -> None:
    """The element with the keyboard's focus has an outline."""
    page.get_by_label("Name").focus()
    for _ in range(7):
        page.keyboard.press("Tab")
    style = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert page.evaluate("document.activeElement.tagName") == "BUTTON"
    assert style == "solid"


# -- everywhere --------------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "dark"), part([(DESK, False), (PHONE, True)], 2))
def test_nothing_keeps_anyone_from_using_it(
    chromium: Browser, file: Path, size: tuple[int, int], dark: bool
) -> None:
    """axe-core has no serious or critical finding, all folded parts open; nothing is asked of a network."""
    with visit(chromium, file, size, dark=dark) as seen:
        seen.page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
        assert seen.axe() == []
        assert seen.requests == [file.as_uri()]


def test_a_phone_shows_it_without_scrolling_sideways(chromium: Browser, file: Path) -> None:
    """Only the tables scroll, in themselves."""
    with visit(chromium, file, PHONE) as seen:
        assert seen.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
        over = "all => all.filter(f => f.getBoundingClientRect().right > f.parentElement.getBoundingClientRect().right)"
        assert seen.page.locator(".class-table .flag").evaluate_all(f"{over}.length") == 0


def test_without_scripts_all_is_there(
    chromium: Browser, file: Path, entries: list[ClassEntry]
) -> None:
    """Every student is shown, and nothing that would do nothing."""
    with visit(chromium, file, scripts=False) as seen:
        expect(seen.page.locator("#class-table tbody tr:visible")).to_have_count(len(entries))
        expect(seen.page.locator("button:visible, form:visible")).to_have_count(0)
        expect(seen.page.locator("#class-table thead th").first).to_have_text("Student")


def test_paper_shows_what_is_folded_and_no_controls(page: Page) -> None:
    """Before printing all parts are unfolded, afterwards as they were; controls are left out."""
    folded = page.locator("details:not([open])")
    before = folded.count()
    assert before > 3
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert folded.count() == 0
    expect(page.locator("form:visible, button:visible, #status:visible")).to_have_count(0)
    # A browser repeats headings on each sheet, but not the buttons in them.
    expect(page.locator("#class-table thead .paper:visible").first).to_have_text("Student")
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert folded.count() == before


def test_a_class_of_forty_prints_on_few_pages(chromium: Browser, file: Path, page: Page) -> None:
    """Every student and every mistake is on them, and no column is one letter wide."""
    paper = printed(chromium, file)
    assert len(paper.pages) <= 8
    text = letters("".join(sheet.extract_text() for sheet in paper.pages))
    assert [name for name in names(page) if letters(name) not in text] == []
    page.set_viewport_size({"width": PAPER[0], "height": PAPER[1]})
    page.emulate_media(media="print")
    assert page.evaluate(NARROW) == []


def test_a_hostile_class_does_nothing(
    chromium: Browser, tmp_path: Path, entries: list[ClassEntry]
) -> None:
    """Names that are markup are shown as they are, and run nothing."""
    evil = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>"
    file = tmp_path / "index.html"
    hostile = []
    for n, entry in enumerate(entries[:3]):
        hostile.append(ClassEntry(f"{evil}{n}", entry.result, evil, "x/report.html"))
    file.write_text(
        render(summarise([*hostile, ClassEntry(evil, None, evil)], read_rubric(None))),
        encoding="utf-8",
    )
    with visit(chromium, file) as seen:
        heading(seen.page, "Points").get_by_role("button").click()
        assert "owned" not in seen.page.title()
        for name in names(seen.page):
            assert name.startswith("<img")
        assert seen.requests == [file.as_uri()]


def test_the_anonymous_page_works_alike(
    chromium: Browser, tmp_path: Path, entries: list[ClassEntry]
) -> None:
    """Without links it can be sorted and filtered too."""
    rubric = read_rubric(None)
    file = tmp_path / "index.html"
    file.write_text(
        render(summarise(anonymous(entries, rubric), rubric), anonymous=True), encoding="utf-8"
    )
    with visit(chromium, file) as seen:
        assert names(seen.page)[:2] == ["Student 01", "Student 02"]
        seen.page.get_by_label("Name").fill("07")
        assert names(seen.page) == ["Student 07"]
        assert seen.axe() == []

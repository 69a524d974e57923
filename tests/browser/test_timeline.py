"""The timelines of a report in a real browser: a click or a key leads to a moment, its log and its time in the bag."""

from __future__ import annotations

import re
import shutil
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from grader import result_folder
from grader.judging import rubrics
from tests.browser.chromium import PHONE, browser, visit
from tests.regraded import judge_results

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("judged_before")]

TESTS = Path(__file__).resolve().parents[1]
ROOM = "details.session#session-"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Give a browser to all tests of this file."""
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def crash(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the report of a subscriber that dies of the first state."""
    folder = tmp_path_factory.mktemp("crash")
    with tarfile.open(TESTS / "composed_recordings/crash_on_early_state.tar.xz") as archive:
        archive.extractall(folder / result_folder.RECORDINGS, filter="data")
    judge_results(folder, rubrics.read_rubric(None))
    return folder / result_folder.REPORT_FILE


@pytest.fixture(scope="module")
def solution(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the report of the solution."""
    folder = tmp_path_factory.mktemp("solution")
    shutil.copytree(TESTS / "recordings/solution", folder / result_folder.RECORDINGS)
    judge_results(folder, rubrics.read_rubric(None))
    return folder / result_folder.REPORT_FILE


def opened(page: Page, session: str) -> Locator:
    """Unfold a session; returns its timeline."""
    page.evaluate("id => document.getElementById(id).open = true", f"session-{session}")
    return page.locator(f"#session-{session} .timeline")


def mark_of(timeline: Locator, row: Locator) -> Locator:
    """Return the mark in the picture that belongs to a row of the list."""
    return timeline.locator(f'.tl-picture a[href="#{row.get_attribute("id")}"]')


def row_of(timeline: Locator, words: str) -> Locator:
    """Return the first row of the list with some words."""
    return timeline.locator("tr[data-at]", has_text=re.compile(words)).first


def test_a_click_on_an_exception_leads_to_the_traceback(chromium: Browser, crash: Path) -> None:
    """The mark tells the time in the bag and the command that plays from there; its button shows the last line."""
    with visit(chromium, crash) as seen:
        timeline = opened(seen.page, "subscriber")
        row = row_of(timeline, "TypeError")
        mark_of(timeline, row).locator("path").click()
        read = timeline.locator(".tl-read")
        at = row.get_attribute("data-at") or ""
        expect(read).to_contain_text(f"{float(at):.3f} s TypeError")
        expect(read).to_contain_text(f"grade play . subscriber --from {float(at):.3f}")
        started = int(timeline.get_attribute("data-started") or "0")
        bag_time = re.search(r"bag time (\d+\.\d{3})", read.inner_text())
        assert bag_time is not None
        assert float(bag_time[1]) == pytest.approx(started / 1e9 + float(at), abs=0.0015)
        read.get_by_role("button", name="log").click()
        line = seen.page.locator(".out.on")
        expect(line).to_be_in_viewport()
        expect(line).to_contain_text("TypeError")


def test_a_click_beside_all_moments_tells_the_time(chromium: Browser, solution: Path) -> None:
    """In the middle of the picture it is half of the session's length."""
    with visit(chromium, solution) as seen:
        timeline = opened(seen.page, "publisher")
        box = timeline.locator(".tl-picture").bounding_box()
        assert box is not None
        timeline.locator(".tl-picture").click(position={"x": box["width"] / 2, "y": 15})
        half = float(timeline.get_attribute("data-length") or 0) / 2
        told = float(timeline.locator(".tl-read b").first.inner_text().split()[0])
        assert told == pytest.approx(half, abs=2 * half / box["width"] + 0.001)


def test_arrow_keys_go_from_moment_to_moment(chromium: Browser, solution: Path) -> None:
    """The row is marked, and its text is told to screen readers."""
    with visit(chromium, solution) as seen:
        timeline = opened(seen.page, "service")
        timeline.get_by_role("group", name="Timeline of service").focus()
        seen.page.keyboard.press("ArrowRight")
        seen.page.keyboard.press("ArrowRight")
        expect(timeline.locator("tr[data-at]").nth(1)).to_have_class(re.compile("on"))
        expect(timeline.get_by_role("status")).to_contain_text("service runs")
        seen.page.keyboard.press("End")
        expect(timeline.locator("tr[data-at]").last).to_have_class(re.compile("on"))


def test_zooming_parts_what_lies_close(chromium: Browser, solution: Path) -> None:
    """Calls that lie on each other are apart when zoomed, the times at the head finer, and it scrolls in itself."""
    with visit(chromium, solution) as seen:
        timeline = opened(seen.page, "service")
        calls = [row_of(timeline, rf"\({label}\)") for label in ("enable", "disable")]

        def apart() -> float:
            first, second = (mark_of(timeline, row).locator("path").bounding_box() for row in calls)
            assert first is not None
            assert second is not None
            return second["x"] - first["x"]

        before, times = apart(), timeline.locator("text.tl-when").all_text_contents()
        for _ in range(4):
            timeline.get_by_role("button", name="Zoom in").click()
        assert apart() == pytest.approx(16 * before, rel=0.05)
        finer = timeline.locator("text.tl-when").all_text_contents()
        assert len(finer) > 4 * len(times)
        assert len(set(finer)) == len(finer)
        width = seen.page.evaluate("document.documentElement.scrollWidth")
        assert width <= seen.page.viewport_size["width"]  # type: ignore[index]


def test_without_scripts_a_mark_leads_to_its_row(chromium: Browser, crash: Path) -> None:
    """The list unfolds at the row, with a link to the line of the log; every tool that is shown works."""
    with visit(chromium, crash, scripts=False) as seen:
        session = seen.page.locator(f"{ROOM}subscriber")
        session.locator("summary").first.click()
        expect(session.locator(".tl-tools")).to_be_hidden()
        row = row_of(session, "TypeError")
        mark_of(session, row).locator("path").click()
        expect(row).to_be_in_viewport()
        row.locator("a").click()
        expect(seen.page.locator(".out:target")).to_contain_text("TypeError")


def test_a_phone_shows_the_lanes(chromium: Browser, solution: Path) -> None:
    """Names and bars stand side by side, and nothing but the picture scrolls sideways."""
    with visit(chromium, solution, PHONE) as seen:
        timeline = opened(seen.page, "launch")
        picture = timeline.locator(".tl-picture").bounding_box()
        names = timeline.locator(".tl-names").bounding_box()
        assert picture is not None
        assert names is not None
        assert picture["height"] == pytest.approx(names["height"], abs=1)
        assert picture["width"] > 200
        assert seen.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]


def test_a_dragged_span_limits_output_moments_and_figures(
    chromium: Browser, solution: Path
) -> None:
    """Lines and moments outside are hidden, and figures of the session are veiled there, until all is asked for."""
    with visit(chromium, solution) as seen:
        timeline = opened(seen.page, "subscriber")
        session = seen.page.locator(f"{ROOM}subscriber")
        picture = timeline.locator(".tl-picture")
        picture.scroll_into_view_if_needed()
        box = picture.bounding_box()
        assert box is not None
        seen.page.mouse.move(box["x"] + box["width"] * 0.3, box["y"] + 15)
        seen.page.mouse.down()
        seen.page.mouse.move(box["x"] + box["width"] * 0.5, box["y"] + 15, steps=4)
        seen.page.mouse.up()
        read = timeline.locator(".tl-read")
        expect(read).to_contain_text("s: output, moments and figures")
        told = re.search(r"Only ([\d.]+)–([\d.]+) s", read.inner_text())
        assert told is not None
        kept = session.locator(".out:not(.outside) i").all_text_contents()
        times = [float(text.split()[0]) for text in kept]
        assert times
        assert float(told[1]) - 0.001 <= min(times) <= max(times) <= float(told[2]) + 0.001
        expect(session.locator(".out.outside")).not_to_have_count(0)
        expect(session.locator("tr.outside")).not_to_have_count(0)
        expect(seen.page.locator("figure[data-session=subscriber] .veil")).not_to_have_count(0)
        expect(seen.page.locator("figure[data-session=service] .veil")).to_have_count(0)
        read.get_by_role("button", name="whole session").click()
        expect(seen.page.locator(".outside, .veil")).to_have_count(0)


def test_brackets_limit_the_time_by_the_keyboard(chromium: Browser, solution: Path) -> None:
    """The span begins and ends at chosen moments; Escape takes it away."""
    with visit(chromium, solution) as seen:
        timeline = opened(seen.page, "subscriber")
        timeline.get_by_role("group", name="Timeline of subscriber").focus()
        for key in (*["ArrowRight"] * 6, "[", "End", "]"):
            seen.page.keyboard.press(key)
        expect(timeline.locator("tr.outside")).not_to_have_count(0)
        seen.page.keyboard.press("Escape")
        expect(timeline.locator("tr.outside")).to_have_count(0)

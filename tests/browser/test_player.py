"""The player of a motion in a real browser: play, scrub, step, turn; and the page without scripts."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.browser.chromium import DESK, PHONE, browser, visit
from tests.report.test_figures import Row, recorded, shown
from tests.report.test_posture import PERIOD, TOPICS, swinging
from tests.report.test_submission_page import page_of

pytestmark = pytest.mark.browser

#: The recording lasts from 1 to 7 s; commands come from 1.4 s on. A check lost points from 1.23 s to its end.
FRAMES = 151


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Give a browser to all tests of this file."""
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a report with a motion."""
    folder = tmp_path_factory.mktemp("player")
    wanted: list[Row] = swinging(FRAMES, first=10, lag=-4.0)
    figure = shown(
        "posture", recorded(folder / "bag", {"/is": swinging(FRAMES), "/wanted": wanted}), **TOPICS
    )
    file = folder / "report.html"
    file.write_text(page_of(figures=[figure]), encoding="utf-8")
    return file


def at(page: Page) -> float:
    """Give the time that the player shows, in s."""
    return float((page.locator(".clock").text_content() or "").removesuffix(" s"))


def tip(page: Page) -> tuple[float, float]:
    """Give where the robot's last link ends in the picture."""
    last = page.locator(".player .link").last
    return float(last.get_attribute("x2") or 0), float(last.get_attribute("y2") or 0)


def button(page: Page, name: str) -> Locator:
    """Give a button of the player."""
    return page.locator(".controls").get_by_role("button", name=name, exact=True)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_nothing_keeps_anyone_from_using_it(dark: bool, chromium: Browser, report: Path) -> None:
    """axe-core has no serious or critical finding, and a phone need not scroll sideways."""
    with visit(chromium, report, PHONE if dark else DESK, dark=dark) as seen:
        expect(seen.page.locator(".controls")).to_be_visible()
        assert seen.axe() == []
        if dark:
            assert seen.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]


def test_the_still_is_what_the_script_draws(chromium: Browser, report: Path) -> None:
    """At the still's moment the script moves nothing that the picture had."""
    shapes = "[...document.querySelectorAll('.player svg.chart > :not(title):not(desc)')].map(e => e.outerHTML)"
    with visit(chromium, report, scripts=False) as seen:
        picture = seen.page.locator(".player svg.chart")
        without = [picture.locator(".link").last.get_attribute(key) for key in ("x2", "y2")]
        lines = [
            picture.locator(name).get_attribute("points")
            for name in (".ghost", ".shadow", ".way", ".ghost-way")
        ]
        expect(seen.page.locator(".controls")).to_be_hidden()
        expect(seen.page.locator(".player button:visible")).to_have_count(0)
        expect(seen.page.locator(".moment .at")).to_have_text(["1.2–7.3 s"])
    with visit(chromium, report) as seen:
        assert len(seen.page.evaluate(shapes)) > 8
        assert tip(seen.page) == pytest.approx([float(value or 0) for value in without], abs=0.1)
        for name, line in zip((".ghost", ".shadow", ".way", ".ghost-way"), lines, strict=True):
            now = seen.page.locator(f".player {name}").get_attribute("points") or ""
            assert numbers(now) == pytest.approx(numbers(line or ""), abs=0.11), name


def numbers(points: str) -> list[float]:
    """Give the places of a line's points from left to right, as a way may begin at either end."""
    places = sorted(tuple(float(part) for part in point.split(",")) for point in points.split())
    found = []
    for place in places:
        for number in place:
            found.append(number)
    return found


def test_keys_scrub_and_step(chromium: Browser, report: Path) -> None:
    """Home and End go to the ends; the buttons beside go one posture on and back; the robot moves with it."""
    with visit(chromium, report) as seen:
        slider = seen.page.get_by_role("slider", name="Time")
        slider.press("Home")
        assert at(seen.page) == 1.0
        first = tip(seen.page)
        expect(seen.page.locator(".player .ghost")).to_have_attribute("points", "")
        button(seen.page, "One posture on").press("Enter")
        assert at(seen.page) == pytest.approx(1 + PERIOD / 1e9)
        button(seen.page, "One posture back").click()
        assert tip(seen.page) == first
        slider.press("End")
        assert at(seen.page) == 7.0
        assert tip(seen.page) != first
        assert len((seen.page.locator(".player .ghost").get_attribute("points") or "").split()) == 3
        expect(slider).to_have_attribute("aria-valuetext", "7.00 s")


@pytest.mark.parametrize("calm", [True, False], ids=["less motion", "motion"])
def test_it_plays_and_pauses(calm: bool, chromium: Browser, report: Path) -> None:
    """The player waits for its button; with reduced motion it then shows a still each half second."""
    with visit(chromium, report) as seen:
        seen.page.emulate_media(reduced_motion="reduce" if calm else "no-preference")
        seen.page.get_by_role("slider", name="Time").press("Home")
        begun = at(seen.page)
        seen.page.evaluate(
            "window.stills = new Set(); new MutationObserver(() => stills.add(document.querySelector('.clock')"
            ".textContent)).observe(document.querySelector('.clock'), {childList: true})"
        )
        seen.page.locator(".time").press(" ")
        expect(seen.page.locator(".clock")).to_have_text(re.compile(r"^(2\.[5-9]|[3-7])"))
        button(seen.page, "Pause").click()
        paused, stills = at(seen.page), seen.page.evaluate("stills.size")
        # However late the pause was pressed, and with one for it.
        most = (paused - begun) / 0.5 + 1
        assert (stills <= most) if calm else (stills > 5)
        seen.page.wait_for_timeout(700)
        assert at(seen.page) == paused
        expect(button(seen.page, "Play")).to_be_visible()


def test_a_moment_of_lost_points_is_found(chromium: Browser, report: Path) -> None:
    """A check that lost points in this recording has a mark on the line of time, a button to go there, and a link."""
    with visit(chromium, report) as seen:
        moment = seen.page.locator(".moment")
        expect(moment).to_have_count(1)
        expect(moment.locator(".cost")).to_have_text("−1.5")
        moment.get_by_role("button", name="1.2–7.3 s").click()
        assert at(seen.page) == 1.23
        mark = seen.page.locator(".marks .span")
        assert float(mark.get_attribute("x") or 0) == pytest.approx(1000 * 0.23 / 6, abs=0.1)
        moment.get_by_role("link", name="Title of a.half").click()
        expect(seen.page.locator("#check-a\\.half .reason")).to_be_in_viewport()


def test_the_view_turns(chromium: Browser, report: Path) -> None:
    """By a button and by the mouse; the fourth press of the button is as before."""
    with visit(chromium, report) as seen:
        before = tip(seen.page)
        for n in range(4):
            button(seen.page, "Other view").click()
            assert (tip(seen.page) == pytest.approx(before, abs=0.01)) == (n == 3)
        box = seen.page.locator(".player svg.chart").bounding_box()
        assert box is not None
        seen.page.mouse.move(box["x"] + 200, box["y"] + 200)
        seen.page.mouse.down()
        seen.page.mouse.move(box["x"] + 260, box["y"] + 200)
        seen.page.mouse.up()
        assert tip(seen.page) != pytest.approx(before, abs=1)


def test_paper_has_the_still_and_no_buttons(chromium: Browser, report: Path) -> None:
    """Printed, the robot stands at the moment that was shown."""
    with visit(chromium, report) as seen:
        seen.page.emulate_media(media="print")
        expect(seen.page.locator(".controls")).to_be_hidden()
        expect(seen.page.locator(".player svg.chart")).to_be_visible()
        expect(seen.page.locator(".moment")).to_be_visible()

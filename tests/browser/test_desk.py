"""The review desk in a real browser: a class of forty, by keyboard, with a desk that is killed in between."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

import pytest
import yaml
from playwright.sync_api import Browser, Page, expect

from grader.result import load_result
from grader.result_folder import RESULT_FILE
from tests.browser.chromium import Visit, browser
from tests.desk.made_class import Served, add_alike, serve

pytestmark = pytest.mark.browser

OPEN, APPEALS = 15, 10
HOSTILE = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Give a browser to all tests of this file."""
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Lay out a class of forty: fifteen without a recording of the service, ten who appeal."""
    folder = tmp_path_factory.mktemp("desk") / "results"
    add_alike(folder, [f"open{n:02d}" for n in range(OPEN)], "solution", without="service")
    add_alike(folder, [f"appeal{n:02d}" for n in range(APPEALS)], "signed_mean_statistics")
    add_alike(folder, [f"fine{n:02d}" for n in range(40 - OPEN - APPEALS)], "solution")
    entries = [
        {
            "submission": f"appeal{n:02d}",
            "check": "subscriber.mean",
            "appeal": f"I think that my mean is right. {HOSTILE}",
            "who": f"appeal{n:02d}",
            "when": "2026-11-21",
        }
        for n in range(APPEALS)
    ]
    (folder / "overrides.yaml").write_text("# appeals by mail\n" + yaml.safe_dump({"overrides": entries}))
    return folder


def opened(chromium: Browser, desk: Served, *, dark: bool = False) -> Visit:
    """Open a desk; what it asks for elsewhere is noted, and what it complains of."""
    context = chromium.new_context(viewport={"width": 1400, "height": 900}, color_scheme="dark" if dark else "light")
    seen = Visit(context.new_page())
    seen.page.on("request", lambda request: seen.requests.append(request.url))
    seen.page.on("console", lambda message: seen.complaints.append(message.text))
    seen.page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    seen.page.goto(desk.address)
    expect(seen.page.locator("#queue button").first).to_be_visible()
    return seen


class Keyboard:
    """Presses keys, and counts them."""

    def __init__(self, page: Page) -> None:
        self.page, self.pressed = page, 0

    def press(self, *keys: str) -> None:
        """Press keys one after the other."""
        for key in keys:
            self.page.keyboard.press(key)
            self.pressed += 1

    def type(self, text: str) -> None:
        """Write a text."""
        self.page.keyboard.type(text)
        self.pressed += len(text)


def decided(page: Page) -> int:
    """Give the number of items that the desk says are decided."""
    return int((page.locator("#progress").text_content() or "").split()[0])


def test_a_class_is_decided_by_keyboard(chromium: Browser, made: Path, tmp_path: Path) -> None:
    """Ten appeals one by one, then fifteen undecided; the desk is killed after four, and nothing is lost."""
    desk = serve(made)
    seen = opened(chromium, desk)
    keys, began = Keyboard(seen.page), time.monotonic()
    for n in range(4):
        settle_appeal(keys, n)
    assert seen.complaints == []
    assert all(url.startswith(desk.address) for url in seen.requests)
    desk.kill()
    seen.page.context.close()
    desk = serve(made)
    try:
        seen = opened(chromium, desk)
        keys.page = seen.page
        assert decided(seen.page) == 4
        for n in range(4, APPEALS):
            settle_appeal(keys, n)
        seen.page.screenshot(path=tmp_path / "desk.png")
        for n in range(OPEN):
            settle_service(keys, n)
        expect(seen.page.locator("#empty")).to_be_visible()
        took_s = time.monotonic() - began
        print(json.dumps({"keystrokes": keys.pressed, "seconds": round(took_s, 1)}))
        assert keys.pressed < 250
        assert seen.complaints == []
        desk.until(lambda plain: not plain["waiting"])
        for n in range(OPEN):
            result = load_result(made / f"open{n:02d}" / RESULT_FILE)
            assert (result.still_undecided, result.final) == (Decimal(0), result.score.possible)
        for n in range(APPEALS):
            kinds = [a.kind.value for a in load_result(made / f"appeal{n:02d}" / RESULT_FILE).adjustments]
            assert kinds == ["appeal", "points" if n % 2 else "reviewed"]
        text = (made / "overrides.yaml").read_text(encoding="utf-8")
        assert text.startswith("# appeals by mail\n")
        assert len(yaml.safe_load(text)["overrides"]) == 2 * APPEALS + OPEN
    finally:
        desk.kill()


def settle_appeal(keys: Keyboard, n: int) -> None:
    """Answer an appeal: every second one gets full points, the others stay as they are with a comment."""
    expect(keys.page.locator("#about")).to_contain_text(f"appeal{n:02d} · appeal")
    if n % 2:
        keys.press("f")
        if n == 1:
            keys.press("r")
            keys.type("mean accepted")
        else:
            keys.press("1")
    else:
        keys.press("a", "c")
        keys.type("See line 40.")
        keys.press("Escape")
    keys.press("Enter")
    expect(keys.page.locator("#about")).not_to_contain_text(f"appeal{n:02d} · appeal")


def settle_service(keys: Keyboard, n: int) -> None:
    """Excuse a whole criterion."""
    expect(keys.page.locator("#about")).to_contain_text(f"open{n:02d} · undecided")
    keys.press("e", "w", "1", "Enter")
    expect(keys.page.locator("#about")).not_to_contain_text(f"open{n:02d} · undecided")


@pytest.mark.parametrize("dark", [False, True])
def test_the_desk_can_be_used_by_all(chromium: Browser, made: Path, dark: bool) -> None:
    """No grave finding of axe-core, with decided items shown, the preview open, and in the evidence."""
    desk = serve(made)
    try:
        page = desk_with_decided(chromium, desk, dark=dark)
        assert page.axe() == []
        page.page.keyboard.press("e")
        page.page.keyboard.press("1")
        page.page.keyboard.press("s")
        expect(page.page.locator("#preview")).to_be_visible()
        assert page.axe() == []
    finally:
        desk.kill()


def desk_with_decided(chromium: Browser, desk: Served, *, dark: bool) -> Visit:
    """Open a desk with all items."""
    context = chromium.new_context(viewport={"width": 1400, "height": 900}, color_scheme="dark" if dark else "light")
    seen = Visit(context.new_page())
    seen.page.goto(desk.address)
    seen.page.locator("#decided").check()
    seen.page.locator("#queue button").first.click()
    return seen


def test_a_students_text_stays_text(chromium: Browser, made: Path) -> None:
    """Markup in an appeal is shown as it was written, on the desk and in the evidence."""
    desk = serve(made)
    try:
        seen = desk_with_decided(chromium, desk, dark=False)
        expect(seen.page.locator("#text")).to_contain_text("<script>document.title='owned'</script>")
        expect(seen.page.frame_locator("#evidence").locator(".said.question")).to_contain_text("<img src=x")
        assert seen.page.title() == "Review desk"
        assert seen.page.frame_locator("#evidence").locator("img, script").count() == 0
    finally:
        desk.kill()

"""The review desk in a real browser: a class of forty, by keyboard, with a desk that is killed in between."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
import yaml
from playwright.sync_api import Browser, Page, expect

from grader.report.views import appeal_text
from grader.result import load_result
from grader.result_folder import RECORDINGS, RESULT_FILE
from tests.browser.chromium import Visit, browser, visit
from tests.desk.made_class import Served, add_alike, serve
from tests.live.small_lab import until
from tests.report.untrusted_texts import FRAGMENTS
from tests.thorough import part

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("judged_before")]

OPEN, APPEALS = 15, 10
#: Texts that browsers, terminals and spreadsheets obey, as in the tests of all other sinks.
HOSTILE = (
    "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>"
    '"><svg onload="document.title=\'owned\'"><a href="javascript:document.title=\'owned\'">x</a>'
    "<iframe src=http://evil.example></iframe><meta http-equiv=refresh content='0;url=http://evil.example'>"
    "<form action=http://evil.example><base href=http://evil.example><link rel=stylesheet href=http://evil.example>"
    "</style></script></textarea></title>{{ 7*7 }}{% raw %}" + "".join(FRAGMENTS)
)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Give a browser to all tests of this file."""
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Lay out a class of forty: fifteen without a recording of the service, ten with an appeal."""
    folder = tmp_path_factory.mktemp("desk") / "results"
    add_alike(folder, [f"open{n:02d}" for n in range(OPEN)], "solution", without="service")
    add_alike(folder, [f"appeal{n:02d}" for n in range(APPEALS)], "signed_mean_statistics")
    add_alike(folder, [f"fine{n:02d}" for n in range(40 - OPEN - APPEALS)], "solution")
    appeals = []
    for n in range(APPEALS):
        appeals.append(appeal_of(f"appeal{n:02d}", "I think that my mean is right."))
    (folder / "overrides.yaml").write_text(
        "# appeals by mail\n" + yaml.safe_dump({"overrides": appeals})
    )
    return folder


def appeal_of(name: str, text: str) -> dict[str, str]:
    """Give an appeal as it stands in the file of overrides."""
    return {
        "submission": name,
        "check": "subscriber.mean",
        "appeal": text,
        "who": name,
        "when": "2026-11-21",
    }


def opened(chromium: Browser, desk: Served, path: str = "", *, dark: bool = False) -> Visit:
    """Open a page of a desk, and note its requests to other places and its complaints."""
    context = chromium.new_context(
        viewport={"width": 1400, "height": 900}, color_scheme="dark" if dark else "light"
    )
    seen = Visit(context.new_page())
    seen.page.on("request", lambda request: seen.requests.append(request.url))
    seen.page.on("console", lambda message: seen.complaints.append(message.text))
    seen.page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    seen.page.on("dialog", lambda dialog: seen.complaints.append(dialog.message))
    seen.page.goto(desk.address + path)
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


def expect_decided(page: Page, number: int) -> None:
    """See that the desk comes to say how many items are decided."""
    expect(page.locator("#progress")).to_contain_text(f"{number} of {APPEALS + 6 * OPEN} decided")


def require_decided_results(made: Path) -> None:
    """Fail unless no points are open any more, and each appeal has its decision."""
    for n in range(OPEN):
        result = load_result(made / f"open{n:02d}" / RESULT_FILE)
        assert (result.still_undecided, result.final) == (Decimal(0), result.score.possible)
    for n in range(APPEALS):
        adjustments = load_result(made / f"appeal{n:02d}" / RESULT_FILE).adjustments
        kinds = [adjustment.kind.value for adjustment in adjustments]
        assert kinds == ["appeal", "points" if n % 2 else "reviewed"]


def test_a_class_is_decided_by_keyboard(chromium: Browser, made: Path) -> None:
    """Ten appeals, one by one, and fifteen undecided, most at once; the desk is killed after four; nothing is lost."""
    desk = serve(made)
    seen = opened(chromium, desk)
    keys, began = Keyboard(seen.page), time.monotonic()
    for n in range(4):
        settle_appeal(keys, n)
    expect_decided(seen.page, 4)
    assert seen.complaints == []
    for url in seen.requests:
        assert url.startswith(desk.address)
    desk.kill()
    seen.page.context.close()
    desk = serve(made)
    try:
        seen = opened(chromium, desk)
        keys.page = seen.page
        expect_decided(seen.page, 4)
        for n in range(4, APPEALS):
            settle_appeal(keys, n)
        settle_services(keys)
        expect(seen.page.locator("#empty")).to_be_visible()
        print(
            json.dumps({"keystrokes": keys.pressed, "seconds": round(time.monotonic() - began, 1)})
        )
        assert keys.pressed < 150
        assert seen.complaints == []
        desk.until(lambda plain: not plain["waiting"])
        require_decided_results(made)
        text = (made / "overrides.yaml").read_text(encoding="utf-8")
        assert text.startswith("# appeals by mail\n")
        assert len(yaml.safe_load(text)["overrides"]) == 2 * APPEALS + 2
    finally:
        desk.kill()


def settle_appeal(keys: Keyboard, n: int) -> None:
    """Answer an appeal: every second one gets full points, the others stay as they are with a comment."""
    expect(keys.page.locator("#about")).to_contain_text(f"appeal{n:02d} · appeal")
    if n == 1:  # The evidence beside an item is its own.
        expect(keys.page.locator("#evidence")).to_be_visible()
        expect(keys.page.frame_locator("#evidence").locator(".said.question")).to_contain_text(
            "appeal01"
        )
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


def settle_services(keys: Keyboard) -> None:
    """Excuse one of a whole criterion, take that back and decide anew; then all others with the same, looked at."""
    for is_final in (False, True):
        expect(keys.page.locator("#about")).to_contain_text("open00 · undecided")
        keys.press("e", "w", "1", "Enter")
        expect_decided(keys.page, APPEALS + 6)
        if not is_final:
            keys.press("u")
            expect_decided(keys.page, APPEALS)
    expect(keys.page.locator("#about")).to_contain_text("open01 · undecided")
    keys.press("e", "w", "1", "s")
    rows = keys.page.locator("#effects tr")
    expect(rows).to_have_count(OPEN)
    expect(rows.first).to_contain_text("open01")
    expect(rows.first).to_contain_text("0 → 20")
    expect(rows.first).to_contain_text("The session 'service' was not recorded.")
    expect(rows.nth(1)).to_contain_text("open00 (decided already)")
    keys.press("Enter")


@pytest.mark.parametrize("dark", part([False, True], 2))
def test_the_desk_can_be_used_by_all(
    chromium: Browser, made: Path, tmp_path: Path, dark: bool
) -> None:
    """No finding of axe-core: with decided items shown, the preview open, in evidence, and among the limits."""
    desk = serve(made)
    try:
        seen = with_decided(chromium, desk, dark=dark)
        assert seen.axe() == []
        seen.page.keyboard.press("e")
        seen.page.keyboard.press("r")
        seen.page.keyboard.type("as agreed")
        seen.page.keyboard.press("Escape")
        seen.page.keyboard.press("s")
        expect(seen.page.locator("#preview")).to_be_visible()
        assert seen.axe() == []
        evidence = (
            tmp_path / "evidence.html"
        )  # Where the desk shows it, axe-core could not run either.
        evidence.write_bytes(desk.ask("GET", "evidence?name=appeal00&what=subscriber.mean")[1])
        with visit(chromium, evidence, dark=dark) as alone:
            assert alone.axe() == []
        limits = opened(chromium, desk, "rubric.html", dark=dark)
        expect(limits.page.locator("input").first).to_be_visible()
        assert limits.axe() == []
    finally:
        desk.kill()


def with_decided(chromium: Browser, desk: Served, *, dark: bool = False) -> Visit:
    """Open a desk with all items."""
    seen = opened(chromium, desk, dark=dark)
    seen.page.locator("#decided").check()
    seen.page.locator("#queue button").first.click()
    return seen


def test_students_texts_stay_texts(chromium: Browser, tmp_path: Path) -> None:
    """Whatever stands in an appeal, a finding, a file or a program's output does nothing, on the desk and beside it."""
    results = tmp_path / "results"
    add_alike(results, ["eve"], "signed_mean_statistics")
    for file in (results / "eve" / RESULT_FILE, *(results / "eve" / RECORDINGS).rglob("*.json")):
        text = json.dumps(poisoned(json.loads(file.read_text(encoding="utf-8"))))
        file.unlink()  # The folder may be a link to a kept recording.
        file.write_text(text, encoding="utf-8")
    entries = {"overrides": [appeal_of("eve", HOSTILE.encode("utf-8", "replace").decode())]}
    (results / "overrides.yaml").write_text(yaml.safe_dump(entries), encoding="utf-8")
    desk = serve(results)
    try:
        seen = with_decided(chromium, desk)
        expect(seen.page.locator("#text")).to_contain_text(
            "<script>document.title='owned'</script>"
        )
        evidence = seen.page.frame_locator("#evidence")
        expect(evidence.locator(".said.question")).to_contain_text("<img src=x")
        expect(evidence.locator(".reason").first).to_contain_text(
            "<script>document.title='owned'</script>"
        )
        assert (
            evidence.locator("img, script, iframe, form, base, link, [onerror], [onload]").count()
            == 0
        )
        assert (seen.page.title(), seen.complaints) == ("Review desk", [])
        # The desk writes the report again in the background, because an appeal is new.
        written = results / "eve" / "report.html"
        until(lambda: "owned" in written.read_text(encoding="utf-8"), 60)
        report = opened(chromium, desk, "report?name=eve")
        expect(report.page.locator(".reason").first).to_contain_text(
            "<script>document.title='owned'</script>"
        )
        assert "owned" not in report.page.title().replace(HOSTILE[:40], "")
        for page in (seen, report):
            assert [url for url in page.requests if not url.startswith(desk.address)] == []
    finally:
        desk.kill()


#: Texts that come from students, by their keys in results and recordings.
_STUDENTS = {
    "reason",
    "expected",
    "measured",
    "hint",
    "notes",
    "advisories",
    "text",
    "texts",
    "error",
    "counted",
}


def poisoned(value: Any, key: str = "") -> Any:
    """Return results or a record with a hostile text behind each of a student's."""
    if isinstance(value, dict):
        return {k: poisoned(v, key if key == "texts" else k) for k, v in value.items()}
    if isinstance(value, list):
        return [poisoned(each, key) for each in value]
    if isinstance(value, str) and key in _STUDENTS:
        return value + HOSTILE
    return value


# -- decisions by keys -----------------------------------------------------------------------------


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Lay out two submissions without a recording of the service: one interfered, and one has two versions."""
    results = tmp_path / "results"
    add_alike(results, ["ann", "bob"], "solution", without="service")
    violation = {"kind": "second_server", "session": "service", "text": "It serves twice."}
    chosen = {"expected": "a.py", "path": "v1/a.py", "others": ["v2/a.py"], "why": "it is first"}
    for name, more in (
        ("ann", {"violations": [violation]}),
        ("bob", {"chosen": [{**chosen, "is_open": True}]}),
    ):
        file = results / name / RESULT_FILE
        plain = json.loads(file.read_text(encoding="utf-8"))
        file.write_text(json.dumps({**plain, **more}), encoding="utf-8")
    return results


def entries(results: Path) -> list[dict[str, Any]]:
    """Return the decisions."""
    file = results / "overrides.yaml"
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    found: list[dict[str, Any]] = (yaml.safe_load(text) or {}).get("overrides") or []
    return found


#: Keys, the points beside the field, and the decision, for each scope and key.
SETTLED: list[tuple[tuple[str, ...], str, dict[str, Any]]] = [
    (("f",), "of 4", {"check": "service.offers", "set": 4}),
    (("z",), "of 4", {"check": "service.offers", "set": 0}),
    (("e",), "of 4", {"check": "service.offers", "excused": True}),
    (("p", "2"), "of 4", {"check": "service.offers", "set": 2}),
    (("w", "f"), "of 20", {"criterion": "service", "set": 20}),
    (("f", "w"), "of 20", {"criterion": "service", "set": 20}),
    (("w", "w", "f"), "of 4", {"check": "service.offers", "set": 4}),
    (("w", "z"), "of 20", {"criterion": "service", "set": 0}),
    (("w", "e"), "of 20", {"criterion": "service", "excused": True}),
    (("e", "w"), "of 20", {"criterion": "service", "excused": True}),
    (("w", "p", "1", "5"), "of 20", {"criterion": "service", "set": 15}),
]


def test_each_key_settles_each_scope(chromium: Browser, tmp_path: Path) -> None:
    """The maximum beside the field is the check's or the criterion's, in a submission for each."""
    results = tmp_path / "results"
    names = [f"s{n:02d}" for n in range(len(SETTLED))]
    add_alike(results, [*names, "unsettled"], "solution", without="service")
    desk = serve(results)
    try:
        seen = opened(chromium, desk)
        keys = Keyboard(seen.page)
        for name, (pressed, limit, _) in zip(names, SETTLED, strict=True):
            expect(seen.page.locator("#about")).to_contain_text(f"{name} · undecided")
            keys.press(*pressed)
            expect(seen.page.locator("#most")).to_have_text(limit)
            keys.press("Escape", "r")
            keys.type("agreed")
            keys.press("Enter")
        expect(seen.page.locator("#about")).to_contain_text("unsettled · undecided")
        for name, entry, (pressed, _, decided) in zip(
            names, entries(results), SETTLED, strict=True
        ):
            about = {key: entry[key] for key in entry if key not in ("reason", "who", "when")}
            assert about == {"submission": name, **decided}, pressed
        assert seen.complaints == []
    finally:
        desk.kill()


def test_the_whole_is_looked_at(chromium: Browser, small: Path) -> None:
    """Interference and two versions of the work are answered for the whole submission, with its points."""
    desk = serve(small)
    try:
        page = opened(chromium, desk).page
        keys = Keyboard(page)
        for n, (kind, words) in enumerate(
            (("interference", "It serves twice."), ("note", "v2/a.py"))
        ):
            page.locator("#kind").select_option(kind)
            expect(page.locator("#text")).to_contain_text(words)
            expect(page.locator("#most")).to_have_text("of 100")
            expect(page.locator("#points")).to_be_disabled()
            page.locator("#kind").evaluate("kind => kind.blur()")
            keys.press("a", "Enter")
            expect(page.locator("#empty")).to_be_visible()
            entry = entries(small)[n]
            assert entry["reviewed"] is True
            assert not {"check", "criterion", "set"} & entry.keys()
    finally:
        desk.kill()


#: Points that a criterion of 20 cannot have, and why.
REFUSED_POINTS = {
    "20.5": "At most 20 points are possible here.",
    "-1": "Fewer than 0 points are not possible.",
    "seven": "This is not a number of points.",
    "1e1": "This is not a number of points.",
    "0x5": "This is not a number of points.",
    "1.234,5": "This is not a number of points.",
    "1,125": "Points have at most two decimals.",
}


def test_more_points_than_there_are_are_refused(chromium: Browser, small: Path) -> None:
    """The desk names the possible points of the decision's check or criterion."""
    desk = serve(small)
    try:
        page = opened(chromium, desk).page
        keys = Keyboard(page)
        expect(page.locator("#about")).to_contain_text("ann · undecided")
        keys.press("w", "r")
        keys.type("agreed")
        for typed, problem in REFUSED_POINTS.items():
            page.fill("#points", typed)
            page.locator("#save").click()
            words = f"{problem} You typed {typed}. Nothing was saved. Enter a number from 0 to 20."
            expect(page.locator("#problem")).to_have_text(words)
            assert entries(small) == []
        page.fill("#points", "2,5")
        page.locator("#save").click()
        expect(page.locator("#about")).not_to_contain_text("ann · undecided")
        assert [entry["set"] for entry in entries(small)] == [2.5]
    finally:
        desk.kill()


def test_a_pasted_question_is_an_appeal(chromium: Browser, small: Path) -> None:
    """A pasted question is kept under the student's name, shown, and can be undone; a text without one is refused."""
    result = load_result(small / "bob" / RESULT_FILE)
    mail = appeal_text(result, result.checks[0]) + "<b>My</b> timer is right."
    desk = serve(small)
    try:
        page = opened(chromium, desk).page
        page.get_by_text("Paste a question").click()
        page.fill("#pasted", "hello")
        page.get_by_role("button", name="Note it").click()
        expect(page.locator("#problem")).to_contain_text("names no check")
        page.fill("#pasted", mail)
        page.get_by_role("button", name="Note it").click()
        expect(page.locator("#about")).to_contain_text("bob · appeal")
        expect(page.locator("#text")).to_have_text("<b>My</b> timer is right.")
        (entry,) = entries(small)
        assert (entry["check"], entry["who"]) == (result.checks[0].id, "bob")
        page.locator("#undo").click()
        expect(page.locator("#about")).not_to_contain_text("appeal")
        assert entries(small) == []
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        page.evaluate("text => navigator.clipboard.writeText(text)", mail)
        page.locator("#reason").focus()
        page.keyboard.press("Control+v")
        assert entries(small) == []
        page.keyboard.press("Escape")
        page.keyboard.press("Control+v")
        expect(page.locator("#about")).to_contain_text("bob · appeal")
        assert [entry["check"] for entry in entries(small)] == [result.checks[0].id]
    finally:
        desk.kill()


def test_a_moved_limit_is_one_command(chromium: Browser, small: Path) -> None:
    """A saved rubric comes with the command that shows, asks, applies and writes mails; it is in the clipboard."""
    desk = serve(small)
    try:
        page = opened(chromium, desk, "rubric.html").page
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        page.locator("#limits input").first.fill("5")
        page.get_by_role("button", name="Save as a file").click()
        expect(page.locator("#said")).to_contain_text("The command is copied.")
        command = page.locator("#command").inner_text()
        assert command.endswith("rubric-edited.yaml --ask --mail")
        assert page.evaluate("navigator.clipboard.readText()") == command
    finally:
        desk.kill()


def test_what_is_half_written_is_kept_with_its_item(chromium: Browser, small: Path) -> None:
    """Comment, reason, points and scope come back with `k`; they never belong to another item."""
    desk = serve(small)
    try:
        page = opened(chromium, desk).page
        keys = Keyboard(page)
        expect(page.locator("#about")).to_contain_text("ann · undecided")
        keys.press("w", "f", "c")
        keys.type("See line 4, and")
        keys.press("Escape", "j")
        expect(page.locator("#about")).to_contain_text("bob · undecided")
        expect(page.locator("#comment")).to_have_value("")
        expect(page.locator("#points")).to_have_value("")
        keys.press("k")
        expect(page.locator("#about")).to_contain_text("ann · undecided")
        expect(page.locator("#comment")).to_have_value("See line 4, and")
        expect(page.locator("#points")).to_have_value("20")
        expect(page.locator("#most")).to_have_text("of 20")
        expect(page.locator("#scope")).to_have_value("criterion")
        expect(page.locator("#changes [aria-pressed=true]")).to_contain_text("Full points")
        keys.press("r")
        keys.type("agreed")
        keys.press("Enter")
        expect(page.locator("#undo")).to_be_enabled()
        expect(page.locator("#about")).to_contain_text("bob · undecided")
        expect(page.locator("#comment")).to_have_value("")
        (entry,) = entries(small)
        assert (entry["criterion"], entry["set"]) == ("service", 20)
        assert entry["comment"] == "See line 4, and"
    finally:
        desk.kill()


def test_the_key_on_a_button_is_the_key_that_works(chromium: Browser, small: Path) -> None:
    """In a comment that is Ctrl Enter, since Enter begins a line; each other button is pressed by the key on it."""
    desk = serve(small)
    try:
        page = opened(chromium, desk).page
        keys = Keyboard(page)
        expect(page.locator("#about")).to_contain_text("ann · undecided")
        for button in page.locator("#changes button").all():
            key = button.locator("kbd").inner_text()
            keys.press(key)
            expect(button).to_have_attribute("aria-pressed", "true")
        save = page.locator("#save kbd")
        expect(save).to_have_text("Enter")
        keys.press("e", "r")
        keys.type("agreed")
        keys.press("Escape", "c")
        expect(save).to_have_text("Ctrl Enter")
        keys.type("one")
        keys.press("Enter")
        keys.type("two")
        expect(page.locator("#comment")).to_have_value("one\ntwo")
        assert entries(small) == []
        keys.press("Control+Enter")
        expect(page.locator("#undo")).to_be_enabled()
        assert entries(small)[0]["comment"] == "one two"
        expect(save).to_have_text("Enter")
        page.locator("#kind").select_option("undecided")
        page.locator("#kind").evaluate("kind => kind.blur()")
        keys.press("e", "1", "s")
        expect(page.locator("#preview")).to_be_visible()
        page.locator("#effects input").first.focus()
        keys.press("Enter")
        expect(page.locator("#preview")).to_be_hidden()
        expect(page.locator("#problem")).to_be_hidden()
    finally:
        desk.kill()

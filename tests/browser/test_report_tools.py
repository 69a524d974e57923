"""Tools of a report in a real browser: search, copies, links, questions, and parts that are built when needed."""

from __future__ import annotations

import re
import shutil
import tarfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Browser, Page, expect

from grader import result_folder
from grader.judging import rubrics
from tests.browser.chromium import PHONE, browser, visit
from tests.regraded import judge_results

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("judged_before")]

TESTS = Path(__file__).resolve().parents[1]
#: Recordings with a copied command, output with an exception, and source lines.
NAMES = ("service_never_answers", "solution", "launch_wrong_executable")
ADDRESS = "ros-lab@example.edu"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Give a browser to all tests of this file."""
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Give the reports of some kept recordings, and of a subscriber that crashes."""
    rubric = rubrics.read_rubric(None)
    folder = tmp_path_factory.mktemp("reports")
    for name in NAMES:
        shutil.copytree(TESTS / "recordings" / name, folder / name / result_folder.RECORDINGS)
    with tarfile.open(TESTS / "composed_recordings/crash_on_early_state.tar.xz") as archive:
        archive.extractall(folder / "crash" / result_folder.RECORDINGS, filter="data")
    for name in (*NAMES, "crash"):
        judge_results(folder / name, rubric)
    return {name: folder / name / result_folder.REPORT_FILE for name in (*NAMES, "crash")}


@pytest.fixture(scope="module")
def with_address(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a report of a lab with a mail address for questions in its policy."""
    rubric = rubrics.read_rubric(None)
    policy = rubric.policy.model_copy(update={"questions_to": ADDRESS})
    folder = tmp_path_factory.mktemp("address")
    kept = TESTS / "recordings/service_never_answers"
    shutil.copytree(kept, folder / result_folder.RECORDINGS)
    judge_results(folder, rubric.model_copy(update={"policy": policy}))
    return folder / result_folder.REPORT_FILE


def copied(page: Page) -> str:
    """Return the text that was copied last."""
    text: str = page.evaluate("navigator.clipboard.readText()")
    return text


def elements(page: Page) -> int:
    """Return the number of elements in a page."""
    count: int = page.evaluate("document.querySelectorAll('*').length")
    return count


def search(page: Page, words: str) -> None:
    """Search by the keyboard."""
    page.keyboard.press("/")
    page.keyboard.type(words)
    expect(page.locator("#found")).to_contain_text("place")


def test_commands_code_and_errors_are_copied(chromium: Browser, reports: dict[str, Path]) -> None:
    """The copy has the text alone, without numbers of lines and without the times of output."""
    with visit(chromium, reports["launch_wrong_executable"]) as seen:
        seen.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        check = seen.page.locator("#check-launch\\.loads")
        check.get_by_role("button", name="Copy this command").last.click()
        expect(seen.page.locator("#told")).to_have_text("Copied: command")
        assert copied(seen.page) == "grade . --sessions launch"
        check.get_by_role("button", name="Copy this error").click()
        assert copied(seen.page) == check.locator(".reason").inner_text().strip()
        check.get_by_role("button", name="Copy this code").first.click()
        source = check.locator(".source").first
        assert copied(seen.page).split("\n") == source.locator("code").all_inner_texts()
        seen.page.get_by_role("button", name="Expand all").click()
        output = seen.page.locator(".output", has=seen.page.locator(".out")).first
        output.get_by_role("button", name="Copy this output").click()
        assert copied(seen.page).split("\n")[0] in output.locator(".out").first.inner_text()
        assert not re.match(r"\d+\.\d{3}", copied(seen.page))


def test_a_link_sign_copies_the_address_of_its_check(
    chromium: Browser, reports: dict[str, Path]
) -> None:
    """The address leads back to the check."""
    with visit(chromium, reports["service_never_answers"]) as seen:
        seen.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        sign = seen.page.locator("#check-service\\.enables .link-sign").first
        assert sign.get_attribute("aria-label") == "Link to: Enables the robot"
        sign.click()
        address = copied(seen.page)
        assert address == f"{reports['service_never_answers'].as_uri()}#check-service.enables"


def test_a_search_unfolds_what_it_finds(chromium: Browser, reports: dict[str, Path]) -> None:
    """Output in a folded session is found; Enter goes to it, and Escape folds all again."""
    with visit(chromium, reports["crash"]) as seen:
        before = seen.page.locator("details[open]").count()
        search(seen.page, "Traceback")
        line = seen.page.locator(".out:visible", has_text="Traceback").first
        expect(line).to_be_visible()
        expect(seen.page.locator(".out:visible", has_not_text="Traceback")).to_have_count(0)
        expect(seen.page.locator(".check.passed:visible")).to_have_count(0)
        for _ in range(2):
            seen.page.keyboard.press("Enter")
        expect(seen.page.locator("#found")).to_contain_text(re.compile(r"^2 of \d+$"))
        assert seen.axe() == []
        seen.page.keyboard.press("Escape")
        expect(seen.page.get_by_role("searchbox")).to_have_value("")
        expect(seen.page.locator("details[open]")).to_have_count(before)
        expect(seen.page.locator(".check.open").first).to_be_visible()


def test_checks_are_filtered_by_their_outcome(chromium: Browser, reports: dict[str, Path]) -> None:
    """Only checks of one kind stay; all are there again after Escape."""
    with visit(chromium, reports["service_never_answers"]) as seen:
        checks = seen.page.locator(".check:visible")
        seen.page.get_by_label("Show").select_option("earned")
        expect(seen.page.locator(".check.failed:visible, .check.partial:visible")).to_have_count(0)
        expect(seen.page.locator("#check-service\\.offers")).to_be_visible()
        seen.page.get_by_label("Show").select_option("lost")
        expect(seen.page.locator("#check-service\\.offers")).to_be_hidden()
        expect(seen.page.locator("#check-service\\.enables")).to_be_visible()
        assert checks.count() > 2
        seen.page.keyboard.press("Escape")
        expect(seen.page.locator(".unfound")).to_have_count(0)


def test_folded_parts_are_built_when_they_are_needed(
    chromium: Browser, reports: dict[str, Path]
) -> None:
    """A page starts with few elements; a link into a folded part still leads there."""
    with visit(chromium, reports["solution"]) as seen:
        assert elements(seen.page) < 1500
        seen.page.get_by_role("button", name="Expand all").click()
        assert elements(seen.page) > 4000
        assert seen.page.locator("noscript").count() == 0
    file = reports["crash"]
    with visit(chromium, file) as seen:
        href = seen.page.evaluate(
            "parts.buildAll() || document.querySelector('.tl-log').getAttribute('href')"
        )
        seen.page.goto(f"{file.as_uri()}{href}")
        seen.page.reload()
        expect(seen.page.locator(href)).to_be_in_viewport()


def test_a_question_is_copied_with_its_check(chromium: Browser, reports: dict[str, Path]) -> None:
    """Without a mail address, one click copies a text with the check's id and link."""
    with visit(chromium, reports["service_never_answers"]) as seen:
        seen.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        check = seen.page.locator("#check-service\\.enables")
        check.get_by_role("button", name="Ask about this").click()
        expect(seen.page.locator("#told")).to_contain_text("Copied. Paste it")
        text = copied(seen.page)
        assert text.split("\n")[0].endswith(", check service.enables")
        assert "report.html#check-service.enables" in text
        assert text.endswith("What I think is wrong:")


def test_a_question_opens_a_mail(chromium: Browser, with_address: Path) -> None:
    """With an address in the lab's policy, the link has subject and text; without scripts it has the subject."""
    selector = "#check-service\\.enables a.ask"
    with visit(chromium, with_address) as seen:
        link = seen.page.locator(selector)
        link.evaluate("e => e.addEventListener('click', event => event.preventDefault())")
        link.click()
        mail = urlsplit(link.get_attribute("href") or "")
        fields = parse_qs(mail.query)
        assert (mail.scheme, mail.path) == ("mailto", ADDRESS)
        assert fields["subject"][0].endswith(", check service.enables")
        assert "report.html#check-service.enables" in fields["body"][0]
    with visit(chromium, with_address, scripts=False) as seen:
        expect(seen.page.locator(selector)).to_have_attribute("href", re.compile("subject=Appeal"))


def test_without_scripts_folded_parts_are_there(
    chromium: Browser, reports: dict[str, Path]
) -> None:
    """Sessions with their output, figures and versions can be unfolded and read."""
    with visit(chromium, reports["solution"], PHONE, scripts=False) as seen:
        session = seen.page.locator("#session-publisher")
        session.locator("summary").first.click()
        expect(session.locator(".tl-picture")).to_be_visible()
        seen.page.locator("#about").click()
        expect(seen.page.locator(".howto")).to_be_visible()

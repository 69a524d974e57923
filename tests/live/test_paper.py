"""The sample submission's report on paper."""

from __future__ import annotations

import pytest

from grader.result_folder import REPORT_FILE
from tests.browser.chromium import browser, printed
from tests.live.sample import Graded

pytestmark = [pytest.mark.live, pytest.mark.browser]


def test_the_samples_report_prints_on_few_pages(alice: Graded) -> None:
    """Six at most, with the figures of all lost checks."""
    with browser() as started:
        paper = printed(started, alice.folder / REPORT_FILE)
    assert len(paper.pages) <= 6

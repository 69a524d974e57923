"""Questions of students, pasted at the desk."""

from __future__ import annotations

import pytest

from grader.desk.pasted import pasted_appeal
from grader.errors import UsageError
from grader.report.views import appeal_text
from tests.report.test_submission_page import CHECKS, result_of

CLASS = {
    "ann": result_of(submission="ann"),
    "ann-2": result_of(submission="ann-2"),
}


@pytest.mark.parametrize("name", CLASS)
def test_a_question_is_an_appeal_of_its_check(name: str) -> None:
    """Submission, check and question are found in the report's text, also in a quoted mail with broken lines."""
    text = appeal_text(CLASS[name], CHECKS[1]) + "My timer\nis right."
    quoted = "Dear all,\n> " + text.replace(", check", ",\n> check").replace("\n", "\n> ")
    for mail in (text, quoted):
        appeal = pasted_appeal(mail, CLASS)
        assert (appeal.names, appeal.id, appeal.change) == ((name,), CHECKS[1].id, "appeal")
        assert appeal.comment == "My timer is right."


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("hello", "names no check"),
        (appeal_text(result_of(submission="zoe"), CHECKS[1]) + "Why?", "names no check"),
        (appeal_text(CLASS["ann"], CHECKS[1]), "ann asks nothing about a.half"),
    ],
)
def test_a_text_without_a_question_is_refused(text: str, problem: str) -> None:
    """The message says why, and nothing becomes an appeal."""
    with pytest.raises(UsageError, match=problem):
        pasted_appeal(text, CLASS)

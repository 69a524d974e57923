"""`grade appeal`: the evidence as a page, judged again, and the exchange that the student reads."""

from __future__ import annotations

import json
import mailbox
import re
import shutil
from decimal import Decimal
from pathlib import Path

import pytest
from rich.console import Console

from grader.commands import appeal
from grader.errors import UsageError
from grader.judging.rubrics import read_rubric
from grader.lab.overrides import load_overrides
from grader.result import AdjustmentKind, Result, load_result
from grader.result_folder import AUDIT_FILE, EXPORTED, REPORT_FILE, RESULT_FILE
from tests.desk.made_class import add_alike

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("judged_before")]

CHECK = "subscriber.mean"


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the results of a class of one student, with two points lost at a check."""
    results = tmp_path_factory.mktemp("class") / "results"
    add_alike(results, ["alice"], "signed_mean_statistics")
    return results


@pytest.fixture
def alice(judged: Path, tmp_path: Path) -> Path:
    """Give a copy of the student's results."""
    shutil.copytree(judged, tmp_path / "results")
    return tmp_path / "results/alice"


def run(folder: Path, *more: str, check: str = CHECK) -> str:
    """Run the command; gives its output, in one line."""
    console = Console(record=True, width=200)
    assert appeal.run([str(folder), check, "--who", "J. Smith", *more], console) == 0
    return " ".join(console.export_text().split())


def listed(folder: Path) -> list[tuple[AdjustmentKind, Decimal, str, str, str]]:
    """Give the adjustments of the result."""
    result: Result = load_result(folder / RESULT_FILE)
    return [(a.kind, a.points, a.reason, a.who, a.comment) for a in result.adjustments]


def test_the_evidence_is_a_page_and_nothing_else_changes(alice: Path) -> None:
    """With expected, measured, figure, timeline and output; judged again, which gives the same."""
    before = {path: path.read_bytes() for path in alice.parent.rglob("*") if path.is_file()}
    printed = run(alice)
    assert "Judged again: failed, 0 of 2, as before." in printed
    assert "Decided by the check itself: Measure and give credit" in printed
    page = alice / "appeal-subscriber.mean.html"
    assert f"Evidence: {page}" in printed
    text = page.read_text(encoding="utf-8")
    for words in (
        "signed error",
        "[0.2591 0.2684",
        "Reported against true RMS error",
        "Output of subscriber",
        "Ctrl-C",
    ):
        assert words in text, (words, page)
    assert "<script" not in text
    links = set(re.findall(r'href="#([^"]+)"', text))
    assert links <= set(re.findall(r' id="([^"]+)"', text))
    after = {
        path: path.read_bytes()
        for path in alice.parent.rglob("*")
        if path.is_file() and path != page
    }
    assert after == before


@pytest.mark.parametrize("points", ["99", "-1"])
def test_points_that_the_check_does_not_have_are_refused_first(alice: Path, points: str) -> None:
    """The range is said before anything is judged or written, whatever else is wrong."""
    before = {path: path.read_bytes() for path in alice.parent.rglob("*") if path.is_file()}
    with pytest.raises(UsageError) as refused:
        run(alice, "--set", points)
    problem = refused.value.problem
    assert problem == f"{CHECK} has 0 to 2 points, not {points}"
    after = {path: path.read_bytes() for path in alice.parent.rglob("*") if path.is_file()}
    assert after == before


def test_a_question_waits_and_is_shown(alice: Path) -> None:
    """A question changes no points, is kept under the student, and stands in the report."""
    printed = run(alice, "--question", "My mean is <b>right</b>: see line 40.")
    assert "Noted in" in printed
    assert listed(alice) == [
        (AdjustmentKind.APPEAL, Decimal(0), "My mean is <b>right</b>: see line 40.", "alice", "")
    ]
    report = (alice / REPORT_FILE).read_text(encoding="utf-8")
    assert "My mean is &lt;b&gt;right&lt;/b&gt;: see line 40." in report


@pytest.mark.parametrize(
    ("options", "kind", "points", "reason"),
    [
        ((), AdjustmentKind.REVIEWED, "0", ""),
        (
            ("--set", "1.5", "--reason", "half is right"),
            AdjustmentKind.POINTS,
            "1.5",
            "half is right",
        ),
        (("--excused",), AdjustmentKind.EXCUSED, "2", "appeal"),
    ],
    ids=["stays", "points", "excused"],
)
def test_question_and_answer_stand_in_the_next_report(
    alice: Path, options: tuple[str, ...], kind: AdjustmentKind, points: str, reason: str
) -> None:
    """Question and answer stand at the check, in this order, with the name of the teacher.

    Points follow, and comments in the file stay.
    """
    (alice.parent / "overrides.yaml").write_text(
        "# by mail\noverrides: []  # none yet\n", encoding="utf-8"
    )
    run(alice, "--question", "Why?", "--answer", "The recording shows it.", *options)
    question = (AdjustmentKind.APPEAL, Decimal(0), "Why?", "alice", "")
    assert listed(alice) == [
        question,
        (kind, Decimal(points), reason, "J. Smith", "The recording shows it."),
    ]
    report = (alice / REPORT_FILE).read_text(encoding="utf-8")
    at_check = report[report.index('id="check-subscriber.mean"') :]
    assert 0 < at_check.index("Why?") < at_check.index("The recording shows it.")
    file = alice.parent / "overrides.yaml"
    assert file.read_text(encoding="utf-8").startswith("# by mail\n")
    assert "# none yet" in file.read_text(encoding="utf-8")
    assert len(load_overrides(file, read_rubric(None)).entries) == 2


def test_an_answer_the_new_report_and_its_mail_are_one_command(alice: Path) -> None:
    """With --mail, the report with the answer lies in a mailbox beside it."""
    (alice.parent / "class-list.csv").write_text("name,email\nalice,alice@uni.example\n")
    printed = run(alice, "--answer", "You are right.", "--set", "2", "--mail")
    mails = alice / EXPORTED / "mail.mbox"
    assert f"{mails}: 1" in printed
    (mail,) = mailbox.mbox(mails, create=False)
    assert mail["To"] == "alice <alice@uni.example>"
    report = (alice / REPORT_FILE).read_bytes()
    assert b"You are right." in report
    attached = [part.get_payload(decode=True) for part in mail.walk() if part.get_filename()]
    assert report in attached


def test_an_unknown_check_is_told(alice: Path) -> None:
    """An unknown check is refused with the nearest known name, and nothing is written."""
    with pytest.raises(UsageError, match=r"did you mean 'subscriber\.mean'"):
        run(alice, check="subscriber.maen")
    with pytest.raises(UsageError, match="no result of this submission"):
        run(alice.parent / "bob")
    assert not (alice.parent / "overrides.yaml").exists()


def test_the_trail_names_the_command_that_was_given(alice: Path) -> None:
    """An answer by this command is not one that was given at the desk."""
    run(alice, "--answer", "You are right.", "--set", "2")
    (line,) = (alice.parent / AUDIT_FILE).read_text(encoding="utf-8").splitlines()
    assert json.loads(line)["command"] == "appeal"

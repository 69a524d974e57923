"""The price of a mistake over all criteria stays in its class, also launched, late or composed."""

from __future__ import annotations

import tarfile
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path

import pytest

from grader.judging.adjust import adjust
from grader.judging.judge import judge, open_recordings
from grader.judging.rubrics import read_rubric
from grader.lab.policy import LatePolicy, SubmissionTime
from grader.lab.rubric import Rubric
from grader.result import Result

KEPT = Path(__file__).resolve().parents[1] / "recordings"
#: The least and the most of a criterion's points that a mistake of each class costs. After a wrong name or type,
#: a fifth of the check stays for the remaining parts.
CLASSES = {
    "endangers": ("0.25", "0.4"),
    "does not work with the rest": ("0.16", "0.5"),
    "is measurably off": ("0.05", "0.3"),
}
#: Fixture -> criterion and class. The first two were launched as well.
MISTAKES = {
    "six_joints": ("publisher", "endangers"),
    "service_wrong_name": ("service", "does not work with the rest"),
    "best_effort_publisher": ("publisher", "does not work with the rest"),
    "wrong_topic": ("publisher", "does not work with the rest"),
    "launch_wrong_executable": ("launch", "does not work with the rest"),
    "qos_invented_numbers": ("qos", "is measurably off"),
    "signed_mean_statistics": ("subscriber", "is measurably off"),
}
#: Sessions of submissions that launch the three nodes in one process -> criterion and price of the
#: mistake alone.
COMPOSED = {
    "solution": ("", 0),
    "strict_six_joints": ("publisher", 8),
    "wrong_type_publisher": ("publisher", 4),
    "wrong_node_name": ("publisher", Decimal("0.5")),
    "crash_on_early_state": ("subscriber", 4),
    "signed_mean_statistics": ("subscriber", 2),
    "service_crashes_on_enable": ("service", 13),
    "service_never_answers": ("service", 13),
}


@pytest.fixture(scope="module")
def rubric() -> Rubric:
    """Give the lab's own rubric."""
    return read_rubric(None)


def lost_in_sessions(result: Result) -> Decimal:
    """Return the points lost in sessions, over all criteria."""
    assert not any(check.undecided for check in result.checks if check.session)
    return sum((check.lost for check in result.checks if check.session), Decimal(0))


@pytest.mark.parametrize("name", MISTAKES)
def test_one_mistake_costs_what_its_consequence_does(name: str, rubric: Rubric) -> None:
    """All lost points belong to the criterion of the mistake, within the class.

    Lateness does not charge the mistake again.
    """
    criterion, consequence = MISTAKES[name]
    points = next(each.points for each in rubric.criteria if each.id == criterion)
    result = judge(open_recordings(KEPT / name, rubric), rubric)
    lost = lost_in_sessions(result)
    least, most = (Decimal(share) * points for share in CLASSES[consequence])
    assert least <= lost <= most
    due = datetime(2026, 11, 20, tzinfo=UTC)
    policy = LatePolicy.model_validate({"due": due.isoformat(), "per_day": "10 %"})
    late = adjust(result, (), policy, SubmissionTime(due + timedelta(hours=1)))
    assert lost_in_sessions(late) == lost
    assert abs(late.final - late.score.earned * Decimal("0.9")) <= Decimal("0.05")


def test_a_check_of_a_repaired_file_says_what_the_repair_costs(rubric: Rubric) -> None:
    """Measured and expected values agree, so the reason alone explains the loss."""
    result = judge(open_recordings(KEPT / "launch_wrong_executable", rubric), rubric)
    found = next(check for check in result.checks if check.id == "launch.arguments")
    title = "The launch file loads as handed in"
    assert found.reason == (f"Judged as if '{title}' were right; 25% are lost by that.")


@pytest.mark.parametrize("name", COMPOSED)
def test_a_mistake_costs_no_more_where_nodes_share_a_process(
    name: str, tmp_path: Path, rubric: Rubric
) -> None:
    """A mistake costs as much as alone, in its own criterion, although other nodes end or wait."""
    with tarfile.open(KEPT.with_name("composed_recordings") / f"{name}.tar.xz") as archive:
        archive.extractall(tmp_path, filter="data")
    result = judge(open_recordings(tmp_path, rubric), rubric)
    criterion, cost = COMPOSED[name]
    losing = set()
    for each in result.criteria:
        for check in each.checks:
            if check.session and check.lost:
                losing.add(each.id)
    assert losing == ({criterion} if criterion else set())
    assert lost_in_sessions(result) == cost

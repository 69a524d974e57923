"""One mistake costs once: a check that is excused by another."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest

from grader.judging.judge import Recordings, judge_checks
from grader.judging.rubrics import rubric_kinds
from grader.lab.rubric import load_rubric
from grader.result import Finding, Outcome
from ros_bag.qos import Qos
from tests.synthetic import BEST_EFFORT, RELIABLE, Session, evenly, submission

RUBRIC = """\
lab: {id: "1", title: One, points: 2}
artifacts: {it: {file: it.py}}
sessions: {experiment: {steps: [{start: {student: it}}]}}
criteria:
  - id: all
    title: All
    points: 2
    checks:
      - id: scale
        title: In metres
        points: 1
        session: experiment
        check: field_range
        with: {topic: /x, field: data, high: 1.0}
      - id: size
        points: 1
        session: experiment
        check: field_range
        excused_by: [scale]
        with: {topic: /x, field: data, low: LOW, high: HIGH, finite: true}
"""


def judged(
    folder: Path, values: list[float], low: float = 0.0, high: float = 1.0
) -> dict[str, Finding]:
    """Judge values by both checks."""
    return judged_with(RUBRIC, folder, values, low, high)


def judged_with(
    rubric: str, folder: Path, values: list[float], low: float = 0.0, high: float = 1.0
) -> dict[str, Finding]:
    """Judge values by the checks of a rubric."""
    (folder / "lab.yaml").write_text(
        rubric.replace("LOW", str(low)).replace("HIGH", str(high)), encoding="utf-8"
    )
    session = Session(folder).process()
    session.typed(
        "/x", "std_msgs/msg/Float64", [{"data": v} for v in values], evenly(1, len(values) - 1)
    )
    recordings = Recordings(submission(), {"experiment": session.recorded()})
    return judge_checks(recordings, load_rubric(folder / "lab.yaml", rubric_kinds()), [])


@pytest.mark.parametrize("values", [[100.0, 50.0], [0.5, 50.0]])
def test_where_the_earlier_check_took_points_this_one_takes_none(
    tmp_path: Path, values: list[float]
) -> None:
    """After a full or partial loss the later check takes no points, but reports its finding."""
    findings = judged(tmp_path, values)
    assert findings["scale"].outcome in (Outcome.FAILED, Outcome.PARTIAL)
    assert (findings["size"].outcome, findings["size"].credit) == (Outcome.EXCUSED, Decimal(1))
    assert "above 1" in findings["size"].reason
    assert (
        "This mistake is charged under 'In metres', and not again here." in findings["size"].reason
    )
    assert findings["size"].charged_by == ("scale",)


def test_where_the_earlier_check_took_none_this_one_does(tmp_path: Path) -> None:
    """A different mistake is charged in the later check."""
    findings = judged(tmp_path, [0.5, 0.6], low=0.55)
    assert findings["scale"].outcome is Outcome.PASSED
    assert findings["size"].outcome is Outcome.PARTIAL
    assert findings["size"].notes == ()


def test_what_is_right_stays_as_it_is(tmp_path: Path) -> None:
    """A passed check has nothing to excuse."""
    findings = judged(tmp_path, [5.0, 6.0], low=0.0, high=9.0)
    assert findings["scale"].outcome is Outcome.FAILED
    assert (findings["size"].outcome, findings["size"].notes) == (Outcome.PASSED, ())


@pytest.mark.parametrize(
    ("points", "charged", "excused"),
    [(("1", "3"), "size", "scale"), (("3", "1"), "scale", "size"), (("4", "4"), "scale", "size")],
    ids=["the later one is dearer", "the earlier one is dearer", "of equals the first"],
)
def test_a_mistake_is_charged_at_its_dearest_check(
    tmp_path: Path, points: tuple[str, str], charged: str, excused: str
) -> None:
    """Wherever it is met first; the other check is never shown as passed."""
    findings = judged_by_cause(tmp_path, [100.0, 50.0], points)
    assert findings[charged].outcome is Outcome.FAILED
    assert (findings[excused].outcome, findings[excused].credit) == (Outcome.EXCUSED, Decimal(1))
    title = {"scale": "In metres", "size": "size"}[charged]
    assert findings[excused].reason.endswith(
        f"This mistake is charged under '{title}', and not again here."
    )
    assert findings[excused].decided_by == "excused"
    assert (findings[excused].charged_by, findings[charged].charged_by) == ((charged,), ())


def test_what_alone_is_wrong_is_charged_where_it_is(tmp_path: Path) -> None:
    """The other check of the cause is right, and stays so."""
    findings = judged_by_cause(tmp_path, [0.5, 0.6], ("3", "1"), low=0.55)
    assert findings["scale"].outcome is Outcome.PASSED
    assert (findings["size"].outcome, findings["size"].causes) == (Outcome.PARTIAL, ("unit",))


def judged_by_cause(
    folder: Path, values: list[float], points: tuple[str, str], low: float = 0.0
) -> dict[str, Finding]:
    """Judge values by two checks of one cause, worth these points."""
    text = RUBRIC.replace("excused_by: [scale]", "cause: unit")
    text = text.replace("title: In metres", "title: In metres\n        cause: unit")
    first, size = text.split("- id: size")
    before, after = first.split("- id: scale")
    after = after.replace("points: 1", f"points: {points[0]}")
    text = (
        f"{before}- id: scale{after}- id: size{size.replace('points: 1', f'points: {points[1]}')}"
    )
    total = int(points[0]) + int(points[1])
    text = text.replace("points: 2}", f"points: {total}}}").replace(
        "    points: 2\n", f"    points: {total}\n"
    )
    return judged_with(text, folder, values, low)


SENSOR = """\
lab: {id: "1", title: One, points: 3}
artifacts: {it: {file: it.py}}
reference: {scanner: {file: scanner.py, node: /scanner}}
sessions: {experiment: {steps: [{start: {student: it}}]}}
criteria:
  - id: all
    title: All
    points: 3
    checks:
      - id: hears
        title: Hears the sensor
        points: 1
        session: experiment
        check: CHECK
        with: WITH
      - {id: answers, points: 1, session: experiment, check: field_range, with: {topic: /y, field: data, high: 1},
         requires: [hears]}
      - {id: once, points: 1, session: experiment, check: field_range, with: {topic: /y, field: data, high: 1},
         requires: [answers]}
"""
HEARS = {
    "topics_subscribed": "{artifact: it, topics: [{topic: /x, type: std_msgs/msg/Float64MultiArray}]}",
    "requested_qos": "{topic: /x, reliability: best_effort}",
}


@pytest.mark.parametrize("check", HEARS)
@pytest.mark.parametrize(("requested", "reached"), [(RELIABLE, False), (BEST_EFFORT, True)])
def test_reliable_of_a_best_effort_sensor_is_charged_where_it_is(
    tmp_path: Path, check: str, requested: Qos, reached: bool
) -> None:
    """Checks of the missing messages are not tested, and name the cause, charged once."""
    (tmp_path / "scanner.py").write_text("", encoding="utf-8")
    text = SENSOR.replace("CHECK", check).replace("WITH", HEARS[check])
    (tmp_path / "lab.yaml").write_text(text, encoding="utf-8")
    session = Session(tmp_path).process().endpoint("publisher", "/x", "/scanner", qos=BEST_EFFORT)
    session.endpoint("subscription", "/x", qos=requested).messages("/x", [[1.0]] * 9, evenly(1, 8))
    recordings = Recordings(submission(), {"experiment": session.recorded()})
    findings = judge_checks(recordings, load_rubric(tmp_path / "lab.yaml", rubric_kinds()), [])
    if reached:
        assert findings["hears"].outcome is Outcome.PASSED
        assert findings["answers"].outcome is Outcome.FAILED
        return
    assert findings["hears"].outcome in (Outcome.PARTIAL, Outcome.FAILED)
    assert "RELIABLE" in findings["hears"].reason
    for name in ("answers", "once"):
        found = findings[name]
        assert (found.outcome, found.blocked_by) == (Outcome.NOT_REACHED, "hears")
        assert (
            found.reason
            == "Not tested, because nothing arrives at your node, as 'Hears the sensor' says."
        )

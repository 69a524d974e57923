"""Checks of fields in a rubric: their parameters, and each mistake with its line before a run."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader.errors import RubricError
from grader.judging.rubrics import rubric_kinds
from grader.lab.rubric import Rubric, load_rubric

GOOD = """\
lab: {id: "1", title: One, points: 8}
artifacts:
  drive: {file: drive.py}
sessions:
  alone:
    steps:
      - start: {student: drive}
      - wait_for: {publisher: /cmd_vel, type: geometry_msgs/msg/Twist}
      - wait_for: {publisher: /odom, type: nav_msgs/msg/Odometry}
      - wait_for: {publisher: /state, type: std_msgs/msg/String}
      - wait_for: {publisher: /goal, type: geometry_msgs/msg/PoseStamped}
        label: go
      - observe: {duration_s: 5}
        label: window
criteria:
  - id: drive
    title: Drives
    points: 8
    checks:
      - id: limits
        points: 1
        session: alone
        check: field_range
        with: {topic: /cmd_vel, field: linear.x, low: -0.5, high: 0.5, change_per_s: 1.0}
      - id: states
        points: 1
        session: alone
        check: field_matches
        excused_by: [limits]
        with: {topic: /state, field: data, pattern: '^(?P<state>[A-Z]+),(?P<x>[0-9.]+)$', numbers: {x: {high: 2.0}}}
      - id: arrives
        points: 1
        session: alone
        check: reaches
        with:
          topic: /odom
          field: pose.pose.position
          target: {field: {topic: /goal, field: pose.position}}
          tolerance: 0.1
          after: go
          within_s: 5
      - id: equals
        points: 1
        session: alone
        check: topic_equals_oracle
        with:
          topic: /cmd_vel
          field: linear.x
          streams: {pose: {topic: /odom, field: pose.pose}, goal: {topic: /goal, field: pose}}
          oracle: oracles.py:speed
          match: nearest
          tolerance: 0.01
      - id: latency
        points: 1
        session: alone
        check: message_latency
        with:
          input: {topic: /odom}
          output: {topic: /cmd_vel}
          match: next
          limits: [{share: 95%, full_within_s: 0.1, none_beyond_s: 0.2}]
      - id: property
        points: 1
        session: alone
        check: signal_property
        with:
          signals: {v: {topic: /cmd_vel, field: linear.x}, far: {topic: /state, pattern: ',([0-9.]+)', field: data}}
          property: always(implies(far < 0.5, eventually[0, 2](abs(v) < 0.1)))
      - id: silent
        points: 1
        session: alone
        check: silent_until
        with: {topic: /cmd_vel, condition: {topic: /goal, field: pose.position.x, low: 0.1}}
      - id: stops
        points: 1
        session: alone
        check: silent_until
        with: {topic: /cmd_vel, step: go}
    figures:
      - kind: field
        title: Way
        session: alone
        with: {lines: {x: {topic: /odom, field: pose.pose.position.x}}, limits: [2.0]}
"""


def load(folder: Path, text: str) -> Rubric:
    """Load a rubric from its text, with its oracles beside it."""
    (folder / "oracles.py").write_text(
        "def speed(streams, parameters, seed):\n    return []\n", encoding="utf-8"
    )
    (folder / "lab.yaml").write_text(text, encoding="utf-8")
    return load_rubric(folder / "lab.yaml", rubric_kinds())


def test_a_rubric_of_fields_loads(tmp_path: Path) -> None:
    """All parts of a rubric of fields are known."""
    assert [spec.id for spec in load(tmp_path, GOOD).checks()][:2] == ["limits", "states"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("field: linear.x, low", "field: linear.y_, low", "has no field 'y_'"),
        ("field: linear.x, low: -0.5", "field: linear.x, low: 0.6", "low is above high"),
        ("field: data, pattern: '^", "field: date, pattern: '^", "did you mean 'data'?"),
        ("numbers: {x:", "numbers: {y:", "there is no named group 'y'"),
        ("(?P<x>[0-9.]+)$'", "(?P<x>[0-9.+$'", "not a valid regular expression"),
        ("excused_by: [limits]", "excused_by: [limit]", "there is no check 'limit'"),
        ("excused_by: [limits]", "excused_by: [arrives]", "is not an earlier check"),
        ("field: pose.pose.position\n", "field: child_frame_id\n", "it must hold numbers"),
        ("field: pose.position}}", "field: pose.positon}}", "did you mean 'position'?"),
        (
            "{field: {topic: /goal, field: pose.position}}",
            "{value: [1.0, 2.0]}",
            "holds 3 numbers, not 2",
        ),
        ("target: {field:", "target: {value: 1.0, field:", "exactly one of value, field, oracle"),
        ("          after: go", "          after: gone", "there is no step labelled 'gone'"),
        ("within_s: 5\n", "within_s: 5\n          none_from_s: 4\n", "must be more than within_s"),
        ("oracles.py:speed", "oracles.py:sped", "did you mean 'speed'?"),
        ("match: nearest", "match: closest", "known are interpolated, nearest, order, stamp"),
        ("match: nearest", "match: stamp", "for_each must say"),
        ("match: nearest", "for_each: pose\n          match: stamp", "has no field 'header'"),
        ("match: next", "match: stamp", "has no field 'header'"),
        ("match: nearest", "match: order\n          for_each: poes", "did you mean 'pose'?"),
        ("output: {topic: /cmd_vel}", "output: {topic: /cmd_val}", "did you mean '/cmd_vel'?"),
        ("match: next", "match: field", "must name one"),
        ("none_beyond_s: 0.2", "none_beyond_s: 0.1", "must be more than full_within_s"),
        ("always(implies(far", "always(implies(fer", "did you mean 'far'?"),
        ("abs(v) < 0.1)))", "abs(v) < 0.1))", "not a property at character"),
        (", pattern: ',([0-9.]+)', field: data}", ", field: data}", "it must hold numbers"),
        ("',([0-9.]+)'", "',[0-9.]+'", "a group of the pattern has to hold"),
        (
            "condition: {topic",
            "step: go, condition: {topic",
            "exactly one of step, message_on, condition",
        ),
        ("/cmd_vel, step: go}", "/cmd_vel, step: window_}", "did you mean 'window'?"),
        ("field: pose.pose.position.x}", "field: pose.pose.position.w}", "has no field 'w'"),
    ],
)
def test_each_mistake_is_told_with_its_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    """Each mistake is reported with its line and remedy before anything runs."""
    assert GOOD.count(old) == 1
    with pytest.raises(RubricError) as caught:
        load(tmp_path, GOOD.replace(old, new))
    assert len(caught.value.mistakes) == 1
    (mistake,) = caught.value.mistakes
    assert words in mistake
    line = int(mistake.split("lab.yaml:")[1].split(":")[0])
    right = GOOD[: GOOD.index(old)].count("\n") + 1
    assert line <= right + 1
    assert line >= right - 8

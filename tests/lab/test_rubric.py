"""The rubric: all its mistakes at once, each with its line; and that it alone knows the lab."""

from __future__ import annotations

import re
import shutil
from datetime import timedelta
from decimal import Decimal
from pathlib import Path

import jsonschema
import pytest
import yaml

from grader.errors import RubricError
from grader.judging.rubrics import read_rubric, rubric_kinds
from grader.lab.kept_lab import lab_folder
from grader.lab.rubric import Rubric, json_schema, load_rubric
from ros_bag.fields import installed_fields, installed_types

GRADER = Path(__file__).resolve().parents[2] / "grader"

GOOD = """\
lab: {id: "1", title: One, points: 5}
artifacts:
  talk: {file: talk.py, executable: talk}
reference:
  arm: {file: arm.py, node: /arm}
sessions:
  alone:
    typical_s: 3
    steps:
      - start: {student: talk}
      - observe: {duration_s: 2, first_message_on: /chat}
        label: window
criteria:
  - id: talk
    title: Talker
    points: 5
    checks:
      - id: talk.publishes
        title: Publishes
        points: 2
        session: alone
        check: topic_published
        with: {artifact: talk, topic: /chat, type: std_msgs/msg/String}
      - id: talk.rate
        title: At 10 Hz
        points: 3
        session: alone
        check: topic_rate
        with: {topic: /chat, process: talk, rate_hz: 10, full_within: 2%, zero_beyond: 20%}
        requires: [talk.publishes]
"""


def load(folder: Path, text: str) -> Rubric:
    """Load a rubric from its text, with its reference file beside it."""
    (folder / "arm.py").touch()
    (folder / "lab.yaml").write_text(text, encoding="utf-8")
    return load_rubric(folder / "lab.yaml", rubric_kinds())


def mistakes(folder: Path, text: str) -> list[str]:
    """Give the mistakes of a rubric."""
    with pytest.raises(RubricError) as caught:
        load(folder, text)
    assert caught.value.remedy or caught.value.mistakes
    return caught.value.mistakes


def line_of(text: str, part: str) -> int:
    """Give the line of the first occurrence of a text."""
    return text[: text.index(part)].count("\n") + 1


def test_a_good_rubric_loads(tmp_path: Path) -> None:
    """A good rubric comes back as typed values."""
    rubric = load(tmp_path, GOOD)
    assert rubric.lab.points == Decimal(5)
    assert rubric.artifacts["talk"].find == ("talk.py", "**/talk.py")
    assert rubric.sessions["alone"].needs == ("talk",)
    assert [step.label for step in rubric.sessions["alone"].steps] == [None, "window"]
    assert [check.points for check in rubric.checks()] == [Decimal(2), Decimal(3)]
    assert rubric.folder == tmp_path
    assert len(rubric.sha256) == 64


WRONG: list[tuple[str, str, str, str]] = [
    ("    typical_s: 3", "    typical: 3", "typical: 3", "unknown key"),
    ("executable: talk}", "exe: talk}", "exe: talk", "unknown key"),
    ("  - id: talk\n", "  - id: talk\n    colour: red\n", "colour: red", "unknown key"),
    ("        title: At 10 Hz", "        titel: At 10 Hz", "titel:", "unknown key"),
    ("criteria:", "extra: 1\ncriteria:", "extra: 1", "unknown key"),
    (
        "        points: 2",
        "        points: 1",
        "    points: 5\n    checks",
        "add up to 4, not to 5",
    ),
    ("title: One, points: 5", "title: One, points: 6", "lab:", "add up to 5, not to 6"),
    ("        points: 2", "        points: two", "points: two", "a number of points is expected"),
    ("        points: 2", "        points: -2", "points: -2", "a number of points is expected"),
    (
        "check: topic_rate",
        "check: topic_speed",
        "check: topic_speed",
        "no check 'topic_speed'; did you mean",
    ),
    (
        "session: alone\n        check: topic_rate",
        "session: all\n        check: topic_rate",
        "session: all",
        "no session",
    ),
    ("id: talk.rate", "id: talk.publishes", "id: talk.publishes\n        title: At", "used twice"),
    ("id: talk.rate\n        ", "", "title: At 10 Hz", "this key is missing"),
    (
        "requires: [talk.publishes]",
        "requires: [talk.other]",
        "requires: [talk",
        "there is no check 'talk.other'",
    ),
    (
        "requires: [talk.publishes]",
        "requires: [talk.rate]",
        "requires: [talk",
        "'talk.rate' is not an earlier check",
    ),
    ("rate_hz: 10", "rate_hz: ten", "with: {topic: /chat, process", "a number is expected"),
    ("rate_hz: 10", "rate_hz: 0", "with: {topic: /chat, process", "greater than 0"),
    (", rate_hz: 10", "", "with: {topic: /chat, process", "this key is missing"),
    (
        "process: talk, rate_hz",
        "proces: talk, rate_hz",
        "with: {topic: /chat, proces",
        "unknown key",
    ),
    ("full_within: 2%", "full_within: some", "with: {topic: /chat, process", "a share from 0 to 1"),
    (
        "- start: {student: talk}",
        "- begin: {student: talk}",
        "- begin",
        "a step has one key of start",
    ),
    ("- start: {student: talk}", "- wait", "- wait", "a step has one key of start"),
    (
        "- start: {student: talk}",
        "- start: {student: tlak}",
        "- start",
        "no artifact 'tlak'; did you mean 'talk'?",
    ),
    (
        "- start: {student: talk}",
        "- start: {}",
        "- start",
        "exactly one of student, launch, reference",
    ),
    ("- start: {student: talk}", "- wait_for: {node: /a, topic: /b}", "- wait_for", "unknown key"),
    ("- start: {student: talk}", "- wait_for: {timeout_s: 1}", "- wait_for", "exactly one of node"),
    ("duration_s: 2", "duration_s: long", "- observe", "a number is expected"),
    ("duration_s: 2", "duration_s: 9999", "- observe", "less than or equal to 300"),
    ("    typical_s: 3", "    typical_s: soon", "typical_s: soon", "a number is expected"),
    ("    typical_s: 3", "    typical_s: 3\n    typical_s: 4", "typical_s: 4", "stands here twice"),
    ("        label: window", "        label: [window]", "label: [", "a text is expected"),
    (
        "    title: Talker",
        "    description: Talker",
        "- id: talk\n",
        "criteria.0.title: this key is missing",
    ),
    ("file: arm.py", "file: leg.py", "arm: {", "no file 'leg.py' beside the rubric"),
    (
        "id: talk\n",
        "id: talk\n    figures: [{kind: rate, title: x, session: other}]\n",
        "figures:",
        "no session 'other'",
    ),
]


@pytest.mark.parametrize(
    ("old", "new", "at", "words"), WRONG, ids=[new.strip()[:40] for _, new, _, _ in WRONG]
)
def test_each_mistake_is_reported_with_its_line(
    tmp_path: Path, old: str, new: str, at: str, words: str
) -> None:
    """One mistake gives one message, with file, line and cause."""
    assert GOOD.count(old) >= 1
    text = GOOD.replace(old, new, 1)
    found = mistakes(tmp_path, text)
    fitting = [message for message in found if words in message]
    assert fitting, found
    assert fitting[0].startswith(f"lab.yaml:{line_of(text, at)}: "), found


def test_all_mistakes_are_reported_at_once(tmp_path: Path) -> None:
    """Mistakes in every part are listed together, in the order of their lines."""
    text = (
        GOOD.replace("typical_s", "typical")
        .replace("check: topic_rate", "check: x")
        .replace("points: 2", "points: 1")
    )
    text = text.replace("duration_s: 2", "duration_s: long").replace("file: arm.py", "file: leg.py")
    found = mistakes(tmp_path, text)
    lines = [int(message.split(":")[1]) for message in found]
    assert len(found) >= 4
    assert lines == sorted(lines)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "a mapping is expected"),
        ("# nothing but a remark\n", "a mapping is expected"),
        ("- a list\n", "a mapping is expected"),
        ("just words\n", "a mapping is expected"),
        ("lab: {id: 1\ncriteria: [\n", "lab.yaml:2"),
        ("lab: 'open\n", "lab.yaml"),
        ("\tlab: x\n", "lab.yaml:1"),
        ("lab: &a [*b]\n", "undefined alias"),
        ("lab: &a {id: *a}\n", "contains itself"),
        ("lab: " + 3000 * "[" + 3000 * "]" + "\n", "nested too deeply"),
        ("{}\n", "this key is missing"),
        ("lab: 5\nartifacts: 5\nsessions: []\ncriteria: x\n", "a list is expected"),
        (
            "lab: {id: a, title: b, points: 0}\ncriteria: [5]\nsessions: {a: 5, b: {steps: 5}}\n",
            "a mapping is expected",
        ),
        ("lab: {id: a, title: b, points: 0}\ncriteria: [{checks: [5]}]\n", "a mapping is expected"),
    ],
)
def test_what_is_no_rubric_is_refused(tmp_path: Path, text: str, words: str) -> None:
    """Text that is empty, no YAML or of another shape gives mistakes, never a traceback."""
    assert any(words in message for message in mistakes(tmp_path, text))


def test_a_merged_key_that_is_set_anew_stands_there_once(tmp_path: Path) -> None:
    """`<<` takes over keys that a mapping may set anew; that is no repetition."""
    found = mistakes(tmp_path, "kept: &a {id: b}\nlab: {<<: *a, id: c}\n")
    for message in found:
        assert "stands here twice" not in message


@pytest.mark.parametrize("value", ["{a: 1}", "[[1]]", "5", "text", "null", "[{}]", "true"])
@pytest.mark.parametrize(
    "key",
    [
        "requires",
        "with",
        "id",
        "check",
        "session",
        "points",
        "title",
        "hint",
        "steps",
        "checks",
        "find",
        "label",
    ],
)
def test_values_of_another_kind_never_break_it(tmp_path: Path, key: str, value: str) -> None:
    """A rubric either loads or is refused with a message, whatever stands behind a key."""
    text = re.sub(rf"^(\s*(?:- )?){key}:.*$", rf"\g<1>{key}: {value}", GOOD, flags=re.MULTILINE)
    try:
        load(tmp_path, text)
    except RubricError as error:
        assert error.mistakes  # noqa: PT017 - it may also load


def test_a_rubric_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    """A path that is not there, a folder, and bytes that are no UTF-8 are told alike."""
    (tmp_path / "bytes.yaml").write_bytes(b"lab: \xff\xfe")
    for path in (tmp_path / "none.yaml", tmp_path, tmp_path / "bytes.yaml"):
        with pytest.raises(RubricError, match="cannot be read") as caught:
            load_rubric(path, rubric_kinds())
        assert caught.value.exit_status == 4
        assert caught.value.remedy


def test_reference_files_may_lie_in_the_labs_folder(tmp_path: Path) -> None:
    """A copy of a rubric finds its reference nodes in the folder given."""
    (tmp_path / "copy").mkdir()
    (tmp_path / "arm.py").touch()
    (tmp_path / "copy/lab.yaml").write_text(GOOD, encoding="utf-8")
    assert load_rubric(tmp_path / "copy/lab.yaml", rubric_kinds(), tmp_path).folder == tmp_path


# -- references and types ----------------------------------------------------------------------------

LAB = """\
lab: {id: "2", title: Two, points: 15}
interfaces: interfaces
artifacts:
  talk: {file: talk.py, executable: talk}
  launch: {file: all.launch.py}
reference:
  arm: {file: arm.py, node: /arm, settings: "arm.py:Settings"}
sessions:
  alone:
    steps:
      - start: {student: talk}
      - wait_for: {publisher: /chat, type: std_msgs/msg/Float64MultiArray}
        label: heard
      - start: {reference: arm, with: {rate_hz: 50}}
      - wait_for: {output_of: arm, text: done}
      - observe: {duration_s: 2, first_message_on: /chat}
        label: window
      - publish: {topic: /orders, type: std_msgs/msg/String, message: {data: go}}
        label: order
      - call: {service: /enable, type: std_srvs/srv/SetBool, request: {data: true}}
        label: enable
      - get_parameters: {node: /talk, names: [rate]}
        label: asked
      - interrupt: {process: talk}
      - wait_exit: {process: talk}
        label: ended
      - publish: {topic: /seen, type: lab_msgs/msg/Sight, message: {range_m: 1.0}}
  together:
    steps:
      - plan: {launch: launch}
        label: plan
criteria:
  - id: all
    title: All
    points: 15
    checks:
      - id: publishes
        points: 2
        session: alone
        check: topic_published
        with: {artifact: talk, topic: /chat, type: std_msgs/msg/Float64MultiArray}
      - id: rate
        points: 2
        session: alone
        check: topic_rate
        with:
          topic: /chat
          process: talk
          window: window
          rate_hz: 10
          full_within: 2%
          zero_beyond: 20%
        requires: [publishes]
      - id: values
        points: 2
        session: alone
        check: field_range
        with:
          topic: /chat
          field: data
          low: 7
      - id: qos
        points: 2
        session: alone
        check: offered_qos
        with: {topic: /chat, reliability: reliable}
      - id: numbers
        points: 2
        session: alone
        check: reported_series
        with:
          artifact: talk
          pattern: '([0-9.]+)'
          streams: {command: /chat}
          field: data
          oracle: oracles.py:numbers
          tolerance: 0.1
          alternatives: [{parameters: {}, meaning: other, charged_by: [rate]}]
      - id: answers
        points: 2
        session: alone
        check: call_answered
        with:
          artifact: talk
          step: enable
          response: {success: true}
      - id: declares
        points: 1
        session: alone
        check: parameters_declared
        with:
          step: asked
          parameters: [{name: rate, type: double, value: 1.0}]
      - id: ends
        points: 1
        session: alone
        check: ends_by_itself
        with: {artifact: talk, step: ended, least_s: 1, most_s: 2, output: done}
      - id: loads
        points: 1
        session: together
        check: launch_loads
        with: {artifact: launch, step: plan}
      - id: calm
        points: 0
        session: alone
        check: checks/mine.py:calm
        with: {heard: /chat, span: window, most_m: 0.3}
        excused_by: [values]
      - id: frames
        points: 0
        session: alone
        check: transform_tree
        with:
          process: arm
          frames: [{child: laser, parent: odom}]
          poses: [{frame: laser, within: odom, xyz: [1, 0, 0]}]
    figures:
      - {kind: rate, title: Rate, session: alone, with: {topic: /chat, rate_hz: 10}}
"""
ARM = """\
from dataclasses import dataclass

@dataclass(frozen=True)
class Settings:
    rate_hz: float = 100.0
    enabled: bool = True
"""

#: Text, misspelling, and message; the mistake lies on the line of the new text.
MISTYPED: list[tuple[str, str, str]] = [
    (
        "start: {student: talk}",
        "start: {student: tlak}",
        "no artifact 'tlak'; did you mean 'talk'?",
    ),
    (
        "artifact: launch, step",
        "artifact: lanch, step",
        "no artifact 'lanch'; did you mean 'launch'?",
    ),
    (
        "plan: {launch: launch}",
        "plan: {launch: launsh}",
        "no artifact 'launsh'; did you mean 'launch'?",
    ),
    (
        "{reference: arm, with",
        "{reference: arn, with",
        "no reference node 'arn'; did you mean 'arm'?",
    ),
    ("with: {rate_hz: 50}", "with: {rate_hzz: 50}", "unknown key; did you mean 'rate_hz'?"),
    ("with: {rate_hz: 50}", "with: {enabled: 1}", "true or false is expected"),
    ("file: arm.py", "file: amr.py", "no file 'amr.py' beside the rubric; did you mean 'arm.py'?"),
    (
        "arm.py:Settings",
        "arm.py:Setings",
        "no function or class 'Setings' in arm.py; did you mean 'Settings'?",
    ),
    (
        "output_of: arm",
        "output_of: army",
        "no process 'army' in session 'alone'; did you mean 'arm'?",
    ),
    ("interrupt: {process: talk}", "interrupt: {process: tolk}", "no process 'tolk'"),
    ("process: talk\n          window", "process: talker\n          window", "no process 'talker'"),
    ("first_message_on: /chat", "first_message_on: /cat", "'/cat' is not known"),
    ("topic: /chat\n          field", "topic: /chatt\n          field", "did you mean '/chat'?"),
    ("streams: {command: /chat}", "streams: {command: /shat}", "'/shat' is not known"),
    (
        "title: Rate, session: alone, with: {topic: /chat,",
        "title: Rate, session: alone, with: {topic: /hat,",
        "'/hat'",
    ),
    (
        "/orders, type: std_msgs/msg/String",
        "/orders, type: std_msgs/msg/Strin",
        "did you mean 'std_msgs/msg/String'?",
    ),
    (
        "/orders, type: std_msgs/msg/String",
        "/orders, type: std_msg/msg/String",
        "did you mean 'std_msgs'?",
    ),
    (
        "/orders, type: std_msgs/msg/String",
        "/orders, type: std_msgs/String",
        "not a type such as std_msgs/msg/String",
    ),
    (
        "type: std_srvs/srv/SetBool",
        "type: std_srvs/srv/Setbool",
        "did you mean 'std_srvs/srv/SetBool'?",
    ),
    (
        "message: {data: go}",
        "message: {dat: go}",
        "String has no field 'dat'; did you mean 'data'?",
    ),
    (
        "request: {data: true}",
        "request: {date: true}",
        "SetBool_Request has no field 'date'; did you mean 'data'?",
    ),
    (
        "response: {success: true}",
        "response: {sucess: true}",
        "no field 'sucess'; did you mean 'success'?",
    ),
    (
        "field: data\n          low",
        "field: dta\n          low",
        "no field 'dta'; did you mean 'data'?",
    ),
    (
        "field: data\n          low",
        "field: layout.dim[0].label\n          low",
        "is a string; it must hold numbers",
    ),
    (
        "field: data\n          oracle",
        "field: layout.dim\n          oracle",
        "it must hold numbers",
    ),
    (
        "window: window",
        "window: widow",
        "no step labelled 'widow' in session 'alone'; did you mean 'window'?",
    ),
    (
        "window: window",
        "window: heard",
        "'heard' labels a step of kind wait_for; observe or publish is needed",
    ),
    (
        "step: enable",
        "step: enabel",
        "no step labelled 'enabel' in session 'alone'; did you mean 'enable'?",
    ),
    (
        "step: asked\n          p",
        "step: enable\n          p",
        "'enable' labels a step of kind call; get_parameters is needed",
    ),
    ("step: ended", "step: endet", "did you mean 'ended'?"),
    ("label: order\n      - c", "label: heard\n      - c", "'heard' labels an earlier step"),
    (
        "oracles.py:numbers",
        "oracles.py:number",
        "no function or class 'number' in oracles.py; did you mean 'numbers'?",
    ),
    (
        "oracles.py:numbers",
        "oracle.py:numbers",
        "no Python file 'oracle.py' beside the rubric; did you mean 'oracles.py'?",
    ),
    ("oracles.py:numbers", "oracles.py:LIMIT", "no function or class 'LIMIT' in oracles.py"),
    ("kind: rate, title", "kind: rte, title", "no kind 'rte'; did you mean 'rate'?"),
    (
        "topic: /chat, rate_hz: 10}",
        "topic: /chat, rate: 10}",
        "unknown key; did you mean 'rate_hz'?",
    ),
    (
        "full_within: 2%",
        "full_within: 2 percent",
        "a share from 0 to 1 is expected, such as 2% or 0.02",
    ),
    ("full_within: 2%", "full_within: 2", "a share from 0 to 1 is expected"),
    ("rate_hz: 10\n", "rate_hz: '10'\n", "a number is expected"),
    ("rate_hz: 10\n", "rate_hz: true\n", "a number is expected"),
    ("reliability: reliable}", "reliability: reliable, depth: 7.5}", "a whole number is expected"),
    (
        "reliability: reliable",
        "reliability: relable",
        "'relable' is not possible here; did you mean 'reliable'?",
    ),
    ("type: double", "type: duble", "'duble' is not possible here; did you mean 'double'?"),
    ("session: together", "session: togther", "no session 'togther'; did you mean 'together'?"),
    (
        "title: Rate, session: alone",
        "title: Rate, session: aline",
        "no session 'aline'; did you mean 'alone'?",
    ),
    (
        "requires: [publishes]",
        "requires: [publish]",
        "no check 'publish'; did you mean 'publishes'?",
    ),
    ("charged_by: [rate]", "charged_by: [rat]", "no check 'rat'; did you mean 'rate'?"),
    ("charged_by: [rate]", "charged_by: [ends]", "'ends' is not an earlier check"),
    (
        "check: launch_loads",
        "check: launch_load",
        "no check 'launch_load'; did you mean 'launch_loads'?",
    ),
    (
        "          tolerance: 0.1",
        "          tolerence: 0.1",
        "unknown key; did you mean 'tolerance'?",
    ),
    ("- observe: {", "- obseve: {", "did you mean 'observe'?"),
    ("pattern: '([0-9.]+)'", "pattern: '([0-9.]+'", "not a valid regular expression"),
    (
        "- start: {student: talk}",
        "- start: {student: talk, with: {a: 1}}",
        "only a reference takes it",
    ),
    (
        "field: data\n          low",
        "field: data[0][1]\n          low",
        "a float64 has no elements, so that [1]",
    ),
    (
        "field: data\n          low",
        "field: data[x]\n          low",
        "'data[x]' is no path of a field such as",
    ),
    ("interfaces: interfaces", "interfaces: interface", "no folder 'interface' beside the rubric"),
    ("lab_msgs/msg/Sight", "lab_msgs/msg/Sigth", "did you mean 'lab_msgs/msg/Sight'?"),
    (
        "message: {range_m: 1.0}",
        "message: {range: 1.0}",
        "Sight has no field 'range'; did you mean 'range_m'?",
    ),
    (
        "checks/mine.py:calm",
        "checks/mine.py:clam",
        "no function or class 'clam' in checks/mine.py; did you mean 'calm'?",
    ),
    ("checks/mine.py:calm", "checks/mien.py:calm", "did you mean 'checks/mine.py'?"),
    ("heard: /chat, span", "heard: /chta, span", "'/chta' is not known"),
    (
        "heard: /chat, span: window",
        "heard: /chat, span: widow",
        "no step labelled 'widow' in session 'alone'",
    ),
    ("most_m: 0.3", "most_mm: 0.3", "unknown key; did you mean 'most_m'?"),
    ("excused_by: [values]", "excused_by: [valeus]", "no check 'valeus'; did you mean 'values'?"),
    (
        "poses: [{frame: laser",
        "poses: [{frame: lazer",
        "'lazer' stands here alone; did you mean 'laser', as elsewhere?",
    ),
]
#: The lab's own check.
MINE = """\
from dataclasses import dataclass

from grader.own_checks import Context, Finding, Topic, Window, passed

@dataclass
class Parameters:
    heard: Topic
    span: Window
    most_m: float

def calm(context: Context, p: Parameters) -> Finding:
    return passed("calm", "calm")
"""


def lab_folder_of(folder: Path) -> Path:
    """Lay the files beside `LAB` that it names."""
    (folder / "arm.py").write_text(ARM, encoding="utf-8")
    for name, text in {
        "checks/mine.py": MINE,
        "interfaces/lab_msgs/msg/Sight.msg": "float64 range_m\n",
    }.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "oracles.py").write_text(
        "LIMIT = 1\n\ndef numbers(streams, parameters, seed):\n    return []\n"
    )
    return folder


def test_the_lab_without_a_mistake_loads(tmp_path: Path) -> None:
    """The rubric loads before the following test makes mistakes in it."""
    (lab_folder_of(tmp_path) / "lab.yaml").write_text(LAB, encoding="utf-8")
    assert len(list(load_rubric(tmp_path / "lab.yaml", rubric_kinds()).checks())) == 11


@pytest.mark.parametrize(
    ("old", "new", "words"), MISTYPED, ids=[f"{n} {m[1]:.30}" for n, m in enumerate(MISTYPED)]
)
def test_what_is_mistyped_is_reported_before_anything_runs(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    """A missing reference, a wrong type or a wrong unit is reported with its line and remedy."""
    assert LAB.count(old) >= 1
    text = LAB.replace(old, new, 1)
    (lab_folder_of(tmp_path) / "lab.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(RubricError) as caught:
        load_rubric(tmp_path / "lab.yaml", rubric_kinds())
    fitting = [message for message in caught.value.mistakes if words in message]
    assert fitting, caught.value.mistakes
    assert fitting[0].startswith(f"lab.yaml:{line_of(text, new)}: ")
    assert len(caught.value.mistakes) <= 4


#: A line of the lab that travels with the grader, the misspelt part, and the misspelling: names that
#: may be given there for the first time, and that stand elsewhere too.
MISSPELT = [
    ("- wait_for: {publisher: /joint_commands,", "joint_commands", "joint_comands"),
    ("- call: {service: /robot/enable,", "enable", "enabel"),
    ("- get_parameters: {node: /robot_mode_service,", "robot_mode", "robot_mod"),
    ("- wait_for: {node: /joint_command_publisher,", "command", "comand"),
    ("- {node: /robot_mode_service, artifact: service,", "mode", "node"),
    ("- {name: max_velocity, type: double", "velocity", "veloctiy"),
    ("names: [max_velocity, safety_enabled]", "safety_enabled", "safetyenabled"),
    ("- {node: /joint_state_subscriber, artifact: subscriber,", "state", "sate"),
]


@pytest.mark.parametrize(
    ("line", "old", "new"), MISSPELT, ids=[f"{new} {line:.30}" for line, _, new in MISSPELT]
)
def test_a_name_that_is_misspelt_once_is_reported(
    tmp_path: Path, line: str, old: str, new: str
) -> None:
    """Students would be charged for it: no program has such a topic, service, node or parameter."""
    shutil.copytree(lab_folder() / "reference", tmp_path / "reference")
    text = (lab_folder() / "rubric.yaml").read_text(encoding="utf-8")
    assert line in text
    text = text.replace(line, line.replace(old, new, 1), 1)
    (tmp_path / "lab.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(RubricError) as caught:
        load_rubric(tmp_path / "lab.yaml", rubric_kinds())
    place, words = (
        f"lab.yaml:{line_of(text, line.replace(old, new, 1))}: ",
        "stands here alone; did you mean '",
    )
    assert any(m.startswith(place) and words in m for m in caught.value.mistakes), (
        caught.value.mistakes
    )


@pytest.mark.parametrize(
    "alike",
    [
        *(
            ("/joint1/state", "/joint2/state"),
            ("/goals", "/goal"),
            ("gain_x", "gain_y"),
            ("/arm_l/pose", "/arm_r/pose"),
        ),
        *(
            ("/talker", "talker"),
            ("left_wheel", "right_wheel"),
            ("min_speed", "max_speed"),
            ("/map", "/mat"),
            ("vx_max", "vy_max"),
        ),
    ],
)
def test_names_that_are_meant_to_be_alike_are_let_be(
    tmp_path: Path, alike: tuple[str, str]
) -> None:
    """Numbers, a plural, a part of one letter, and short names; whichever of the two stands alone."""
    for one, other in (alike, alike[::-1]):
        names = f"names: [{one}, {one}, {other}]"
        (lab_folder_of(tmp_path) / "lab.yaml").write_text(
            LAB.replace("names: [rate]", names, 1), encoding="utf-8"
        )
        load_rubric(tmp_path / "lab.yaml", rubric_kinds())


def test_many_mistypings_are_reported_at_once(tmp_path: Path) -> None:
    """Mistakes of ten kinds in one rubric all have their message."""
    chosen = [MISTYPED[n] for n in (0, 4, 8, 12, 15, 25, 31, 34, 36, 41)]
    text = LAB
    for old, new, _ in chosen:
        text = text.replace(old, new, 1)
    (lab_folder_of(tmp_path) / "lab.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(RubricError) as caught:
        load_rubric(tmp_path / "lab.yaml", rubric_kinds())
    for _, _, words in chosen:
        assert any(words in message for message in caught.value.mistakes), words


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("std_msgs/msg/String, message: {data: go}", "our_msgs/msg/Order, message: {a: 1}"),
        (
            "- wait_for: {output_of: arm, text: done}",
            "- start: {launch: launch}\n      - wait_for: {output_of: it-1}",
        ),
        (
            "rate_hz: 10}",
            "rate_hz: 10}}\n      - {kind: latency, title: A, session: alone, with: {topics: [/rosout]}",
        ),
    ],
)
def test_what_cannot_be_known_is_let_be(tmp_path: Path, old: str, new: str) -> None:
    """Names that cannot be known beforehand are accepted.

    Examples: messages not installed here, a process of a launch file, and topics of ROS itself.
    """
    (lab_folder_of(tmp_path) / "lab.yaml").write_text(LAB.replace(old, new, 1), encoding="utf-8")
    load_rubric(tmp_path / "lab.yaml", rubric_kinds())


def test_fields_are_known_where_ros_is_not_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where one only regrades, a mistyped field or type of a message of ROS itself is reported all the same."""
    monkeypatch.setattr("sys.prefix", str(tmp_path / "nowhere"))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    text = LAB.replace("field: data\n          low", "field: dta\n          low", 1).replace(
        "msg/String", "msg/Strng"
    )
    (lab_folder_of(tmp_path) / "lab.yaml").write_text(text, encoding="utf-8")
    installed_types.cache_clear()
    installed_fields.cache_clear()
    try:
        with pytest.raises(RubricError) as caught:
            load_rubric(tmp_path / "lab.yaml", rubric_kinds())
    finally:
        installed_types.cache_clear()
    installed_fields.cache_clear()
    assert [message.rpartition("; ")[2] for message in caught.value.mistakes] == [
        "did you mean 'std_msgs/msg/String'?",
        "did you mean 'data'?",
    ]


# -- the rubric that travels with the grader -------------------------------------------------------


def test_the_shipped_rubric_is_valid() -> None:
    """The shipped rubric loads, and has the lab's table of points."""
    rubric = read_rubric(None)
    table = {criterion.title: criterion.points for criterion in rubric.criteria}
    assert table == {
        "Publisher Node": 20,
        "Subscriber Node": 20,
        "Service Node": 20,
        "Launch File": 15,
        "QoS Analysis": 15,
        "Documentation": 10,
    }
    assert rubric.lab.points == 100


def test_each_check_of_the_shipped_rubric_says_how_to_mend() -> None:
    """Every check has a title and a hint."""
    assert [
        check.id
        for check in read_rubric(None).checks()
        if not check.hint or check.title == check.id
    ] == []


def lab_words() -> set[str]:
    """Collect the names of this lab from its rubric: topics, nodes, services, files, executables, package."""
    plain = yaml.safe_load((lab_folder() / "rubric.yaml").read_text(encoding="utf-8"))
    words: set[str] = set()

    def collect(value: object) -> None:
        if isinstance(value, dict):
            for inner in value.values():
                collect(inner)
        elif isinstance(value, list):
            for inner in value:
                collect(inner)
        elif isinstance(value, str) and re.fullmatch(
            r"/[a-z_/]{4,}|[a-z_]+\.py|reference/\w+\.py:\w+", value
        ):
            words.add(value.strip("/").removesuffix(".py"))

    for key in ("artifacts", "reference", "sessions", "criteria"):
        collect(plain[key])
    return words | {plain["lab"]["package"]}


@pytest.mark.parametrize("suffix", ["*.py", "*.j2"])
def test_the_grader_knows_nothing_of_the_lab(suffix: str) -> None:
    """No topic, node, service, file or executable of the lab stands in the grader's sources."""
    words = lab_words()
    assert {"joint_commands", "robot/enable", "robot_mode_service", "qos_comparison"} <= words
    expression = re.compile(
        r"(?<![A-Za-z0-9_])(?:" + "|".join(map(re.escape, sorted(words))) + r")(?![A-Za-z0-9_])"
    )
    inside = GRADER / "shipped_lab"
    hits = []
    for path in sorted(GRADER.rglob(suffix)):
        if not path.is_relative_to(inside):
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
                if expression.search(line):
                    hits.append(f"{path.relative_to(GRADER)}:{number}: {line.strip()}")
    assert hits == []


def test_numbers_as_text_are_no_points(tmp_path: Path) -> None:
    """Points are numbers: infinity and not-a-number are mistakes, too."""
    for value in (".nan", ".inf", "true", "'2'"):
        text = GOOD.replace("        points: 2", f"        points: {value}")
        assert any("a number of points" in message for message in mistakes(tmp_path, text))


POLICY = "policy:\n  late: {due: 2026-11-20T23:59:00+01:00, grace: 10 min, per_day: 10 %}\n"


def test_a_rubric_may_say_what_lateness_costs(tmp_path: Path) -> None:
    """A policy comes back as typed values; without one, lateness costs nothing."""
    late = load(tmp_path, GOOD + POLICY).policy.late
    assert late is not None
    assert (late.due.isoformat(), late.grace) == (
        "2026-11-20T23:59:00+01:00",
        timedelta(minutes=10),
    )
    assert load(tmp_path, GOOD).policy.late is None


def test_an_editor_takes_a_policy_as_it_is_written() -> None:
    """The JSON Schema knows times and amounts by their text, not by their parsed values."""
    validator = jsonschema.Draft202012Validator(json_schema(rubric_kinds()))
    policy = yaml.safe_load(
        POLICY.replace("2026-11-20T23:59:00+01:00", "'2026-11-20T23:59:00+01:00'")
    )
    assert list(validator.iter_errors({**yaml.safe_load(GOOD), **policy})) == []
    policy["policy"]["late"]["grace"] = 10
    assert list(validator.iter_errors({**yaml.safe_load(GOOD), **policy})) != []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("10 %", "10", "an amount with its unit is expected"),
        ("10 min", "10", "a time with its unit is expected"),
        ("+01:00", "", "the time needs its offset from UTC"),
        ("23:59:00+01:00", "24:59:00+01:00", "a date with its time is expected"),
        ("2026-11-20T", "2026-13-20T", "a date with its time is expected"),
        (", per_day: 10 %", "", "one of per_day and never_after is needed"),
        ("per_day", "per_week", "unknown key"),
        ("  late:", "  later:", "unknown key"),
    ],
)
def test_mistakes_in_a_policy_have_their_lines(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    """Each is told with the line of the policy."""
    text = GOOD + POLICY.replace(old, new)
    line = line_of(text, "  late")
    assert any(
        f"lab.yaml:{line}: " in found and message in found for found in mistakes(tmp_path, text)
    )


def test_the_example_in_the_labs_rubric_is_a_policy(tmp_path: Path) -> None:
    """The policy that stands in the lab's rubric as a comment can be used as it is."""
    lines = (lab_folder() / "rubric.yaml").read_text(encoding="utf-8").splitlines()
    first = lines.index("# policy:")
    example = [line.removeprefix("# ") for line in lines[first : lines.index("", first)]]
    late = load(tmp_path, GOOD + "\n".join(example) + "\n").policy.late
    assert late is not None
    assert late.never_after == timedelta(days=7)

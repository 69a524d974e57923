"""The rubric: all its mistakes at once, each with its line; and that it alone knows the lab."""

from __future__ import annotations

import re
from datetime import timedelta
from decimal import Decimal
from pathlib import Path

import pytest
import yaml

from grader.checks import PARAMETERS_OF
from grader.errors import RubricError
from grader.pipeline import lab_folder, read_rubric
from grader.rubric import Rubric, load_rubric

GRADER = Path(__file__).resolve().parents[1] / "grader"

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
    return load_rubric(folder / "lab.yaml", PARAMETERS_OF)


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
    """What it says comes back as typed values."""
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
    ("criteria:", "extra: 1\ncriteria:", "extra: 1", "unknown key; known are"),
    ("        points: 2", "        points: 1", "    points: 5\n    checks", "add up to 4, not to 5"),
    ("title: One, points: 5", "title: One, points: 6", "lab:", "add up to 5, not to 6"),
    ("        points: 2", "        points: two", "points: two", "a number of points is expected"),
    ("        points: 2", "        points: -2", "points: -2", "a number of points is expected"),
    ("check: topic_rate", "check: topic_speed", "check: topic_speed", "no check 'topic_speed'; known are"),
    (
        "session: alone\n        check: topic_rate",
        "session: all\n        check: topic_rate",
        "session: all",
        "no session",
    ),
    ("id: talk.rate", "id: talk.publishes", "id: talk.publishes\n        title: At", "used twice"),
    ("id: talk.rate\n        ", "", "title: At 10 Hz", "missing or used twice"),
    ("requires: [talk.publishes]", "requires: [talk.other]", "requires: [talk", "'talk.other' is no earlier check"),
    ("requires: [talk.publishes]", "requires: [talk.rate]", "requires: [talk", "'talk.rate' is no earlier check"),
    ("rate_hz: 10", "rate_hz: ten", "with: {topic: /chat, process", "valid number"),
    ("rate_hz: 10", "rate_hz: 0", "with: {topic: /chat, process", "greater than 0"),
    (", rate_hz: 10", "", "with: {topic: /chat, process", "this key is missing"),
    ("process: talk, rate_hz", "proces: talk, rate_hz", "with: {topic: /chat, proces", "unknown key"),
    ("full_within: 2%", "full_within: some", "with: {topic: /chat, process", "valid number"),
    ("- start: {student: talk}", "- begin: {student: talk}", "- begin", "a step has one key of start"),
    ("- start: {student: talk}", "- wait", "- wait", "a step has one key of start"),
    ("- start: {student: talk}", "- start: {student: tlak}", "- start", "'tlak' is not defined"),
    ("- start: {student: talk}", "- start: {}", "- start", "exactly one of student, launch, reference"),
    ("- start: {student: talk}", "- wait_for: {node: /a, topic: /b}", "- wait_for", "unknown key"),
    ("- start: {student: talk}", "- wait_for: {timeout_s: 1}", "- wait_for", "exactly one of node"),
    ("duration_s: 2", "duration_s: long", "- observe", "valid number"),
    ("duration_s: 2", "duration_s: 9999", "- observe", "less than or equal to 300"),
    ("    typical_s: 3", "    typical_s: soon", "typical_s: soon", "a time in seconds is expected"),
    ("    typical_s: 3", "    typical_s: 3\n    typical_s: 4", "typical_s: 4", "stands here twice"),
    ("        label: window", "        label: [window]", "label: [", "a name is expected"),
    ("    title: Talker", "    description: Talker", "- id: talk\n", "criteria.0.title: it is missing"),
    ("file: arm.py", "file: leg.py", "arm: {", "no file leg.py beside the rubric"),
    (
        "id: talk\n",
        "id: talk\n    figures: [{kind: rate, title: x, session: other}]\n",
        "figures:",
        "no session 'other'",
    ),
]


@pytest.mark.parametrize(("old", "new", "at", "words"), WRONG, ids=[new.strip()[:40] for _, new, _, _ in WRONG])
def test_each_mistake_is_reported_with_its_line(tmp_path: Path, old: str, new: str, at: str, words: str) -> None:
    """One mistake gives one message, with file, line and what is wrong."""
    assert GOOD.count(old) >= 1
    text = GOOD.replace(old, new, 1)
    found = mistakes(tmp_path, text)
    fitting = [message for message in found if words in message]
    assert fitting, found
    assert fitting[0].startswith(f"lab.yaml:{line_of(text, at)}: "), found


def test_all_mistakes_are_reported_at_once(tmp_path: Path) -> None:
    """Mistakes in every part are listed together, in the order of their lines."""
    text = (
        GOOD.replace("typical_s", "typical").replace("check: topic_rate", "check: x").replace("points: 2", "points: 1")
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


@pytest.mark.parametrize("value", ["{a: 1}", "[[1]]", "5", "text", "null", "[{}]", "true"])
@pytest.mark.parametrize(
    "key", ["requires", "with", "id", "check", "session", "points", "title", "hint", "steps", "checks", "find", "label"]
)
def test_values_of_another_kind_never_break_it(tmp_path: Path, key: str, value: str) -> None:
    """Whatever stands behind a key, the rubric either loads or says what is wrong."""
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
            load_rubric(path, PARAMETERS_OF)
        assert caught.value.exit_status == 4
        assert caught.value.remedy


def test_reference_files_may_lie_in_the_labs_folder(tmp_path: Path) -> None:
    """A copy of a rubric finds its reference nodes in the folder given."""
    (tmp_path / "copy").mkdir()
    (tmp_path / "arm.py").touch()
    (tmp_path / "copy/lab.yaml").write_text(GOOD, encoding="utf-8")
    assert load_rubric(tmp_path / "copy/lab.yaml", PARAMETERS_OF, tmp_path).folder == tmp_path


# -- the rubric that travels with the grader -------------------------------------------------------


def test_the_shipped_rubric_is_valid() -> None:
    """It loads, and has the lab's table of points."""
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
    assert [check.id for check in read_rubric(None).checks() if not check.hint or check.title == check.id] == []


def test_labels_that_checks_refer_to_exist() -> None:
    """Each step and window that a check names is a label in its session."""
    rubric = read_rubric(None)
    for check in rubric.checks():
        values = check.parameters.model_dump()
        named = {v for k, v in values.items() if k == "window" or k == "step" or k.endswith("_step")}
        labels = {step.label for step in rubric.sessions[check.session].steps} if check.session else set()
        assert named - {None} <= labels, check.id


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
        elif isinstance(value, str) and re.fullmatch(r"/[a-z_/]{4,}|[a-z_]+\.py|reference/\w+\.py:\w+", value):
            words.add(value.strip("/").removesuffix(".py"))

    for key in ("artifacts", "reference", "sessions", "criteria"):
        collect(plain[key])
    return words | {plain["lab"]["package"]}


@pytest.mark.parametrize("suffix", ["*.py", "*.j2"])
def test_the_grader_knows_nothing_of_the_lab(suffix: str) -> None:
    """No topic, node, service, file or executable of the lab stands in the grader's sources."""
    words = lab_words()
    assert {"joint_commands", "robot/enable", "robot_mode_service", "qos_comparison"} <= words
    expression = re.compile(r"(?<![A-Za-z0-9_])(?:" + "|".join(map(re.escape, sorted(words))) + r")(?![A-Za-z0-9_])")
    inside = GRADER / "lab"
    hits = [
        f"{path.relative_to(GRADER)}:{number}: {line.strip()}"
        for path in sorted(GRADER.rglob(suffix))
        if not path.is_relative_to(inside)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if expression.search(line)
    ]
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
    assert (late.due.isoformat(), late.grace) == ("2026-11-20T23:59:00+01:00", timedelta(minutes=10))
    assert load(tmp_path, GOOD).policy.late is None


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
def test_mistakes_in_a_policy_have_their_lines(tmp_path: Path, old: str, new: str, message: str) -> None:
    """Each is told with the line of the policy."""
    text = GOOD + POLICY.replace(old, new)
    line = line_of(text, "  late")
    assert any(f"lab.yaml:{line}: " in found and message in found for found in mistakes(tmp_path, text))


def test_the_example_in_the_labs_rubric_is_a_policy(tmp_path: Path) -> None:
    """The policy that stands in the lab's rubric as a comment can be used as it is."""
    lines = (lab_folder() / "rubric.yaml").read_text(encoding="utf-8").splitlines()
    first = lines.index("# policy:")
    example = [line.removeprefix("# ") for line in lines[first : lines.index("", first)]]
    late = load(tmp_path, GOOD + "\n".join(example) + "\n").policy.late
    assert late is not None
    assert late.never_after == timedelta(days=7)

"""A lab's own interfaces: a rubric is checked against them before anything is built, and they are kept with it."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader.errors import RubricError
from grader.judging.rubrics import read_rubric, rubric_kinds
from grader.lab import kept_lab
from grader.lab.rubric import Rubric, load_rubric

RUBRIC = """\
lab: {id: own, title: Own, points: 1}
interfaces: interfaces
artifacts:
  talk: {file: talk.py}
sessions:
  alone:
    steps:
      - start: {student: talk}
      - publish: {topic: /in, type: lab_msgs/msg/Reading, message: {value: 1.0, header: {frame_id: x}}}
      - call: {service: /add, type: lab_msgs/srv/Add, request: {a: 1, b: 2}}
      - wait_for: {publisher: /num, type: team_msgs/msg/Num}
criteria:
  - id: talk
    title: Talker
    points: 1
    checks:
      - id: it
        points: 1
        session: alone
        check: topic_published
        with: {artifact: talk, topic: /num, type: lab_msgs/msg/Reading}
"""
READING = "std_msgs/Header header\nfloat64 value 1.5\n"


def load(folder: Path, text: str = RUBRIC, **files: str) -> Rubric:
    """Load a rubric beside the lab's interfaces, with some files replaced."""
    texts = {
        "msg/Reading.msg": READING,
        "srv/Add.srv": "int64 a\nint64 b\n---\nint64 sum\n",
        **files,
    }
    for name, definition in texts.items():
        path = folder / "interfaces/lab_msgs" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(definition, encoding="utf-8")
    (folder / "rubric.yaml").write_text(text, encoding="utf-8")
    return load_rubric(folder / "rubric.yaml", rubric_kinds())


def test_types_and_fields_of_the_labs_own_are_known(tmp_path: Path) -> None:
    """Types of the lab's own packages are known, and a student's package is taken unseen."""
    rubric = load(tmp_path)
    assert [package.name for package in rubric.interface_packages] == ["lab_msgs"]


ASKED = RUBRIC.replace("interfaces: interfaces", "asked_interfaces: interfaces")


def test_types_that_students_are_asked_to_define_are_known(tmp_path: Path) -> None:
    """They are checked as the lab's own, kept with recordings, and never take the place of a student's."""
    rubric = load(tmp_path, ASKED)
    assert rubric.interface_packages == []
    assert "interfaces/lab_msgs/srv/Add.srv" in kept_lab.files_of(rubric)
    with pytest.raises(RubricError) as raised:
        load(tmp_path, ASKED.replace("request: {a: 1", "request: {c: 1"))
    assert any("no field 'c'" in mistake for mistake in raised.value.mistakes)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (("value: 1.0", "valeu: 1.0"), "value"),
        (("lab_msgs/srv/Add", "lab_msgs/srv/Ad"), "lab_msgs/srv/Add"),
        (("type: lab_msgs/msg/Reading, message", "type: lab_msg/msg/Reading, message"), "lab_msgs"),
        (("request: {a: 1", "request: {c: 1"), "no field 'c'"),
        (("interfaces: interfaces", "interfaces: elsewhere"), "no folder 'elsewhere'"),
        (("interfaces: interfaces", "interfaces: ../.."), "no folder"),
    ],
)
def test_mistakes_are_found_before_anything_runs(
    wrong: tuple[str, str], words: str, tmp_path: Path
) -> None:
    """A misspelt type or field is reported before anything runs, with the nearest right one."""
    with pytest.raises(RubricError) as raised:
        load(tmp_path, RUBRIC.replace(*wrong))
    assert any(words in mistake for mistake in raised.value.mistakes), raised.value.mistakes


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("msg/Reading.msg", "int value\n", "lab_msgs/int"),
        ("msg/Reading.msg", "geometry_msgs/Poin p\n", "geometry_msgs/Poin"),
        ("msg/reading.msg", READING, "msg/reading.msg"),
        ("srv/Add.srv", "int64 a\n", "srv/Add.srv"),
        ("../std_msgs/msg/String.msg", "int64 data\n", "ROS has a package of this name"),
    ],
)
def test_mistakes_in_a_definition_name_it(file: str, text: str, words: str, tmp_path: Path) -> None:
    """A mistake in a definition names the file, if it can be known without building it."""
    with pytest.raises(RubricError) as raised:
        load(tmp_path, RUBRIC, **{file: text})
    assert any(words in mistake for mistake in raised.value.mistakes), raised.value.mistakes


def test_they_are_kept_with_recordings(tmp_path: Path) -> None:
    """Interfaces are kept with recordings, to make the copied rubric valid away from the lab."""
    rubric = load(tmp_path)
    kept = tmp_path / "results" / kept_lab.KEPT
    for name, text in kept_lab.files_of(rubric).items():
        (kept / name).parent.mkdir(parents=True, exist_ok=True)
        (kept / name).write_text(text, encoding="utf-8")
    copy = tmp_path / "results/rubric.yaml"
    copy.write_text(rubric.text, encoding="utf-8")
    kept_lab.trust(kept_lab.files_of(rubric))
    assert [package.name for package in read_rubric(copy).interface_packages] == ["lab_msgs"]

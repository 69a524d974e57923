"""The engine knows ROS, and each rubric its lab: no line of the engine has a name of a lab that is shipped."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
#: Outside the engine: the template of a lab, and the lab that `grade doctor` uses.
LABS_OF_ITS_OWN = (ROOT / "grader/lab/template", ROOT / "grader/doctor/lab")
RUBRICS = [ROOT / "rubric.yaml", *sorted(ROOT.glob("labs/*/rubric.yaml"))]
#: Names that belong to ROS: topics of its own, and the nodes of `demo_nodes_py` and `topic_tools`.
OF_ROS = {"/tf", "/tf_static", "/clock", "/rosout", "talker", "talker.py", "/talker", "relay"}
#: Where a lab gives its names: keys of steps, checks and figures.
_NAMING = {
    *(
        "node",
        "publisher",
        "subscription",
        "service",
        "action",
        "topic",
        "first_message_on",
        "nodes",
    ),
    *("child", "parent", "frame", "within", "executable", "file"),
}
_LINES = {
    path.relative_to(ROOT): path.read_text(encoding="utf-8")
    for package in ("grader", "launch_plan", "ros_bag")
    for path in sorted((ROOT / package).rglob("*"))
    if path.suffix in (".py", ".j2", ".js", ".yaml")
    and not any(path.is_relative_to(own) for own in LABS_OF_ITS_OWN)
}


def names_in(part: Any, key: str = "") -> set[str]:
    """Give the names of a part of a rubric: texts behind keys that name something, and joints and frames in them."""
    if isinstance(part, dict):
        found = set()
        for k, value in part.items():
            for name in names_in(value, str(k)):
                found.add(name)
        return found
    if isinstance(part, list):
        return {name for value in part for name in names_in(value, key)}
    known = isinstance(part, str) and key in _NAMING
    if known:
        return {part}
    return set(re.findall(r"\b\w+_(?:joint|link)\b", str(part)))


def names_of(rubric: Path) -> set[str]:
    """Return the names of a lab: its id, and the names in its rubric, nodes and oracles."""
    plain = yaml.safe_load(rubric.read_text(encoding="utf-8"))
    names = names_in({key: plain[key] for key in ("sessions", "criteria", "artifacts")}) | names_in(
        plain.get("bonus")
    )
    for file in (*rubric.parent.glob("*.py"), *rubric.parent.glob("reference/*.py")):
        names |= set(re.findall(r"\b\w+_(?:joint|link)\b", file.read_text(encoding="utf-8")))
    return {plain["lab"]["id"], *names} - OF_ROS


@pytest.mark.parametrize("rubric", RUBRICS, ids=lambda path: path.parent.name)
def test_no_line_of_the_engine_names_a_lab(rubric: Path) -> None:
    """Neither its id, nor a topic, node, action, file, joint or frame of it."""
    names = names_of(rubric)
    assert len(names) > 5
    found = []
    for path, text in _LINES.items():
        # A search for plain text is a hundred times as quick as that for words.
        for name in filter(text.__contains__, names):
            word = re.compile(rf"(?<![\w/]){re.escape(name)}(?!\w)")
            found += [f"{path}: {line.strip()}" for line in text.splitlines() if word.search(line)]
    assert found == []


def test_a_name_would_be_found() -> None:
    """Frames, joints, topics, nodes and files of both labs are among the searched names."""
    first, second = (names_of(rubric) for rubric in RUBRICS[:2])
    assert {
        "09-01",
        "/joint_commands",
        "/robot_mode_service",
        "joint_publisher.py",
        "/execute_trajectory",
    } <= first
    assert {
        "09-02",
        "camera_link",
        "turret_joint",
        "/target_in_camera",
        "forearm_link",
        "camera_mount.py",
    } <= second

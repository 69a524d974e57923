"""Interfaces of students' packages: read from CMakeLists.txt without running it."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader.judging.rubrics import read_rubric
from grader.recording.submission import PackageFact, SubmissionRecord
from grader.submission.artifacts import read_submission_folder
from grader.submission.packages.interfaces import interface_packages, interface_problems

CALL = 'rosidl_generate_interfaces(${PROJECT_NAME}\n  "msg/Num.msg"\n  srv/Add.srv\n  DEPENDENCIES std_msgs)\n'
BY_VARIABLE = 'set(files "msg/Num.msg")\nrosidl_generate_interfaces(${PROJECT_NAME} ${files})\n'
BY_GLOB = 'file(GLOB files "msg/*.msg")\nrosidl_generate_interfaces(${PROJECT_NAME} ${files})\n'
DEFINED = {
    "ws/mine/msg/Num.msg": "int64 num\n",
    "ws/mine/msg/Left.msg": "int8 x\n",
    "ws/mine/srv/Add.srv": "---\n",
}


def made(script: str) -> tuple[set[str], list[str]]:
    """Return the generated interfaces, and the problems of the package."""
    fact = PackageFact("mine", "ws/mine", "ament_cmake")
    texts = {**DEFINED, "ws/mine/CMakeLists.txt": script, "msg/Other.msg": "int8 x\n"}
    record = SubmissionRecord("s", texts=texts, packages=[fact])
    files = set()
    for package in interface_packages(record):
        for file in package.files:
            files.add(file)
    return files, interface_problems(fact, texts)


@pytest.mark.parametrize(
    ("script", "files"),
    [
        (CALL, {"msg/Num.msg", "srv/Add.srv"}),
        (BY_VARIABLE, {"msg/Num.msg"}),
        (BY_GLOB, {"msg/Num.msg", "msg/Left.msg", "srv/Add.srv"}),
        (
            CALL.replace('"msg/Num.msg"', '"${CMAKE_CURRENT_SOURCE_DIR}:msg/Num.msg"'),
            {"msg/Num.msg", "srv/Add.srv"},
        ),
        (BY_VARIABLE.replace('Num.msg"', 'Num.msg;msg/Left.msg"'), {"msg/Num.msg", "msg/Left.msg"}),
        ("find_package(ament_cmake)\n", set()),
    ],
)
def test_what_is_listed_is_made(script: str, files: set[str]) -> None:
    """By name or by a variable; where only CMake could tell, all; where nothing calls for it, none."""
    assert made(script)[0] == files


def test_what_colcon_build_would_leave_out_is_said() -> None:
    """A definition that is not listed, one that is not there, and none at all that is asked for."""
    assert made(CALL)[1] == ["CMakeLists.txt does not list msg/Left.msg, so it is not made"]
    assert (
        "CMakeLists.txt lists msg/Sum.msg, which is not there"
        in made(CALL.replace("Num", "Sum"))[1]
    )
    assert "does not call rosidl_generate_interfaces" in made("project(mine)\n")[1][0]
    assert made(BY_GLOB)[1] == []


def test_a_package_of_messages_is_in_the_group() -> None:
    """CMake generates nothing for a package.xml without the group."""
    fact = PackageFact("mine", "mine", "ament_cmake")
    group = "<member_of_group>rosidl_interface_packages</member_of_group>"
    texts = {
        "mine/CMakeLists.txt": "rosidl_generate_interfaces(mine msg/Num.msg)\n",
        "mine/msg/Num.msg": "int64 num\n",
        "mine/package.xml": "<package><name>mine</name></package>",
    }
    (problem,) = interface_problems(fact, texts)
    assert f"package.xml has no {group}" in problem
    assert not interface_problems(fact, {**texts, "mine/package.xml": group})


def test_a_definition_that_is_a_link_is_none(tmp_path: Path) -> None:
    """The target of a link stays unread, and is no part of the submission."""
    secret = tmp_path / "secret"
    secret.write_text("int64 secret\n", encoding="utf-8")
    package = tmp_path / "submission/mine"
    (package / "msg").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>mine</name></package>", encoding="utf-8")
    (package / "CMakeLists.txt").write_text(BY_GLOB, encoding="utf-8")
    (package / "msg/Num.msg").symlink_to(secret)
    (package / "msg/Other.msg").write_text("int64 other\n", encoding="utf-8")
    (package / "joint_publisher.py").touch()
    record = read_submission_folder(package.parent, read_rubric(None))
    assert [dict(found.files) for found in interface_packages(record)] == [
        {"msg/Other.msg": "int64 other\n"}
    ]

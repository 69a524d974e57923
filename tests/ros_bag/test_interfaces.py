"""Interface packages before they are built: their files, their contents, and folders that are no such package."""

from __future__ import annotations

import pytest

from ros_bag.fields import also_defined, fields_of, packages_with, types_in
from ros_bag.interfaces import InterfacePackage, in_order, packages_of, shipped_packages


def test_a_package_is_named_by_its_manifest_or_its_folder() -> None:
    """The folder above msg/, srv/ and action/ is the package's."""
    found = {}
    for package in packages_of(
        {
            "a/msg/Num.msg": "int64 num\n",
            "a/srv/Add.srv": "---\n",
            "b/package.xml": "<package><name>my_b</name></package>",
            "b/action/Go.action": "---\n---\n",
            "b/other/No.msg": "int64 num\n",
            "msg/No.txt": "",
        }
    ):
        found[package.name] = set(package.files)
    assert found == {"a": {"msg/Num.msg", "srv/Add.srv"}, "my_b": {"action/Go.action"}}


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("My-Package", {"msg/Num.msg": ""}),
        ("a__b", {"msg/Num.msg": ""}),
        ("a" * 240, {"msg/Num.msg": ""}),
        ("a", {"msg/../../x.msg": ""}),
        ("a", {"../x.msg": ""}),
        ("a", {"msg/num.msg": ""}),
        ("a", {"msg/Num.srv": ""}),
        ("a", {f"msg/N{number}.msg": "" for number in range(10_000)}),
        ("a", {"msg/Num.msg": "int64 x\n" * 100_000}),
    ],
)
def test_what_is_none_says_why(name: str, files: dict[str, str]) -> None:
    """Names that ROS does not take, names that climb, and far more than anybody writes."""
    assert InterfacePackage(name, files).problem
    assert not InterfacePackage("a", {"msg/Num.msg": "int64 num\n"}).problem


def test_fields_are_known_without_a_build() -> None:
    """Fields of messages and of parts of services and actions are known; a type without a package is the package's own."""
    package = InterfacePackage(
        "my_msgs",
        {
            "msg/Num.msg": "int64 LIMIT=7\nint64 num 3\nstd_msgs/Header header\n",
            "srv/Add.srv": "Num[] nums # both\n---\nfloat64[2] sums\n",
            "action/Count.action": "int32 goal\n---\nint32 total\n---\nint32 so_far\n",
        },
    )
    with also_defined([package]):
        assert fields_of("my_msgs/msg/Num") == {"num": "int64", "header": "std_msgs/msg/Header"}
        assert fields_of("my_msgs/srv/Add_Request") == {"nums": "my_msgs/msg/Num[]"}
        assert fields_of("my_msgs/srv/Add_Response") == {"sums": "float64[]"}
        assert fields_of("my_msgs/action/Count_Feedback") == {"so_far": "int32"}
        assert types_in("my_msgs", "srv") == ("my_msgs/srv/Add",)
        assert "my_msgs" in packages_with("action")
    assert fields_of("my_msgs/msg/Num") is None, "known for as long as it is at hand"


def test_types_that_come_with_the_grader_are_known() -> None:
    """Packages of ROS that have no wheels are known without a build, and each of their definitions is valid."""
    assert {package.name for package in shipped_packages()} == {
        "ackermann_msgs",
        "example_interfaces",
        "tf2_msgs",
    }
    assert [package.problem for package in shipped_packages() if not package.fields] == []
    assert fields_of("example_interfaces/srv/SetBool_Request") == {"data": "bool"}
    drive = fields_of("ackermann_msgs/msg/AckermannDrive")
    assert drive is not None
    assert list(drive)[:3] == ["steering_angle", "steering_angle_velocity", "speed"]
    assert "example_interfaces/msg/Int64" in types_in("example_interfaces", "msg")


def test_a_part_of_a_package_holds_the_named_types_and_those_that_they_use() -> None:
    """Without a named type the package stays whole."""
    files = {
        "msg/Part.msg": "int64 x\n",
        "msg/Whole.msg": "Part[] parts\n",
        "srv/Other.srv": "---\n",
    }
    package = InterfacePackage("a", files)
    assert set(package.named_in("from a.msg import Whole").files) == {
        "msg/Part.msg",
        "msg/Whole.msg",
    }
    assert package.named_in("import a.msg").files == files


@pytest.mark.parametrize("files", [{"srv/Add.srv": "int64 a\n"}, {"msg/Num.msg": "int64\n"}])
def test_what_is_no_definition_names_its_file(files: dict[str, str]) -> None:
    """The error names the file, for the instructor to find it."""
    with pytest.raises(ValueError, match=next(iter(files))):
        _ = InterfacePackage("a", files).fields


def test_packages_stand_after_those_that_they_use() -> None:
    """Also where the names say the contrary, and in a circle, which ends."""
    a = InterfacePackage("a", {"msg/A.msg": "b/B b\n# c/C\n"})
    b, c = (
        InterfacePackage("b", {"msg/B.msg": "c/C[3] c\n"}),
        InterfacePackage("c", {"msg/C.msg": "int8 x\n"}),
    )
    assert [p.name for p in in_order([a, b, c])] == ["c", "b", "a"]
    circle = InterfacePackage("c", {"msg/C.msg": "a/A a\n"})
    assert {p.name for p in in_order([a, b, circle])} == {"a", "b", "c"}
    assert a.used == {"b"}, "what stands in a comment is not used"


def test_what_is_used_stands_in_lines_as_rosidl_has_them() -> None:
    """An unnoticed use would not tell kept builds apart, and a build with other definitions would be taken."""
    for end in ("\n", "\r", "\x0b", "\x0c", "\x1c", "\u2028"):
        assert InterfacePackage("a", {"msg/A.msg": f"int8 x{end}\tb/B b\n"}).used == {"b"}, repr(
            end
        )

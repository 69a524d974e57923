"""Near misses: the name that was meant, and none where nothing was."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.evidence.near_miss import Candidate, likeness, near_miss

FLOATS, TEXT = "std_msgs/msg/Float64MultiArray", "std_msgs/msg/String"
NAMES = st.from_regex(r"(/[a-z][a-z0-9_]{0,12}){1,3}", fullmatch=True)


def meant(wanted: str, *candidates: tuple[str, str], kind: str | None = FLOATS) -> str | None:
    """Give the name that is chosen."""
    found = near_miss(wanted, kind, [Candidate(*c) for c in candidates])
    return found.name if found else None


@given(NAMES, NAMES)
def test_likeness_is_a_share(one: str, other: str) -> None:
    """Two names are alike between not at all and wholly; a name is wholly like itself."""
    assert 0 <= likeness(one, other) <= 1
    assert likeness(one, one) == 1


@pytest.mark.parametrize(
    "name",
    ["/joint_command", "/JointCommands", "/arm/joint_commands", "/joint_comands", "/joint_cmds"],
)
def test_a_misspelt_name_is_nearer_than_another(name: str) -> None:
    """A typo, another spelling, a namespace more: the name meant is chosen among others of its type."""
    assert meant("/joint_commands", ("/battery_voltage", FLOATS), (name, FLOATS)) == name


def test_the_only_one_of_the_type_is_meant_whatever_its_name() -> None:
    """A node with one topic of the type can mean no other."""
    assert meant("/joint_commands", ("/x", FLOATS), ("/joint_command", TEXT)) == "/x"


@pytest.mark.parametrize(
    ("wanted", "name", "taken"),
    [
        ("/number_count", "/my_number", False),
        ("/number_count", "/number_cnt", True),
        ("/number_count", "/count", True),
        ("/number_count", "/x", True),
        ("/number", "/my_number", True),
    ],
)
def test_a_topic_of_another_purpose_is_not_taken(wanted: str, name: str, taken: bool) -> None:
    """A misspelt input is no missing output, even if it is the only topic of the type."""
    found = near_miss(wanted, FLOATS, [Candidate(name, FLOATS)], {"/number", "/number_count"})
    assert (found is not None) is taken


def test_a_name_of_another_type_is_taken_if_it_is_alike() -> None:
    """With a wrong type only likeness counts."""
    assert meant("/joint_commands", ("/joint_command", TEXT), ("/log", TEXT)) == "/joint_command"
    assert meant("/joint_commands", ("/battery", TEXT)) is None


def test_without_a_type_only_likeness_counts() -> None:
    """A node's name has no type."""
    assert (
        meant("/joint_publisher", ("/joint_pub", ""), ("/service", ""), kind=None) == "/joint_pub"
    )


def test_nothing_is_meant_where_there_is_nothing() -> None:
    """No candidate, or none that is alike, gives none."""
    assert meant("/joint_commands") is None
    assert meant("/joint_commands", ("/zzz", FLOATS), ("/yyy", FLOATS)) is None


@given(st.lists(st.tuples(NAMES, st.sampled_from([FLOATS, TEXT])), max_size=6), st.randoms())
def test_the_order_of_candidates_does_not_matter(
    candidates: list[tuple[str, str]], random: object
) -> None:
    """The choice depends on the names alone."""
    other = list(candidates)
    random.shuffle(other)  # type: ignore[attr-defined]
    assert meant("/joint_commands", *candidates) == meant("/joint_commands", *other)


@pytest.mark.parametrize(
    "name", ["/a", "/a/b_1", "/a__b", "/_", "/", "a", "/a/", "//a", "/1", "/a-b", "/é", "/a\n"]
)
def test_a_topic_of_the_graph_is_one_that_a_reference_node_can_be_given(name: str) -> None:
    """Others than rcl takes are none: a reference node that is given one ends, and the session with it."""
    pytest.importorskip("rclpy")
    from rclpy.exceptions import InvalidTopicNameException
    from rclpy.validate_full_topic_name import validate_full_topic_name

    from grader.live.ros_node.graph import _TOPIC_NAME

    for length in (len(name), 247, 248):
        long = name + "a" * (length - len(name))
        try:
            taken = bool(validate_full_topic_name(long))
        except InvalidTopicNameException:
            taken = False
        assert (_TOPIC_NAME.fullmatch(long) is not None) == taken, long

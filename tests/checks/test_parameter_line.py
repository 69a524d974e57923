"""Lines of a launch file."""

from __future__ import annotations

import pytest

from grader.checks.launch import parameter_line

TEXT = """\
from launch_ros.actions import Node

COMMON = {'a': 1}
nodes = [
    Node(
        name='first',
        parameters=[
            {'a': 1,
             'b': 2}],
    ),
    Node(name='second',
         parameters=[COMMON]),
    Node(name='third'),
]
"""


@pytest.mark.parametrize(
    ("node_line", "parameter", "line"),
    [
        (5, "a", 8),
        (5, "b", 9),
        (5, "none", 5),
        (11, "a", 11),
        (13, "a", 13),
        (20, "a", 20),
        (None, "a", None),
    ],
)
def test_a_parameter_is_found_or_what_is_nearest(
    node_line: int | None, parameter: str, line: int | None
) -> None:
    """A parameter is located at its own line, or at the line of its node."""
    assert parameter_line(TEXT, node_line, parameter) == line


@pytest.mark.parametrize("text", ["<launch/>", "", "x = (", "\0"])
def test_a_file_that_is_no_python_has_the_line_of_the_node(text: str) -> None:
    """XML and YAML launch files, and broken ones, are not looked into."""
    assert parameter_line(text, 3, "a") == 3

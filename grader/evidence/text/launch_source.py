"""Where in a launch file something stands, read off its text."""

from __future__ import annotations

#: Lines that a node's entry in a launch file takes at most.
_MOST_LINES = 60


def parameter_line(text: str, node_line: int | None, parameter: str) -> int | None:
    """Find the line of a launch file that gives a node a parameter; else the one on which the node is made."""
    first = node_line or 0
    for number, line in enumerate(text.split("\n")[first : first + _MOST_LINES] if first else (), first + 1):
        if f"'{parameter}'" in line or f'"{parameter}"' in line:
            return number
        if "Node(" in line:
            break
    return node_line

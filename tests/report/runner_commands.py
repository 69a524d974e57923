"""Reads workflow commands from a printed line as GitHub's runner does; any name is taken for a known one.

The runner tries two forms on each line: `::name key=value,key=value::data` after leading blanks, and
`##[name key=value;key=value]data` anywhere.
"""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Command:
    """A command that was read."""

    name: str
    properties: dict[str, str]
    data: str


def _decoded(text: str, codes: dict[str, str]) -> str:
    for code, character in codes.items():
        text = text.replace(code, character)
    return text


#: In the runner's order: the percent sign last.
_DATA = {"%0D": "\r", "%0A": "\n", "%25": "%"}
_PROPERTY = {"%0D": "\r", "%0A": "\n", "%3A": ":", "%2C": ",", "%25": "%"}


def colon_command(line: str) -> Command | None:
    """Return the command that a line is in the form of today."""
    line = line.lstrip()
    end = line.find("::", 2)
    if not line.startswith("::"):
        return None
    if end < 0:
        return None
    name, blank, rest = line[2:end].partition(" ")
    if not name:
        return None
    if ":" in name:
        return None
    if blank:
        pairs = [pair.split("=", 1) for pair in rest.strip().split(",") if "=" in pair]
    else:
        pairs = []
    return Command(
        name,
        {k: _decoded(v, _PROPERTY) for k, v in pairs if k and v},
        _decoded(line[end + 2 :], _DATA),
    )


def bracket_command(line: str) -> str | None:
    """Return the name of a line's command in the old form, or in the form of Azure or TeamCity."""
    found = re.search(r"##[A-Za-z]*\[([^ \]]*)[^\]]*\]", line)
    return found[1] if found else None

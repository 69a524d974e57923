"""Untrusted text in the log of a CI job: what the runner would take for a command of ours stays text.

GitHub's runner reads each printed line for `::name properties::data` at its start (after blanks) and for
`##[name properties]data` anywhere in it. Azure Pipelines and TeamCity use `##word[` in the same way.
"""

from __future__ import annotations

import re

from grader.report.untrusted import line, shown

_LONGEST = 4000
#: The first of two colons with which a command could begin, wherever a line may be broken.
_COLONS = re.compile(r":(?=:[^\s:])")
_BRACKET = re.compile(r"##(?=[A-Za-z]*\[)")


def command_data(text: str, longest: int = _LONGEST) -> str:
    """Return a text as the data of a workflow command; line ends stay, as the runner writes them."""
    return _percent(uncommanded(shown(text, longest)))


def command_property(text: str, longest: int = _LONGEST) -> str:
    """Return a text as the value of a property of a workflow command, on one line."""
    return _percent(line(text, longest)).replace(":", "%3A").replace(",", "%2C")


def uncommanded(text: str) -> str:
    """Return a text of which no part is a command, at whatever place its lines are broken when it is printed.

    Two colons are parted by a blank where a name and two colons follow; likewise `##` and a bracket. C++ names
    such as `std::vector` stay, unless they have three parts.
    """
    last = text.rfind("::")
    parted = _COLONS.sub(lambda found: ": " if found.start() + 2 <= last else ":", text)
    return _BRACKET.sub("## ", parted)


def _percent(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")

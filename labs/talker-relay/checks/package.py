"""Checks of the files that were handed in."""

import re
from dataclasses import dataclass

from grader.own_checks import Finding, Part, Submission, failed, of_parts

_NAME = re.compile(r"<name>\s*([\w-]{1,100})\s*</name>")
_MADE = ("build", "install", "log")


@dataclass
class Parameters:
    name: str


def is_named(submission: Submission, p: Parameters) -> Finding:
    """Look for the package's name in each package.xml, and for folders that colcon makes."""
    expected = f"a package {p.name}, without build folders"
    found = _names(submission)
    if not found:
        return failed(expected, "no package", "There is no package.xml in the submission.")
    return of_parts(expected, [_named(found, p.name), _clean(submission)])


def _names(submission: Submission) -> list[str]:
    found = []
    for path in submission.paths:
        if path.rpartition("/")[2] == "package.xml":
            found += _NAME.findall(submission.text(path) or "")[:1]
    return found


def _named(found: list[str], name: str) -> Part:
    if name in found:
        return Part(1.0, f"the package {name}", weight=3)
    reason = f"The package is named {found[0]}, not {name}, so that `ros2 run {name} ...` finds nothing."
    return Part(0.0, f"the package {found[0]}", reason, weight=3)


def _clean(submission: Submission) -> Part:
    made = []
    for path in submission.left_out:
        if path.rstrip("/").rpartition("/")[2] in _MADE:
            made.append(path)
    if not made:
        return Part(1.0, "no build folders", weight=2)
    reason = f"{', '.join(sorted(made)[:3])}: colcon makes these folders; they do not belong into the submission."
    return Part(0.0, "build folders", reason, weight=2)

"""What a student's packages define as interfaces, by parsing their `CMakeLists.txt` alone."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator, Mapping

from grader.recording.interfaces import PARTS, InterfacePackage
from grader.recording.submission import PackageFact, SubmissionRecord
from grader.submission.packages.cmake_script import commands_of

_SUFFIXES = tuple(f".{kind}" for kind in PARTS)


def interface_packages(submission: SubmissionRecord) -> Iterator[InterfacePackage]:
    """Give the packages whose `CMakeLists.txt` has interfaces generated, with the definitions that it lists.

    Where the list holds what only CMake could tell, all definitions in the package stand for it.
    """
    for package in submission.packages:
        defined = _defined(package, submission.texts)
        listed = _listed(package, submission.texts)
        unknown = any("$" in word for word in listed or ())
        if listed is None:
            continue
        files = {file: text for file, text in defined.items() if unknown or file in listed}
        if files:
            yield InterfacePackage(package.name, files)


def interface_problems(package: PackageFact, texts: Mapping[str, str]) -> list[str]:
    """Return what keeps `colcon build` from making interfaces of a package's definitions, as far as its list tells."""
    defined, listed = _defined(package, texts), _listed(package, texts)
    if not defined and not listed:
        return []
    if listed is None:
        return [
            "CMakeLists.txt does not call rosidl_generate_interfaces, so nothing is made of its definitions"
        ]
    if any("$" in word for word in listed):
        return []
    gone = [
        f"CMakeLists.txt lists {file}, which is not there" for file in listed if file not in defined
    ]
    left = [
        f"CMakeLists.txt does not list {file}, so it is not made"
        for file in defined
        if file not in listed
    ]
    return gone + left


def _defined(package: PackageFact, texts: Mapping[str, str]) -> dict[str, str]:
    above = f"{package.path}/" if package.path else ""
    inside = {
        path.removeprefix(above): text for path, text in texts.items() if path.startswith(above)
    }
    return {
        path: text
        for path, text in inside.items()
        if path.endswith(_SUFFIXES) and path.count("/") == 1
    }


def _listed(package: PackageFact, texts: Mapping[str, str]) -> list[str] | None:
    """Return the files of which interfaces are generated, with words that hold variables; None if none are."""
    script = texts.get(f"{package.path}/CMakeLists.txt" if package.path else "CMakeLists.txt", "")
    calls = [
        words
        for name, words in commands_of(script, package.name)
        if name == "rosidl_generate_interfaces"
    ]
    # The first word is the target's name; one may be a list, or a file behind the folder that it is relative to.
    words = [part for call in calls for word in call[1:] for part in re.split("[;:]", word)]
    named = [posixpath.normpath(word) for word in words if word.endswith(_SUFFIXES) or "$" in word]
    return named if calls else None

"""Interfaces that a student's packages define, by parsing their `CMakeLists.txt` alone."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator, Mapping

from grader.recording.submission import PackageFact, SubmissionRecord
from grader.submission.packages.cmake_script import commands_of
from ros_bag.interfaces import PARTS, InterfacePackage

_SUFFIXES = tuple(f".{kind}" for kind in PARTS)


def interface_packages(submission: SubmissionRecord) -> Iterator[InterfacePackage]:
    """Yield the packages with generated interfaces, with the definitions that their `CMakeLists.txt` lists.

    If only CMake can tell a listed word, all definitions of the package are taken.
    """
    for package in submission.packages:
        files = _defined(package, submission.texts)
        listed = _listed(package, submission.texts)
        if listed is None:
            continue
        if not _has_unknown(listed):
            files = {file: text for file, text in files.items() if file in listed}
        if files:
            yield InterfacePackage(package.name, files)


#: Group of the packages with messages.
_GROUP = "rosidl_interface_packages"


def interface_problems(package: PackageFact, texts: Mapping[str, str]) -> list[str]:
    """Return the reasons why `colcon build` makes no interfaces of a package's definitions, as far as its list tells."""
    defined = _defined(package, texts)
    listed = _listed(package, texts)
    if not defined and not listed:
        return []
    if listed is None:
        return [
            "CMakeLists.txt does not call rosidl_generate_interfaces, so nothing is made of its definitions"
        ]
    if _has_unknown(listed):
        return []
    problems = []
    manifest = f"{package.path}/package.xml".lstrip("/")
    if _GROUP not in texts.get(manifest, _GROUP):
        problems.append(
            f"package.xml has no <member_of_group>{_GROUP}</member_of_group>, "
            "so CMake stops at rosidl_generate_interfaces"
        )
    for file in listed:
        if file not in defined:
            problems.append(f"CMakeLists.txt lists {file}, which is not there")
    for file in defined:
        if file not in listed:
            problems.append(f"CMakeLists.txt does not list {file}, so it is not made")
    return problems


def _has_unknown(listed: list[str]) -> bool:
    """Return whether only CMake can tell a word of a list."""
    return any("$" in word for word in listed)


def _defined(package: PackageFact, texts: Mapping[str, str]) -> dict[str, str]:
    """Return the texts of a package's definitions, by their paths in it, such as `msg/State.msg`."""
    above = f"{package.path}/" if package.path else ""
    found: dict[str, str] = {}
    for path, text in texts.items():
        inside = path.removeprefix(above)
        is_definition = inside.endswith(_SUFFIXES) and inside.count("/") == 1
        if path.startswith(above) and is_definition:
            found[inside] = text
    return found


def _listed(package: PackageFact, texts: Mapping[str, str]) -> list[str] | None:
    """Return the files with generated interfaces, and words with variables; None if nothing is generated."""
    path = f"{package.path}/CMakeLists.txt" if package.path else "CMakeLists.txt"
    found: list[str] = []
    is_called = False
    for name, words in commands_of(texts.get(path, ""), package.name):
        if name != "rosidl_generate_interfaces":
            continue
        is_called = True
        # The first word is the target's name. A word can be a list, or have the folder in front of a file.
        for word in re.split("[;:]", ";".join(words[1:])):
            if word.endswith(_SUFFIXES) or "$" in word:
                found.append(posixpath.normpath(word))
    return found if is_called else None

"""Faults of a package.xml: a manifest that colcon does not read, and dependencies that it misspells or lacks."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple
from xml.etree import ElementTree

from grader.evidence.build_faults import line_with, within
from grader.evidence.known_packages import package_meant_by
from grader.recording.submission import PackageFact, SubmissionRecord
from grader.submission.packages.colcon import is_launch_file

_IMPORT = re.compile(r"^[ \t]*(?:from|import)[ \t]+([A-Za-z_]\w*)", re.MULTILINE)
_DEPENDENCY = re.compile(
    r"<(?:depend|exec_depend|build_depend|run_depend|build_export_depend|test_depend)\b[^>]{0,200}>\s*([\w.-]{1,100})\s*<"
)


class ManifestProblem(NamedTuple):
    """A mistake in a package.xml: words that end a sentence, its remedy and line."""

    words: str
    remedy: str
    line: int | None


#: Elements that a package.xml must have, by catkin_pkg, each with a pattern of its text and a correct line.
_ELEMENTS = {
    "name": (r"[a-zA-Z][\w-]*", "<name>my_package</name>"),
    "version": (r"\d+\.\d+\.\d+", "<version>0.1.0</version>"),
    "description": (r"(?s).*\S.*", "<description>Text</description>"),
    "maintainer": (r"(?s).*\S.*", '<maintainer email="ann@example.org">Ann</maintainer>'),
    "license": (r"(?s).*\S.*", "<license>Apache-2.0</license>"),
}
#: Elements below <package>, by catkin_pkg.
_OF_ALL_FORMATS = (
    *_ELEMENTS,
    *("url", "author", "export", "conflict", "replace"),
    *("build_depend", "buildtool_depend", "test_depend"),
)
_OF_FORMAT_1 = (*_OF_ALL_FORMATS, "run_depend")
_OF_LATER_FORMATS = {
    *_OF_ALL_FORMATS,
    *("depend", "exec_depend", "build_export_depend", "buildtool_export_depend", "doc_depend"),
    *("group_depend", "member_of_group"),
}
_EMAIL = re.compile(r"[\w%+-]+(\.[\w%+-]+)*@[A-Za-z0-9%-]+(\.[A-Za-z0-9%-]+)*\.[a-zA-Z]{2,}")
_LONGEST_MANIFEST = 100_000


def manifest_problem(text: str) -> ManifestProblem | None:
    """Return the first known mistake that keeps colcon from reading a package.xml; None without one."""
    text = text[:_LONGEST_MANIFEST]
    if re.search("<!(DOCTYPE|ENTITY)", text):
        return None
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as problem:
        line, _ = problem.position
        return ManifestProblem(f"it is not valid XML ({problem})", _xml_remedy(str(problem)), line)
    except ValueError:
        return None
    found = _structure_problem(root, text)
    if found is not None:
        return found
    for name in _ELEMENTS:
        found = _element_problem(root, name, text)
        if found is not None:
            return found
    return None


#: Beginnings of messages of the XML parser, and their remedies.
_XML_REMEDIES = {
    "not well-formed": "Correct package.xml; in a text, & is written &amp; and < is written &lt;.",
    "XML or text declaration": "Correct package.xml: nothing stands before `<?xml`.",
}


def _xml_remedy(problem: str) -> str:
    for beginning, remedy in _XML_REMEDIES.items():
        if problem.startswith(beginning):
            return remedy
    return "Correct package.xml."


def _structure_problem(root: ElementTree.Element, text: str) -> ManifestProblem | None:
    """Return the first element that the format of a package.xml does not have, or that it has too often."""
    number = root.get("format", "1")
    known = set(_OF_FORMAT_1) if number == "1" else _OF_LATER_FORMATS
    for element in root:
        if element.tag in known:
            continue
        line = line_with(text, f"<{element.tag}")
        if number == "1" and element.tag in _OF_LATER_FORMATS:
            words = f"its format is 1, which has no <{element.tag}>"
            first = line_with(text, "<package")
            return ManifestProblem(words, 'Write <package format="3">.', first)
        near = difflib.get_close_matches(str(element.tag), sorted(known), n=1)
        if element.tag == "run_depend":
            near = ["exec_depend"]
        remedy = f"Remove <{element.tag}>."
        if near:
            remedy = f"Write <{near[0]}> instead of <{element.tag}>."
        return ManifestProblem(f"<{element.tag}> is no element of it", remedy, line)
    if len(root.findall("export/build_type")) > 1:
        line = line_with(text, "<build_type")
        remedy = "Remove all <build_type> but one."
        return ManifestProblem("it has several <build_type>", remedy, line)
    return None


def _element_problem(root: ElementTree.Element, name: str, text: str) -> ManifestProblem | None:
    """Return the mistake of an element; None if it is correct."""
    pattern, example = _ELEMENTS[name]
    element = root.find(name)
    remedy = f"Write {example}."
    if element is None:
        return ManifestProblem(f"it has no <{name}>", remedy, None)
    value = element.text.strip() if element.text else "empty"
    line = line_with(text, f"<{name}")
    if not re.fullmatch(pattern, value):
        words = re.findall(r"[A-Za-z]\w*", value[:60])
        if name == "name" and words:
            remedy = f"Write <name>{'_'.join(words)}</name>, and this name in the other files."
        return ManifestProblem(f"its <{name}> is {value[:60]}", remedy, line)
    if name == "maintainer" and not _EMAIL.fullmatch(element.get("email", "")[:200]):
        return ManifestProblem("its <maintainer> has no valid email", remedy, line)
    return None


def misspelt_dependencies(submission: SubmissionRecord, package: PackageFact) -> dict[str, str]:
    """Return the declared packages that no ROS distribution has, each with the known package meant by it.

    Names of libraries for CMake, such as `OpenCV`, have capitals; names in a package.xml have none.
    """
    manifest = submission.texts.get(within(package, "package.xml"), "")
    ours = [each.name for each in submission.packages]
    found = {}
    for name in _DEPENDENCY.findall(manifest):
        meant = package_meant_by(name, ours)
        if meant.islower():
            found[name] = meant
    return found


def undeclared_dependencies(
    submission: SubmissionRecord, package: PackageFact, known: Iterable[str]
) -> dict[str, str]:
    """Return the packages of ROS that a package imports and does not declare, with a file of each.

    Parameters
    ----------
    known
        Names of packages of ROS.
    """
    manifest = submission.texts.get(within(package, "package.xml"), "")
    declared = {*_DEPENDENCY.findall(manifest), package.name}
    ours = {each.name for each in submission.packages}
    names = {*known, *ours} - declared
    found: dict[str, str] = {}
    for path, text in _modules(submission, package):
        for name in _IMPORT.findall(text):
            if name in names:
                found.setdefault(name, path)
    return found


def _modules(submission: SubmissionRecord, package: PackageFact) -> Iterator[tuple[str, str]]:
    """Yield the Python files of a package, without its tests, its launch files, and packages in its folder."""
    above = within(package, "")
    inner = []
    for each in submission.packages:
        if within(each, "") != above:
            inner.append(within(each, ""))
    for path, text in submission.texts.items():
        inside = path.removeprefix(above)
        is_module = path.startswith(above) and path.endswith(".py")
        if is_launch_file(path):
            continue
        if _lies_below(path, inner, above):
            continue
        if is_module and not inside.startswith(("test/", "launch/")):
            yield path, text


def _lies_below(path: str, folders: Iterable[str], above: str) -> bool:
    """Return whether a path is in one of the folders inside another folder."""
    for folder in folders:
        if folder.startswith(above):
            if path.startswith(folder):
                return True
    return False

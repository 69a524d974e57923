"""One source of the version, also for the newest release in the changelog."""

from __future__ import annotations

import re
import tomllib
from datetime import date
from itertools import pairwise

from grader import __version__
from tests.packages import ROOT

CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
#: Headings within a release, in the order of this file (keepachangelog.com, 1.1.0).
SECTIONS = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"]
#: Lines of a page.
PAGE = 120


def releases() -> dict[str, str]:
    """Return the text of each release by its heading, newest first."""
    parts = re.split(r"^## (.+)\n", CHANGELOG, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def test_one_source_of_the_version() -> None:
    """The package takes its version from `grader/__init__.py`, and no page names an image of another version."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["dynamic"] == ["version"]
    assert project["tool"]["hatch"]["version"] == {"path": "grader/__init__.py"}
    named = set()
    for page in (ROOT / "docs").glob("*.md"):
        named |= set(re.findall(r"/grade:([\w.]+)", page.read_text(encoding="utf-8")))
    assert named == {__version__}


def test_the_first_heading_is_unreleased() -> None:
    """Later changes have a place, and each release has a version and a day, newest first."""
    first, *others = releases()
    assert first == "[Unreleased]"
    matches = [
        re.fullmatch(r"\[(\d+)\.(\d+)\.(\d+)\] - (\d{4}-\d\d-\d\d)", each) for each in others
    ]
    numbers = []
    days = []
    for match in matches:
        assert match
        numbers.append(tuple(map(int, match.groups()[:3])))
        days.append(date.fromisoformat(match[4]))
    assert numbers == sorted(numbers, reverse=True)
    assert days == sorted(days, reverse=True)


def test_the_newest_release_is_this_version() -> None:
    """`grade --version` prints the version of the newest release in the changelog."""
    _, newest, *_ = releases()
    assert newest.startswith(f"[{__version__}] - ")


def test_each_release_is_a_page_with_the_known_sections() -> None:
    """Sections come in their order, have entries, and a release has at most a page of lines."""
    for text in releases().values():
        assert len(text.splitlines()) <= PAGE
        sections = re.findall(r"^### (.+)\n\n- ", text, flags=re.MULTILINE)
        assert sections == re.findall(r"^### (.+)$", text, flags=re.MULTILINE)
        places = [SECTIONS.index(section) for section in sections]
        assert all(earlier < later for earlier, later in pairwise(places))

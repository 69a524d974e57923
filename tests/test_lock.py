"""Locked packages: complete, as pinned, and with hashes; read without a package index."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from importlib import metadata

import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.packages import ROOT

LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
_ENTRY = re.compile(
    r"^([a-z0-9.-]+)==(\S+)(?: ; ([^\\]+?))? \\\n((?: +--hash=\S+(?: \\)?\n?)+)", re.M
)


def holds(marker: str, environment: dict[str, str] | None = None) -> bool:
    """Tell whether a marker holds, here or in another environment; an empty one does."""
    if not marker:
        return True
    return Marker(marker).evaluate(environment)


def locked() -> dict[str, tuple[str, str]]:
    """Return version and marker of each locked package that this Python and platform need."""
    entries = {}
    for name, version, marker, _ in _ENTRY.findall(LOCK):
        if holds(marker):
            entries[name] = (version, marker)
    return entries


def pinned() -> dict[str, str]:
    """Return the version of each package in constraints.txt for this Python."""
    versions: dict[str, str] = {}
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            continue
        requirement = Requirement(line)
        if applies(requirement, set()):
            versions[canonicalize_name(requirement.name)] = str(requirement.specifier)[2:]
    return versions


def applies(requirement: Requirement, extras: set[str]) -> bool:
    """Tell whether a requirement counts here, with one of the extras or without any."""
    marker = str(requirement.marker) if requirement.marker else ""
    return any(holds(marker, {"extra": each}) for each in {"", *extras})


def needed() -> set[str]:
    """Return the names of the package's dependencies with the extra `all`, and of theirs, as installed here."""
    names: set[str] = set()
    seen = set()
    open_ends = list(own_requirements())
    while open_ends:
        requirement = open_ends.pop()
        name = canonicalize_name(requirement.name)
        key = (name, *sorted(requirement.extras))
        if key in seen:
            continue
        seen.add(key)
        names.add(name)
        for line in metadata.metadata(name).get_all("Requires-Dist", []):
            further = Requirement(line)
            if applies(further, requirement.extras):
                open_ends.append(further)
    return names


def own_requirements() -> Iterator[Requirement]:
    """Yield the requirements of pyproject.toml that the extra `all` includes, for this Python."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    (every,) = extras["all"]
    lines = list(project["dependencies"])
    for extra in Requirement(every).extras:
        lines += extras[extra]
    for line in lines:
        requirement = Requirement(line)
        if applies(requirement, set()):
            yield requirement


def test_each_entry_has_hashes() -> None:
    """Every line belongs to an entry, and every hash is a SHA-256."""
    (comment,) = _ENTRY.sub("", LOCK).splitlines()
    assert comment.startswith("# ")
    hashes = re.findall(r"--hash=(\S+)", LOCK)
    assert len(hashes) > len(locked())
    assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", each) for each in hashes)


def test_locked_versions_are_the_pinned_ones() -> None:
    """A version changed in constraints.txt alone is found: renew the lock by tools/write-lock."""
    pins = pinned()
    for name, (version, _) in locked().items():
        assert pins.get(name) == version


def test_the_lock_is_complete_and_has_nothing_else() -> None:
    """A dependency added to or removed from pyproject.toml is found: renew the lock by tools/write-lock."""
    assert set(locked()) == needed()


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_one_lock_for_each_python(python: str) -> None:
    """Each package has exactly one version for each Python that the package runs on."""
    names = []
    environment = {"python_version": python, "python_full_version": f"{python}.9"}
    for name, _, marker, _ in _ENTRY.findall(LOCK):
        if holds(marker, environment):
            names.append(name)
    assert len(names) == len(set(names))
    assert len(names) > 100


def test_image_and_release_use_the_lock() -> None:
    """Image and release workflow install by hash."""
    for file in ("Dockerfile", ".github/workflows/release.yml"):
        assert "--require-hashes" in (ROOT / file).read_text(encoding="utf-8")

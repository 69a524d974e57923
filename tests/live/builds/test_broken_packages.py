"""Packages with one defect each, built by colcon as their kept builds tell."""

from __future__ import annotations

from pathlib import Path

import pytest

from confine.isolation import Isolation
from tests.broken_packages.cases import Case, cases, kept_builds, write_exactly
from tests.live.builds.test_build import built, cache, isolation
from tests.thorough import part

pytestmark = pytest.mark.live
#: Fixtures of the other module.
__all__ = ["cache", "isolation"]

#: One of this many cases is built for each commit, so that all of them take some 15 s of CPU.
_ONE_OF = 14


@pytest.mark.parametrize("case", part(cases(), _ONE_OF), ids=lambda case: case.kind)
def test_colcon_says_what_was_kept(case: Case, tmp_path: Path, isolation: Isolation) -> None:
    """Outcome, words and installed files of a build are those by which the report is tested."""
    write_exactly(tmp_path / "ws", case.files())
    found = built(tmp_path / "ws", isolation)
    kept = kept_builds()[case.kind]
    assert [each.outcome for each in found] == [each.outcome for each in kept]
    for build, other in zip(found, kept, strict=True):
        assert _programs(build.installed) == _programs(other.installed)
    first = found[0]
    if first.outcome == "failed":
        assert case.says in first.output


def _programs(installed: list[str]) -> list[str]:
    """Return the installed files that do not depend on the version of Python."""
    return [path for path in installed if not path.startswith("lib/python")]

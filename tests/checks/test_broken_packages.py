"""Words of the report about packages with one defect each, by their kept builds."""

from __future__ import annotations

from pathlib import Path

import pytest

from grader.evidence.compiled import why_not_built
from grader.result import Outcome
from tests.broken_packages.cases import Case, cases, kept_builds, write_exactly
from tests.live.builds.reading import read
from tests.synthetic import judged


@pytest.mark.parametrize("case", cases(), ids=lambda case: case.kind)
def test_a_broken_package_is_explained(case: Case, tmp_path: Path) -> None:
    """The reason has the defect, its file and line, and the remedy names the change; a correct package passes."""
    write_exactly(tmp_path, case.files())
    record = read(tmp_path)
    record.builds = kept_builds()[case.kind]
    for build in record.builds:
        assert not why_not_built(build)
        if build.outcome == "failed":
            assert case.says in build.output
    wanted = {"executables": ["talker"], "files": ["launch/*.py"]}
    finding = judged("package_builds", wanted, None, record)
    if not case.report:
        assert finding.outcome is Outcome.PASSED, finding.reason
        return
    expected = case.expected()
    assert expected.words in finding.reason
    assert expected.remedy in finding.hint
    places = [(place.file, place.line) for place in finding.where]
    assert (f"src/lab/{expected.file}", expected.line) in places, places

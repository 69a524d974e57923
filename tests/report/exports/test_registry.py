"""All exports: each is complete, the same each time, and bounded whatever a student wrote."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings

from grader.errors import GraderError
from grader.report.exports import EXPORTS
from grader.result_folder import REPORT_FILE, RESULT_FILE
from tests.report.exports.sample_results import (
    VARIABLES,
    adjusted_and_tampered,
    every_outcome,
    exported,
    hostile_results,
    megabyte_result,
    of_recording,
)
from tests.thorough import examples

NAMES = sorted(EXPORTS)


def test_no_export_takes_the_place_of_a_result() -> None:
    """Each has a file of its own in the results folder."""
    files = [export.file_name for export in EXPORTS.values()]
    assert len({*files, RESULT_FILE, REPORT_FILE}) == len(files) + 2
    for name, export in EXPORTS.items():
        assert export.name == name
        assert export.description


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("recording", ["solution", "wrong_topic", "missing_service_file"])
def test_equal_results_give_equal_bytes(name: str, recording: str) -> None:
    """Results of real recordings are exported, twice the same."""
    first = exported(name, of_recording(recording), environment=VARIABLES)
    assert first == exported(name, of_recording(recording), environment=VARIABLES)


@pytest.mark.parametrize("name", NAMES)
@settings(suppress_health_check=[HealthCheck.too_slow], max_examples=examples(40))
@given(plain=hostile_results())
def test_every_export_can_be_encoded(name: str, plain: dict[str, object]) -> None:
    """No lone surrogate, no control character but line ends is left in any of them."""
    text = exported(name, plain, environment=VARIABLES)
    text.encode("utf-8")
    assert not {c for c in text if ord(c) < 32 or 127 <= ord(c) < 160} - {"\n"}


@pytest.mark.parametrize("name", NAMES)
def test_megabytes_are_cut(name: str) -> None:
    """The size of an export does not depend on how much a student wrote."""
    assert len(exported(name, megabyte_result(), environment=VARIABLES).encode()) < 1024 * 1024


@pytest.mark.parametrize("name", NAMES)
def test_the_path_prefix_leads_to_the_file(name: str) -> None:
    """Forms that point at files name them from the repository's root, the others are the same with a prefix."""
    plain, at = every_outcome(), "labs/nine"
    with_prefix = exported(name, plain, path_prefix=at, environment=VARIABLES)
    points = name in ("github-annotations", "gitlab-codequality")
    assert (f"{at}/a.partial.py" in with_prefix) == points
    assert points or with_prefix == exported(name, plain, environment=VARIABLES)


def test_a_missing_variable_is_named() -> None:
    """The form that needs variables says which are not set; the others need none."""
    with pytest.raises(GraderError, match="SUBMISSION_TAG, COMMIT_URL"):
        exported(
            "classroom50",
            every_outcome(),
            environment={**VARIABLES, "SUBMISSION_TAG": "", "COMMIT_URL": ""},
        )
    for name in set(EXPORTS) - {"classroom50"}:
        assert exported(name, adjusted_and_tampered())

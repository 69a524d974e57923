"""Fixtures shared by the live tests."""

from __future__ import annotations

import pytest

from tests.live.sample import Graded, graded_once


@pytest.fixture(scope="session")
def alice(tmp_path_factory: pytest.TempPathFactory) -> Graded:
    """Give the results of the sample submission."""
    return graded_once(tmp_path_factory.getbasetemp())

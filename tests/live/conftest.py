"""Fixtures shared by the live tests, and the end of the servers of each module."""

from __future__ import annotations

import pytest

from tests.live.sample import Graded, graded_once
from tests.live.shared_server import end_servers


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """End the servers with the last test of a module."""
    if nextitem is None or nextitem.path != item.path:
        end_servers()


@pytest.fixture(scope="session")
def alice(tmp_path_factory: pytest.TempPathFactory) -> Graded:
    """Give the results of the sample submission."""
    return graded_once(tmp_path_factory.getbasetemp())

"""Settings for all tests."""

from __future__ import annotations

import codecs
import os
from collections.abc import Generator, Iterator

import pytest
from hypothesis import HealthCheck, settings

from tests.machine import beside_others

# How long an example takes says more about the machine than about the code.
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol() -> Generator[None, object, object]:
    """Let each test wait while another has the machine alone."""
    with beside_others():
        return (yield)


@pytest.fixture(autouse=True, scope="session")
def _own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep what the tests trust apart from what the user does, also in the processes that they start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture
def plain_user() -> Iterator[None]:
    """Let the superuser be somebody who may not read everything, for a while."""
    if os.geteuid() == 0:
        codecs.lookup("utf-8-sig")  # Python's own library may be where nobody else can read it.
        os.seteuid(65534)
        yield
        os.seteuid(0)
    else:
        yield

"""Settings for all tests."""

from __future__ import annotations

import codecs
import os
import signal
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests.in_turn import InTurn, Kind, kind_of, step_behind
from tests.machine import beside_others
from tests.thorough import examples

# The time of an example depends more on the machine than on the code.
settings.register_profile(
    "any machine",
    deadline=None,
    max_examples=examples(),
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("any machine")


def pytest_configure() -> None:
    """React to Ctrl-C even if a shell's `&` started the tests; their child processes would inherit that it is ignored."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> InTurn:
    """Let workers take tests in the order of `tests/in_turn.py`."""
    config.option.loadscopereorder = False
    return InTurn(config, log)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put live tests behind those that only compute, where one process runs all."""
    items.sort(key=lambda item: kind_of(item.nodeid) < Kind.CLOCK)
    step_behind(config, items)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol() -> Generator[None, object, object]:
    """Let each test wait while another has the machine alone."""
    with beside_others():
        return (yield)


@pytest.fixture(autouse=True, scope="session")
def _own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep the tests' trusted files apart from the user's, also in processes that tests start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="session")
def judged_before() -> None:
    """Judge in this process: those that branch off it to judge need not compile templates and patterns again."""
    from grader.judging.judgement import judge_recordings
    from grader.judging.rubrics import read_rubric
    from grader.lab.overrides import Overrides

    judge_recordings(
        Path(__file__).parent / "recordings/missing_service_file", read_rubric(None), Overrides()
    )


@pytest.fixture
def plain_user() -> Iterator[None]:
    """Replace the superuser by a user that may not read everything, for a while."""
    if os.geteuid() == 0:
        codecs.lookup("utf-8-sig")  # Python's own library may be where nobody else can read it.
        os.seteuid(65534)
        yield
        os.seteuid(0)
    else:
        yield
